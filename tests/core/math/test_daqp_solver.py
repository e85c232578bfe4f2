"""Oracles: Clarabel, closed forms, Drake's own conventions."""

import math

import numpy as np
import pytest
from pydrake.solvers import (
    ClarabelSolver,
    MathematicalProgram,
    MathematicalProgramResult,
    SolutionResult,
)

from nadia_balance.core.math.daqp_solver import DaqpSolver
from tests.qp_examples import tight

FOUND = SolutionResult.kSolutionFound
DEFINITE, BOUNDED = True, False


def program_in_pieces(seed: int, definite: bool):
    """A random program as people write them, and its variables.

    Costs and constraints are of a few of the variables, at random; of one and
    the same twice, perhaps.  `definite` costs have one minimum; else it is the
    bounds that leave a minimum, and some are equal.  Rows may be met by one
    value only, without any force, or be there twice.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 9))
    inside, everything = rng.normal(size=n), np.arange(n)
    program = MathematicalProgram()
    x = program.NewContinuousVariables(n)

    def some():
        return rng.integers(n, size=rng.integers(1, n + 1))

    def add_cost(which, rank):
        root = rng.normal(size=(rank, len(which)))
        a, b = rng.normal(size=(2, len(which)))
        program.AddQuadraticCost(root.T @ root, b, x[which], is_convex=True)
        program.AddLinearCost(a, 3.0, x[which])

    def add_bounds(which, room):
        lower, upper = inside[which] - room, inside[which] + room
        program.AddBoundingBoxConstraint(lower, upper, x[which])

    for _ in range(rng.integers(1, 4)):
        add_cost(some(), 1 + definite)
    for _ in range(rng.integers(0, 4)):
        which, count = some(), int(rng.integers(1, 3))
        A, kind = rng.normal(size=(count, len(which))), rng.integers(4)
        value = A @ inside[which]
        gaps = rng.exponential(size=(2, count)) * (rng.random((2, count)) < 0.7)
        if kind == 0 or not gaps.any():
            program.AddLinearEqualityConstraint(A, value, x[which])
            continue
        lower, upper = value - gaps[0], value + gaps[1]
        upper = upper + np.inf if kind == 1 else upper
        for _ in range(kind):
            program.AddLinearConstraint(A, lower, upper, x[which])
    if definite:
        add_cost(everything, n)
    else:
        add_bounds(everything, rng.exponential(size=n))
    add_bounds(np.unique(some()), 1.0)
    return program, x


def box(centre, most=math.inf):
    """The program |x - centre|^2, with x <= most."""
    program = MathematicalProgram()
    x = program.NewContinuousVariables(len(centre))
    cost = program.AddQuadraticErrorCost(np.eye(len(centre)), centre, x)
    bound = program.AddBoundingBoxConstraint(-math.inf, most, x)
    return program, x, cost, bound


@pytest.mark.parametrize("definite", [DEFINITE, BOUNDED])
def test_finds_the_optimum_of_any_convex_qp(definite):
    """Oracles: Clarabel's cost, to 1e-6; its x, if there is one only.

    Drake computes the costs, and what is violated.
    """
    solver = DaqpSolver()
    for seed in range(150):
        program, x = program_in_pieces(seed, definite)
        result = solver.Solve(program)
        assert result.is_success()
        assert not result.GetInfeasibleConstraints(program, 1e-8)
        best = ClarabelSolver().Solve(program, None, tight())
        cost = pytest.approx(best.get_optimal_cost(), rel=1e-6, abs=1e-6)
        assert result.get_optimal_cost() == cost
        if definite:
            found, expected = (each.GetSolution(x) for each in (result, best))
            assert found == pytest.approx(expected, abs=1e-6)


def test_fills_a_result_or_returns_one():
    """Oracle: by hand, x = (1, 0.5) costs 1 + 3; both are the same bits."""
    program, x, *_ = box([2.0, 0.5], 1.0)
    program.AddLinearCost(np.zeros(2), 3.0, x)
    solver, filled = DaqpSolver(), MathematicalProgramResult()
    returned = solver.Solve(program)
    assert solver.Solve(program, None, None, filled) is None
    for result in returned, filled:
        assert result.is_success()
        assert result.get_solution_result() == FOUND
        assert result.GetSolution(x) == pytest.approx([1.0, 0.5], abs=1e-12)
        double = result.GetSolution(2.0 * x[0]).Evaluate()
        assert double == pytest.approx(2.0, abs=1e-12)
        assert result.get_optimal_cost() == pytest.approx(4.0, abs=1e-12)
        assert result.get_x_val().tolist() == solver.solve(program)[0].tolist()
    assert solver.solver_id().name() == "DAQP"
    assert solver.available() and solver.enabled()


@pytest.mark.parametrize("verdict", ["kInfeasibleConstraints", "kUnbounded"])
def test_says_why_there_is_no_solution(verdict):
    """Oracles: by construction; the cost that Clarabel tells."""
    program, x, *_ = box([0.0, 0.0], 1.0)
    if verdict == "kUnbounded":
        program.AddLinearCost(program.NewContinuousVariables(1)[0])
    else:
        program.AddLinearConstraint(x[0] + x[1] >= 2.1)
    result, known = DaqpSolver().Solve(program), ClarabelSolver().Solve(program)
    assert not result.is_success()
    assert result.get_solution_result().name == verdict
    assert result.get_optimal_cost() == known.get_optimal_cost()
    assert np.isnan(result.GetSolution(x)).all()


REFUSED = {
    "kLorentzConeConstraint": lambda program, x: (
        program.AddLorentzConeConstraint(np.eye(2), np.zeros(2), x)
    ),
    "kBinaryVariable": lambda program, _: program.NewBinaryVariables(1),
    "a quadratic cost that is not convex": lambda program, x: (
        program.AddQuadraticCost(np.diag([1.0, -4.0]), np.zeros(2), x)
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refuses_what_it_cannot_solve(name):
    """Oracle: the name of what was added."""
    program, x, *_ = box([2.0, 0.5], 1.0)
    solver = DaqpSolver()
    assert solver.AreProgramAttributesSatisfied(program)
    assert solver.ExplainUnsatisfiedProgramAttributes(program) == ""
    REFUSED[name](program, x)
    message = f"DaqpSolver cannot solve a program with {name}"
    assert not solver.AreProgramAttributesSatisfied(program)
    assert solver.ExplainUnsatisfiedProgramAttributes(program) == message
    with pytest.raises(ValueError, match=message):
        solver.Solve(program)


@pytest.mark.parametrize("size", [1e-8, 1.0, 1e8])
@pytest.mark.parametrize("Q", [[[1.0, 2.0], [2.0, 1.0]], -np.eye(2)])
def test_trusts_nobody_who_says_that_it_is_convex(Q, size):
    """Oracle: an eigenvalue of -size, where Drake was told that it is not."""
    program = MathematicalProgram()
    x = program.NewContinuousVariables(2)
    program.AddQuadraticCost(size * np.array(Q), np.zeros(2), x, True)
    program.AddBoundingBoxConstraint(-1.0, 1.0, x)
    result = DaqpSolver().Solve(program)
    assert not result.is_success()
    assert result.get_solution_result() == SolutionResult.kSolverSpecificError
    assert math.isnan(result.get_optimal_cost())
    assert np.isnan(result.GetSolution(x)).all()


def test_a_program_may_change_between_two_solves():
    """Oracle: by hand, the point of a box that is nearest to a centre."""
    solver = DaqpSolver()
    program, x, cost, bound = box([2.0, 0.5, -3.0], 1.0)

    def found():
        x, result = solver.solve(program)
        assert result == FOUND
        return x.tolist()

    assert found() == pytest.approx([1.0, 0.5, -3.0], abs=1e-12)
    bound.evaluator().UpdateUpperBound([9.0, 0.0, 9.0])
    assert found() == pytest.approx([2.0, 0.0, -3.0], abs=1e-12)
    cost.evaluator().UpdateCoefficients(2.0 * np.eye(3), -2.0 * np.ones(3))
    assert found() == pytest.approx([1.0, 0.0, 1.0], abs=1e-12)
    row = program.AddLinearConstraint([[0.0, 0.0, 1.0]], [-9.0], [-1.0], x)
    assert found() == pytest.approx([1.0, 0.0, -1.0], abs=1e-12)
    row.evaluator().UpdateCoefficients(np.eye(3)[:2], [3.0, -9.0], [4.0, 9.0])
    assert found() == pytest.approx([3.0, 0.0, 1.0], abs=1e-12)
    program.RemoveConstraint(row)
    assert found() == pytest.approx([1.0, 0.0, 1.0], abs=1e-12)
    more = program.NewContinuousVariables(1)
    program.AddQuadraticErrorCost(np.eye(1), [7.0], more)
    assert found() == pytest.approx([1.0, 0.0, 1.0, 7.0], abs=1e-12)


def test_variables_may_be_replaced_between_two_solves():
    """Oracle: by hand; there are as many as before, but in another order."""
    program = MathematicalProgram()
    first, *others = program.NewContinuousVariables(3)
    program.AddQuadraticErrorCost(np.eye(2), [1.0, 2.0], others)
    bound = program.AddBoundingBoxConstraint(0.0, 1.0, first)
    solver = DaqpSolver()
    found = solver.Solve(program).GetSolution(others)
    assert found == pytest.approx([1.0, 2.0], abs=1e-12)
    program.RemoveConstraint(bound)
    program.RemoveDecisionVariable(first)
    more = program.NewContinuousVariables(1)
    program.AddQuadraticErrorCost(np.eye(1), [7.0], more)
    result = solver.Solve(program)
    found = result.GetSolution(np.append(others, more))
    assert found == pytest.approx([1.0, 2.0, 7.0], abs=1e-12)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_refuses_a_cost_that_is_not_finite(value):
    """Oracle: the name of what is wrong; of bounds: test_qp."""
    program, x, *_ = box([0.0, 0.0], 1.0)
    program.AddLinearCost([0.0, value], 0.0, x)
    with pytest.raises(ValueError, match="^cost of the QP: must be finite"):
        DaqpSolver().Solve(program)
