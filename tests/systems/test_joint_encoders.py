"""Oracle: moments of the normal distribution."""

import numpy as np
import pytest

from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.systems.estimation import JointEncoders
from tests import blocks
from tests.whole_body_examples import nadia, standing_state

PERIOD, NJ = 0.004, 23


def told(sensors, ticks, seed=0):
    encoders = JointEncoders(nadia(), sensors, PERIOD, seed)
    state = standing_state()
    inputs = [{"state": state}] * ticks
    (joints,) = blocks.told(encoders, PERIOD, inputs, "joints")
    return joints - np.concatenate((state[7 : 7 + NJ], state[-NJ:]))


def test_errors_are_white_and_of_their_deviations():
    """Oracle: four standard errors of 500 ticks; none without noise."""
    sensors = SensorParams(joint_noise=1e-3, joint_speed_noise=0.05)
    errors = told(sensors, 500)
    for part, deviation in (errors[:, :NJ], 1e-3), (errors[:, NJ:], 0.05):
        z = part / deviation
        assert z.std() == pytest.approx(1.0, abs=4.0 / (1000 * NJ) ** 0.5)
        following = np.mean(z[1:] * z[:-1])
        assert following == pytest.approx(0.0, abs=4.0 / (500 * NJ) ** 0.5)
    assert np.array_equal(errors[:3], told(sensors, 3))
    assert not np.any(
        np.isclose(errors[:3], told(sensors, 3, seed=1), rtol=0.0)
    )
    assert not np.any(told(SensorParams(), 3))
