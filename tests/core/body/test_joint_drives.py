"""Oracles: scipy's sampled first-order lag; the torque-speed line by points."""

import numpy as np
import pytest

from nadia_balance.core.body.joint_drives import JointDriveParams, torque_limits
from nadia_balance.core.math.bounds import check


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
