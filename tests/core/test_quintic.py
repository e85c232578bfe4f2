"""Oracles: boundary values, finite differences, the integral of the jerk."""

import numpy as np
import pytest

from nadia_balance.core.quintic import STEP, end_beyond, quintic, time_to_pass

HORIZON = 0.6
TIMES = np.array([HORIZON])
# From and to anywhere, at any rate, and a point far from the straight way.
START = np.array([[0.0, 0.25], [0.3, -0.2], [2.0, 1.0]])
END = np.array([[0.35, -0.1], [0.1, 0.0], [0.0, -1.0]])
VIA, AT = np.array([0.28, 0.15]), 0.34


def jerk(start, end, duration):
    """Integral of the squared jerk, all axes.

    Exact but for rounding: the acceleration is a cubic, so that a difference
    of four points is its derivative, and three Gauss points integrate the
    square of that.
    """
    nodes, weights = np.polynomial.legendre.leggauss(3)
    t = 0.5 * duration * (1.0 + nodes)
    d = 0.04 * duration

    def acceleration(t):
        return quintic(start, end, np.array([duration]), t[:, None])[2]

    far = acceleration(t + 2.0 * d) - acceleration(t - 2.0 * d)
    near = acceleration(t + d) - acceleration(t - d)
    squared = np.sum(((8.0 * near - far) / (12.0 * d)) ** 2, axis=1)
    return 0.5 * duration * weights @ squared


def jerk_through(rates):
    """The cost of passing VIA at AT with the `rates` v, a, shape (2, 2)."""
    middle = np.vstack([VIA, rates])
    return jerk(START, middle, AT) + jerk(middle, END, HORIZON - AT)


def test_meets_both_ends():
    """Oracle: the boundary values."""
    rng = np.random.default_rng(0)
    start, end = rng.normal(size=(2, 3, 4))
    horizon = np.array([0.3, 0.5, 0.7, 0.9])
    for column, h in enumerate(horizon):
        arrived = quintic(start, end, horizon, h)[:, column]
        assert arrived == pytest.approx(end[:, column], abs=1e-9)
    begun = quintic(start, end, horizon, 0.0)
    assert begun == pytest.approx(start, abs=1e-12)


def test_rates_are_its_derivatives():
    """Oracle: central differences."""
    rng = np.random.default_rng(1)
    start, end = rng.normal(size=(2, 3, 4))
    horizon, step = np.full(4, 0.8), 1e-5
    before, here, after = (
        quintic(start, end, horizon, 0.3 + d) for d in (-step, 0.0, step)
    )
    rates = (after[:2] - before[:2]) / (2 * step)
    assert rates == pytest.approx(here[1:], abs=1e-6)


def test_many_times_are_each_of_them():
    """Oracle: one time after the other, to the last bit."""
    times = np.linspace(0.0, HORIZON, 7)
    at_once = quintic(START, END, TIMES, times[:, None])
    for k, t in enumerate(times):
        np.testing.assert_array_equal(
            at_once[:, k], quintic(START, END, TIMES, t)
        )


def test_passes_the_point_with_the_least_jerk():
    """Oracle: the cost does not change with the rates there, to first order.

    It is quadratic in the rates, so that central differences are exact; the
    changes are compared with those that a unit off the optimum would make.
    """
    aimed = end_beyond(START, END, HORIZON, VIA, AT)
    passing = quintic(START, aimed, TIMES, AT)
    assert passing[0] == pytest.approx(VIA, abs=1e-12)
    best = jerk_through(passing[1:])
    for k in range(4):
        unit = np.zeros(4)
        unit[k] = 1.0
        unit = unit.reshape(2, 2)
        up, down = (jerk_through(passing[1:] + s * unit) for s in (1, -1))
        curvature = up + down - 2.0 * best
        assert curvature > 0.0
        assert up - down == pytest.approx(0.0, abs=1e-9 * curvature)


def test_goes_on_the_same_when_started_again_before_the_point():
    """Oracle: Bellman's principle."""
    aimed = end_beyond(START, END, HORIZON, VIA, AT)
    now = quintic(START, aimed, TIMES, 0.2)
    again = end_beyond(now, END, HORIZON - 0.2, VIA, AT - 0.2)
    for t in 0.05, 0.14:
        restarted = quintic(now, again, TIMES - 0.2, t)
        whole = quintic(START, aimed, TIMES, 0.2 + t)
        assert restarted == pytest.approx(whole, rel=1e-9, abs=1e-9)


def test_passes_the_point_when_it_costs_least():
    """Oracle: the integral of the jerk, of all other times."""
    chosen = time_to_pass(START, END, HORIZON, VIA)

    def cost(t):
        aimed = end_beyond(START, END, HORIZON, VIA, t)
        middle = quintic(START, aimed, TIMES, t)
        return jerk(START, middle, t) + jerk(middle, END, HORIZON - t)

    others = [cost(n * STEP) for n in range(1, 60)]
    assert cost(chosen) <= min(others)
    assert 0.0 < chosen < HORIZON


def test_the_time_stays_the_same_on_the_way():
    """Oracle: Bellman's principle."""
    chosen = time_to_pass(START, END, HORIZON, VIA)
    aimed = end_beyond(START, END, HORIZON, VIA, chosen)
    for t in 0.002, 0.08, 0.157:
        now = quintic(START, aimed, TIMES, t)
        left = time_to_pass(now, END, HORIZON - t, VIA)
        assert left + t == pytest.approx(chosen, abs=1e-9)
