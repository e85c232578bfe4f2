"""Oracle: Drake's plant, read from the same URDF."""

import mujoco
import numpy as np
import pytest
from pydrake.multibody import plant as mbp
from pydrake.multibody.math import SpatialForce
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
