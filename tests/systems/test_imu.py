"""Oracles: gravity, a carousel in closed form, moments of the noise."""

import math

import numpy as np
import pytest

from nadia_balance.core.estimation.sensors import SAMPLE, SensorParams
from nadia_balance.systems.estimation import Imu
from tests import blocks
from tests.whole_body_examples import nadia, standing_state

PERIOD, NQ = 0.004, 30
PLACED = SensorParams(
    imu_position=[0.2, 0.1, -0.05], imu_rpy_deg=[90.0, 0.0, 0.0]
)
NOISE = SensorParams(
    gyro_noise=1e-3, gyro_bias=0.1, force_noise=0.02, force_bias=0.3
)


def told(sensors, states, seed=0):
    """What the IMU tells in each tick, of the states of the robot."""
    imu = Imu(nadia(), sensors, PERIOD, seed)
    inputs = [{"state": state} for state in states]
    return blocks.told(imu, PERIOD, inputs, "imu")[0]


def carousel(rate, t):
    """[q, v] of a robot whose pelvis turns about z, at rest in the origin."""
    state = standing_state().copy()
    half = 0.5 * rate * t
    state[:7] = [math.cos(half), 0, 0, math.sin(half), 0, 0, 1]
    state[NQ + 2] = rate
    return state


def test_rides_on_a_carousel():
    """Oracle: gravity up, w^2 r inwards; y of the IMU is z of the pelvis."""
    states = [carousel(1.5, i * PERIOD) for i in range(4)]
    _, *measured = told(PLACED, states)
    # The mean of what turns by 6 mrad: its length, by half of that squared / 6.
    inwards = -(1.5**2) * np.array([0.2, 0.1])
    expected = [0.0, 1.5, 0.0, inwards[0], 9.81, -inwards[1], 0.0, 1.5, 0.0]
    for imu in measured:
        assert imu == pytest.approx(expected, abs=1e-5)


def test_an_impact_is_in_the_mean():
    """Oracle: 0.1 m/s within a period are 25 m/s^2."""
    states = [standing_state().copy() for _ in range(2)]
    states[1][NQ + 3] += 0.1
    first, second = told(SensorParams(), states)
    assert first == pytest.approx([0, 0, 0, 0, 0, 9.81, 0, 0, 0])
    assert second[3:6] - first[3:6] == pytest.approx([25.0, 0.0, 0.0])


def test_noise_is_of_its_density_and_the_bias_stays():
    """Oracle: N / sqrt(T); a bias that all samples of a seed share."""
    measured = told(NOISE, [standing_state()] * 1000) - np.eye(9)[5] * 9.81
    again = told(NOISE, [standing_state()] * 3) - np.eye(9)[5] * 9.81
    assert np.array_equal(measured[:3], again)
    root, short = PERIOD**-0.5, SAMPLE**-0.5
    deviation = np.repeat([1e-3 * root, 0.02 * root, 1e-3 * short], 3)
    assert measured.std(axis=0) == pytest.approx(deviation, rel=4.0 / 2000**0.5)
    bias = measured.mean(axis=0)
    assert bias[:3] == pytest.approx(bias[6:], abs=0.006)
    assert 0.02 < np.max(np.abs(bias[:3])) < 0.4


def test_tells_no_more_than_its_range():
    """Oracle: the range."""
    sensors = SensorParams(gyro_range=1.0, force_range=5.0)
    measured = told(sensors, [carousel(1.5, i * PERIOD) for i in range(2)])[1]
    assert measured == pytest.approx([0, 0, 1, 0, 0, 5, 0, 0, 1], abs=1e-9)


def test_refuses_a_body_that_the_robot_lacks():
    with pytest.raises(ValueError, match="^imu_body = 'TAIL': must be a body"):
        Imu(nadia(), SensorParams(imu_body="TAIL"), PERIOD)
