import ctypes
import itertools

import numpy as np
import pytest

from nadia_balance.core.qp_programs import QpProblem
from nadia_balance.core.qp_solver import SOLVERS, DenseQp
from tests.qp_examples import SIZES, by_daqp, by_quadprog, random_qp

# What each method can promise, for solutions of size 1 to 10.
ACCURACY = {"active_set": 1e-9, "clarabel": 1e-3, "osqp": 1e-7}


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


@pytest.mark.parametrize("solver", SOLVERS)
def test_prints_nothing(solver, capfd):
    """Oracle: what the process itself writes, with and without active rows."""
    size = (4, 0, 10)  # OSQP would count an equality as active
    qp, (*problem, lower, upper) = DenseQp(*size, solver), random_qp(0, *size)
    wide = np.full_like(lower, 1e3)
    for bounds in (lower, upper), (-wide, wide):
        found = qp.solve(QpProblem(*problem, *bounds))
        assert found.solved
    assert not found.active.any()
    ctypes.CDLL(None).fflush(None)  # what C has not written yet
    assert capfd.readouterr() == ("", "")


def test_reports_the_largest_violation():
    """Oracle: the error an interior point leaves, measured by hand."""
    problem = random_qp(3, 12, 3, 20)
    found = DenseQp(12, 3, 20, "clarabel").solve(QpProblem(*problem))
    _, _, A_eq, b_eq, C, lower, upper = problem
    value = C @ found.x
    by_hand = max(
        np.abs(A_eq @ found.x - b_eq).max(),
        (lower - value).max(),
        (value - upper).max(),
    )
    assert found.violation == pytest.approx(by_hand, abs=1e-15)
    assert 1e-13 < found.violation < 1e-5


def test_earlier_problems_leave_no_trace():
    """Oracle: a fresh object gives the same bits."""
    size = (12, 3, 20)
    used = DenseQp(*size)
    for seed in range(4):
        used.solve(QpProblem(*random_qp(seed, *size)))
    problem = random_qp(9, *size)
    fresh = DenseQp(*size).solve(QpProblem(*problem))
    again = used.solve(QpProblem(*problem))
    assert np.array_equal(again.x, fresh.x)
    assert np.array_equal(again.active, fresh.active)
    assert again.iterations == fresh.iterations


def test_works_without_inequalities():
    """Oracle: the KKT system by numpy.linalg.solve."""
    H, g, A_eq, b_eq, *_ = random_qp(1, 6, 2, 4)
    none = np.zeros(0)
    kkt = np.block([[H, A_eq.T], [A_eq, np.zeros((2, 2))]])
    expected = np.linalg.solve(kkt, np.concatenate([-g, b_eq]))[:6]
    found = DenseQp(6, 2, 0).solve(
        QpProblem(H, g, A_eq, b_eq, np.zeros((0, 6)), none, none)
    )
    assert found.x == pytest.approx(expected, abs=1e-10)


def contradiction():
    C = np.array([[1.0, 0.0], [1.0, 0.0]])
    lower, upper = np.array([1.0, -np.inf]), np.array([np.inf, -1.0])
    none = np.zeros((0, 2)), np.zeros(0)
    return QpProblem(np.eye(2), np.zeros(2), *none, C, lower, upper)


@pytest.mark.parametrize("solver", SOLVERS)
def test_says_that_there_is_no_solution(solver):
    """Oracle: x_0 >= 1 and x_0 <= -1 exclude each other."""
    found = DenseQp(2, 0, 2, solver).solve(contradiction())
    assert not found.solved
    assert np.isnan(found.x).all()


def test_counts_the_fallback():
    """Oracle: without a solution the interior point must have been asked."""
    found = DenseQp(2, 0, 2).solve(contradiction())
    assert found.fallback
    problem = random_qp(1, 4, 1, 10)
    assert not DenseQp(4, 1, 10).solve(QpProblem(*problem)).fallback


NAMES = ["H", "g", "A_eq", "b_eq", "C", "lower", "upper"]


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("index", range(7))
def test_refuses_nan_by_name(solver, index):
    """Oracle: the name of the one argument that was spoilt."""
    problem = list(random_qp(0, 4, 1, 10))
    problem[index] = problem[index].copy()
    problem[index].flat[-1] = np.nan
    with pytest.raises(ValueError, match=f"^{NAMES[index]} "):
        DenseQp(4, 1, 10, solver).solve(QpProblem(*problem))


def test_every_single_nan_in_the_cost_is_noticed():
    """Oracle: the active set accepts nothing that is not finite."""
    qp = DenseQp(4, 1, 10)
    for i, j in itertools.product(range(4), repeat=2):
        problem = list(random_qp(0, 4, 1, 10))
        problem[0][i, j] = np.nan
        with pytest.raises(ValueError, match="H of the QP: must be finite"):
            qp.solve(QpProblem(*problem))


def test_refuses_a_solver_it_does_not_know():
    """Oracle: the message lists what is allowed."""
    with pytest.raises(
        ValueError,
        match="solver = 'mosek': must be one of active_set, clarabel, osqp",
    ):
        DenseQp(2, 0, 1, "mosek")
