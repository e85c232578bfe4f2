"""Oracles: the closed backward recursion, and the pendulum's equation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.com_trajectory import (
    rows_at,
    segment_system,
    solve_segments,
)

OMEGA = 3.2


def backward_icp(durations, ecmp, omega):
    """The ICP at all knots, from the last one back (algorithm of [9])."""
    icp = [ecmp[-1]]
    for i in reversed(range(len(durations))):
        a, b, T = ecmp[i], ecmp[i + 1], durations[i]
        lead = (b - a) / (T * omega)
        icp.append(a + lead + np.exp(-omega * T) * (icp[-1] - b - lead))
    return np.array(icp[::-1])


@st.composite
def problems(draw):
    """Durations of 1 to 20 segments, an eCMP path, and a CoM."""
    n = draw(st.integers(1, 20))
    duration = st.floats(0.01, 2.0)
    random = np.random.default_rng(draw(st.integers(0, 10**6)))
    durations = np.array(draw(st.lists(duration, min_size=n, max_size=n)))
    return (
        durations,
        random.uniform(-1, 1, (n + 1, 2)),
        random.uniform(-1, 1, 2),
    )


@given(problems())
def test_the_icp_is_that_of_the_backward_recursion(problem):
    """Oracle: the closed recursion; both lose some 1e-16 times 1e4."""
    durations, ecmp, com = problem
    solution = solve_segments(durations, ecmp, com, OMEGA)
    icp = [
        rows_at(0.0, T, OMEGA)[1] @ c
        for T, c in zip(durations, solution, strict=True)
    ]
    expected = backward_icp(durations, ecmp, OMEGA)[:-1]
    np.testing.assert_allclose(icp, expected, atol=1e-10)


@pytest.mark.parametrize("duration", [1e-5, 1e-3, 1.0, 10.0, 100.0])
def test_very_short_and_very_long_segments_cost_little_accuracy(duration):
    """Oracle: the recursion, to the 1e-8 that planning needs."""
    durations = np.array([0.3, duration, 0.3, duration, 10.0])
    ecmp = np.array([0.0, 0.1, 0.3, 0.2, 0.4, 0.4])[:, None]
    solution = solve_segments(durations, ecmp, np.zeros(1), OMEGA)
    expected = backward_icp(durations, ecmp, OMEGA)
    for i, T in enumerate(durations):
        for t, icp in (0.0, expected[i]), (T, expected[i + 1]):
            found = rows_at(t, T, OMEGA)[1] @ solution[i]
            np.testing.assert_allclose(found, icp, atol=1e-8)


@given(problems())
def test_meets_every_condition_of_the_paper(problem):
    """Oracle: the conditions below Eq. 4, put in one by one."""
    durations, ecmp, com = problem
    solution = solve_segments(durations, ecmp, com, OMEGA)
    values = np.array(
        [
            [rows_at(t, T, OMEGA) @ c for t in (0.0, T)]
            for T, c in zip(durations, solution, strict=True)
        ]
    )  # (segment, start or end, CoM or ICP or eCMP, xy)
    exact = {"rtol": 0.0, "atol": 1e-10}
    np.testing.assert_allclose(values[0, 0, 0], com, **exact)
    np.testing.assert_allclose(values[:, 0, 2], ecmp[:-1], **exact)
    np.testing.assert_allclose(values[:, 1, 2], ecmp[1:], **exact)
    np.testing.assert_allclose(values[1:, 0, :2], values[:-1, 1, :2], **exact)
    np.testing.assert_allclose(values[-1, 1, 1], ecmp[-1], **exact)


@given(problems(), st.floats(0.1, 0.9))
def test_moves_as_the_pendulum_does(problem, fraction):
    """Oracle: ICP and acceleration by central differences of the CoM.

    With h = 1e-4 the second difference is good to 1e-16 / h^2 = 1e-8, times
    the size of the coefficients.
    """
    durations, ecmp, com = problem
    solution = solve_segments(durations, ecmp, com, OMEGA)
    h = 1e-4
    for T, c in zip(durations, solution, strict=True):
        t = fraction * T
        before, now, after = (
            rows_at(t + s * h, T, OMEGA) @ c for s in (-1, 0, 1)
        )
        velocity = (after[0] - before[0]) / (2.0 * h)
        acceleration = (after[0] - 2.0 * now[0] + before[0]) / h**2
        np.testing.assert_allclose(now[1], now[0] + velocity / OMEGA, atol=1e-6)
        np.testing.assert_allclose(
            now[2], now[0] - acceleration / OMEGA**2, atol=1e-6
        )


@given(
    st.lists(st.floats(-1, 1), min_size=6, max_size=6),
    st.floats(0.1, 1.5),
    st.floats(0.0, 1.0),
)
def test_the_rows_hold_for_cubic_segments_too(coefficients, T, fraction):
    """Oracle: Eq. 4 as documented, with its derivatives taken by hand."""
    c, t, w = np.array(coefficients), fraction * T, OMEGA
    growing = c[0] * np.exp(w * (t - T))
    decaying = c[1] * np.exp(-w * t)
    cubic = np.polynomial.Polynomial(c[:1:-1])
    com = growing + decaying + cubic(t)
    velocity = w * (growing - decaying) + cubic.deriv(1)(t)
    acceleration = w**2 * (growing + decaying) + cubic.deriv(2)(t)
    expected = [com, com + velocity / w, com - acceleration / w**2]
    np.testing.assert_allclose(rows_at(t, T, w) @ c, expected, atol=1e-13)


@given(
    st.lists(st.floats(-1, 1), min_size=12, max_size=12),
    st.floats(0.1, 1.5),
    st.floats(0.1, 1.5),
)
def test_the_system_says_the_same_as_the_rows(coefficients, T0, T1):
    """Oracle: rows_at() for two cubic segments; slopes of the cubic eCMP."""
    c = np.array(coefficients).reshape(2, 6)
    system = segment_system(np.array([T0, T1]), OMEGA)
    found = np.einsum("abcd,cd->ab", system, c)
    starts = [
        rows_at(0.0, T, OMEGA) @ x for T, x in zip([T0, T1], c, strict=True)
    ]
    ends = [rows_at(T, T, OMEGA) @ x for T, x in zip([T0, T1], c, strict=True)]

    def slope(x, t):
        cubic = np.polynomial.Polynomial(x[:1:-1])
        return cubic.deriv(1)(t) - cubic.deriv(3)(t) / OMEGA**2

    def velocity(values):
        return OMEGA * (values[1] - values[0])

    expected = [
        [starts[0][2], slope(c[0], 0.0), ends[0][2], slope(c[0], T0)],
        [starts[1][2], slope(c[1], 0.0), ends[1][2], slope(c[1], T1)],
    ]
    expected[0] += [
        ends[0][0] - starts[1][0],
        velocity(ends[0]) - velocity(starts[1]),
    ]
    expected[1] += [ends[1][1], starts[0][0]]
    np.testing.assert_allclose(found, expected, atol=1e-12)


@given(problems())
def test_the_ecmp_is_linear(problem):
    """Oracle: linear interpolation; the cubic terms must vanish."""
    durations, ecmp, com = problem
    solution = solve_segments(durations, ecmp, com, OMEGA)
    for i, T in enumerate(durations):
        for s in 0.25, 0.5, 0.75:
            found = rows_at(s * T, T, OMEGA)[2] @ solution[i]
            expected = (1 - s) * ecmp[i] + s * ecmp[i + 1]
            np.testing.assert_allclose(found, expected, atol=1e-11)


def test_is_well_conditioned_for_a_walk_of_three_steps():
    """Oracle: numpy's condition number; counted from 0 it is above 1e13."""
    step = [0.15, 0.15, 0.2975, 0.2975, 0.105]
    durations = np.array(3 * step + [0.4, 0.4, 10.0])
    size = 6 * len(durations)
    matrix = segment_system(durations, OMEGA).reshape(size, size)
    assert np.linalg.cond(matrix) < 1e7
