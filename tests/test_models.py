"""What holds for the shapes and figures of every robot in models."""

import itertools
import logging

import numpy as np
import pytest
from pydrake.geometry import Role, Sphere
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.core.walking import Side
from nadia_balance.robot import load_robot, robot_names
from tests.model_world import Urdf, World

ROBOTS = {name: load_robot(name) for name in robot_names()}
URDFS = {name: Urdf(robot) for name, robot in ROBOTS.items()}
LINKS = [(name, link) for name, urdf in URDFS.items() for link in urdf.links]
# Thigh, shin and ankle, which stands for the foot: left, right.
LEGS = {
    "atlas": (("l_uleg", "l_lleg", "l_talus"), ("r_uleg", "r_lleg", "r_talus")),
    "nadia": (
        ("LEFT_THIGH_LINK", "LEFT_SHIN_LINK", "LEFT_ANKLE_LINK"),
        ("RIGHT_THIGH_LINK", "RIGHT_SHIN_LINK", "RIGHT_ANKLE_LINK"),
    ),
}
HIPS = {
    "atlas": ("l_leg_hpx", "r_leg_hpx"),
    "nadia": ("LEFT_HIP_X", "RIGHT_HIP_X"),
}
THIGH, SHIN, ANKLE = range(3)

every_robot = pytest.mark.parametrize("name", ROBOTS)


def warnings_of_parsing(urdf: str, caplog) -> list[str]:
    """What Drake warns of when it parses a URDF, not being strict."""
    caplog.clear()
    with caplog.at_level(logging.WARNING, logger="drake"):
        plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
        Parser(plant).AddModelsFromString(urdf, "urdf")
        plant.Finalize()
    return [record.getMessage() for record in caplog.records]


@every_robot
def test_drake_parses_without_a_warning(name, caplog):
    """Oracle: the same with an inertia that no body has: Drake warns."""
    urdf = ROBOTS[name].urdf.read_text()
    before, ixx, after = urdf.partition('ixx="')
    assert not warnings_of_parsing(urdf, caplog)
    assert warnings_of_parsing(f"{before}{ixx}-{after}", caplog)


@every_robot
def test_the_ground_adds_neither_body_nor_mass(name):
    """Oracle: the links of the URDF, and the mass of the robot alone."""
    world = World(ROBOTS[name])
    assert world.plant.num_bodies() == 1 + len(URDFS[name].links)
    mass = world.plant.CalcTotalMass(world.context)
    assert mass == pytest.approx(ROBOTS[name].mass, rel=1e-15)


@pytest.mark.parametrize("name, link", LINKS)
def test_every_inertia_is_possible(name, link):
    """Oracle: principal moments are positive and make a triangle."""
    mass, _, inertia = URDFS[name].inertial(link)
    small, middle, large = np.linalg.eigvalsh(inertia)
    assert mass > 0.0
    assert small > 0.0
    assert small + middle > large


@every_robot
def test_every_joint_that_moves_has_an_actuator_and_armature(name):
    """Oracle: 0.1 kg m^2 reflected."""
    plant = ROBOTS[name].control_plant()
    actuators = [
        plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()
    ]
    driven = sorted(actuator.joint().name() for actuator in actuators)
    assert driven == sorted(URDFS[name].joints)
    armature = [actuator.default_reflected_inertia() for actuator in actuators]
    assert armature == pytest.approx([0.1] * len(actuators), rel=1e-12)


@every_robot
@pytest.mark.parametrize("side", Side)
def test_the_contact_spheres_end_at_the_corners_of_the_sole(name, side):
    """Oracle: the rectangle in robot.yaml."""
    robot, world = ROBOTS[name], World(ROBOTS[name])
    foot = world.plant.GetBodyByName(robot.foot_bodies[side])
    lowest = []
    for shape in world.plant.GetCollisionGeometriesForBody(foot):
        sphere = world.inspector.GetShape(shape)
        assert isinstance(sphere, Sphere)
        centre = world.inspector.GetPoseInFrame(shape).translation()
        lowest.append(centre - [0.0, 0.0, sphere.radius()])
    X_FS = robot.X_FootSole[side]
    corners = [X_FS @ [*corner, 0.0] for corner in robot.sole]
    # Sums of decimals, exact but for their last digits.
    assert sorted(np.round(lowest, 12).tolist()) == sorted(
        np.round(corners, 12).tolist()
    )


