"""Oracles: quadprog, of Eqs. 20 to 22 with delta eliminated; formulas."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import quadprog

from nadia_balance.core.feedback import icp_step_qp
from nadia_balance.core.math.bounds import check
from nadia_balance.core.math.polygon import convex_hull, halfspaces
from nadia_balance.core.walking.vocabulary import FootPose

PARAMS = icp_step_qp.IcpStepQpParams()
GAIN = PARAMS.feedback_gain


class StepProblem(NamedTuple):
    """The arguments of IcpStepQp, but for the weights."""

    error: np.ndarray
    cmp: np.ndarray
    moves: np.ndarray
    cmp_room: tuple
    step_room: tuple


def matrix(rng, size):
    """A random weight about `size`, of any direction."""
    L = rng.normal(size=(2, 2)) + 2.0 * np.eye(2)
    return size * L @ L.T / 5.0


def polygon(rng, size):
    return convex_hull(rng.uniform(-size, size, (8, 2)))


def case(seed):
    """A random problem of 1 to 4 steps, of either kind, and its weights."""
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
    weights = icp_step_qp.StepWeights(
        matrix(rng, 10.0), matrix(rng, 1.0), matrix(rng, 1e4)
    )
    return problem, weights


def by_quadprog(problem, weights, gain):
    """Steps (n, 2) and eta (2,), delta = k (e - G x) with x = (steps, eta)."""
    n = problem.moves.shape[1]
    icp_moves, cmp_moves = problem.moves
    G = np.hstack([np.kron(icp_moves, np.eye(2)), np.eye(2)])
    H = np.zeros((2 * n + 2, 2 * n + 2))
    H[:-2, :-2] = np.kron(np.eye(n), weights.step)
    H[-2:, -2:] = weights.slack
    H += gain**2 * G.T @ weights.feedback @ G
    g = -(gain**2) * G.T @ weights.feedback @ problem.error
    (A_c, b_c), (A_s, b_s) = problem.cmp_room, problem.step_room
    shift = np.hstack([np.kron(cmp_moves, np.eye(2)), np.zeros((2, 2))])
    rows = np.vstack(
        [A_c @ (shift - gain * G), np.hstack([A_s, np.zeros((len(b_s), 2))])]
    )
    delta_0 = problem.cmp + gain * problem.error
    bounds = np.concatenate([b_c - A_c @ delta_0, b_s])
    x = quadprog.solve_qp(H, -g, -rows.T, -bounds)[0]
    return x[:-2].reshape(n, 2), x[-2:]


def solve(problem, weights, **changes):
    params = replace(PARAMS, num_steps=4, **changes)
    qp = icp_step_qp.IcpStepQp(params)
    *arguments, cmp_room, step_room = problem
    limits = qp.limits(weights, cmp_room, step_room)
    return qp.solve(*arguments, limits)


@pytest.mark.parametrize("seed", range(25))
def test_finds_what_another_solver_finds(seed):
    """Oracle: quadprog; a solver of four steps, of which 1 to 4 are used."""
    problem, weights = case(seed)
    found, result = solve(problem, weights)
    assert result.solved
    steps, slack = by_quadprog(problem, weights, GAIN)
    assert found == pytest.approx(steps, abs=1e-10)
    assert result.x[-2:] == pytest.approx(slack, abs=1e-10)


@pytest.mark.parametrize("seed", range(8))
def test_with_its_footholds_the_feedback_alone_is_the_same(seed):
    """Oracle: Eq. 19 with the QP's optimum, whose parts are optimal."""
    rng = np.random.default_rng(seed)
    problem, weights = case(seed)
    room = polygon(rng, 0.2)
    problem = problem._replace(cmp_room=halfspaces(room))
    steps, result = solve(problem, weights)
    icp, cmp = problem.moves @ steps
    expected = GAIN * (problem.error - icp - result.x[-2:])
    ankles = icp_step_qp.AnkleFeedback(room, weights, GAIN)
    delta = ankles.delta(problem.error - icp, problem.cmp + cmp)
    assert delta == pytest.approx(expected, abs=1e-10)


def test_weights_turn_with_the_stance_foot():
    """Oracle: v' Q_W v = u' Q u, with v = R u."""
    params = replace(PARAMS, step_weight=[[7.0, 1.0], [1.0, 2.0]])
    stance, u = FootPose([1.0, 2.0, 0.0], 0.7), np.array([0.3, -0.2])
    v = stance.rotation @ u
    found = icp_step_qp.StepWeights.of(params, stance).step
    assert v @ found @ v == pytest.approx(u @ params.step_weight @ u)


@pytest.mark.parametrize(
    "weight",
    [
        [],
        [[1.0, 0.0]],
        [[1.0, 0.0], [0.0, -1.0]],
        [[1.0, 2.0], [2.0, 1.0]],
        [[1.0, 0.5], [0.0, 1.0]],
    ],
)
def test_refuses_what_is_no_weight(weight):
    """Oracle: the field, its value, what is allowed."""
    params = replace(PARAMS, slack_weight=weight)
    with pytest.raises(ValueError, match="slack_weight = "):
        check(params)
