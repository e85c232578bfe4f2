"""Oracle: the time of a step at constant mean speed, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.robot.model import load_robot
from nadia_balance.robot.reach import margins


def warned(robot):
    """The margins' line on the time of a step, the drives being at rest."""
    nothing = np.zeros(robot.control_plant().num_actuators())
    lines = margins(robot, nothing, nothing)
    return [line for line in lines if "swing" in line]


@pytest.mark.parametrize("name", ["nadia", "atlas", "g1"])
def test_feet_that_are_at_the_reach_in_a_swing_are_fast_enough(name):
    """Oracle: these robots walk; 1 m in 0.7 s, less 10 ms to settle, by size.

    A foot that goes at 0.95 of that mean speed is late.
    """
    robot = load_robot(name)
    assert warned(robot) == []
    model, size = robot.point_mass, robot.params.size
    slower = (size.leg / 0.88) ** 0.5 * 0.95 / (0.7 - 0.01)
    slow = replace(model.detour, max_speed=slower)
    robot.point_mass = replace(model, detour=slow)
    (line,) = warned(robot)
    assert line.startswith("warning: short: speed of the leg joints")
