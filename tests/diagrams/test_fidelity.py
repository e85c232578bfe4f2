"""Drives as they could be built, and ideal ones, of a robot that is shoved."""

import math

import numpy as np
import pytest

from tests.diagrams.simulated import figures, simulated

PERIOD = 0.004
PUSH = "duration: 0.5, pushes: [{delta_v: 0.3, at: 0.1 s, direction_deg: 90}]}"
REALISTIC = f"{{fidelity: realistic, {PUSH}"


def test_real_torques_lag_behind_the_commanded():
    """Oracle: a first-order lag of 40 Hz in closed form, from tick to tick.

    The joints are slower than half their limit.  The robot stands at first,
    and its drives hold it.
    """
    logs = simulated(REALISTIC).logs
    commanded, torques = logs["actuation"], logs["torques"]
    left = math.exp(-2.0 * math.pi * 40.0 * PERIOD)
    expected = commanded + left * (torques - commanded)
    assert figures(REALISTIC)["max_joint_speed_ratio"] < 0.5
    assert torques[1:] == pytest.approx(expected[:-1], abs=1e-9)
    assert np.array_equal(torques[0], commanded[0])
