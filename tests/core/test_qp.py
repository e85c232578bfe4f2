"""Oracles: quadprog, daqp, the KKT system by numpy, and by hand."""

import numpy as np
import pytest

from nadia_balance.core.qp import (
    SOLVERS,
    DenseQp,
    EqualityQp,
    FullQp,
    QpProblem,
    solve_active_set,
)
from tests.qp_examples import SIZES, by_daqp, by_quadprog, random_qp

# What each method can promise, for solutions of size 1 to 10.
ACCURACY = {"active_set": 1e-9, "clarabel": 1e-3}
SIZE = (12, 3, 20)
NAMES = ["H", "g", "A_eq", "b_eq", "C", "lower", "upper"]


def by_active_set(problem, guess):
    qp = EqualityQp(len(problem[1]))
    return solve_active_set(qp, QpProblem(*problem), guess)


def active_rows(problem):
    """Where quadprog's solution touches a bound."""
    C, lower, upper = problem[4:]
    value = C @ by_quadprog(*problem)
    touches = (value > upper - 1e-9).astype(np.int8)
    touches -= value < lower + 1e-9
    return touches


def contradiction():
    """x_0 >= 1 and x_0 <= -1."""
    C = np.array([[1.0, 0.0], [1.0, 0.0]])
    lower, upper = np.array([1.0, -np.inf]), np.array([np.inf, -1.0])
    none = np.zeros((0, 2)), np.zeros(0)
    return QpProblem(np.eye(2), np.zeros(2), *none, C, lower, upper)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_finds_the_optimum(solver, size):
    """Oracles: quadprog and daqp, both dual active-set codes."""
    qp = DenseQp(*size, solver)
    for seed in range(8):
        problem = random_qp(seed, *size)
        found = qp.solve(QpProblem(*problem))
        assert found.solved
        accuracy = ACCURACY[solver]
        assert found.x == pytest.approx(by_quadprog(*problem), abs=accuracy)
        assert found.x == pytest.approx(by_daqp(*problem), abs=accuracy)


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("powers", [(-5, -5), (5, 5), (-5, 5)])
def test_the_units_of_the_rows_do_not_matter(size, powers):
    """Oracle: quadprog, of the rows as they were before they were scaled."""
    rng = np.random.default_rng(0)
    for seed in range(8):
        problem = random_qp(seed, *size)
        H, g, A, b, C, lower, upper = problem
        s = 10.0 ** rng.uniform(*powers, len(b))
        t = 10.0 ** rng.uniform(*powers, len(C))
        rows = s[:, None] * A, s * b, t[:, None] * C, t * lower, t * upper
        found = DenseQp(*size).solve(QpProblem(H, g, *rows))
        assert found.solved
        assert found.x == pytest.approx(by_quadprog(*problem), abs=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
def test_says_that_there_is_no_solution(solver):
    """Oracle: two bounds exclude each other."""
    found = DenseQp(2, 0, 2, solver).solve(contradiction())
    assert not found.solved
    assert np.isnan(found.x).all()


def test_counts_the_fallback():
    """Oracle: without a solution the interior point must have been asked."""
    found = DenseQp(2, 0, 2).solve(contradiction())
    assert found.fallback and found.iterations > 1
    problem = QpProblem(*random_qp(1, 4, 1, 10))
    warm = DenseQp(4, 1, 10).solve(problem, active_rows(problem))
    assert not warm.fallback and warm.iterations == 1


def test_reports_the_largest_violation():
    """Oracle: by hand: the equality is off by 2, the inequality by 3."""
    one, none = np.ones((1, 1)), np.zeros(1)
    problem = QpProblem(one, none, one, none, one, none + 5.0, none + 6.0)
    x = np.array([2.0])
    assert problem.excess(problem.C @ x) == pytest.approx([3.0])
    assert problem.violation(x, problem.excess(problem.C @ x)) == 3.0
    assert problem.violation(x, problem.excess(problem.C @ x) - 2.0) == 2.0
    assert problem.excess(np.array([8.0])) == pytest.approx([2.0])
    nan = np.array([np.nan])
    assert np.isnan(problem.violation(nan, problem.excess(nan)))


def test_earlier_problems_leave_no_trace():
    """Oracle: a fresh object gives the same bits."""
    used = DenseQp(*SIZE)
    for seed in range(4):
        used.solve(QpProblem(*random_qp(seed, *SIZE)))
    problem = random_qp(9, *SIZE)
    fresh = DenseQp(*SIZE).solve(QpProblem(*problem))
    again = used.solve(QpProblem(*problem))
    assert np.array_equal(again.x, fresh.x)
    assert np.array_equal(again.active, fresh.active)
    assert again.iterations == fresh.iterations


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("size", [(4, 2, 10), (4, 2, 0), (4, 0, 0)], ids=str)
def test_refuses_what_is_not_finite_by_name(solver, size):
    """Oracle: the name of the one argument; bounds may be open."""
    for index, name in enumerate(NAMES):
        wrong = {"lower": [np.inf], "upper": [-np.inf]}
        for value in [np.nan, *wrong.get(name, [np.inf, -np.inf])]:
            problem = list(random_qp(0, *size))
            for place in range(problem[index].size):
                problem[index] = problem[index].copy()
                problem[index].flat[place] = value
                with pytest.raises(ValueError, match=f"^{name} "):
                    DenseQp(*size, solver).solve(QpProblem(*problem))
                problem[index] = random_qp(0, *size)[index]


def test_refuses_a_solver_it_does_not_know():
    """Oracle: the message lists what is allowed."""
    with pytest.raises(
        ValueError,
        match="solver = 'mosek': must be one of active_set, clarabel",
    ):
        DenseQp(2, 0, 1, "mosek")


def test_the_active_rows_of_the_solution_solve_it_at_once():
    """Oracle: one equality-constrained solve is all that is left to do."""
    problem = random_qp(5, *SIZE)
    found = by_active_set(problem, active_rows(problem))
    assert found.solved and found.iterations == 1
    assert found.x == pytest.approx(by_quadprog(*problem), abs=1e-11)


def test_follows_a_problem_that_changes_a_little():
    """Oracle: quadprog; with the rows of before it takes a round or two."""
    problem = list(random_qp(5, *SIZE))
    active = active_rows(problem)
    direction = np.random.default_rng(0).normal(size=12)
    iterations = []
    for _ in range(20):
        problem[1] = problem[1] + 0.1 * direction
        found = by_active_set(problem, active)
        active = found.active
        iterations.append(found.iterations)
        assert found.x == pytest.approx(by_quadprog(*problem), abs=1e-9)
    assert np.mean(iterations) < 2.0


@pytest.mark.parametrize("guess", [-1, 1])
def test_an_absurd_guess_does_not_change_the_optimum(guess):
    """Oracle: quadprog; the guess makes an equality of every row."""
    problem = QpProblem(*random_qp(2, *SIZE))
    guess = np.full(SIZE[2], guess, dtype=np.int8)
    before = guess.copy()
    found = DenseQp(*SIZE).solve(problem, guess)
    assert found.solved
    assert found.x == pytest.approx(by_quadprog(*problem), abs=1e-9)
    assert np.array_equal(guess, before)


def with_two_rows():
    """A problem, and two of its rows at their bounds."""
    problem = QpProblem(*random_qp(1, *SIZE))
    active = np.zeros(20, dtype=np.int8)
    active[np.flatnonzero(np.isfinite(problem.lower))[0]] = -1
    active[np.flatnonzero(np.isfinite(problem.upper))[-1]] = 1
    return problem, active


def by_numpy(problem, active):
    """x and the multipliers of the KKT system."""
    rows = np.flatnonzero(active)
    bound = np.where(active < 0, problem.lower, problem.upper)[rows]
    A = np.vstack([problem.A_eq, problem.C[rows]])
    b = np.concatenate([problem.b_eq, bound])
    kkt = np.block([[problem.H, -A.T], [A, np.zeros((len(b), len(b)))]])
    solution = np.linalg.solve(kkt, np.concatenate([-problem.g, b]))
    return solution[:12], solution[12 + 3 :]


def test_active_rows_are_equalities_and_their_number_may_change():
    """Oracle: the KKT system by numpy.linalg.solve, multipliers included."""
    problem, two = with_two_rows()
    none = np.zeros_like(two)
    qp = EqualityQp(12)
    for active in none, two, none:
        x, multipliers = qp.solve(problem, active)
        expected, of_rows = by_numpy(problem, active)
        assert x == pytest.approx(expected, abs=1e-10)
        assert multipliers[active != 0] == pytest.approx(of_rows, abs=1e-9)
        assert not np.any(multipliers[active == 0])


def test_contradicting_rows_have_no_solution_but_equal_ones_do():
    """Oracle: one row at two bounds; one equality twice."""
    problem, active = with_two_rows()
    expected, _ = EqualityQp(12).solve(problem, active)
    again = [0, 1, 2, 2]
    double = problem._replace(
        A_eq=problem.A_eq[again], b_eq=problem.b_eq[again]
    )
    x, _ = EqualityQp(12).solve(double, active)
    assert x == pytest.approx(expected, abs=1e-9)
    first, last = np.flatnonzero(active)
    problem.C[last] = problem.C[first]
    x, _ = EqualityQp(12).solve(problem, active)
    assert np.isnan(x).all()


@pytest.mark.parametrize("name", ["A_eq", "b_eq", "C"])
def test_rows_that_are_not_finite_do_not_reach_drake(name):
    """Oracle: Drake would end the process."""
    problem, active = with_two_rows()
    getattr(problem, name)[:] = np.nan
    x, _ = EqualityQp(12).solve(problem, active)
    assert np.isnan(x).all()


def test_the_interior_point_finds_the_active_rows():
    """Oracle: where quadprog's solution touches a bound."""
    problem = random_qp(3, *SIZE)
    found = FullQp(*SIZE).solve(QpProblem(*problem))
    assert found.x == pytest.approx(by_quadprog(*problem), abs=1e-3)
    assert np.array_equal(found.active, active_rows(problem))
