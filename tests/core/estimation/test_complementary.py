"""Oracles: closed forms of the filter's linear equations."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from nadia_balance.core.estimation import complementary
from nadia_balance.core.estimation.complementary import (
    PLACE,
    SPEED,
    TILT,
    Complementary,
    gravity_direction,
)
from nadia_balance.core.estimation.invariant_ekf import Legs, skew
from nadia_balance.core.estimation.sensors import SensorParams

T, UP = 0.004, np.array([0.0, 0.0, 9.81])
BOTH, NONE = np.array([True, True]), np.array([False, False])
FILTER = Complementary(SensorParams(), T)
# Soles 0.9 m below an IMU that does not move, level and straight on.
STILL = Legs(
    np.array([[0.0, 0.1, -0.9], [0.0, -0.1, -0.9]]),
    np.array([np.eye(3), np.eye(3)]),
    np.zeros((2, 6, 1)),
    np.zeros((2, 3)),
)


def standing(R=None):
    """At the origin, on both soles."""
    R = np.eye(3) if R is None else R
    state = FILTER.begin(R, np.zeros(3), np.zeros((3, 3)))
    for i in (0, 1):
        state = FILTER.touch(state, i, STILL)
    return state


def test_gravity_tells_tilt_and_the_gyros_bias():
    """Oracle: e' = -TILT e - b, b' = TILT^2 / 4 e, from e = 0 and b."""
    bias, ticks = np.array([0.002, -0.001, 0.0]), 5000
    state = standing()
    for k in range(ticks):
        t = k * T
        expected = -bias * t * math.exp(-0.5 * TILT * t)
        tilt = np.array((state.R[2, 1], -state.R[2, 0]))
        # To first order in tilt, and in the period.
        assert tilt == pytest.approx(-expected[:2], abs=2e-5)
        state = FILTER.predict(state, np.concatenate((bias, UP)))
    left = (1.0 + 0.5 * TILT * ticks * T) * math.exp(-0.5 * TILT * ticks * T)
    assert state.bias[0] == pytest.approx(bias * (1.0 - left), abs=1e-5)


def test_a_free_fall_tells_no_tilt():
    """Oracle: the gyro alone; without rotation nothing turns."""
    up, state = np.array([0.6, 0.0, 0.8]), standing()
    for force in np.zeros(3), np.array([0.5, 0.0, 0.0]):
        imu = np.concatenate((np.zeros(3), force))
        assert gravity_direction(up, imu, T).tolist() == up.tolist()
    fallen = FILTER.predict(state, np.zeros(6))
    assert fallen.R.tolist() == state.R.tolist()
    assert fallen.x[0] == pytest.approx(-UP * T)


def test_feet_tell_the_velocity_and_the_place():
    """Oracle: a geometric sum, of an accelerometer that is wrong upward."""
    wrong, state = np.array([0.0, 0.0, 0.05]), standing()
    left = math.exp(-SPEED * T)
    for k in range(50):
        expected = 0.05 * T * left * (1.0 - left**k) / (1.0 - left)
        assert state.x[0] == pytest.approx((0.0, 0.0, expected), abs=1e-12)
        state = FILTER.predict(state, np.concatenate((np.zeros(3), UP + wrong)))
        state = FILTER.correct(state, BOTH, STILL)
    assert 0.0 < state.x[1, 2] < 0.05 / SPEED / PLACE


def test_a_body_that_swings_over_its_foot_has_that_velocity():
    """Oracle: v = -R (w x p + p') in any pose, at once by a gain of 1."""
    R, w = expm(skew(np.array([0.1, -0.2, 0.5]))), np.array([0.3, 0.4, -0.2])
    own = np.array([0.5, -0.1, 0.2])  # by the joints alone
    legs = STILL._replace(v=np.cross(w, STILL.p) + own)
    bias = np.array([[0.01, -0.02, 0.03], [0.0, 0.0, 0.0]])
    state = standing(R)._replace(bias=bias)
    one = np.array([True, False])
    found = FILTER.correct(state, one, legs).x[0]
    expected = -R @ (np.cross(w - bias[0], STILL.p[0]) + own)
    share = 1.0 - math.exp(-SPEED * T)
    assert found == pytest.approx(share * expected, abs=1e-12)
    assert FILTER.correct(state, NONE, legs) is state


def test_soles_hold_the_place_and_the_heading():
    """Oracle: what is off decays by PLACE; a landing moves nothing."""
    state, share = standing(), math.exp(-PLACE * T)
    turn = expm(skew(np.array([0.0, 0.0, 0.02])))
    x = state.x.copy()
    x[1] = 0.01, -0.02, 0.03
    found = FILTER.correct(state._replace(x=x, R=turn), BOTH, STILL)
    assert found.R[1, 0] == pytest.approx(0.02 * share, abs=1e-5)
    off = found.x[1] - np.mean(state.x[2:] - STILL.p @ turn.T, axis=0)
    assert off == pytest.approx(share * x[1], abs=1e-12)
    raised = FILTER.level(found, 1, 0.1, STILL)
    assert raised.x[3, 2] == pytest.approx(0.1)
    assert raised.x[1:] - found.x[1:] == pytest.approx(
        np.tile((0.0, 0.0, 1.0), (3, 1)), abs=1e-12
    )
    assert np.diag(found.cov)[:9:3] == pytest.approx(
        np.square(complementary.ERROR)
    )
