"""Oracles: quadprog, of Eqs. 20 to 22 with delta eliminated; KKT; formulas."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import quadprog
from scipy.linalg import block_diag
from scipy.optimize import nnls

from nadia_balance.core.feedback import icp_step_qp
from nadia_balance.core.math.polygon import convex_hull, halfspaces
from nadia_balance.core.walking.state import FootPose, Side
from nadia_balance.parameters.bounds import check
from tests.example_walks import walk

PARAMS = icp_step_qp.IcpStepQpParams(num_steps=4)
GAIN = PARAMS.feedback_gain


class StepProblem(NamedTuple):
    """The arguments of IcpStepQp."""

    error: np.ndarray
    cmp: np.ndarray
    moves: np.ndarray
    cmp_room: tuple
    step_room: tuple
    weights: icp_step_qp.StepWeights


def polygon(rng, size):
    return convex_hull(rng.uniform(-size, size, (8, 2)))


def weights(rng, ranks):
    """Random ones of four steps, of these ranks; of eta and delta."""
    steps = []
    for rank in ranks:
        root = rng.uniform(1.0, 7.0) * rng.normal(size=(2, rank))
        steps.append(root @ root.T)
    slack, feedback = rng.uniform(0.5, 2.0, (2, 2, 2))
    slack = 1e4 * (slack @ slack.T + 0.1 * np.eye(2))
    return icp_step_qp.StepWeights(
        costs=block_diag(*steps, slack), R=feedback @ feedback.T
    )


def case(seed, ranks=(1, 2, 2, 2)):
    """A random problem of 1 to 4 steps, of either kind."""
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
    return StepProblem(
        rng.uniform(-0.15, 0.15, 2),
        rng.uniform(-0.05, 0.05, 2),
        moves,
        halfspaces(polygon(rng, 0.15 if swinging else 0.3)),
        (np.vstack(rows), np.concatenate(bounds)),
        weights(rng, ranks),
    )


def program(problem):
    """H, g, A, b of the cost and of A x <= b, x = (steps, eta), without delta.

    delta = k (e - G x).
    """
    n = problem.moves.shape[1]
    icp_moves, cmp_moves = problem.moves
    G = np.hstack([np.kron(icp_moves, np.eye(2)), np.eye(2)])
    costs, R = problem.weights
    kept = [*range(2 * n), *range(len(costs) - 2, len(costs))]
    H = costs[np.ix_(kept, kept)] + GAIN**2 * G.T @ R @ G
    g = -(GAIN**2) * G.T @ R @ problem.error
    (A_c, b_c), (A_s, b_s) = problem.cmp_room, problem.step_room
    shift = np.hstack([np.kron(cmp_moves, np.eye(2)), np.zeros((2, 2))])
    rows = np.vstack(
        [A_c @ (shift - GAIN * G), np.hstack([A_s, np.zeros((len(b_s), 2))])]
    )
    delta_0 = problem.cmp + GAIN * problem.error
    return H, g, rows, np.concatenate([b_c - A_c @ delta_0, b_s])


def solve(problem):
    """The optimum x = (steps, eta)."""
    shifts, result = icp_step_qp.IcpStepQp(PARAMS).solve(*problem)
    assert result.solved and not result.fallback
    return np.append(shifts, result.x[-2:])


@pytest.mark.parametrize("seed", range(25))
def test_finds_what_another_solver_finds(seed):
    """Oracle: quadprog; a solver of four steps, of which 1 to 4 are used.

    No weight is diagonal, and that of the first step is singular.
    """
    problem = case(seed)
    H, g, A, b = program(problem)
    expected = quadprog.solve_qp(H, -g, -A.T, -b)[0]
    assert solve(problem) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("ranks", [(1, 1, 1, 1), (0, 1, 0, 2)], ids=str)
def test_weights_may_be_singular(ranks):
    """Oracle: the KKT conditions, with non-negative least squares.

    There may be several optima: quadprog refuses such a cost.  DAQP iterates
    until the slope of 1e4 is 1e-6.
    """
    for seed in range(10):
        problem = case(seed, ranks)
        H, g, A, b = program(problem)
        x = solve(problem)
        assert (A @ x - b).max() < 1e-9
        active = A[A @ x - b > -1e-7]
        slope = H @ x + g
        if len(active):
            slope += active.T @ nnls(active.T, -slope)[0]
        assert np.abs(slope).max() < 2e-6


@pytest.mark.parametrize("seed", range(8))
def test_with_its_footholds_the_feedback_alone_is_the_same(seed):
    """Oracle: Eq. 19 with the QP's optimum, whose parts are optimal."""
    room = polygon(np.random.default_rng(seed), 0.2)
    problem = case(seed)._replace(cmp_room=halfspaces(room))
    x = solve(problem)
    icp, cmp = problem.moves @ x[:-2].reshape(-1, 2)
    left = problem.error - icp
    ankles = icp_step_qp.ankle_feedback(room, problem.weights, GAIN)
    expected = GAIN * (left - x[-2:])
    assert ankles.delta(left, problem.cmp + cmp) == pytest.approx(
        expected, abs=1e-9
    )


@pytest.mark.parametrize("side", Side)
def test_weights_turn_with_the_feet(side):
    """Oracle: the cost of a shift as it is seen from the foot's own sole.

    x is forward, y toward the swing side; the last weight that is given holds
    for all steps after it.
    """
    one, two = [[4.0, 1.5], [1.5, 9.0]], [[2.0, -1.0], [-1.0, 1.0]]
    feedback, slack = [[1.0, 0.5], [0.5, 0.3]], [[900.0, 30.0], [30.0, 400.0]]
    params = replace(
        PARAMS,
        num_steps=3,
        step_weights=[one, two],
        feedback_weight=feedback,
        slack_weight=slack,
    )
    stance, steps = FootPose(yaw=-0.7), walk(turn=0.4).footsteps
    steps = tuple(
        replace(step, side=swing)
        for step, swing in zip(steps, (side, side.other, side), strict=True)
    )
    costs, R = icp_step_qp.step_weights(params, stance, steps, side)
    frames = [*((step.pose, step.side) for step in steps), (stance, side)]
    x = np.random.default_rng(2).normal(size=8)
    seen = [
        foot.rotation.T @ part * [1.0, swing.sign]
        for (foot, swing), part in zip(frames, x.reshape(4, 2), strict=True)
    ]
    expected = sum(
        v @ np.array(w) @ v
        for v, w in zip(seen, [one, two, two, slack], strict=True)
    )
    assert x @ costs @ x == pytest.approx(expected, rel=1e-12)
    assert x[-2:] @ R @ x[-2:] == pytest.approx(
        seen[-1] @ np.array(feedback) @ seen[-1], rel=1e-12
    )


def test_each_step_has_one_weight_at_most():
    """Oracle: the message; a negative one is named by its place."""
    good, bad = [[1.0, 2.0], [2.0, 4.0]], [[-1.0, 0.0], [0.0, -1.0]]
    check(replace(PARAMS, step_weights=4 * [good]))
    with pytest.raises(ValueError, match="must be 1 to num_steps = 4 matrices"):
        check(replace(PARAMS, step_weights=5 * [good]))
    with pytest.raises(
        ValueError, match=r"^step_weights\[1\] = .*semidefinite"
    ):
        check(replace(PARAMS, step_weights=[good, bad]))
