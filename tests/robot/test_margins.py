"""Oracles: a step at constant mean speed, and a leg's torque, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.robot.model import RobotModel, load_robot, load_robot_params
from nadia_balance.robot.reach import margins, too_weak


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


def test_joints_that_carry_it_on_two_legs_only_are_warned_of():
    """Oracle: statics by hand, of a G1 whose CoM is above one sole.

    Its knee needs twice the 10 N m of two legs, but for the shin's own.  That
    weighs 2.5 kg, its centre 0.12 m from the knee.  As the pelvis goes aside
    with the CoM, the hip is half a step width, 0.237 m, beside the force that
    carries all.
    """
    robot = load_robot("g1")
    assert too_weak(robot) == []
    params, _ = load_robot_params("g1")
    params.drives.motors["N7520-22.5"].max_torque = 13.0
    weak = RobotModel(params, robot.urdf)
    needed = {
        line.split()[4]: float(line.split()[-3]) for line in too_weak(weak)
    }
    for side in "left", "right":
        knee = needed.pop(f"{side}_knee_joint,")
        assert knee == pytest.approx(20.0, abs=3.0)
        roll = needed.pop(f"{side}_hip_roll_joint,")
        assert roll == pytest.approx(0.5 * 33.3 * 9.81 * 0.237, rel=0.15)
    assert not needed
