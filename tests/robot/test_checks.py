"""Improper contacts, of boxes that lie on the ground and on each other."""

import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.robot.plants import improper_contacts
from tests.boxes import cube, ground

FEET = {"left", "right"}
SIZE = 0.1  # of every box [m]
# Positions of boxes, on the ground and on top of another one [m].
LOW, BESIDE = [0.0, 0.0, 0.049], [0.0, 1.0, 0.049]
TOP = [0.0, 0.0, 0.148]


def contacts(positions: dict) -> set[str]:
    """What touches improperly when boxes are put at these positions (3,).

    All are the robot's but the one named box.
    """
    builder = DiagramBuilder()
    plant = ground(builder)
    robot, other = map(plant.AddModelInstance, ("robot", "other"))
    for name, p_WB in positions.items():
        model = other if name == "box" else robot
        cube(plant, name, model, 1.0, SIZE, p_WB)
    plant.Finalize()
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.001)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    results = plant.get_contact_results_output_port().Eval(context)
    return improper_contacts(plant, results, robot, FEET)


@pytest.mark.parametrize(
    "positions, expected",
    [
        ({"left": LOW, "right": BESIDE}, set()),
        ({"knee": LOW}, {"knee - ground"}),
        ({"left": TOP, "right": LOW}, {"left - right"}),
        # A foot may stand on a box, but no knee.
        ({"box": LOW, "left": TOP}, set()),
        ({"box": LOW, "knee": TOP}, {"knee - other::box"}),
    ],
)
def test_names_what_is_not_foot_and_ground(positions, expected):
    """Oracle: where the boxes were put."""
    assert contacts(positions) == expected
