"""The figures and the shapes of models/nadia/nadia.urdf."""

import itertools
import logging
from xml.etree import ElementTree

import numpy as np
import pytest
from pydrake.geometry import Role, Sphere
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.core.walking import Side
from nadia_balance.robot import load_robot, terrain_file

ROBOT = load_robot("nadia")
URDF = ElementTree.parse(ROBOT.urdf).getroot()
LINKS = [link.get("name") for link in URDF.iter("link")]
JOINTS = [joint.get("name") for joint in URDF.findall("joint")]
MIRROR = np.diag([1.0, -1.0, 1.0])  # y -> -y


class World:
    """Nadia on the flat ground, at the positions q, lifted by a height."""

    def __init__(self, q=None, height=0.0):
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
        ROBOT.add_to(self.plant)
        Parser(self.plant).AddModels(str(terrain_file()))
        self.plant.Finalize()
        self.inspector = scene_graph.model_inspector()
        self._simulator = Simulator(builder.Build())
        self.context = self.plant.GetMyMutableContextFromRoot(
            self._simulator.get_mutable_context()
        )
        if q is not None:
            self.plant.SetPositions(
                self.context, [*q[:6], q[6] + height, *q[7:]]
            )

    def set_angle(self, joint: str, angle: float) -> None:
        self.plant.GetJointByName(joint).set_angle(self.context, angle)

    def touching(self) -> list[tuple[str, str]]:
        """The names of the bodies of every pair of shapes that overlap."""
        port = self.plant.get_geometry_query_input_port()
        pairs = port.Eval(self.context).ComputePointPairPenetration()
        return [(self._body(p.id_A), self._body(p.id_B)) for p in pairs]

    def improper_contacts(self) -> set[str]:
        """What the robot says of the contacts of the next millisecond."""
        self._simulator.AdvanceTo(0.001)
        results = self.plant.get_contact_results_output_port().Eval(
            self.context
        )
        return ROBOT.improper_contacts(self.plant, results)

    def candidates(self) -> list[tuple[str, str]]:
        """The names of the bodies of every pair of shapes that may touch."""
        pairs = self.inspector.GetCollisionCandidates()
        return [(self._body(a), self._body(b)) for a, b in pairs]

    def _body(self, geometry_id) -> str:
        frame = self.inspector.GetFrameId(geometry_id)
        return self.plant.GetBodyFromFrameId(frame).name()


