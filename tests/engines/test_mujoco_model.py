"""Oracle: Drake's plant, read from the same URDF."""

import mujoco
import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.multibody import plant as mbp
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.engines.mujoco_model import MujocoModel
from nadia_balance.robot.model import load_robot

ROBOTS = [("nadia", "ideal"), ("nadia", "realistic"), ("atlas", "realistic")]


def modelled(name: str, fidelity: str):
    """Drake's closed scene, its plant and scene graph, and MuJoCo's model."""
    robot, builder = load_robot(name, fidelity), DiagramBuilder()
    plant, scene_graph = robot.add_plant_to(builder)
    model = MujocoModel(plant, scene_graph.model_inspector())
    return builder.Build(), plant, scene_graph, model


def a_state(plant: MultibodyPlant, rng, reach: float) -> np.ndarray:
    """[q, v], each joint up to `reach` [rad] from standing."""
    q = plant.GetPositions(plant.CreateDefaultContext())
    q[:4] += 0.5 * rng.normal(size=4)
    q[:4] /= np.linalg.norm(q[:4])
    q[7:] += rng.uniform(-reach, reach, len(q) - 7)
    return np.concatenate([q, rng.normal(size=plant.num_velocities())])


@pytest.mark.parametrize("name", ["nadia", "atlas"])
def test_moves_as_drake_does(name):
    """Oracle: CoM and acceleration of Drake's continuous plant.

    With torques (some beyond their limits), gravity, rotor inertia and a wrench
    on a link, free of contacts and joint limits.  They differ by the rounding
    of a solution with M, some 1e-12 of 400 rad/s^2.
    """
    _, _, _, model = modelled(name, "ideal")
    model.model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    plant = MultibodyPlant(0.0)
    load_robot(name).add_to(plant)
    plant.Finalize()
    context, rng = plant.CreateDefaultContext(), np.random.default_rng(1)
    force = mbp.ExternallyAppliedSpatialForce()
    force.body_index = plant.GetBodyByName(load_robot(name).torso_body).index()
    nv, com = plant.num_velocities(), plant.CalcCenterOfMassPositionInWorld
    for _ in range(10):
        x = a_state(plant, rng, 1.0)
        torques = rng.uniform(-50.0, 50.0, plant.num_actuators())
        force.p_BoBq_B = rng.normal(size=3)
        force.F_Bq_W = SpatialForce(rng.uniform(-50.0, 50.0, (6, 1)))
        plant.SetPositionsAndVelocities(context, x)
        plant.get_actuation_input_port().FixValue(context, torques)
        plant.get_applied_spatial_force_input_port().FixValue(context, [force])
        model.forward(x, torques, [force])
        expected = plant.EvalTimeDerivatives(context).CopyToVector()[-nv:]
        acceleration = model.rates(model.data.qacc)
        assert acceleration == pytest.approx(expected, rel=1e-10, abs=1e-9)
        assert model.data.subtree_com[0] == pytest.approx(com(context))


@pytest.mark.parametrize(("name", "fidelity"), ROBOTS)
def test_touches_what_it_touches_in_drake(name, fidelity):
    """Oracle: the penetrations that SceneGraph finds, by bodies and depth."""
    diagram, plant, scene_graph, model = modelled(name, fidelity)
    root, rng = diagram.CreateDefaultContext(), np.random.default_rng(2)
    scene_context = scene_graph.GetMyContextFromRoot(root)
    inspector = scene_graph.model_inspector()
    torques, seen = np.zeros(plant.num_actuators()), set()
    for _ in range(40):
        x = a_state(plant, rng, 0.6)
        context = plant.GetMyMutableContextFromRoot(root)
        plant.SetPositionsAndVelocities(context, x)
        query = scene_graph.get_query_output_port().Eval(scene_context)
        expected = {}
        for pair in query.ComputePointPairPenetration():
            bodies = frozenset(
                int(plant.GetBodyFromFrameId(inspector.GetFrameId(i)).index())
                for i in (pair.id_A, pair.id_B)
            )
            expected[bodies] = max(pair.depth, expected.get(bodies, 0.0))
        _, contacts = model.step(x, torques)
        assert model.data.ncon == len(contacts)
        depths = {}
        for contact, dist in zip(
            contacts, model.data.contact.dist, strict=True
        ):
            pair = contact.bodyA_index(), contact.bodyB_index()
            bodies = frozenset(map(int, pair))
            depths[bodies] = max(-dist, depths.get(bodies, 0.0))
        assert set(depths) == set(expected)
        ground = {pair: d for pair, d in expected.items() if 0 in pair}
        assert {pair: depths[pair] for pair in ground} == pytest.approx(ground)
        seen |= set(depths)
    assert any(0 in pair for pair in seen) and any(0 not in p for p in seen)


def test_a_joint_stops_at_its_limit():
    """Oracle: the range in the URDF, pressed against with all torque.

    That bends it by 0.5 degrees.
    """
    _, plant, _, model = modelled("nadia", "ideal")
    x = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    x[6] = 2.0  # in the air
    knee = plant.GetJointActuatorByName("LEFT_KNEE_Y")
    torques = np.zeros(plant.num_actuators())
    torques[int(knee.index())] = knee.effort_limit()
    upper_limit = knee.joint().position_upper_limits()[0]
    for _ in range(1000):
        x, _ = model.step(x, torques)
    angle = x[knee.joint().position_start()]
    assert angle == pytest.approx(upper_limit, abs=0.01)


