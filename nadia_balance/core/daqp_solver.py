"""DAQP as a solver of Drake's, for small dense convex QPs."""

import math
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import daqp  # type: ignore[import-not-found]
import numpy as np
from pydrake.solvers import (
    ChooseBestSolver,
    MakeSolver,
    MathematicalProgram,
    MathematicalProgramResult,
    ProgramAttribute,
    SolutionResult,
    SolverId,
    SolverInterface,
)

from nadia_balance.core.walking import Array

# Of rows that DAQP has brought to length 1.  With its default, 1e-6, rows of
# very different lengths are violated by centimetres.
_PRIMAL_TOLERANCE = 1e-10
_RESULTS = {
    1: SolutionResult.kSolutionFound,
    2: SolutionResult.kSolutionFound,
    -1: SolutionResult.kInfeasibleConstraints,
    -3: SolutionResult.kUnbounded,
    -4: SolutionResult.kIterationLimit,
}
_ATTRIBUTES = {
    ProgramAttribute.kQuadraticCost,
    ProgramAttribute.kLinearCost,
    ProgramAttribute.kLinearConstraint,
    ProgramAttribute.kLinearEqualityConstraint,
}


class DaqpSolution(NamedTuple):
    """What DAQP finds: `x` (n,), NaN unless `result` is kSolutionFound.

    `iterations` counts the working sets that were tried.
    """

    x: Array
    result: SolutionResult
    iterations: int


class DaqpSolver(SolverInterface):
    """Solves convex QPs exactly, by a dual active-set method.

        min 1/2 x'Hx + g'x  s.t.  lower <= A x <= upper

    Made for dense programs of up to some hundred variables and rows, solved
    one after the other in a loop: `solve` costs about 20 us more than DAQP
    itself, once it knows a program.  No result depends on an earlier one.
    Arnstroem, Bemporad and Axehill, A dual active-set solver for embedded
    quadratic programming using recursive LDL' updates, IEEE Transactions on
    Automatic Control 67 (2022).

    Initial guess and solver options are not used.  A result has no dual
    solution, and its `get_solver_id` is another one's: Drake lets no solver
    in Python set them.
    """

    def __init__(self) -> None:
        super().__init__()
        # How the variables of a binding are picked from those of a program:
        # it takes Drake as long to tell as DAQP to solve.
        self._picks: WeakKeyDictionary[Any, dict[Any, Array | None]] = (
            WeakKeyDictionary()
        )

    def available(self) -> bool:
        """It is a dependency of this package."""
        return True

    def enabled(self) -> bool:
        """It needs no licence."""
        return True

    def solver_id(self) -> SolverId:
        """DAQP."""
        return SolverId("DAQP")

    def AreProgramAttributesSatisfied(self, prog: MathematicalProgram) -> bool:
        """True for linear and quadratic costs, and linear constraints."""
        return set(prog.required_capabilities()) <= _ATTRIBUTES

    def ExplainUnsatisfiedProgramAttributes(
        self, prog: MathematicalProgram
    ) -> str:
        """Returns what of `prog` it cannot solve; empty if it can."""
        more = set(prog.required_capabilities()) - _ATTRIBUTES
        if not more:
            return ""
        names = ", ".join(sorted(attribute.name for attribute in more))
        return f"DaqpSolver cannot solve a program with {names}"

    def Solve(  # type: ignore[override]
        self,
        prog: MathematicalProgram,
        initial_guess: Array | None = None,
        solver_options: Any = None,
        result: MathematicalProgramResult | None = None,
    ) -> MathematicalProgramResult | None:
        """Solves `prog` as any solver of Drake's does.

        Returns a result, or writes into `result` if one is given.

        Raises:
            ValueError: it is no convex QP, or a coefficient is not finite.
        """
        if why := self.ExplainUnsatisfiedProgramAttributes(prog):
            raise ValueError(why)
        solution = self.solve(prog)
        filled = MathematicalProgramResult() if result is None else result
        _fill(filled, prog, solution)
        return filled if result is None else None

    def solve(self, prog: MathematicalProgram) -> DaqpSolution:
        """Solves the convex QP `prog`, without a MathematicalProgramResult.

        Raises:
            ValueError: a coefficient is not finite, or a bound is NaN, or an
                infinity that nothing can meet.
        """
        n, picks = prog.num_vars(), self._picks.setdefault(prog, {})
        H, g = _cost(prog, n, picks)
        A, lower, upper = _rows(prog, n, picks)
        _check(H, g, lower, upper)
        x, _, flag, info = daqp.solve(
            H.T, g, A, upper, lower, primal_tol=_PRIMAL_TOLERANCE
        )
        result = _RESULTS.get(flag, SolutionResult.kSolverSpecificError)
        if result is not SolutionResult.kSolutionFound:
            x = np.full(n, np.nan)
        return DaqpSolution(x, result, info["iterations"])


