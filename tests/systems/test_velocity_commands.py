"""Oracles: the rows, read by hand; messages by hand."""

import re

import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.systems.plan import VelocityCommands
from tests.blocks import answer

ROWS = [(0.5, 0.3, 0.0, 0.0), (2.0, 0.0, 0.1, -0.4), (2.004, 0.0, 0.0, 0.0)]


def test_each_row_holds_from_its_time_to_that_of_the_next():
    """Oracle: by hand; before the first row the robot is to stand."""
    commands = VelocityCommands(ROWS)
    simulator = Simulator(commands)
    for time, expected in (
        (0.0, [0.0, 0.0, 0.0]),
        (0.496, [0.0, 0.0, 0.0]),
        (0.5, [0.3, 0.0, 0.0]),
        (1.996, [0.3, 0.0, 0.0]),
        (2.0, [0.0, 0.1, -0.4]),
        (9.0, [0.0, 0.0, 0.0]),
    ):
        simulator.AdvanceTo(time)
        command = answer(commands, simulator.get_context(), "velocity_command")
        assert command.tolist() == expected


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([(0.0, 0.3, 0.0)], "rows[0] = (0.0, 0.3, 0.0): must be 4 finite"),
        ([(0.0, float("nan"), 0.0, 0.0)], "rows[0]"),
        ([(-0.1, 0.0, 0.0, 0.0)], "rows[0]"),
        ([(1.0, 0.3, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)], "rows[1]"),
    ],
)
def test_bad_rows_are_refused(rows, message):
    """Oracle: the message names the row and its values."""
    with pytest.raises(ValueError, match=re.escape(message)):
        VelocityCommands(rows)
