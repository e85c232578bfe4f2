"""Oracles: scipy's sampled first-order lag; the torque-speed line by points."""

import math

import numpy as np
import pytest
from scipy.signal import cont2discrete

from nadia_balance.core.body.joint_drives import (
    JointDriveParams,
    lag_share,
    torque_limits,
)
from nadia_balance.core.math.bounds import check


@pytest.mark.parametrize("bandwidth", [5.0, 40.0, 400.0])
def test_the_lag_is_a_first_order_one(bandwidth):
    """Oracle: scipy, of 1 / (s / omega + 1) behind a hold of 1 ms."""
    lag = [1.0], [1.0 / (2.0 * math.pi * bandwidth), 1.0]
    num, den, _ = cont2discrete(lag, 0.001)
    share = lag_share(bandwidth, 0.001)
    assert np.ravel(num) == pytest.approx([0.0, share])
    assert den == pytest.approx([1.0, share - 1.0])


@pytest.mark.parametrize(
    ("speed", "least", "most"),
    [  # of 100 N m and 12 rad/s, full up to 9 rad/s
        (0.0, -100.0, 100.0),
        (9.0, -100.0, 100.0),
        (10.0, -100.0, 200.0 / 3.0),
        (12.0, -100.0, 0.0),
        (15.0, -100.0, 0.0),
        (-10.5, -50.0, 100.0),
    ],
)
def test_the_torque_speed_line_bounds_what_drives(speed, least, most):
    """Oracle: points on the line, by hand; beside a drive at rest."""
    speeds, torques = np.array([0.0, speed]), np.array([7.0, 100.0])
    found = torque_limits(speeds, torques, np.array([2.0, 12.0]), 0.75)
    assert found == pytest.approx(np.array([[-7.0, least], [7.0, most]]))


@pytest.mark.parametrize("torque", [0.0, -5.0])
def test_refuses_a_drive_without_torque(torque):
    """Oracle: the message names joint, value and unit."""
    check(JointDriveParams(max_torque={"KNEE": 1e-3}))
    drives = JointDriveParams(max_torque={"HIP": 5.0, "KNEE": torque})
    with pytest.raises(ValueError) as error:
        check(drives, "drives")
    message = f"drives.max_torque.KNEE = {torque}: must be > 0 N m"
    assert str(error.value) == message
