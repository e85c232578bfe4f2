"""Improper contacts, of boxes that lie on the ground and on each other."""

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.robot.plants import improper_contacts
from tests.boxes import ground, register

FEET = {"left", "right"}
SIZE = 0.1  # of every box [m]
ON_GROUND = 0.5 * SIZE - 0.001  # [m]
ON_TOP = 1.5 * SIZE - 0.002  # [m]


def contacts(positions: dict) -> set[str]:
    """What touches improperly when boxes are put at these positions (3,).

    All are the robot's but the one named box.
    """
    builder = DiagramBuilder()
    plant = ground(builder)
    robot = plant.AddModelInstance("robot")
    other = plant.AddModelInstance("other")
    cube = Box(SIZE, SIZE, SIZE)
    bodies = {
        name: plant.AddRigidBody(
            name,
            other if name == "box" else robot,
            SpatialInertia.SolidBoxWithMass(1.0, *cube.size()),
        )
        for name in positions
    }
    for body in bodies.values():
        register(plant, body, cube)
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for name, p_WB in positions.items():
        plant.SetFreeBodyPose(context, bodies[name], RigidTransform(p_WB))
    simulator.AdvanceTo(0.001)
    results = plant.get_contact_results_output_port().Eval(context)
    return improper_contacts(plant, results, robot, FEET)


@pytest.mark.parametrize(
    "positions, expected",
    [
        ({"left": [0, 0, ON_GROUND], "right": [0, 1, ON_GROUND]}, set()),
        ({"knee": [0, 0, ON_GROUND]}, {"knee - ground"}),
        (
            {"left": [0, 0, ON_TOP], "right": [0, 0, ON_GROUND]},
            {"left - right"},
        ),
        # A foot may stand on a box, but no knee.
        ({"box": [0, 0, ON_GROUND], "left": [0, 0, ON_TOP]}, set()),
        (
            {"box": [0, 0, ON_GROUND], "knee": [0, 0, ON_TOP]},
            {"knee - other::box"},
        ),
    ],
)
def test_names_what_is_not_foot_and_ground(positions, expected):
    """Oracle: where the boxes were put."""
    positions = {k: np.array(p, dtype=float) for k, p in positions.items()}
    assert contacts(positions) == expected
