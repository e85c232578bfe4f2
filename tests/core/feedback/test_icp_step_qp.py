"""Oracles: quadprog, of Eqs. 20 to 22 with delta eliminated; formulas."""

from typing import NamedTuple

import numpy as np
import pytest
import quadprog

from nadia_balance.core.feedback import icp_step_qp
from nadia_balance.core.math.polygon import convex_hull, halfspaces

GAIN = icp_step_qp.IcpStepQpParams().feedback_gain


class StepProblem(NamedTuple):
    """The arguments of IcpStepQp, but for the weights."""

    error: np.ndarray
    cmp: np.ndarray
    moves: np.ndarray
    cmp_room: tuple
    step_room: tuple


def polygon(rng, size):
    return convex_hull(rng.uniform(-size, size, (8, 2)))


def case(seed):
    """A random problem of 1 to 4 steps, of either kind, and its parameters."""
    rng = np.random.default_rng(seed)
    n, swinging = int(rng.integers(1, 5)), rng.random() < 0.5
    gammas = rng.uniform(0.03, 0.3) * 0.1 ** np.arange(n)
    moves = np.array([gammas, gammas * (0.0 if swinging else rng.normal())])
    rows, bounds = [], []
    for i in range(n):  # each foothold within reach of the one before it
        A, b = halfspaces(polygon(rng, 0.5) + rng.uniform(-0.2, 0.2, 2))
        row = np.zeros((len(b), n, 2))
        row[:, i] = A
        if i > 0:
            row[:, i - 1] = -A
        rows.append(row.reshape(len(b), 2 * n))
        bounds.append(b)
    problem = StepProblem(
        rng.uniform(-0.15, 0.15, 2),
        rng.uniform(-0.05, 0.05, 2),
        moves,
        halfspaces(polygon(rng, 0.15 if swinging else 0.3)),
        (np.vstack(rows), np.concatenate(bounds)),
    )
    step, feedback, slack = rng.uniform(0.2, 5.0, 3) * [10.0, 1.0, 1e4]
    return problem, icp_step_qp.IcpStepQpParams(
        num_steps=4,
        step_weight=step,
        feedback_weight=feedback,
        slack_weight=slack,
    )


def by_quadprog(problem, params, gain):
    """Steps (n, 2) and eta (2,), delta = k (e - G x) with x = (steps, eta)."""
    n = problem.moves.shape[1]
    icp_moves, cmp_moves = problem.moves
    G = np.hstack([np.kron(icp_moves, np.eye(2)), np.eye(2)])
    H = params.step_weight * np.eye(2 * n + 2)
    H[-2:, -2:] = params.slack_weight * np.eye(2)
    H += params.feedback_weight * gain**2 * G.T @ G
    g = -params.feedback_weight * gain**2 * G.T @ problem.error
    (A_c, b_c), (A_s, b_s) = problem.cmp_room, problem.step_room
    shift = np.hstack([np.kron(cmp_moves, np.eye(2)), np.zeros((2, 2))])
    rows = np.vstack(
        [A_c @ (shift - gain * G), np.hstack([A_s, np.zeros((len(b_s), 2))])]
    )
    delta_0 = problem.cmp + gain * problem.error
    bounds = np.concatenate([b_c - A_c @ delta_0, b_s])
    x = quadprog.solve_qp(H, -g, -rows.T, -bounds)[0]
    return x[:-2].reshape(n, 2), x[-2:]


def solve(problem, params):
    return icp_step_qp.IcpStepQp(params).solve(*problem)


@pytest.mark.parametrize("seed", range(25))
def test_finds_what_another_solver_finds(seed):
    """Oracle: quadprog; a solver of four steps, of which 1 to 4 are used."""
    problem, params = case(seed)
    shifts, result = solve(problem, params)
    assert result.solved
    steps, slack = by_quadprog(problem, params, GAIN)
    assert shifts == pytest.approx(steps, abs=1e-10)
    assert result.x[-2:] == pytest.approx(slack, abs=1e-10)


@pytest.mark.parametrize("seed", range(8))
def test_with_its_footholds_the_feedback_alone_is_the_same(seed):
    """Oracle: Eq. 19 with the QP's optimum, whose parts are optimal."""
    rng = np.random.default_rng(seed)
    problem, params = case(seed)
    room = polygon(rng, 0.2)
    problem = problem._replace(cmp_room=halfspaces(room))
    steps, result = solve(problem, params)
    icp, cmp = problem.moves @ steps
    expected = GAIN * (problem.error - icp - result.x[-2:])
    left = problem.error - icp
    delta = icp_step_qp.ankle_feedback(left, problem.cmp + cmp, room, params)
    assert delta == pytest.approx(expected, abs=1e-10)
