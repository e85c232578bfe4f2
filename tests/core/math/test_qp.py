"""Oracles: quadprog, Clarabel, optima by construction, and by hand."""

import numpy as np
import pytest

from nadia_balance.core.math import daqp_solver
from nadia_balance.core.math.qp import DenseQp, QpProblem
from tests.qp_examples import SIZES, by_clarabel, by_quadprog, random_qp

NAMES = ["H", "g", "A", "lower bound", "upper bound"]
# Tolerance for solutions of size 1 to 10; QP codes are exact to rounding.
ACCURACY = 1e-9


def solve(problem):
    return DenseQp(len(problem.g)).solve(problem)


def with_rows(problem, A, lower, upper):
    """The problem, with more rows."""
    return problem._replace(
        A=np.vstack((problem.A, A)),
        lower=np.append(problem.lower, lower),
        upper=np.append(problem.upper, upper),
    )


def contradiction():
    """x_0 >= 1 and x_0 <= -1."""
    A = np.array([[1.0, 0.0], [1.0, 0.0]])
    lower, upper = np.array([1.0, -np.inf]), np.array([np.inf, -1.0])
    return QpProblem(np.eye(2), np.zeros(2), A, lower, upper)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_finds_the_optimum(size):
    """Oracles: quadprog; Clarabel, an interior-point code, to 1e-6."""
    qp = DenseQp(size[0])
    for seed in range(8):
        problem = random_qp(seed, *size)
        found = qp.solve(problem)
        assert found.solved and not found.fallback and found.solves == 1
        assert found.x == pytest.approx(by_quadprog(problem), abs=ACCURACY)
        assert found.x == pytest.approx(by_clarabel(problem), abs=1e-6)
        assert found.violation < ACCURACY


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("cost", [1e-8, 1.0, 1e8])
@pytest.mark.parametrize("powers", [(-5, -5), (5, 5), (-5, 5)], ids=str)
def test_units_do_not_matter(size, powers, cost):
    """Oracle: quadprog, of rows and cost as they were before scaling."""
    rng = np.random.default_rng(0)
    for seed in range(8):
        problem = random_qp(seed, *size)
        H, g, A, lower, upper = problem
        s = 10.0 ** rng.uniform(*powers, len(A))
        found = solve(
            QpProblem(cost * H, cost * g, s[:, None] * A, s * lower, s * upper)
        )
        assert found.solved and not found.fallback
        assert found.x == pytest.approx(by_quadprog(problem), abs=ACCURACY)


def dependent_rows():
    """What may be added to a problem without changing its solution."""
    problem = random_qp(1, *SIZES[-1])
    a, b = problem.A[:3], problem.lower[:3]
    c, low, high = problem.A[-4:], problem.lower[-4:], problem.upper[-4:]
    mixed, none = np.array([1.0, -2.0, 0.5]), np.zeros((1, 41))
    return problem, {
        "equalities times -3": (-3.0 * a, -3.0 * b, -3.0 * b),
        "a mixture of equalities": (mixed @ a, mixed @ b, mixed @ b),
        "equalities as inequalities": (a, b, b + 1.0),
        "equalities, one-sided": (a, np.full(3, -np.inf), b),
        "inequalities times 1000": (1e3 * c, 1e3 * low, 1e3 * high),
        "zero": (none, 0.0, 0.0),
        "zero between bounds": (none, -1.0, 1.0),
        "zero without bounds": (none, -np.inf, np.inf),
    }


@pytest.mark.parametrize("kind", dependent_rows()[1])
def test_rows_may_depend_on_each_other(kind):
    """Oracle: quadprog, without those that are superfluous."""
    problem, rows = dependent_rows()
    found = solve(with_rows(problem, *rows[kind]))
    assert found.solved and not found.fallback
    assert found.x == pytest.approx(by_quadprog(problem), abs=ACCURACY)


@pytest.mark.parametrize("power", [0.0, 1.0, 2.0, 2.5])
def test_finds_a_vertex_of_many_rows_whatever_the_cost(power):
    """Oracle: by construction, twice as many rows meet as are needed.

    At x, of the rows A x >= b all are active, and the gradient of the cost is
    A' m with m >= 0.  A condition number of up to 1e10 takes 6 digits of 16.
    """
    for seed in range(100):
        rng = np.random.default_rng(seed)
        sizes = 10.0 ** rng.uniform(-power, power, (5, 1))
        root, A, x = (
            sizes * rng.normal(size=(5, 5)),
            rng.normal(size=(10, 5)),
            rng.normal(size=5),
        )
        H = root @ root.T
        m = np.append(rng.exponential(size=5), np.zeros(5))
        m *= np.sqrt(np.trace(H))
        infinite = np.full(10, np.inf)
        found = solve(QpProblem(H, A.T @ m - H @ x, A, A @ x, infinite))
        assert found.solved and not found.fallback
        assert found.x == pytest.approx(x, abs=ACCURACY)


