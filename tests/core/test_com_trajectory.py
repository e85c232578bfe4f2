"""Oracles: the paper's linear system, and the pendulum's equation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.com_trajectory import rows_at, solve_segments

OMEGA = 3.2


def rows_with_rates(t, durations):
    """Rows (n, 6) for CoM, its velocity, eCMP and its velocity at t (n,)."""
    zero, one, w = 0.0 * t, 1.0 + 0.0 * t, OMEGA
    grow, decay = np.exp(w * (t - durations)), np.exp(-w * t)
    com = [grow, decay, t**3, t**2, t, one]
    velocity = [w * grow, -w * decay, 3.0 * t**2, 2.0 * t, one, zero]
    acceleration = [w**2 * grow, w**2 * decay, 6.0 * t, 2.0 * one, zero, zero]
    jerk = [w**3 * grow, -(w**3) * decay, 6.0 * one, zero, zero, zero]
    com, velocity, acceleration, jerk = (
        np.stack(rows, axis=1) for rows in (com, velocity, acceleration, jerk)
    )
    return com, velocity, com - acceleration / w**2, velocity - jerk / w**2


def paper_system(durations, ecmp, com_start):
    """The 6N x 6N system below Eq. 4 and its right-hand side (6N, k)."""
    n = len(durations)
    com_0, velocity_0, ecmp_0, slope_0 = rows_with_rates(
        0.0 * durations, durations
    )
    com_T, velocity_T, ecmp_T, slope_T = rows_with_rates(durations, durations)
    system, values = np.zeros((n, 6, n, 6)), np.zeros((n, 6, ecmp.shape[1]))
    i, j = np.arange(n), np.arange(n - 1)
    system[i, 0, i], system[i, 1, i] = ecmp_0, slope_0
    system[i, 2, i], system[i, 3, i] = ecmp_T, slope_T
    system[j, 4, j], system[j, 4, j + 1] = com_T[:-1], -com_0[1:]
    system[j, 5, j], system[j, 5, j + 1] = velocity_T[:-1], -velocity_0[1:]
    system[-1, 4, -1] = com_T[-1] + velocity_T[-1] / OMEGA
    system[-1, 5, 0] = com_0[0]
    slope = (ecmp[1:] - ecmp[:-1]) / durations[:, None]
    values[:, 0], values[:, 1] = ecmp[:-1], slope
    values[:, 2], values[:, 3] = ecmp[1:], slope
    values[-1, 4], values[-1, 5] = ecmp[-1], com_start
    return system.reshape(6 * n, 6 * n), values.reshape(6 * n, -1)


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
def test_is_the_solution_of_the_papers_system(problem):
    """Oracle: what is left of its 6N equations; some 1e-16 times 1e2.

    The matrix is regular, so that there is no other solution.
    """
    durations, ecmp, com = problem
    system, values = paper_system(durations, ecmp, com)
    found = solve_segments(durations, ecmp, com, OMEGA).reshape(len(system), 2)
    np.testing.assert_allclose(system @ found, values, rtol=0.0, atol=1e-12)
    assert np.linalg.cond(system) < 1e10


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