def _pick(
    binding: Any, prog: MathematicalProgram, picks: dict[Any, Array | None]
) -> Array | None:
    """E (k, n) of a binding, whose variables are E x; None: they are x."""
    if binding in picks:
        return picks[binding]
    n = prog.num_vars()
    indices = prog.FindDecisionVariableIndices(binding.variables())
    E = np.eye(n)[indices]
    picks[binding] = None if np.array_equal(E, np.eye(n)) else E
    return picks[binding]


def _cost(
    prog: Any, n: int, picks: dict[Any, Array | None]
) -> tuple[Array, Array]:
    """H (n, n) and g (n,) of the sum of all costs."""
    squares, slopes = [], []
    for binding in prog.quadratic_costs():
        E, cost = _pick(binding, prog, picks), binding.evaluator()
        squares.append(cost.Q() if E is None else E.T @ cost.Q() @ E)
        slopes.append(cost.b() if E is None else cost.b() @ E)
    for binding in prog.linear_costs():
        E, cost = _pick(binding, prog, picks), binding.evaluator()
        slopes.append(cost.a() if E is None else cost.a() @ E)
    H = squares[0] if len(squares) == 1 else sum(squares, np.zeros((n, n)))
    g = slopes[0] if len(slopes) == 1 else sum(slopes, np.zeros(n))
    return H, g


def _rows(
    prog: Any, n: int, picks: dict[Any, Array | None]
) -> tuple[Array, Array, Array]:
    """A (m, n), lower (m,) and upper (m,) of all constraints."""
    rows, lower, upper = [], [], []
    for bindings in (
        prog.linear_equality_constraints(),
        prog.linear_constraints(),
        prog.bounding_box_constraints(),
    ):
        for binding in bindings:
            E, constraint = _pick(binding, prog, picks), binding.evaluator()
            A = constraint.GetDenseA()
            rows.append(A if E is None else A @ E)
            lower.append(constraint.lower_bound())
            upper.append(constraint.upper_bound())
    if len(rows) == 1:
        return np.ascontiguousarray(rows[0]), lower[0], upper[0]
    A = np.ascontiguousarray(np.concatenate([np.zeros((0, n)), *rows]))
    return A, np.concatenate([[], *lower]), np.concatenate([[], *upper])


def _check(H: Array, g: Array, lower: Array, upper: Array) -> None:
    """Raises ValueError; DAQP would return NaN, and say that it is solved.

    Drake lets nothing else but costs and bounds be NaN or infinite.
    """
    # A sum of squares is finite only if all are; H.T is as it is in memory.
    if not math.isfinite(np.vdot(H.T, H.T) + g @ g):
        if not (np.isfinite(H).all() and np.isfinite(g).all()):
            raise ValueError("cost of the QP: must be finite")
    # argmax() and argmin() find a NaN.
    if lower.size and not lower[lower.argmax()] < math.inf:
        raise ValueError("lower bound of the QP: must be < inf, not NaN")
    if upper.size and not upper[upper.argmin()] > -math.inf:
        raise ValueError("upper bound of the QP: must be > -inf, not NaN")


def _fill(result: Any, prog: Any, solution: DaqpSolution) -> None:
    """Writes `solution` of `prog` into `result`.

    Only a solver of Drake's own can tell a result its variables and cost.  So
    one is asked for x, as the solution of x = solution.x with prog's cost.
    """
    known: Any = MathematicalProgram()
    variables = prog.decision_variables()
    known.AddDecisionVariables(variables)
    x = np.nan_to_num(solution.x)
    known.AddLinearEqualityConstraint(np.eye(len(x)), x, variables)
    for binding in [*prog.quadratic_costs(), *prog.linear_costs()]:
        known.AddCost(binding)
    # No cost, either, of no solution.
    known.AddLinearCost(0.0 * x, 0.0 * float(solution.x.sum()), variables)
    solver = MakeSolver(ChooseBestSolver(known))
    solver.Solve(known, None, None, result)
    result.set_x_val(solution.x)
    result.set_solution_result(solution.result)