def inertial(link: str) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, CoM (3,) and inertia (3, 3) of a link, as written in the URDF."""
    found = URDF.find(f"link[@name='{link}']/inertial")
    i = {k: float(v) for k, v in found.find("inertia").attrib.items()}
    inertia = [
        [i["ixx"], i["ixy"], i["ixz"]],
        [i["ixy"], i["iyy"], i["iyz"]],
        [i["ixz"], i["iyz"], i["izz"]],
    ]
    com = np.array(found.find("origin").get("xyz").split(), dtype=float)
    return float(found.find("mass").get("value")), com, np.array(inertia)


def warnings_of_parsing(urdf: str, caplog) -> list[str]:
    """What Drake warns of when it parses a URDF, not being strict."""
    caplog.clear()
    with caplog.at_level(logging.WARNING, logger="drake"):
        plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
        Parser(plant).AddModelsFromString(urdf, "urdf")
        plant.Finalize()
    return [record.getMessage() for record in caplog.records]


def test_drake_parses_without_a_warning(caplog):
    """Oracle: the same with the published signs, of which Drake warns."""
    urdf = ROBOT.urdf.read_text()
    right = urdf.index('<link name="RIGHT_SHOULDER_ROLL_LINK">')
    as_published = urdf[:right] + urdf[right:].replace(
        'ixx="0.00787035"', 'ixx="-0.00787035"', 1
    )
    assert not warnings_of_parsing(urdf, caplog)
    assert warnings_of_parsing(as_published, caplog)


def test_the_mass_is_that_of_the_robot():
    """Oracle: total and largest masses of the public description [kg]."""
    assert ROBOT.mass == pytest.approx(90.8976, abs=1e-3)
    for link, mass in {
        "PELVIS_LINK": 19.0917,
        "TORSO_LINK": 13.5,
        "LEFT_THIGH_LINK": 10.953,
        "RIGHT_SHIN_LINK": 5.42,
        "LEFT_FOOT_LINK": 1.75,
        "RIGHT_SHOULDER_PITCH_LINK": 2.917,
    }.items():
        assert inertial(link)[0] == mass


def test_the_ground_adds_neither_body_nor_mass():
    world = World()
    assert world.plant.num_bodies() == 1 + len(LINKS)
    assert world.plant.CalcTotalMass(world.context) == ROBOT.mass


@pytest.mark.parametrize("link", LINKS)
def test_every_inertia_is_possible(link):
    """Oracle: principal moments are positive and make a triangle."""
    mass, _, inertia = inertial(link)
    small, middle, large = np.linalg.eigvalsh(inertia)
    assert mass > 0.0
    assert small > 0.0
    assert small + middle > large


@pytest.mark.parametrize(
    "link", ["HIP_YAW", "HIP_ROLL", "THIGH", "ANKLE", "SHOULDER_ROLL"]
)
def test_left_and_right_mirror_each_other_where_published_so(link):
    """Oracle: reflection in the x-z plane."""
    mass, com, inertia = inertial(f"LEFT_{link}_LINK")
    other_mass, other_com, other_inertia = inertial(f"RIGHT_{link}_LINK")
    assert other_mass == mass
    assert (other_inertia == MIRROR @ inertia @ MIRROR).all()
    if link == "SHOULDER_ROLL":  # published with the wrong sign of x, too
        com = com * [-1.0, 1.0, 1.0]
    assert (other_com == MIRROR @ com).all()


def test_every_joint_has_an_actuator_with_its_limit_and_armature():
    """Oracle: the efforts of the issue [N m]; 0.1 kg m^2 reflected."""
    effort = dict.fromkeys(JOINTS, 1000.0)
    effort |= {"LEFT_KNEE_Y": 350.0, "RIGHT_KNEE_Y": 350.0}
    arm = ("SHOULDER_Y", "SHOULDER_X", "SHOULDER_Z", "ELBOW_Y")
    for name, left, right in zip(
        arm, (52.0, 57.0, 24.0, 24.0), (41.0, 41.0, 23.0, 23.0), strict=True
    ):
        effort |= {f"LEFT_{name}": left, f"RIGHT_{name}": right}
    plant = ROBOT.control_plant()
    actuators = [
        plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()
    ]
    assert len(actuators) == 23
    assert {a.joint().name(): a.effort_limit() for a in actuators} == effort
    for actuator in actuators:
        assert actuator.joint().velocity_upper_limits() == [100.0]
    armature = [actuator.default_reflected_inertia() for actuator in actuators]
    assert armature == pytest.approx([0.1] * 23, rel=1e-12)


def test_the_mass_matrix_is_well_conditioned():
    """Oracle: 924 in the notes at the zero pose, 22 071 without armature."""
    plant = ROBOT.control_plant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, ROBOT.standing_positions())
    assert np.linalg.cond(plant.CalcMassMatrix(context)) < 2000.0


@pytest.mark.parametrize("side", Side)
def test_the_contact_spheres_end_at_the_corners_of_the_sole(side):
    """Oracle: the corners of the foot's mesh, x, y, z in the foot frame."""
    world = World()
    foot = world.plant.GetBodyByName(ROBOT.foot_bodies[side])
    lowest = []
    for shape in world.plant.GetCollisionGeometriesForBody(foot):
        sphere = world.inspector.GetShape(shape)
        assert isinstance(sphere, Sphere)
        centre = world.inspector.GetPoseInFrame(shape).translation()
        lowest.append(centre - [0.0, 0.0, sphere.radius()])
    x, y, z = (-0.072, 0.178), (-0.06, 0.06), -0.088
    corners = [[a, b, z] for a in x for b in y]
    # Sums of decimals, exact but for their last digits.
    assert sorted(np.round(lowest, 12).tolist()) == corners
    X_FS = ROBOT.X_FootSole[side]
    sole = [X_FS @ [*corner, 0.0] for corner in ROBOT.sole]
    assert sorted(np.round(sole, 12).tolist()) == corners


