"""Oracles: numerical integration, and the definitions by hand."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nadia_balance.core.math import lipm

OMEGA = 3.1
COM, VELOCITY = np.array([0.1, -0.2]), np.array([0.4, 0.3])
ECMP = np.array([0.15, 0.05])


def integrate(t):
    """CoM and velocity (2, 2) after `t`, of xddot = omega^2 (x - r)."""

    def rate(_, state):
        return np.concatenate([state[2:], OMEGA**2 * (state[:2] - ECMP)])

    start = np.concatenate([COM, VELOCITY])
    found = solve_ivp(rate, (0.0, t), start, rtol=1e-12, atol=1e-14)
    return found.y[:, -1].reshape(2, 2)


@pytest.mark.parametrize("height", [0.0, -1.0, math.nan])
def test_refuses_a_height_that_is_none(height):
    """Oracle: the message names the field and the value."""
    with pytest.raises(ValueError, match=f"com_height = {height}: must be > 0"):
        lipm.natural_frequency(height)


@pytest.mark.parametrize("t", [-0.4, 0.0, 0.7])
def test_com_and_icp_move_as_integrated(t):
    """Oracle: RK45, to 1e-12; also backward in time."""
    com, velocity = lipm.com_after(COM, VELOCITY, ECMP, OMEGA, t)
    np.testing.assert_allclose([com, velocity], integrate(t), atol=1e-11)
    icp = lipm.icp_after(lipm.icp(COM, VELOCITY, OMEGA), ECMP, OMEGA, t)
    com, velocity = integrate(t)
    assert icp == pytest.approx(com + velocity / OMEGA, abs=1e-11)
