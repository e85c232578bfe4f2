"""Oracles: a formula, a refusal; the rest: systems/test_joint_drives.py."""

import math
from dataclasses import replace

import pytest
from scipy.integrate import solve_ivp

from nadia_balance.core.body.model import JointDriveParams, MotorParams
from nadia_balance.parameters.bounds import check
from tests.example_walks import MODEL


def test_the_natural_frequency_is_that_of_the_com_height():
    """Oracle: RK45 of x'' = g x / z, also of a copy with another height.

    From x' = omega x on it grows by e in 1 / omega.
    """
    for model in MODEL, replace(MODEL, com_height=0.5):

        def rate(_, state, z=model.com_height):
            return state[1], 9.81 * state[0] / z

        fall = solve_ivp(
            rate,
            (0.0, 1.0 / model.omega),
            (1.0, model.omega),
            rtol=1e-10,
            atol=1e-12,
        )
        assert fall.y[0, -1] == pytest.approx(math.e, abs=1e-7)


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
