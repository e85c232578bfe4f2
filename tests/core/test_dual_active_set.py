import numpy as np
import pytest

from nadia_balance.core.dual_active_set import (
    InfeasibleError,
    Iterate,
    solve_dual,
)
from nadia_balance.core.qp_programs import EqualityQp, QpProblem
from tests.qp_examples import SIZES, by_quadprog, random_qp


def solve(problem, active=None):
    if active is None:
        active = np.zeros(len(problem[-1]), dtype=np.int8)
    equality_qp = EqualityQp(len(problem[1]))
    return solve_dual(Iterate(equality_qp, QpProblem(*problem), active))


@pytest.mark.parametrize("size", SIZES[:3], ids=str)
def test_satisfies_the_optimality_conditions(size):
    """Oracle: the Karush-Kuhn-Tucker conditions, multipliers by lstsq."""
    for seed in range(8):
        problem = random_qp(seed, *size)
        H, g, A_eq, b_eq, C, lower, upper = problem
        found = solve(problem)
        x, active = found.x, found.active
        assert found.solved
        assert np.abs(A_eq @ x - b_eq).max(initial=0.0) < 1e-8
        assert np.all(C @ x > lower - 1e-8)
        assert np.all(C @ x < upper + 1e-8)
        assert C[active < 0] @ x == pytest.approx(lower[active < 0], abs=1e-8)
        assert C[active > 0] @ x == pytest.approx(upper[active > 0], abs=1e-8)
        rows = np.vstack([A_eq, C[active != 0]])
        multipliers = np.linalg.lstsq(rows.T, H @ x + g, rcond=None)[0]
        assert rows.T @ multipliers == pytest.approx(H @ x + g, abs=1e-7)
        assert np.all(multipliers[len(b_eq) :] * active[active != 0] < 1e-7)


def test_copes_with_rows_that_depend_on_each_other():
    """Oracle: the corner of a box whose rows all come three times."""
    H, g = np.eye(3), np.array([-3.0, -4.0, 5.0])
    C = np.vstack([np.eye(3)] * 3 + [np.ones((1, 3))])
    upper, lower = np.ones(10), -np.ones(10)
    found = solve((H, g, np.zeros((0, 3)), np.zeros(0), C, lower, upper))
    assert found.solved
    assert found.x == pytest.approx([1.0, 1.0, -1.0], abs=1e-12)


def test_drops_rows_that_should_not_be_active():
    """Oracle: quadprog; the start has rows on the wrong side."""
    problem = random_qp(4, 12, 3, 20)
    active = np.zeros(20, dtype=np.int8)
    finite = np.isfinite(problem[-1])
    active[np.flatnonzero(finite)[:5]] = 1
    found = solve(problem, active)
    assert found.x == pytest.approx(by_quadprog(*problem), abs=1e-9)


def test_gives_up_in_the_end():
    """Oracle: this cold start takes more rounds than Clarabel takes time."""
    found = solve(random_qp(0, *SIZES[3]))
    assert not found.solved
    assert found.iterations == 40
    assert np.isnan(found.x).all()


@pytest.mark.parametrize("seed", range(5))
def test_tells_that_the_constraints_exclude_each_other(seed):
    """Oracle: Farkas; the rows sum up to 0 <= -1."""
    rng = np.random.default_rng(seed)
    C = rng.normal(size=(6, 5))
    weights = rng.uniform(0.5, 1.0, size=5)
    C[5] = -weights @ C[:5]
    upper = rng.normal(size=6)
    upper[5] = -1.0 - weights @ upper[:5]
    lower = np.full(6, -np.inf)
    none = np.zeros((0, 5)), np.zeros(0)
    with pytest.raises(InfeasibleError):
        solve((np.eye(5), rng.normal(size=5), *none, C, lower, upper))