def test_left_moves_as_the_mirror_of_right():
    """Oracle: reflection; joints about x and z turn the other way."""
    plant = ROBOT.control_plant()
    context = plant.CreateDefaultContext()
    low, high = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    rng = np.random.default_rng(1)
    left = [name for name in JOINTS if name.startswith("LEFT_")]
    for name in left:
        joint = plant.GetJointByName(name)
        other = plant.GetJointByName(name.replace("LEFT_", "RIGHT_"))
        sign = 1.0 if name.endswith("_Y") else -1.0
        i, j = joint.position_start(), other.position_start()
        assert sorted([sign * low[i], sign * high[i]]) == [low[j], high[j]]
        angle = rng.uniform(low[i], high[i])
        joint.set_angle(context, angle)
        other.set_angle(context, sign * angle)
    for link in LINKS:
        if link.startswith("LEFT_"):
            X_L, X_R = (
                plant.GetBodyByName(name).EvalPoseInWorld(context)
                for name in (link, link.replace("LEFT_", "RIGHT_"))
            )
            # At most ten rotations in a row: a few units of rounding.
            np.testing.assert_allclose(
                MIRROR @ X_L.GetAsMatrix34() @ np.diag([1, -1, 1, 1]),
                X_R.GetAsMatrix34(),
                rtol=0.0,
                atol=1e-14,
            )


@pytest.mark.parametrize("link", LINKS)
def test_every_link_can_be_seen(link):
    world = World()
    frame = world.plant.GetBodyFrameIdOrThrow(
        world.plant.GetBodyByName(link).index()
    )
    assert world.inspector.NumGeometriesForFrameWithRole(
        frame, Role.kIllustration
    )


def test_the_shapes_are_few():
    """Oracle: 60, so that a replay stays small."""
    assert len(list(URDF.iter("visual"))) <= 60


@pytest.mark.parametrize("step_width", [0.125, 0.25, 0.8])
def test_only_the_corners_of_the_soles_touch_when_standing(step_width):
    """Oracle: four spheres a sole, 1 mm into the ground, and nothing else."""
    q = ROBOT.standing_positions(step_width)
    q[6] -= 0.001
    world = World(q)
    feet = [body for pair in world.touching() for body in pair]
    assert sorted(feet) == sorted(
        [*ROBOT.foot_bodies.values(), "world"] * 4 + ["world"] * 4
    )
    assert world.improper_contacts() == set()


@pytest.mark.parametrize(
    "angles, links",
    [
        ({}, ("ANKLE", "ANKLE")),  # feet of 0.12 m, 0.1 m apart
        ({"HIP_X": (-0.3, 0.0)}, ("SHIN", "SHIN")),
        ({"HIP_X": (-0.3, 0.0)}, ("SHIN", "ANKLE")),
        ({"HIP_X": (-0.4, 0.4)}, ("SHIN", "THIGH")),
        ({"HIP_X": (-0.4, 0.4)}, ("THIGH", "THIGH")),
    ],
)
def test_legs_that_pass_through_each_other_are_noticed(angles, links):
    """Adducts the hips, left and right, until the legs cross."""
    world = World(ROBOT.standing_positions(0.1), height=0.5)
    for joint, (left, right) in angles.items():
        world.set_angle(f"LEFT_{joint}", left)
        world.set_angle(f"RIGHT_{joint}", right)
    left, right = links
    expected = f"LEFT_{left}_LINK - RIGHT_{right}_LINK"
    assert expected in world.improper_contacts()


@pytest.mark.parametrize(
    "axis, angle, body",
    [
        (1, 1.5, "LEFT_ELBOW_PITCH_LINK"),  # forward
        (1, -1.5, "TORSO_LINK"),  # backward
        (0, 1.5, "PELVIS_LINK"),  # on the right side
    ],
)
def test_a_robot_that_lies_touches_with_more_than_its_feet(axis, angle, body):
    """Oracle: what is lowest when the pelvis is 0.1 m high."""
    q = ROBOT.standing_positions()
    q[:7] = 0.0
    q[0], q[1 + axis], q[6] = np.cos(angle / 2), np.sin(angle / 2), 0.1
    assert f"{body} - ground" in World(q).improper_contacts()


def test_a_leg_can_touch_the_other_leg_and_all_the_ground():
    """Oracle: the product of the links that have shapes for it."""
    among_links, with_ground = [], set()
    for pair in World().candidates():
        if "world" in pair:
            with_ground |= set(pair)
        else:
            among_links.append(sorted(pair))
    legs = [
        [f"{side}_{link}_LINK" for link in ("THIGH", "SHIN", "ANKLE")]
        for side in ("LEFT", "RIGHT")
    ]
    assert sorted(among_links) == sorted(map(list, itertools.product(*legs)))
    shaped = {k.get("name") for k in URDF.iter("link") if k.find("collision")}
    assert with_ground == {"world"} | shaped
