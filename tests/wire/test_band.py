"""A band holds a hanging robot, sets it down and lifts it again."""

import numpy as np
import pytest

from nadia_balance.wire.band import Band

MASS, HEIGHT, DT = 33.0, 1.15, 0.001


def falling(band: Band, p, v, seconds: float, is_stiff: bool):
    """A point mass on the band, which lets go below its height."""
    for _ in range(round(seconds / DT)):
        band.advance(is_stiff, DT)
        acceleration = band.force(p, v) / MASS - [0.0, 0.0, 9.81]
        v = v + DT * acceleration
        p = p + DT * v
    return p, v


def test_holds_a_mass_clear_of_the_ground():
    """Oracle: equilibrium, with the soles CLEARANCE above the ground."""
    p, v = falling(
        Band(MASS, HEIGHT),
        p=np.array([0.2, -0.1, HEIGHT]),
        v=np.array([0.3, 0.0, -0.5]),
        seconds=5.0,
        is_stiff=False,
    )
    np.testing.assert_allclose(p, [0.2, -0.1, HEIGHT + 0.03], atol=1e-3)
    np.testing.assert_allclose(v, 0.0, atol=1e-3)


def test_sets_down_a_robot_that_is_stiff_and_lifts_one_that_is_not():
    """Oracle: by hand: 2.5 s, then a second; half a second up."""
    band = Band(MASS, HEIGHT)
    p, v = np.array([0.0, 0.0, HEIGHT]), np.zeros(3)
    for _ in range(3000):
        band.advance(True, DT)
    assert band.hold == pytest.approx(0.5, abs=2 * DT)
    assert 0.0 < band.force(p, v)[2] < MASS * 9.81
    for _ in range(600):
        band.advance(True, DT)
    assert band.is_slack
    assert not band.force(p, v).any()
    band.advance(False, DT)
    assert not band.is_slack
    low = np.array([1.0, 2.0, 0.5])
    np.testing.assert_allclose(band.force(low, v)[:2], 0.0)  # above it
    p, _ = falling(band, low, v, seconds=5.0, is_stiff=False)
    np.testing.assert_allclose(p, [1.0, 2.0, HEIGHT + 0.03], atol=1e-3)


def test_one_that_does_not_catch_lets_a_robot_lie():
    """But does not drop one that has never stood."""
    band = Band(MASS, HEIGHT, catches=False)
    for is_stiff in [True] * 3000 + [False] * 1000:
        band.advance(is_stiff, DT)
    assert band.hold == 1.0
    for is_stiff in [True] * 4000 + [False] * 1000:
        band.advance(is_stiff, DT)
    assert band.is_slack
