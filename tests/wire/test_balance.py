"""What RobotBalance says of a robot before it balances it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.systems.primitives import DiscreteTimeIntegrator

from nadia_balance.balance_controller import controller_params
from nadia_balance.robot.fall import FALLEN_TILT
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.params import load_sensors
from nadia_balance.wire.balance import RobotBalance, Ticking
from tests.wire.examples import state


def test_a_robot_lies_by_the_tilt_of_its_pelvis_not_of_its_imu():
    """Oracle: the angle from the pelvis' z axis to the vertical, by Drake."""
    mounted = [20.0, 80.0, -130.0]  # roll, pitch, yaw of the IMU [deg]
    sensors = replace(load_sensors("proprioceptive"), imu_rpy_deg=mounted)
    balance = RobotBalance(load_robot("g1"), controller_params("g1"), sensors)
    R_BI = RollPitchYaw(*np.radians(mounted)).ToRotationMatrix()
    answers = []
    for rpy in np.random.default_rng(4).uniform(-1.2, 1.2, (20, 3)):
        R_WB = RollPitchYaw(*rpy).ToRotationMatrix()
        wxyz = (R_WB @ R_BI).ToQuaternion().wxyz()
        tilt = math.acos(R_WB.matrix()[2, 2])
        answers.append(balance.lies(state(0.0, 29, quaternion=wxyz)))
        assert answers[-1] == (tilt > FALLEN_TILT)
    assert 3 < sum(answers) < 17


def test_a_tick_is_updated_once_by_its_own_inputs():
    """Oracle: 0.1 times the sum of the inputs of all ticks before.

    However often the tick is finished: also never, which the next one does.
    """
    period = 0.1
    ticking = Ticking(DiscreteTimeIntegrator(1, period), period)
    for begin in range(2):
        ticking.begin()
        total = 0.0
        for tick in range(30):
            ticking.tick(u=np.array([tick + 1.0]))
            assert ticking.output("y") == pytest.approx(period * total)
            total += tick + 1.0
            for _ in range((tick + begin) % 3):
                ticking.finish()
                np.testing.assert_allclose(ticking.output("y"), period * total)


def test_a_command_is_of_its_own_tick():
    """Oracle: a sample that is tilted turns the torques of that very tick."""
    robot = load_robot("g1")
    sensors = load_sensors("proprioceptive")
    balance = RobotBalance(robot, controller_params("g1"), sensors)
    standing = state(0.0, 29, q=robot.standing_positions()[7:], dq=np.zeros(29))
    level = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 9.81, 0.0, 0.0, 0.0])
    turning = level + [0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0]
    steps = []
    for last in level, turning:
        balance.begin()
        for imu in *[level] * 5, last:
            command = balance.tick(imu, standing, np.zeros(3))
            balance.finish()
        steps.append(command.tau)
    assert np.abs(steps[1] - steps[0]).max() > 0.1