def contradicting_rows():
    """What leaves no solution, by 1e-3."""
    problem = random_qp(1, *SIZES[-1])
    a, b = problem.A[:3], problem.lower[:3] + 1e-3
    mixed, none = np.array([1.0, -2.0, 0.5]), np.zeros((1, 41))
    return problem, {
        "equality times -3": (-3.0 * a[:1], -3.0 * b[:1], -3.0 * b[:1]),
        "mixture of equalities": (mixed @ a, mixed @ b, mixed @ b),
        "inequality": (a[:1], b[:1], np.inf),
        "row of its own": (np.ones((1, 41)), 1.0, 0.999),
        "short row of its own": (np.full((1, 41), 1e-7), 1e-7, 0.999e-7),
        "zero": (none, 1e-3, 1e-3),
        "zero, one-sided": (none, -np.inf, -1e-3),
    }


@pytest.mark.parametrize("kind", contradicting_rows()[1])
@pytest.mark.parametrize("cost", [1e-6, 1.0, 1e6])
def test_says_that_there_is_no_solution(kind, cost):
    """Oracle: by construction; there is nothing that Clarabel could do."""
    problem, rows = contradicting_rows()
    problem = problem._replace(H=cost * problem.H, g=cost * problem.g)
    found = solve(with_rows(problem, *rows[kind]))
    assert not found.solved and not found.fallback
    assert np.isnan(found.x).all() and found.x.shape == (41,)
    assert np.isnan(found.violation) and found.solves == 1


def test_counts_the_fallback(monkeypatch):
    """Oracles: a DAQP that ends without a result; quadprog, to 1e-6."""
    out_of_time = (np.ones(12), 0.0, -4, {"iterations": 10000})
    monkeypatch.setattr(daqp_solver.daqp, "solve", lambda *_, **__: out_of_time)
    for seed in range(4):
        problem = random_qp(seed, 12, 3, 20)
        found = solve(problem)
        assert found.solved and found.fallback and found.solves == 2
        assert found.x == pytest.approx(by_quadprog(problem), abs=1e-6)
        assert found.violation < 1e-6
    found = solve(contradiction())
    assert not found.solved and found.fallback and found.solves == 2
    assert np.isnan(found.x).all() and np.isnan(found.violation)


def test_reports_the_largest_violation():
    """Oracle: by hand, x = 0 and 5 <= x <= 6."""
    one, bounds = np.ones((1, 1)), (np.array([0.0, 5.0]), np.array([0.0, 6.0]))
    problem = QpProblem(one, np.zeros(1), np.ones((2, 1)), *bounds)
    for x, most in (2.0, 3.0), (-1.0, 6.0), (5.5, 5.5), (9.0, 9.0):
        assert problem.violation(np.array([x])) == most
    apart = problem._replace(lower=np.array([-9.0, 5.0]))
    assert apart.violation(np.array([6.0])) == 6.0
    nothing = apart._replace(upper=np.array([9.0, 6.0]))
    assert nothing.violation(np.array([6.0])) == 0.0
    assert np.isnan(problem.violation(np.array([np.nan])))


def test_earlier_problems_leave_no_trace_nor_do_their_rows():
    """Oracles: a fresh object gives the same bits; numpy, without rows."""
    used, free = DenseQp(12), random_qp(0, 12, 0, 0)
    for size in (3, 20), (0, 5), (0, 0), (5, 0), (3, 20):
        zero = np.zeros((1, 12))
        assert not used.solve(with_rows(free, zero, 1.0, 1.0)).solved
        problem = random_qp(9, 12, *size)
        again, fresh = used.solve(problem), solve(problem)
        assert again.x.tolist() == fresh.x.tolist()
        assert again[1:] == fresh[1:] and fresh.solved
    alone = np.linalg.solve(free.H, -free.g)
    assert used.solve(free).x == pytest.approx(alone, abs=ACCURACY)


@pytest.mark.parametrize("size", [(4, 2, 10), (4, 0, 0)], ids=str)
def test_refuses_what_is_not_finite_by_name(size):
    """Oracle: the name of the one argument; bounds may be open."""
    qp = DenseQp(4)
    for index, name in enumerate(NAMES):
        open_end = {"lower bound": [np.inf], "upper bound": [-np.inf]}
        for value in [np.nan, *open_end.get(name, [np.inf, -np.inf])]:
            for place in range(random_qp(0, *size)[index].size):
                problem = random_qp(0, *size)
                problem[index].flat[place] = value
                with pytest.raises(ValueError, match=f"^{name} of the QP: "):
                    qp.solve(problem)
    assert qp.solve(random_qp(0, *size)).solved