@pytest.mark.parametrize("name, link", LINKS)
def test_every_link_can_be_seen(name, link):
    """Oracle: it has a shape to be drawn."""
    world = World(ROBOTS[name])
    frame = world.plant.GetBodyFrameIdOrThrow(
        world.plant.GetBodyByName(link).index()
    )
    assert world.inspector.NumGeometriesForFrameWithRole(
        frame, Role.kIllustration
    )


@every_robot
def test_the_shapes_are_few(name):
    """Oracle: 60, so that a replay stays small."""
    assert len(list(URDFS[name].root.iter("visual"))) <= 60


@every_robot
@pytest.mark.parametrize("step_width", [0.125, 0.25, 0.8])
def test_only_the_corners_of_the_soles_touch_when_standing(name, step_width):
    """Oracle: four spheres a sole, 1 mm into the ground, and nothing else."""
    robot = ROBOTS[name]
    q = robot.standing_positions(step_width)
    q[6] -= 0.001
    world = World(robot, q)
    feet = [body for pair in world.touching() for body in pair]
    assert sorted(feet) == sorted(
        [*robot.foot_bodies.values(), "world"] * 4 + ["world"] * 4
    )
    assert world.improper_contacts() == set()


@every_robot
@pytest.mark.parametrize(
    "hips, left, right",
    [
        ((), ANKLE, ANKLE),  # as they stand: insteps of 0.11 m, 0.1 m apart
        ((-0.3, 0.0), SHIN, SHIN),
        ((-0.3, 0.0), SHIN, ANKLE),
        ((-0.5, 0.0), SHIN, THIGH),
        ((-0.4, 0.4), THIGH, THIGH),
    ],
)
def test_legs_that_pass_through_each_other_are_noticed(name, hips, left, right):
    """Oracle: the two links; the hips are adducted until the legs cross."""
    world = World(ROBOTS[name], ROBOTS[name].standing_positions(0.1), 0.5)
    for joint, angle in zip(HIPS[name], hips, strict=False):
        world.set_angle(joint, angle)
    lefts, rights = LEGS[name]
    assert f"{lefts[left]} - {rights[right]}" in world.improper_contacts()


@pytest.mark.parametrize(
    "name, axis, angle, body",
    [
        ("nadia", 1, 1.5, "LEFT_ELBOW_PITCH_LINK"),  # forward
        ("nadia", 1, -1.5, "TORSO_LINK"),  # backward
        ("nadia", 0, 1.5, "PELVIS_LINK"),  # on the right side
        ("atlas", 1, 1.5, "l_ufarm"),
        ("atlas", 1, -1.5, "utorso"),
        ("atlas", 0, 1.5, "r_ufarm"),
    ],
)
def test_a_robot_that_lies_touches_with_more_than_its_feet(
    name, axis, angle, body
):
    """Oracle: what is lowest when the pelvis is 0.1 m high."""
    q = ROBOTS[name].standing_positions()
    q[:7] = 0.0
    q[0], q[1 + axis], q[6] = np.cos(angle / 2), np.sin(angle / 2), 0.1
    contacts = World(ROBOTS[name], q).improper_contacts()
    assert f"{body} - ground" in contacts


@every_robot
def test_a_leg_can_touch_the_other_leg_and_all_the_ground(name):
    """Oracle: the product of the links that have shapes for it."""
    among_links, with_ground = [], set()
    for pair in World(ROBOTS[name]).candidates():
        if "world" in pair:
            with_ground |= set(pair)
        else:
            among_links.append(sorted(pair))
    pairs = map(sorted, itertools.product(*LEGS[name]))
    assert sorted(among_links) == sorted(pairs)
    links = URDFS[name].root.iter("link")
    shaped = {link.get("name") for link in links if link.find("collision")}
    assert with_ground == {"world"} | shaped
