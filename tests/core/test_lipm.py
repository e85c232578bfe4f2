"""Oracles: numerical integration, and the definitions by hand."""

import math

import numpy as np
import pytest

from nadia_balance.core.lipm import (
    com_after,
    icp,
    icp_after,
    natural_frequency,
)

OMEGA = 3.1
COM, VELOCITY = np.array([0.1, -0.2]), np.array([0.4, 0.3])
ECMP = np.array([0.15, 0.05])


def integrate(t, steps=1000):
    """CoM and velocity after `t`, by RK4 of xddot = omega^2 (x - r)."""

    def rate(state):
        return np.array([state[1], OMEGA**2 * (state[0] - ECMP)])

    state, h = np.array([COM, VELOCITY]), t / steps
    for _ in range(steps):
        k1 = rate(state)
        k2 = rate(state + 0.5 * h * k1)
        k3 = rate(state + 0.5 * h * k2)
        k4 = rate(state + h * k3)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


def test_the_natural_frequency_of_one_metre():
    """Oracle: the square root of 9.81, by hand."""
    assert natural_frequency(1.0) == pytest.approx(3.1320919526731650)
    assert natural_frequency(4.0, gravity=1.0) == pytest.approx(0.5)


@pytest.mark.parametrize("height", [0.0, -1.0, math.nan])
def test_refuses_a_height_that_is_none(height):
    """Oracle: the message names the field and the value."""
    with pytest.raises(ValueError, match=f"com_height = {height}: must be > 0"):
        natural_frequency(height)


@pytest.mark.parametrize("t", [-0.4, 0.0, 0.7])
def test_com_and_icp_move_as_integrated(t):
    """Oracle: RK4; its error at h = 0.7 ms is below 1e-11."""
    com, velocity = com_after(COM, VELOCITY, ECMP, OMEGA, t)
    np.testing.assert_allclose([com, velocity], integrate(t), atol=1e-11)
    np.testing.assert_allclose(
        icp_after(icp(COM, VELOCITY, OMEGA), ECMP, OMEGA, t),
        icp(com, velocity, OMEGA),
        rtol=0.0,
        atol=1e-14,
    )


def test_the_icp_of_a_com_at_rest_is_the_com():
    """Oracle: Eq. 1 with no velocity."""
    np.testing.assert_array_equal(icp(COM, np.zeros(2), OMEGA), COM)


def test_an_icp_on_the_ecmp_stays_there():
    """Oracle: Eq. 2 vanishes."""
    np.testing.assert_array_equal(icp_after(ECMP, ECMP, OMEGA, 2.0), ECMP)
