"""Oracles: SciPy's Riccati equation, moments of the noise, by hand."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from nadia_balance.core.estimation.motion_filter import (
    ACCELERATION_ERROR,
    LARGE,
    motion_filter,
)

T = 0.004
# A joint, the rate of a gyro, a velocity without noise.
NOISE = np.array([[1e-3, np.inf, np.inf], [0.05, 5.5e-3, 0.0]])
A, G = np.array([[1.0, T], [0.0, 1.0]]), np.array([0.5 * T * T, T])
Q = ACCELERATION_ERROR**2 * np.outer(G, G)


def test_its_gain_is_that_of_the_steady_kalman_filter():
    """Oracle: the solution of the Riccati equation, if all is measured."""
    R = np.diag(NOISE[:, 0] ** 2)
    P = solve_discrete_are(A.T, np.eye(2), Q, R)
    expected = P @ np.linalg.inv(P + R)
    gain = motion_filter(NOISE, T).gain
    assert gain[:, :, 0] == pytest.approx(expected, rel=1e-6)
    # Of a rate alone: p = p r / (p + r) + q, in closed form.
    q, r = Q[1, 1], NOISE[1, 1] ** 2
    p = 0.5 * (q + np.sqrt(q * q + 4.0 * q * r))
    assert gain[1, :, 1] == pytest.approx([0.0, p / (p + r)], rel=1e-6)
    assert gain[1, :, 2] == pytest.approx([0.0, 1.0])


def test_errors_are_those_of_a_kalman_filter():
    """Oracle: P of the Riccati equation, in 4,000 ticks of true noise."""
    rng, n = np.random.default_rng(3), 4000
    R = np.diag(NOISE[:, 0] ** 2)
    P = solve_discrete_are(A.T, np.eye(2), Q, R)
    P = P - P @ np.linalg.inv(P + R) @ P
    joint = motion_filter(NOISE[:, :1], T)
    truth, told, errors = np.zeros((2, 1)), np.zeros((2, 1)), []
    for i in range(n):
        a = np.sin(0.01 * i)
        truth = A @ truth + np.outer(
            G, a + ACCELERATION_ERROR * rng.normal(size=1)
        )
        expected = A @ told + np.outer(G, [a])
        noise = NOISE[:, :1] * rng.normal(size=(2, 1))
        told = joint.corrected(expected, truth + noise)
        errors.append((told - truth)[:, 0])
    # Neighbours are alike: 20 ticks are worth one.
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms == pytest.approx(
        np.sqrt(np.diag(P)), rel=3.0 / (2 * n / 20) ** 0.5
    )


def test_what_is_more_than_noise_is_believed_at_once():
    """Oracle: by hand: the filter is never more than the noise behind."""
    joint = motion_filter(NOISE[:, :1], T)
    still = np.zeros((2, 1))
    bound = LARGE * NOISE[1, 0]
    for speed in -3.0, -1.01 * bound, 0.99 * bound, 1.0:
        told = joint.corrected(still, np.array([[0.0], [speed]]))
        k = joint.gain[1, 1, 0]
        within = np.clip(speed, -bound, bound)
        assert told[1, 0] == pytest.approx(k * within + speed - within)
        assert abs(told[1, 0] - speed) <= bound
