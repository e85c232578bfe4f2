import numpy as np
import pytest
from pydrake.solvers import ClarabelSolver

from nadia_balance.core.qp_programs import EqualityQp, FullQp, QpProblem
from tests.qp_examples import by_quadprog, random_qp

SIZE = (12, 3, 20)


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


def test_active_rows_are_equalities():
    """Oracle: the KKT system by numpy.linalg.solve, multipliers included."""
    problem, active = with_two_rows()
    x, multipliers = EqualityQp(12).solve(problem, active)
    expected, of_rows = by_numpy(problem, active)
    assert x == pytest.approx(expected, abs=1e-10)
    assert multipliers[active != 0] == pytest.approx(of_rows, abs=1e-9)
    assert not np.any(multipliers[active == 0])


def test_the_number_of_rows_may_change():
    """Oracle: numpy, on the way up and down."""
    problem, two = with_two_rows()
    none = np.zeros_like(two)
    qp = EqualityQp(12)
    for active in (none, two, none):
        x, _ = qp.solve(problem, active)
        assert x == pytest.approx(by_numpy(problem, active)[0], abs=1e-10)


def test_contradicting_rows_have_no_solution():
    """Oracle: one row at two bounds."""
    problem, active = with_two_rows()
    first, last = np.flatnonzero(active)
    problem.C[last] = problem.C[first]
    x, _ = EqualityQp(12).solve(problem, active)
    assert np.isnan(x).all()


def test_rows_that_say_the_same_are_no_contradiction():
    """Oracle: the solution with one of them."""
    problem, active = with_two_rows()
    problem.A_eq[2], problem.b_eq[2] = problem.A_eq[1], problem.b_eq[1]
    x, _ = EqualityQp(12).solve(problem, active)
    fewer = QpProblem(
        problem.H,
        problem.g,
        problem.A_eq[:2],
        problem.b_eq[:2],
        problem.C,
        problem.lower,
        problem.upper,
    )
    expected, _ = EqualityQp(12).solve(fewer, active)
    assert x == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("name", ["A_eq", "b_eq", "C"])
def test_rows_that_are_not_finite_do_not_reach_drake(name):
    """Oracle: Drake would end the process."""
    problem, active = with_two_rows()
    getattr(problem, name)[:] = np.nan
    x, _ = EqualityQp(12).solve(problem, active)
    assert np.isnan(x).all()


def test_finds_the_active_rows_of_the_whole_problem():
    """Oracle: where quadprog's solution touches a bound."""
    problem = random_qp(3, *SIZE)
    C, lower, upper = problem[4:]
    x, active = FullQp(*SIZE).solve(QpProblem(*problem), ClarabelSolver())
    exact = by_quadprog(*problem)
    assert x == pytest.approx(exact, abs=1e-3)
    touches = (C @ exact > upper - 1e-9).astype(int)
    touches -= C @ exact < lower + 1e-9
    assert np.array_equal(active, touches)


def test_measures_the_violation():
    """Oracle: by hand, the equality is off by 2, the inequality by 3."""
    one, none = np.ones((1, 1)), np.zeros(1)
    problem = QpProblem(one, none, one, none, one, none + 5.0, none + 6.0)
    x = np.array([2.0])
    assert problem.excess(x) == pytest.approx([3.0])
    assert problem.violation(x, problem.excess(x)) == 3.0
    assert problem.violation(x, problem.excess(x) - 2.0) == 2.0
    nan = np.array([np.nan])
    assert np.isnan(problem.violation(nan, problem.excess(nan)))
