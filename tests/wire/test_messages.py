"""Messages that are unfit for use are told by field, value and rule."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.wire.messages import fault_of
from tests.wire.examples import N, command, state


@pytest.mark.parametrize(
    ("message", "rule"),
    [
        (state(1.0), ""),
        (command(), ""),
        (state(np.nan), "time = nan: must be finite"),
        (state(1.0, n=4), "q has 4 numbers: must be 3"),
        (state(1.0, gyro=np.zeros(4)), "gyro has 4 numbers: must be 3"),
        (
            state(1.0, force=np.array([0.0, np.inf, 9.0])),
            "force = [0.0, inf, 9.0]: must be finite",
        ),
        (
            state(1.0, quaternion=np.zeros(4)),
            "quaternion has the norm 0: must be 1",
        ),
        (
            replace(command(), tau=np.array([1.0, np.nan, 2.0])),
            "tau = [1.0, nan, 2.0]: must be finite",
        ),
        (
            state(1.0, tau=np.array([1.0, -1e308, 2.0])),
            "tau = [1.0, -1e+308, 2.0]: must be within 1e+06 of 0",
        ),
        (replace(command(), kd=-command().kd), "kp, kd: must be >= 0"),
    ],
)
def test_says_what_is_wrong_with_a_message(message, rule):
    """Oracle: by hand."""
    assert fault_of(message, N) == rule
