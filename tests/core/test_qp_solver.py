import itertools

import daqp
import numpy as np
import pytest
import quadprog

from nadia_balance.core.qp_solver import SOLVERS, DenseQp

# Sizes (variables, equalities, inequalities); the last is a hard one from a
# cold start: some twenty of its inequalities are active.
SIZES = [(4, 0, 10), (4, 1, 10), (12, 3, 20), (41, 18, 80)]
# What each method can promise, for solutions of size 1 to 10.
ACCURACY = {"active_set": 1e-9, "clarabel": 1e-3, "osqp": 1e-5}


def random_qp(seed, n, equalities, inequalities):
    """A feasible QP whose bounds are partly infinite."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    inside = rng.normal(size=n)
    A_eq = rng.normal(size=(equalities, n))
    C = rng.normal(size=(inequalities, n))
    lower = C @ inside - rng.exponential(size=inequalities)
    upper = C @ inside + rng.exponential(size=inequalities)
    lower[rng.random(inequalities) < 0.3] = -np.inf
    upper[rng.random(inequalities) < 0.3] = np.inf
    H = root @ root.T + 0.01 * np.eye(n)
    return H, 5.0 * rng.normal(size=n), A_eq, A_eq @ inside, C, lower, upper


def by_quadprog(H, g, A_eq, b_eq, C, lower, upper):
    below, above = np.isfinite(lower), np.isfinite(upper)
    rows = np.vstack([A_eq, C[below], -C[above]])
    bounds = np.concatenate([b_eq, lower[below], -upper[above]])
    return quadprog.solve_qp(H, -g, rows.T, bounds, len(b_eq))[0]


def by_daqp(H, g, A_eq, b_eq, C, lower, upper):
    rows = np.ascontiguousarray(np.vstack([A_eq, C]))
    above = np.concatenate([b_eq, np.minimum(upper, 1e30)])
    below = np.concatenate([b_eq, np.maximum(lower, -1e30)])
    sense = np.zeros(len(above), dtype=np.int32)
    sense[: len(b_eq)] = 5  # equality
    x, _, flag, _ = daqp.solve(H, g, rows, above, below, sense)
    assert flag == 1
    return x


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_finds_the_optimum(solver, size):
    """Oracles: quadprog and daqp, both dual active-set codes."""
    qp = DenseQp(*size, solver)
    for seed in range(8):
        problem = random_qp(seed, *size)
        found = qp.solve(*problem)
        assert found.solved
        accuracy = ACCURACY[solver]
        assert found.x == pytest.approx(by_quadprog(*problem), abs=accuracy)
        assert found.x == pytest.approx(by_daqp(*problem), abs=accuracy)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_satisfies_the_optimality_conditions(size):
    """Oracle: the Karush-Kuhn-Tucker conditions, multipliers by lstsq."""
    for seed in range(8):
        problem = random_qp(seed, *size)
        H, g, A_eq, b_eq, C, lower, upper = problem
        found = DenseQp(*size).solve(*problem)
        x, active = found.x, found.active
        assert np.abs(A_eq @ x - b_eq).max(initial=0.0) < 1e-8
        assert np.all(C @ x > lower - 1e-8)
        assert np.all(C @ x < upper + 1e-8)
        assert C[active < 0] @ x == pytest.approx(lower[active < 0], abs=1e-8)
        assert C[active > 0] @ x == pytest.approx(upper[active > 0], abs=1e-8)
        rows = np.vstack([A_eq, C[active != 0]])
        multipliers = np.linalg.lstsq(rows.T, H @ x + g, rcond=None)[0]
        assert rows.T @ multipliers == pytest.approx(H @ x + g, abs=1e-7)
        assert np.all(multipliers[len(b_eq) :] * active[active != 0] < 1e-7)


def test_reports_the_largest_violation():
    """Oracle: the error an interior point leaves, measured by hand."""
    problem = random_qp(3, 12, 3, 20)
    found = DenseQp(12, 3, 20, "clarabel").solve(*problem)
    _, _, A_eq, b_eq, C, lower, upper = problem
    value = C @ found.x
    by_hand = max(
        np.abs(A_eq @ found.x - b_eq).max(),
        (lower - value).max(),
        (value - upper).max(),
    )
    assert found.violation == pytest.approx(by_hand, abs=1e-15)
    assert 1e-13 < found.violation < 1e-5


def test_the_active_rows_of_the_solution_solve_it_at_once():
    """Oracle: one equality-constrained solve is all that is left to do."""
    qp, problem = DenseQp(12, 3, 20), random_qp(5, 12, 3, 20)
    cold = qp.solve(*problem)
    warm = qp.solve(*problem, cold.active)
    assert cold.iterations > 1
    assert warm.iterations == 1
    assert warm.x == pytest.approx(cold.x, abs=1e-11)


@pytest.mark.parametrize("guess", [-1, 1])
def test_an_absurd_guess_does_not_change_the_optimum(guess):
    """Oracle: quadprog; the guess makes all rows equalities, 80 in 23 dims."""
    size = (41, 18, 80)
    problem = random_qp(2, *size)
    mask = np.full(80, guess, dtype=np.int8)
    found = DenseQp(*size).solve(*problem, mask)
    assert found.x == pytest.approx(by_quadprog(*problem), abs=1e-9)


def test_earlier_problems_leave_no_trace():
    """Oracle: a fresh object gives the same bits."""
    size = (12, 3, 20)
    used = DenseQp(*size)
    for seed in range(4):
        used.solve(*random_qp(seed, *size))
    problem = random_qp(9, *size)
    fresh = DenseQp(*size).solve(*problem)
    again = used.solve(*problem)
    assert np.array_equal(again.x, fresh.x)
    assert np.array_equal(again.active, fresh.active)
    assert again.iterations == fresh.iterations


def test_copes_with_rows_that_depend_on_each_other():
    """Oracle: the corner of a box whose rows all come three times."""
    H, g = np.eye(3), np.array([-3.0, -4.0, 5.0])
    C = np.vstack([np.eye(3)] * 3 + [np.ones((1, 3))])
    upper, lower = np.ones(10), -np.ones(10)
    found = DenseQp(3, 0, 10).solve(
        H, g, np.zeros((0, 3)), np.zeros(0), C, lower, upper
    )
    assert found.solved
    assert found.x == pytest.approx([1.0, 1.0, -1.0], abs=1e-12)


def test_works_without_inequalities():
    """Oracle: the KKT system by numpy.linalg.solve."""
    H, g, A_eq, b_eq, *_ = random_qp(1, 6, 2, 4)
    none = np.zeros(0)
    kkt = np.block([[H, A_eq.T], [A_eq, np.zeros((2, 2))]])
    expected = np.linalg.solve(kkt, np.concatenate([-g, b_eq]))[:6]
    found = DenseQp(6, 2, 0).solve(
        H, g, A_eq, b_eq, np.zeros((0, 6)), none, none
    )
    assert found.x == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("solver", SOLVERS)
def test_says_that_there_is_no_solution(solver):
    """Oracle: x_0 >= 1 and x_0 <= -1 exclude each other."""
    C = np.array([[1.0, 0.0], [1.0, 0.0]])
    lower, upper = np.array([1.0, -np.inf]), np.array([np.inf, -1.0])
    found = DenseQp(2, 0, 2, solver).solve(
        np.eye(2), np.zeros(2), np.zeros((0, 2)), np.zeros(0), C, lower, upper
    )
    assert not found.solved
    assert np.isnan(found.x).all()


def test_counts_the_fallback():
    """Oracle: without a solution the interior point must have been asked."""
    C = np.array([[1.0, 0.0], [1.0, 0.0]])
    lower, upper = np.array([1.0, -np.inf]), np.array([np.inf, -1.0])
    found = DenseQp(2, 0, 2).solve(
        np.eye(2), np.zeros(2), np.zeros((0, 2)), np.zeros(0), C, lower, upper
    )
    assert found.fallback
    problem = random_qp(1, 4, 1, 10)
    assert not DenseQp(4, 1, 10).solve(*problem).fallback


NAMES = ["H", "g", "A_eq", "b_eq", "C", "lower", "upper"]


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("index", range(7))
def test_refuses_nan_by_name(solver, index):
    """Oracle: the name of the one argument that was spoilt."""
    problem = list(random_qp(0, 4, 1, 10))
    problem[index] = problem[index].copy()
    problem[index].flat[-1] = np.nan
    with pytest.raises(ValueError, match=f"^{NAMES[index]} "):
        DenseQp(4, 1, 10, solver).solve(*problem)


def test_every_single_nan_in_the_cost_is_noticed():
    """Oracle: the active set accepts nothing that is not finite."""
    qp = DenseQp(4, 1, 10)
    for i, j in itertools.product(range(4), repeat=2):
        problem = list(random_qp(0, 4, 1, 10))
        problem[0][i, j] = np.nan
        with pytest.raises(ValueError, match="H of the QP: must be finite"):
            qp.solve(*problem)


def test_refuses_a_solver_it_does_not_know():
    """Oracle: the message lists what is allowed."""
    with pytest.raises(
        ValueError,
        match="solver = 'mosek': must be one of active_set, clarabel, osqp",
    ):
        DenseQp(2, 0, 1, "mosek")
