"""Oracles: a foot moved by hand; the same run without a pause."""

import math

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.systems.analysis import Simulator

from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.diagrams.simulation import start
from nadia_balance.diagrams.touchdowns import TouchdownRecord
from nadia_balance.robot.model import load_robot
from nadia_balance.systems.signals import Touchdown
from tests.diagrams.simulated import diagram_of

STEP = 0.001


def states(velocity, tilt, turn_rate, steps):
    """The robot as one rigid body, tilted about y, that moves and turns."""
    robot = load_robot("nadia")
    plant = robot.control_plant()
    q, v = robot.standing_positions(0.25), np.zeros(plant.num_velocities())
    rows = []
    for k in range(steps):
        angle = tilt + turn_rate * k * STEP
        moved = q.copy()
        moved[:4] = RollPitchYaw(0.0, angle, 0.0).ToQuaternion().wxyz()
        moved[4:7] += np.array(velocity) * k * STEP
        v[:3], v[3:6] = (0.0, turn_rate, 0.0), velocity
        rows.append(np.concatenate((moved, v)))
    return robot, np.array(rows)


def touchdowns(robot, record, forces):
    """The rows of the touchdowns of a record that begins at 0."""
    times = STEP * np.arange(len(record))
    return TouchdownRecord(robot, STEP).touchdowns(times, record, forces)


def test_the_lowest_corner_is_measured_one_step_before_it_meets_the_ground():
    """Oracle: a rigid body's kinematics, by hand.

    Tilted forward, the toe is lowest; its velocity is that of the base and the
    angular velocity times the arm.
    """
    velocity, tilt, rate = (0.6, -0.8, -0.3), 0.1, 2.0
    robot, record = states(velocity, tilt, rate, 400)
    forces = np.zeros((400, 2))
    forces[200:, 1] = robot.mass * GRAVITY
    forces[205, 1] *= 4.0
    (row,) = touchdowns(robot, record, forces)
    found = Touchdown(row)
    assert (found.time, found.side) == (pytest.approx(0.2), -1.0)
    angle = tilt + 0.199 * rate
    assert found.tilt == pytest.approx(angle)
    # From the base to the toe, in the base's frame, as the robot stands.
    plant = robot.control_plant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, robot.standing_positions(0.25))
    foot = plant.GetBodyByName("RIGHT_FOOT_LINK").EvalPoseInWorld(context)
    sole = (foot @ robot.X_FootSole[list(robot.X_FootSole)[1]]).translation()
    toe = sole + [np.max(robot.sole[:, 0]), 0.0, 0.0]
    x, _, z = toe - robot.standing_positions(0.25)[4:7]
    ahead = math.cos(angle) * x + math.sin(angle) * z
    above = math.cos(angle) * z - math.sin(angle) * x
    along = velocity[0] + rate * above, velocity[1]
    assert found.speed_along == pytest.approx(math.hypot(*along))
    assert found.speed_down == pytest.approx(-velocity[2] + rate * ahead)
    assert found.force == pytest.approx(4.0)
    assert found.mean_force == pytest.approx(1.3)  # nine steps of 1, one of 4


def test_a_bounce_is_no_touchdown_and_both_feet_have_theirs():
    """Oracle: by hand; 59 ms in the air are a bounce, 60 a step."""
    robot, record = states((0.0, 0.0, -0.1), 0.0, 0.0, 600)
    forces = np.full((600, 2), 100.0)
    forces[100:159, 0] = 0.0
    forces[300:360, 0] = 0.0
    forces[400:500, 1] = 0.0
    rows = touchdowns(robot, record, forces)
    found = Touchdown(rows.T)
    assert found.time == pytest.approx([0.36, 0.5])
    assert found.side.tolist() == [1.0, -1.0]
    none = touchdowns(robot, record, np.zeros((600, 2)))
    assert none.shape == (0, 8)


def test_the_slide_is_what_the_sole_moves_in_a_tenth_of_a_second():
    """Oracle: a constant velocity."""
    robot, record = states((0.3, 0.4, 0.0), 0.0, 0.0, 400)
    forces = np.zeros((400, 2))
    forces[100:, 0] = 200.0
    (row,) = touchdowns(robot, record, forces)
    assert Touchdown(row).slide == pytest.approx(0.05)


def test_a_run_that_goes_on_from_a_copy_has_the_same_touchdowns():
    """Oracle: the run in one go; Drake logs the row of the copy twice."""
    diagram = diagram_of("{gait: {num_steps: 2, standing_duration: 0.1}}")
    simulator = start(diagram)
    simulator.AdvanceTo(0.5)
    copy = Simulator(diagram, simulator.get_context().Clone())
    simulator.AdvanceTo(2.2)
    copy.AdvanceTo(2.2)
    whole, in_two = (
        diagram.read_logs(one.get_context())["touchdowns"]
        for one in (simulator, copy)
    )
    assert len(whole) > 0
    assert np.array_equal(whole, in_two)
