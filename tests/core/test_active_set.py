import numpy as np
import pytest

from nadia_balance.core.active_set import solve_active_set
from nadia_balance.core.qp_programs import EqualityQp, QpProblem
from tests.qp_examples import by_quadprog, random_qp

SIZE = (12, 3, 20)


def solve(problem, guess=None):
    if guess is None:
        guess = np.zeros(len(problem[-1]), dtype=np.int8)
    equality_qp = EqualityQp(len(problem[1]))
    return solve_active_set(equality_qp, QpProblem(*problem), guess)


def test_the_active_rows_of_the_solution_solve_it_at_once():
    """Oracle: one equality-constrained solve is all that is left to do."""
    problem = random_qp(5, *SIZE)
    cold = solve(problem)
    warm = solve(problem, cold.active)
    assert cold.iterations > 1
    assert warm.iterations == 1
    assert warm.x == pytest.approx(cold.x, abs=1e-11)


def test_follows_a_problem_that_changes_a_little():
    """Oracle: quadprog; with the rows of before it takes a round or two."""
    problem = list(random_qp(5, *SIZE))
    active = solve(problem).active
    direction = np.random.default_rng(0).normal(size=12)
    iterations = []
    for _ in range(20):
        problem[1] = problem[1] + 0.1 * direction
        found = solve(problem, active)
        active = found.active
        iterations.append(found.iterations)
        assert found.x == pytest.approx(by_quadprog(*problem), abs=1e-9)
    assert np.mean(iterations) < 2.0


@pytest.mark.parametrize("guess", [-1, 1])
@pytest.mark.parametrize("size", [(4, 1, 10), SIZE], ids=str)
def test_an_absurd_guess_does_not_change_the_optimum(size, guess):
    """Oracle: quadprog; the guess makes an equality of every row."""
    problem = random_qp(2, *size)
    found = solve(problem, np.full(size[2], guess, dtype=np.int8))
    assert found.solved
    assert found.x == pytest.approx(by_quadprog(*problem), abs=1e-9)


def test_leaves_the_guess_as_it_is():
    """Oracle: a copy."""
    guess = np.ones(20, dtype=np.int8)
    solve(random_qp(2, *SIZE), guess)
    assert np.all(guess == 1)


def test_says_that_it_has_no_solution():
    """Oracle: a row cannot be above 1 and below -1."""
    problem = list(random_qp(2, *SIZE))
    C, lower, upper = problem[4:]
    C[0], lower[0], upper[0] = C[1], 1.0, np.inf
    lower[1], upper[1] = -np.inf, -1.0
    found = solve(problem)
    assert not found.solved
    assert np.isnan(found.x).all()
