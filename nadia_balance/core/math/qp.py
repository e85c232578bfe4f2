"""Small dense quadratic programs, solved once per tick."""

import math
from typing import Any, NamedTuple

import numpy as np
from pydrake import solvers
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.daqp_solver import DaqpSolver

# A hundredth of Clarabel's default.
_GAP_TOLERANCE = 1e-10


class QpProblem(NamedTuple):
    """Minimise 1/2 x'Hx + g'x, lower <= A x <= upper; equal bounds: A x = b."""

    H: Array
    g: Array
    A: Array
    lower: Array
    upper: Array

    def violation(self, x: Array) -> float:
        """Returns the largest constraint violation; NaN if x is NaN."""
        value = self.A @ x
        if not value.size:
            return 0.0 * float(x.sum())
        violations = np.maximum(self.lower - value, value - self.upper)
        # numpy's max() takes five times as long; both propagate NaN.
        return max(float(violations[violations.argmax()]), 0.0)

    def require_finite(self) -> None:
        """Raises ValueError naming H, g or A if it is not finite.

        Drake would terminate the process.
        """
        H, g, A, _, _ = self
        # A sum of squares is finite only if all are.
        if not math.isfinite(np.vdot(H, H) + g @ g + np.vdot(A, A)):
            for name in ("H", "g", "A"):
                if not np.isfinite(getattr(self, name)).all():
                    raise ValueError(f"{name} of the QP: must be finite")


class QpResult(NamedTuple):
    """The solution of a QP, and its status.

    `x` (n,) is NaN unless `solved`.  `solves` counts the programs solved,
    `fallback` is True if Clarabel was used, `violation` is the largest
    absolute violation of a constraint, NaN unless `solved`.
    """

    x: Array
    solved: bool
    solves: int = 1
    fallback: bool = False
    violation: float = math.nan


class DenseQp:
    """Minimises 1/2 x'Hx + g'x, lower <= A x <= upper.

    H (n, n) must be positive definite, bounds may be equal or infinite, and
    the number of rows may change: no result depends on an earlier one.  DAQP
    solves it; if it finds neither a solution nor a proof of infeasibility,
    Clarabel does to its own accuracy, and `fallback` is True.
    """

    def __init__(self, num_variables: int) -> None:
        # Untyped, as Drake's stubs lack NumPy's present array types.
        program: Any = MathematicalProgram()
        n = num_variables
        x = program.NewContinuousVariables(n)
        cost = program.AddQuadraticCost(np.eye(n), np.zeros(n), x, True)
        # With one row, because Drake drops a constraint without rows.
        row, zero = np.zeros((1, n)), np.zeros(1)
        limits = program.AddLinearConstraint(row, zero, zero, x)
        # Kept, because each access takes as long as an update.
        self._program, self._cost = program, cost.evaluator()
        self._limits = limits.evaluator()
        self._daqp = DaqpSolver()
        self._options = solvers.SolverOptions()
        for name in ("tol_gap_abs", "tol_gap_rel"):
            self._options.SetOption(ClarabelSolver.id(), name, _GAP_TOLERANCE)

    def solve(self, problem: QpProblem) -> QpResult:
        """Returns the solution of the QP.

        Raises ValueError: NaN in the problem, or infinity outside the bounds,
        or a lower bound of inf or an upper one of -inf.
        """
        problem.require_finite()
        H, g, A, lower, upper = problem
        # H.T equals H, in the memory order for which Drake makes no copy.
        self._cost.UpdateCoefficients(H.T, g, 0.0, True)
        self._limits.UpdateCoefficients(A, lower, upper)
        x, result = self._daqp.solve(self._program)
        if result is solvers.SolutionResult.kSolutionFound:
            return QpResult(x, True, violation=problem.violation(x))
        if result is solvers.SolutionResult.kInfeasibleConstraints:
            return QpResult(x, False)
        found = ClarabelSolver().Solve(self._program, None, self._options)
        if not found.is_success():
            return QpResult(np.full(g.size, np.nan), False, 2, True)
        x = np.asarray(found.get_x_val())
        return QpResult(x, True, 2, True, problem.violation(x))


def largest_first(A: Array, b: Array) -> Array | None:
    """Returns the x (n,) of the largest x[0] with A x <= b; None: no such x.

    The linear program is solved by the simplex method.
    """
    program: Any = MathematicalProgram()  # untyped: its stubs lack Array
    x = program.NewContinuousVariables(A.shape[1])
    program.AddLinearConstraint(A, np.full(len(b), -np.inf), b, x)
    program.AddLinearCost(-x[0])
    result = solvers.ClpSolver().Solve(program)
    return np.asarray(result.GetSolution(x)) if result.is_success() else None
