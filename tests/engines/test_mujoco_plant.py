"""Oracles: weights of bodies at rest; ballistics; messages by hand."""

import sys

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.engines.mujoco_plant import MujocoPlant, add_mujoco_plant
from nadia_balance.robot.model import load_robot
from tests.blocks import answer, running

FACES = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
CUBE = "".join(
    f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)
) + "".join(f"f {face}\n" for face in FACES)


def touch(plant: MultibodyPlant, body, shape) -> None:
    friction = CoulombFriction(0.8, 0.8)
    plant.RegisterCollisionGeometry(
        body, RigidTransform(), shape, "touches", friction
    )


def test_all_shapes_lie_on_the_ground_with_their_weight(tmp_path):
    """Oracle: m g, within 5 g, for one body of each shape."""
    (tmp_path / "cube.obj").write_text(CUBE)
    shapes = {
        "box": Box(0.2, 0.2, 0.2),
        "capsule": Capsule(0.1, 0.2),
        "cylinder": Cylinder(0.1, 0.2),
        "ellipsoid": Ellipsoid(0.1, 0.1, 0.1),
        "hull": Convex(str(tmp_path / "cube.obj"), 0.1),
        "sphere": Sphere(0.1),
    }
    plant, scene_graph = MultibodyPlant(0.001), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    touch(plant, plant.world_body(), HalfSpace())
    bodies = {}
    for i, (name, shape) in enumerate(shapes.items()):
        inertia = SpatialInertia.SolidSphereWithMass(1.0 + i, 0.1)
        bodies[name] = plant.AddRigidBody(name, inertia)
        touch(plant, bodies[name], shape)
        high = 0.2 if name == "capsule" else 0.1
        pose = RigidTransform([float(i), 0.0, high])
        plant.SetDefaultFloatingBaseBodyPose(bodies[name], pose)
    plant.Finalize()
    engine = MujocoPlant(plant, scene_graph)
    simulator, context = running(engine, actuation=np.zeros(0))
    simulator.AdvanceTo(0.5)
    results, forces = answer(engine, context, "contact_results"), {}
    for i in range(results.num_point_pair_contacts()):
        contact = results.point_pair_contact_info(i)
        a, b = int(contact.bodyA_index()), int(contact.bodyB_index())
        sign = 1.0 if a == 0 else -1.0
        found = forces.setdefault(max(a, b), np.zeros(3))
        found += sign * contact.contact_force()
    for i, body in enumerate(bodies.values()):
        weight = 9.81 * (1.0 + i)
        found = forces[int(body.index())][2]
        assert found == pytest.approx(weight, abs=0.05)


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
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.delitem(sys.modules, "nadia_balance.engines.mujoco_model")
    message = "^engine = 'mujoco': must have its package: pip install mujoco$"
    with pytest.raises(ValueError, match=message):
        MujocoPlant(plant, scene_graph)
