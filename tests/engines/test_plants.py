"""Oracles: weights of bodies at rest; the closed form; messages by hand."""

import sys

import numpy as np
import pytest
from pydrake import geometry
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.core.math.lipm import GRAVITY, com_after, icp
from nadia_balance.core.walking.state import Phase, Side, WalkingState
from nadia_balance.engines.plants import (
    MujocoPlant,
    PointMassPlant,
    add_mujoco_plant,
)
from nadia_balance.robot.model import load_robot
from tests.blocks import answer, running
from tests.boxes import register
from tests.example_walks import MODEL, ReferencePoint, replace, walk

FACES = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
CUBE = "".join(
    f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)
) + "".join(f"f {face}\n" for face in FACES)

PERIOD = 0.002
START = ReferencePoint([0.01, 0.02], [0.1, -0.05], [0.0, 0.0])


def test_all_shapes_lie_on_the_ground_with_their_weight(tmp_path):
    """Oracle: m g, within 5 g, for one body of each shape."""
    (tmp_path / "cube.obj").write_text(CUBE)
    shapes = {
        "box": geometry.Box(0.2, 0.2, 0.2),
        "capsule": geometry.Capsule(0.1, 0.2),
        "cylinder": geometry.Cylinder(0.1, 0.2),
        "ellipsoid": geometry.Ellipsoid(0.1, 0.1, 0.1),
        "hull": geometry.Convex(str(tmp_path / "cube.obj"), 0.1),
        "sphere": geometry.Sphere(0.1),
    }
    plant, scene_graph = MultibodyPlant(0.001), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    register(plant, plant.world_body(), geometry.HalfSpace())
    bodies = []
    for i, (name, shape) in enumerate(shapes.items()):
        inertia = SpatialInertia.SolidSphereWithMass(1.0 + i, 0.1)
        bodies.append(plant.AddRigidBody(name, inertia))
        register(plant, bodies[i], shape)
        high = 0.2 if name == "capsule" else 0.1
        pose = RigidTransform([float(i), 0.0, high])
        plant.SetDefaultFloatingBaseBodyPose(bodies[i], pose)
    plant.Finalize()
    engine = MujocoPlant(plant, scene_graph)
    simulator, context = running(engine, actuation=np.zeros(0))
    simulator.AdvanceTo(0.5)
    results, forces = answer(engine, context, "contact_results"), {}
    for i in range(results.num_point_pair_contacts()):
        contact = results.point_pair_contact_info(i)
        a, b = int(contact.bodyA_index()), int(contact.bodyB_index())
        sign = 1.0 if a == 0 else -1.0
        force = forces.setdefault(max(a, b), np.zeros(3))
        force += sign * contact.contact_force()
    for i, body in enumerate(bodies):
        weight = forces[int(body.index())][2]
        assert weight == pytest.approx(9.81 * (1.0 + i), abs=0.05)


@pytest.fixture(scope="module")
def nadia():
    return add_mujoco_plant(DiagramBuilder(), load_robot("nadia"))


def test_a_state_that_diverges_ends_the_run(nadia, tmp_path, monkeypatch):
    """And MuJoCo leaves no log of it in the user's folder."""
    monkeypatch.chdir(tmp_path)
    engine, plant, _ = nadia
    torques = np.zeros(plant.num_actuators())
    simulator, context = running(engine, actuation=torques)
    x = answer(engine, context, "state").copy()
    x[plant.num_positions() :] = 1e200
    context.SetDiscreteState(x)
    with pytest.raises(RuntimeError, match="state is not finite"):
        simulator.AdvanceTo(0.1)
    assert not list(tmp_path.iterdir())


def test_says_what_to_install(nadia, monkeypatch):
    """Oracle: Python's way to say that a module is not there."""
    _, plant, scene_graph = nadia
    ours = "nadia_balance.engines.mujoco_model"
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.delitem(sys.modules, ours)
    message = "^engine = 'mujoco': must have its package: pip install mujoco$"
    with pytest.raises(ValueError, match=message):
        MujocoPlant(plant, scene_graph)
    monkeypatch.setitem(sys.modules, ours, None)
    with pytest.raises(ModuleNotFoundError, match=ours):
        MujocoPlant(plant, scene_graph)


def plant_with(
    phase=Phase.SWING, ecmp=(0, 0), swing=(0, 0, 0.05), push=0, rates=6 * (0,)
):
    """The plant, its simulator and a context in which all inputs are fixed.

    `swing` (3,), `rates` [v(3), a(3)]: of the right foot, in or before a swing.
    """
    state = WalkingState(replace(walk(), phase=phase, start=START))
    plant = PointMassPlant(MODEL, PERIOD, state)
    return plant, *running(
        plant,
        ecmp_command=[0.0, 0.0, *ecmp],
        swing_foot_reference=[*swing, *rates, 0.3, 0.5, -20.0],
        walking_state=state,
        push_force=[push, 0.0, 0.0],
    )


def test_moves_as_the_pendulum_does():
    """Oracle: the closed form over half a second, in one piece."""
    ecmp = np.array([0.03, -0.02])
    plant, simulator, context = plant_with(ecmp=ecmp)
    start = answer(plant, context, "com_state").copy()
    simulator.AdvanceTo(0.499)
    com, velocity = com_after(start[:2], start[3:5], ecmp, MODEL.omega, 0.5)
    end = answer(plant, context, "com_state")
    assert end[:2] == pytest.approx(com, abs=1e-10)
    assert end[3:5] == pytest.approx(velocity, abs=1e-10)
    expected = icp(com, velocity, MODEL.omega)
    assert answer(plant, context, "icp") == pytest.approx(expected, abs=1e-10)


def test_a_push_changes_the_velocity_by_its_impulse():
    """Oracle: F t / m over one tick, to first order."""
    velocities = []
    for push in 0.0, 900.0:
        plant, simulator, context = plant_with(push=push)
        simulator.AdvanceTo(0.5 * PERIOD)
        velocities.append(answer(plant, context, "com_state")[3])
    change = velocities[1] - velocities[0]
    assert change == pytest.approx(900.0 * PERIOD / MODEL.mass, rel=1e-4)


def test_the_swing_foot_goes_where_it_is_told():
    """Oracle: p + v t + a t^2 / 2, by hand, for one tick of 0.002 s."""
    rates = (0.5, -1.0, 1.5, 10.0, 20.0, -30.0)
    swing = (0.05, -0.13, 0.04)
    plant, simulator, context = plant_with(swing=swing, rates=rates)
    simulator.AdvanceTo(0.5 * PERIOD)
    foot = answer(plant, context, "foot_poses")[Side.RIGHT]
    end = [0.05 + 0.00102, -0.13 - 0.00196, 0.04 + 0.00294]
    assert foot.p_WF == pytest.approx(end, abs=1e-12)
    assert foot.yaw == pytest.approx(0.3 + 0.00096, abs=1e-12)


@pytest.mark.parametrize(
    ("phase", "height", "shares"),
    [
        (Phase.TRANSFER, 0.0, (0.5, 0.5)),
        (Phase.SWING, 0.05, (1.0, 0.0)),
        (Phase.SWING, 0.0, (0.5, 0.5)),
    ],
)
def test_feet_on_the_ground_share_the_weight(phase, height, shares):
    """Oracle: by hand."""
    plant, simulator, context = plant_with(phase, swing=(0.0, 0.0, height))
    simulator.AdvanceTo(0.5 * PERIOD)
    forces = answer(plant, context, "foot_forces")
    assert forces == pytest.approx(MODEL.mass * GRAVITY * np.array(shares))
