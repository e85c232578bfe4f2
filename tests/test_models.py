"""The shapes and figures of the robots in models."""

import itertools
from xml.etree import ElementTree

import numpy as np
import pytest
from pydrake.geometry import Sphere
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.robot import plants
from nadia_balance.robot.model import RobotModel, load_robot, robot_names


class World:
    """A robot on the flat ground, at the positions q."""

    def __init__(self, robot: RobotModel, q=None):
        builder = DiagramBuilder()
        self.plant, scene_graph = robot.add_plant_to(builder)
        self.inspector = scene_graph.model_inspector()
        self._robot = robot
        self._simulator = Simulator(builder.Build())
        root = self._simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(root)
        if q is not None:
            self.plant.SetPositions(self.context, q)

    def touching(self) -> list[tuple[str, str]]:
        """The names of the bodies of every pair of shapes that overlap."""
        port = self.plant.get_geometry_query_input_port()
        pairs = port.Eval(self.context).ComputePointPairPenetration()
        return [(self.body(p.id_A), self.body(p.id_B)) for p in pairs]

    def improper_contacts(self) -> set[str]:
        """What the robot says of the contacts of the next millisecond."""
        self._simulator.AdvanceTo(0.001)
        port = self.plant.get_contact_results_output_port()
        results = port.Eval(self.context)
        return self._robot.improper_contacts(self.plant, results)

    def body(self, geometry_id) -> str:
        frame = self.inspector.GetFrameId(geometry_id)
        return self.plant.GetBodyFromFrameId(frame).name()


ROBOTS = {name: load_robot(name, "realistic") for name in robot_names()}
URDFS = {n: ElementTree.parse(r.urdf).getroot() for n, r in ROBOTS.items()}


def both(sides: str, links: str) -> list[list[str]]:
    """The names of these links, for each of the sides in place of %."""
    return [links.replace("%", side).split() for side in sides.split()]


# Thigh, shin and foot: left, right.
LEGS = {
    "atlas": both("l r", "%_uleg %_lleg %_foot"),
    "g1": both("left right", "%_hip_yaw_link %_knee_link %_ankle_roll_link"),
    "nadia": both("LEFT RIGHT", "%_THIGH_LINK %_SHIN_LINK %_FOOT_LINK"),
}
# Chains of links with shapes, other than legs, whose neighbours cannot touch.
ARM = "torso_link %_shoulder_yaw_link %_elbow_link %_wrist_pitch_link "
ARMS = both("left right", f"{ARM}%_rubber_hand")
CHAINS = {"g1": [["pelvis", "torso_link", "head_link"], *ARMS]}
# Step widths that the legs reach [m], and one at which the shoes touch.
WIDTHS = dict.fromkeys(("atlas", "nadia"), (0.17, 0.25, 0.8))
WIDTHS["g1"] = (0.1, 0.237, 0.49)
FOOT = 2  # of a leg's links


# In public descriptions: the mass of all [kg]; effort limits of legs and arms,
# of which there are two, and of the waist [N m]; speed limit [rad/s] and rotor
# inertia [kg m^2] of the G1's motors, by their torque.  The sister machines of
# the others reach 8 to 12 rad/s.
MASSES = {"atlas": 174.0503, "g1": 33.3411, "nadia": 90.8976}
EFFORTS = {
    "atlas": 2 * [275, 530, 840, 890, 740, 360, 87, 99, 63, 112]
    + [106, 445, 300],
    "g1": 2 * [88, 139, 88, 139, 35, 35, 25, 25, 25, 25, 25, 5, 5]
    + [88, 35, 35],
    "nadia": 2 * [1000, 1000, 1000, 350, 1000, 1000]
    + 3 * [1000]
    + [52, 57, 24, 24, 41, 41, 23, 23],
}
MOTORS = {
    **{88.0: (32.0, 0.01017752004), 139.0: (20.0, 0.025101925)},
    **{35.0: (30.0, 0.00721945), 25.0: (37.0, 0.003609725)},
    **{5.0: (22.0, 0.00425), 0.0: (12.0, 0.1)},
}

every_robot = pytest.mark.parametrize("name", ROBOTS)


