"""Pushes and Drake's mouse act on the robot at the same time."""

from importlib.metadata import version

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ExternallyAppliedSpatialForce,
)
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

from nadia_balance.view.scene import add_mouse, connect_forces, start_meshcat

MASS = 2.0


def force(body, f_W):
    """A source of that force at the centre of mass."""
    applied = ExternallyAppliedSpatialForce()
    applied.body_index = body.index()
    applied.F_Bq_W = SpatialForce(tau=np.zeros(3), f=f_W)
    return ConstantValueSource(Value([applied]))


def test_all_forces_act_and_so_may_the_mouse():
    """Oracles: Newton, m v = t sum(F); Drake's version, for its mouse."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.01)
    body = plant.AddRigidBody(
        "ball", SpatialInertia.SolidSphereWithMass(MASS, 0.1)
    )
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    mouse = add_mouse(builder, plant, scene_graph, start_meshcat()[0])
    assert (mouse is not None) == (int(version("drake").split(".")[1]) >= 57)
    pushes = [
        builder.AddSystem(force(body, f_W)).get_output_port()
        for f_W in ([3.0, 0.0, 0.0], [0.0, 5.0, 1.0])
    ]
    connect_forces(builder, plant, *pushes, mouse)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.5)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    v_WB = plant.EvalBodySpatialVelocityInWorld(context, body).translational()
    expected = 0.5 / MASS * np.array([3.0, 5.0, 1.0])
    assert v_WB == pytest.approx(expected, abs=1e-12)
