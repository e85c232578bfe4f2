"""What RobotBalance says of a robot before it balances it."""

import math
from dataclasses import replace

import numpy as np
from pydrake.math import RollPitchYaw

from nadia_balance.balance_controller import controller_params
from nadia_balance.robot.model import FALLEN_TILT, load_robot
from nadia_balance.robot.params import load_sensors
from nadia_balance.wire.balance import RobotBalance
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