@every_robot
def test_masses_and_drives_are_those_of_the_robot(name):
    """Oracle: the public description, and the drives of Nadia's arms.

    Armatures of Atlas and Nadia are 0.1 kg m^2, and their wrists and necks do
    not move; those of the G1 are of its public MJCF.
    """
    assert ROBOTS[name].mass == pytest.approx(MASSES[name], abs=1e-3)
    plant = load_robot(name, "ideal").control_plant()  # no drives' limits
    drives = plants.actuators(plant)
    driven = sorted(actuator.joint().name() for actuator in drives)
    joints = URDFS[name].findall("joint")
    moving = [j.get("name") for j in joints if j.get("type") != "fixed"]
    assert driven == sorted(moving)
    efforts = [actuator.effort_limit() for actuator in drives]
    assert sorted(efforts) == sorted(EFFORTS[name])
    for actuator, effort in zip(drives, efforts, strict=True):
        speed, armature = MOTORS[effort if name == "g1" else 0.0]
        assert actuator.joint().velocity_upper_limits() == [speed]
        inertia = actuator.default_reflected_inertia()
        assert inertia == pytest.approx(armature, rel=1e-12)


@every_robot
def test_the_contact_spheres_end_at_the_corners_of_the_sole(name):
    """Oracle: the rectangle in robot.yaml."""
    robot, world = ROBOTS[name], World(ROBOTS[name])
    for side, X_FS in robot.X_FootSole.items():
        foot = world.plant.GetBodyByName(robot.foot_bodies[side])
        lowest = []
        for shape in world.plant.GetCollisionGeometriesForBody(foot):
            sphere = world.inspector.GetShape(shape)
            if not isinstance(sphere, Sphere):
                continue  # of the shoe
            centre = world.inspector.GetPoseInFrame(shape).translation()
            lowest.append(centre - [0.0, 0.0, sphere.radius()])
        corners = [X_FS @ [*corner, 0.0] for corner in robot.sole]
        # Sums of decimals, exact but for their last digits.
        ends = (sorted(np.round(p, 12).tolist()) for p in (lowest, corners))
        assert next(ends) == next(ends)


@every_robot
def test_only_the_corners_of_the_soles_touch_when_standing(name):
    """Oracle: four spheres a sole, 1 mm into the ground, and nothing else."""
    robot = ROBOTS[name]
    for step_width in WIDTHS[name]:
        q = robot.standing_positions(step_width)
        q[6] -= 0.001
        world = World(robot, q)
        feet = [body for pair in world.touching() for body in pair]
        expected = [*robot.foot_bodies.values(), "world", "world"] * 4
        assert sorted(feet) == sorted(expected)
        assert world.improper_contacts() == set()


def candidates(world):
    """The pairs of links that may touch each other, and those the ground."""
    among_links, with_ground = set(), set()
    for shapes in world.inspector.GetCollisionCandidates():
        pair = frozenset(map(world.body, shapes))
        if "world" in pair:
            with_ground |= pair
        else:
            among_links.add(pair)
    return among_links, with_ground


@every_robot
def test_all_links_but_neighbours_can_touch(name):
    """Oracle: all pairs of links that have shapes, less a list by hand."""
    pelvis = ROBOTS[name].pelvis_body
    links = URDFS[name].iter("link")
    shaped = {
        link.get("name") for link in links if link.find("collision") is not None
    }
    pairs = set(map(frozenset, itertools.combinations(shaped, 2)))
    legs = [(pelvis, *leg) for leg in LEGS[name]]
    for chain in (*legs, *CHAINS.get(name, [])):
        pairs -= set(map(frozenset, itertools.pairwise(chain)))
    assert candidates(World(ROBOTS[name])) == (pairs, {"world"} | shaped)


@every_robot
def test_in_ideal_only_one_leg_touches_the_other(name):
    """Oracle: the product of the legs' links, but for the feet."""
    among_links, _ = candidates(World(load_robot(name, "ideal")))
    pairs = set(map(frozenset, itertools.product(*LEGS[name])))
    assert among_links == pairs - {frozenset(leg[FOOT] for leg in LEGS[name])}