TWO_LEGS = """<robot name="two_legs">
  <link name="hull"><inertial><mass value="{hull}"/>
    <inertia ixx="0.3" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/>
  </inertial></link>
  <link name="left"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/>
    <inertia ixx="0.03" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/>
  </inertial></link>
  <link name="right"><inertial><origin xyz="0 0 -0.3"/><mass value="2"/>
    <inertia ixx="0.03" iyy="0.04" izz="0.01" ixy="0" ixz="0" iyz="0"/>
  </inertial></link>
  <joint name="left_hip" type="revolute"><parent link="hull"/>
    <child link="left"/><origin xyz="0 0.1 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="9"/></joint>
  <joint name="right_hip" type="revolute"><parent link="hull"/>
    <child link="right"/><origin xyz="0 -0.1 0"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="9"/></joint>
</robot>"""
# The same in another order, with a heavier hull and a spring that pulls.
TWO_LEGS_MJCF = """<mujoco><worldbody><body name="hull">
  <freejoint/>
  <inertial pos="0 0 0" mass="7" diaginertia="0.3 0.2 0.1"/>
  <body name="right" pos="0 -0.1 0">
    <joint name="right_hip" axis="1 0 0"/>
    <inertial pos="0 0 -0.3" mass="2" diaginertia="0.03 0.04 0.01"/></body>
  <body name="left" pos="0 0.1 0">
    <joint name="left_hip" axis="0 1 0"/>
    <inertial pos="0 0 -0.2" mass="1" diaginertia="0.03 0.02 0.01"/></body>
</body></worldbody>
<actuator><position joint="left_hip" kp="900"/></actuator></mujoco>"""


def two_legs(hull: float, inertia: float, step: float) -> MultibodyPlant:
    """Drake's plant of two legs with reflected inertia."""
    plant = MultibodyPlant(step)
    urdf = TWO_LEGS.format(hull=hull)
    Parser(plant).AddModelsFromString(urdf, "urdf")
    for name in "left_hip", "right_hip":
        actuator = plant.AddJointActuator(
            name, plant.GetJointByName(name), 50.0
        )
        actuator.set_default_rotor_inertia(inertia)
        actuator.set_default_gear_ratio(1.0)
    plant.Finalize()
    return plant


def read(plant: MultibodyPlant, folder, text: str) -> MujocoModel:
    """MuJoCo's model of a plant that an MJCF replaces."""
    (folder / "two_legs.xml").write_text(text)
    inspector = SceneGraph().model_inspector()
    return MujocoModel(plant, inspector, folder / "two_legs.xml")


def test_an_mjcf_moves_in_the_place_of_the_plant(tmp_path):
    """Oracle: Drake's plant with the masses of the MJCF.

    Its joints come in another order, its actuator does nothing, its reflected
    inertia is the plant's.
    """
    model = read(two_legs(3.0, 0.05, 0.001), tmp_path, TWO_LEGS_MJCF)
    plant = two_legs(7.0, 0.05, 0.0)
    context, rng = plant.CreateDefaultContext(), np.random.default_rng(4)
    force = mbp.ExternallyAppliedSpatialForce()
    force.body_index = plant.GetBodyByName("right").index()
    x = np.concatenate(([0.5, 0.5, -0.5, 0.5], rng.normal(size=13)))
    force.p_BoBq_B = rng.normal(size=3)
    force.F_Bq_W = SpatialForce(rng.normal(size=(6, 1)))
    torques = np.array([20.0, -90.0])
    plant.SetPositionsAndVelocities(context, x)
    plant.get_actuation_input_port().FixValue(context, torques)
    plant.get_applied_spatial_force_input_port().FixValue(context, [force])
    x[6] = 1.0
    model.forward(x, torques, [force])
    expected = plant.EvalTimeDerivatives(context).CopyToVector()[-8:]
    expected_in_order = model.rates(model.data.qacc)
    assert expected_in_order == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="left"', 'name="port"', "must have left and left_hip"),
        ('name="right_hip"', "", "must have right and right_hip"),
        ("<freejoint/>", "", "must have hull and "),
        (
            'axis="1 0 0"/>',
            'axis="1 0 0"/><joint axis="0 0 1"/>',
            "has 9 velocities: must be 8",
        ),
        ("<mujoco>", "<robot>", "model = "),
    ],
)
def test_an_mjcf_is_of_the_same_robot(tmp_path, old, new, message):
    """Oracle: by hand."""
    with pytest.raises(ValueError, match=message):
        read(
            two_legs(3.0, 0.0, 0.001), tmp_path, TWO_LEGS_MJCF.replace(old, new)
        )


def test_an_mjcf_stands_on_ground_of_its_own_or_on_ours(tmp_path):
    """Oracle: a leg with a ball, 1 cm deep in the plane z = 0."""
    ball = '<geom type="sphere" size="0.05" pos="0 0 -0.5" mass="0"/></body>'
    text = TWO_LEGS_MJCF.replace("</body>", ball, 1)
    plane = '<worldbody><geom type="plane" size="0 0 1"/>'
    plant = two_legs(3.0, 0.0, 0.001)
    x = np.zeros(17)
    x[0], x[6] = 1.0, 0.54
    for made in text, text.replace("<worldbody>", plane):
        model = read(plant, tmp_path, made)
        _, contacts = model.step(x, np.zeros(2))
        (contact,) = contacts
        bodies = {contact.bodyA_index(), contact.bodyB_index()}
        assert bodies == {
            plant.world_body().index(),
            plant.GetBodyByName("right").index(),
        }
        assert abs(contact.contact_force()[2]) > 1.0
