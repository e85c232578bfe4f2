"""Oracles: a formula, a refusal; the rest: systems/test_joint_drives.py."""

import math
from dataclasses import replace

import pytest

from nadia_balance.core.body.model import JointDriveParams, MotorParams
from nadia_balance.parameters.bounds import check
from tests.example_walks import MODEL


def test_the_natural_frequency_is_that_of_the_com_height():
    """Oracle: sqrt(g / z), also of a copy with another height."""
    assert math.sqrt(9.81 / 0.95) == MODEL.omega
    lower = replace(MODEL, com_height=0.5)
    assert lower.omega == pytest.approx(math.sqrt(9.81 / 0.5))


@pytest.mark.parametrize("torque", [0.0, -5.0])
def test_refuses_a_drive_without_torque(torque):
    """Oracle: the message names motor, value and unit."""
    check(JointDriveParams(motors={"knee": MotorParams(max_torque=1e-3)}))
    motor = MotorParams(joints=["KNEE"], max_torque=torque)
    drives = JointDriveParams(motors={"knee": motor})
    with pytest.raises(ValueError) as error:
        check(drives, "drives")
    message = f"drives.motors.knee.max_torque = {torque}: must be > 0 N m"
    assert str(error.value) == message
