"""Small dense quadratic programs, solved once per tick."""

import math
from typing import Any, NamedTuple

import numpy as np
from pydrake import solvers

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.daqp_solver import solve_arrays


class QpProblem(NamedTuple):
    """Minimise 1/2 x'Hx + g'x subject to lower <= A x <= upper."""

    H: Array  # (n, n)
    g: Array  # (n,)
    A: Array  # (m, n)
    lower: Array  # (m,); equal to `upper` in rows that are equalities
    upper: Array  # (m,)

    def violation(self, x: Array) -> float:
        """The largest violation of a constraint.

        Args:
            x: point (n,).

        Returns:
            max(0, lower - A x, A x - upper); NaN if x is NaN.
        """
        value = self.A @ x
        if not value.size:
            return 0.0 * float(x.sum())
        violations = np.maximum(self.lower - value, value - self.upper)
        # numpy's max() takes five times as long; both propagate NaN.
        return max(float(violations[violations.argmax()]), 0.0)

    def require_finite(self) -> None:
        """Refuses what would make Drake terminate the process.

        Raises:
            ValueError: H, g or A is not finite; it is named.
        """
        # A sum of squares is finite only if all are.
        squares = np.vdot(self.H, self.H) + self.g @ self.g
        if math.isfinite(squares + np.vdot(self.A, self.A)):
            return
        for name, values in (("H", self.H), ("g", self.g), ("A", self.A)):
            if not np.isfinite(values).all():
                raise ValueError(f"{name} of the QP: must be finite")


class QpResult(NamedTuple):
    """The solution of a QP, and its status."""

    x: Array  # (n,), NaN unless `solved`
    solved: bool
    solves: int = 1  # programs solved
    fallback: bool = False  # Clarabel was used
    violation: float = math.nan  # largest, absolute; NaN unless `solved`


class DenseQp:
    """Minimises 1/2 x'Hx + g'x subject to lower <= A x <= upper.

    H (n, n) must be positive semidefinite; if it is singular, one of the minima
    is found.  Bounds may be equal or infinite, and the number of rows may
    change: no result depends on an earlier one.  DAQP takes its arrays; if it
    finds neither a solution nor a proof of infeasibility, the
    MathematicalProgram is filled with them, Clarabel solves it to its own
    accuracy, and `fallback` is True.

    Args:
        num_variables: n, the length of x.
    """

    def __init__(self, num_variables: int) -> None:
        # Untyped, as Drake's stubs lack NumPy's present array types.
        program: Any = solvers.MathematicalProgram()
        self._program = program
        x = program.NewContinuousVariables(num_variables)
        # Kept, because each access takes as long as an update.
        self._cost = program.AddQuadraticCost(
            Q=np.eye(num_variables),
            b=np.zeros(num_variables),
            vars=x,
            is_convex=True,
        ).evaluator()
        # With one row, because Drake drops a constraint without rows.
        self._limits = program.AddLinearConstraint(
            A=np.zeros((1, num_variables)),
            lb=np.zeros(1),
            ub=np.zeros(1),
            vars=x,
        ).evaluator()
        self._options = solvers.SolverOptions()
        # A hundredth of Clarabel's default.
        for name in ("tol_gap_abs", "tol_gap_rel"):
            self._options.SetOption(solvers.ClarabelSolver.id(), name, 1e-10)

    def solve(self, problem: QpProblem, is_tentative: bool = False) -> QpResult:
        """Solves one problem.

        Args:
            problem: its cost and its rows.
            is_tentative: it is not solved a second time, more carefully, where
                it looks infeasible, as something else is done then.

        Returns:
            The minimum, or that there is none.

        Raises:
            ValueError: NaN in the problem, or infinity outside the bounds, or
                a lower bound of inf or an upper one of -inf.
        """
        problem.require_finite()
        # H.T equals H, in the memory order for which nobody makes a copy.
        x, result = solve_arrays(
            H=problem.H.T,
            g=problem.g,
            A=problem.A,
            lower=problem.lower,
            upper=problem.upper,
            is_tentative=is_tentative,
        )
        if result is solvers.SolutionResult.kSolutionFound:
            return QpResult(x, True, violation=problem.violation(x))
        if result is solvers.SolutionResult.kInfeasibleConstraints:
            return QpResult(x, False)
        self._cost.UpdateCoefficients(
            new_Q=problem.H.T, new_b=problem.g, new_c=0.0, is_convex=True
        )
        self._limits.UpdateCoefficients(problem.A, problem.lower, problem.upper)
        second = solvers.ClarabelSolver().Solve(
            self._program, None, self._options
        )
        if not second.is_success():
            return QpResult(x, False, solves=2, fallback=True)
        x = np.asarray(second.get_x_val())
        return QpResult(
            x=x,
            solved=True,
            solves=2,
            fallback=True,
            violation=problem.violation(x),
        )


def largest_first(A: Array, b: Array) -> Array | None:
    """Maximises x[0] subject to A x <= b, by the simplex method.

    Args:
        A: rows (m, n).
        b: upper bounds (m,).

    Returns:
        The maximum x (n,); None if there is none.
    """
    # Untyped: its stubs lack Array.
    program: Any = solvers.MathematicalProgram()
    x = program.NewContinuousVariables(A.shape[1])
    program.AddLinearConstraint(A=A, lb=np.full(len(b), -np.inf), ub=b, vars=x)
    program.AddLinearCost(-x[0])
    result = solvers.ClpSolver().Solve(program)
    return np.asarray(result.GetSolution(x)) if result.is_success() else None
