"""A refusal; the torque-speed line: tests/systems/test_joint_drives.py."""

import pytest

from nadia_balance.core.body.joint_drives import JointDriveParams
from nadia_balance.core.math.bounds import check


@pytest.mark.parametrize("torque", [0.0, -5.0])
def test_refuses_a_drive_without_torque(torque):
    """Oracle: the message names joint, value and unit."""
    check(JointDriveParams(max_torque={"KNEE": 1e-3}))
    drives = JointDriveParams(max_torque={"HIP": 5.0, "KNEE": torque})
    with pytest.raises(ValueError) as error:
        check(drives, "drives")
    message = f"drives.max_torque.KNEE = {torque}: must be > 0 N m"
    assert str(error.value) == message
