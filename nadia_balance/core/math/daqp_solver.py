"""DAQP as a Drake solver, for small dense convex QPs."""

import itertools
import math
from typing import Any
from weakref import WeakKeyDictionary

import daqp  # type: ignore[import-not-found]
import numpy as np
from pydrake import solvers

from nadia_balance.core.math.arrays import Array

# Primal tolerance of rows that DAQP has normalised.  With its default, 1e-6,
# rows of very different lengths are violated by centimetres.
_TOLERANCE = 1e-10
_INFEASIBLE = -1
_DOUBTFUL = {_INFEASIBLE, -2, -6, 4}  # also cycles, contradicting equalities
_RESULTS = {
    1: solvers.SolutionResult.kSolutionFound,
    2: solvers.SolutionResult.kSolutionFound,
    _INFEASIBLE: solvers.SolutionResult.kInfeasibleConstraints,
    -3: solvers.SolutionResult.kUnbounded,
    -4: solvers.SolutionResult.kIterationLimit,
    -6: solvers.SolutionResult.kInfeasibleConstraints,
}
_NO_COSTS = {
    solvers.SolutionResult.kInfeasibleConstraints: math.inf,
    solvers.SolutionResult.kUnbounded: -math.inf,
}
_ATTRIBUTES = {
    solvers.ProgramAttribute.kQuadraticCost,
    solvers.ProgramAttribute.kLinearCost,
    solvers.ProgramAttribute.kLinearConstraint,
    solvers.ProgramAttribute.kLinearEqualityConstraint,
}


Program = solvers.MathematicalProgram
# Selection matrices E (k, n) of each binding, see _pick().
_Picks = dict[Any, Array | None]


class DaqpSolver(solvers.SolverInterface):
    """Solves convex QPs exactly, by a dual active-set method.

        minimise 1/2 x'Hx + g'x  subject to  lower <= A x <= upper

    It is for dense programs of up to some hundred variables and rows, solved
    repeatedly in a loop.  No result depends on an earlier one.
    Arnstroem, Bemporad and Axehill, A dual active-set solver for embedded
    quadratic programming using recursive LDL' updates, IEEE TAC 67 (2022).

    Initial guess and solver options are not used.  A result has no dual
    solution, and its `get_solver_id` names another solver: Drake does not let
    Python solvers set them.
    """

    def __init__(self) -> None:
        super().__init__()
        # Cache of the variables of each program and the selection matrices of
        # its bindings: Drake's lookup takes as long as DAQP's solve.
        self._picks: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()

    def available(self) -> bool:
        """DAQP is a dependency of this package.

        Returns:
            True.
        """
        return True

    enabled = available  # it needs no licence

    def solver_id(self) -> solvers.SolverId:
        """The name of this solver.

        Returns:
            The id "DAQP".
        """
        return solvers.SolverId("DAQP")

    def AreProgramAttributesSatisfied(self, prog: Program) -> bool:
        """Whether this solver can solve a program.

        Args:
            prog: any program.

        Returns:
            True for linear and convex quadratic costs, linear constraints.
        """
        return not self.ExplainUnsatisfiedProgramAttributes(prog)

    def ExplainUnsatisfiedProgramAttributes(self, prog: Program) -> str:
        """Why this solver cannot solve a program.

        Args:
            prog: any program.

        Returns:
            A message with its unsupported attributes; empty if there are none.
        """
        names = sorted(
            attribute.name
            for attribute in set(prog.required_capabilities()) - _ATTRIBUTES
        )
        costs: Any = prog.quadratic_costs()
        if not all(binding.evaluator().is_convex() for binding in costs):
            names.append("a quadratic cost that is not convex")
        if not names:
            return ""
        return f"DaqpSolver cannot solve a program with {', '.join(names)}"

    def Solve(  # type: ignore[override]
        self,
        prog: Program,
        initial_guess: Array | None = None,
        solver_options: Any = None,
        result: solvers.MathematicalProgramResult | None = None,
    ) -> solvers.MathematicalProgramResult | None:
        """Solves a program like any Drake solver.

        Args:
            prog: convex QP.
            initial_guess: not used.
            solver_options: not used.
            result: what the result is written into, if given.

        Returns:
            The result; None if `result` is given.

        Raises:
            ValueError: `prog` is no convex QP, or a coefficient not finite.
        """
        message = self.ExplainUnsatisfiedProgramAttributes(prog)
        if message:
            raise ValueError(message)
        x, outcome = self.solve(prog)
        filled = result or solvers.MathematicalProgramResult()
        _fill(filled, prog, solution=x, outcome=outcome)
        return filled if result is None else None

    def solve(self, prog: Program) -> tuple[Array, solvers.SolutionResult]:
        """Solves a program without Drake's result, which takes longer to make.

        Args:
            prog: convex QP of n variables.

        Returns:
            The minimum x (n,), and its result; unless that is kSolutionFound,
            x is NaN.

        Raises:
            ValueError: a cost is not convex, a coefficient not finite, a bound
                is NaN, a lower bound is inf or an upper bound is -inf.
        """
        variables = prog.decision_variable_index()
        previous, picks = self._picks.get(prog, (None, {}))
        if previous != variables:
            picks = {}
            self._picks[prog] = variables, picks
        H, g = _cost(prog, picks)
        A, lower, upper = _rows(prog, picks)
        return solve_arrays(H=H, g=g, A=A, lower=lower, upper=upper)


def solve_arrays(
    *,
    H: Array,
    g: Array,
    A: Array,
    lower: Array,
    upper: Array,
    is_tentative: bool = False,
) -> tuple[Array, solvers.SolutionResult]:
    """Minimises 1/2 x'Hx + g'x subject to lower <= A x <= upper.

    Args:
        H: positive semidefinite (n, n); fastest if H.T is contiguous.
        g: (n,), finite.
        A: contiguous rows (m, n), finite.
        lower: (m,), equal to `upper` in rows that are equalities.
        upper: (m,).
        is_tentative: what looks infeasible counts as that, although rounding
            may look so, and is not solved a second time.

    Returns:
        The minimum x (n,), and its result; unless that is kSolutionFound, x is
        NaN.

    Raises:
        ValueError: a bound is NaN, a lower bound is inf or an upper bound is
            -inf, H or g is not finite.
    """
    # argmax() and argmin() return the index of a NaN.
    if lower.size and not lower[lower.argmax()] < math.inf:
        raise ValueError("lower bound of the QP: must be < inf, not NaN")
    if upper.size and not upper[upper.argmin()] > -math.inf:
        raise ValueError("upper bound of the QP: must be > -inf, not NaN")
    x, flag = _solution(
        H=H, g=g, A=A, lower=lower, upper=upper, is_tentative=is_tentative
    )
    result = _RESULTS.get(flag, solvers.SolutionResult.kSolverSpecificError)
    if result is not solvers.SolutionResult.kSolutionFound:
        x = np.full(g.size, np.nan)
    return x, result


def _pick(binding: Any, prog: Program, picks: _Picks) -> Array | None:
    """Returns E (k, n) of a binding with the variables E x; None for E = I."""
    if binding not in picks:
        unit = np.eye(prog.num_vars())
        E = unit[prog.FindDecisionVariableIndices(binding.variables())]
        picks[binding] = None if np.array_equal(E, unit) else E
    return picks[binding]


def _cost(prog: Any, picks: _Picks) -> tuple[Array, Array]:
    """Returns H (n, n) and g (n,) of the sum of all costs."""
    squares, slopes = [], []
    for binding in prog.quadratic_costs():
        E, cost = _pick(binding, prog, picks), binding.evaluator()
        if not cost.is_convex():  # DAQP may not detect slight non-convexity
            raise ValueError("quadratic cost of the QP: must be convex")
        squares.append(cost.Q() if E is None else E.T @ cost.Q() @ E)
        slopes.append(cost.b() if E is None else cost.b() @ E)
    for binding in prog.linear_costs():
        E, cost = _pick(binding, prog, picks), binding.evaluator()
        slopes.append(cost.a() if E is None else cost.a() @ E)
    n = prog.num_vars()
    H = squares[0] if len(squares) == 1 else sum(squares, np.zeros((n, n)))
    g = slopes[0] if len(slopes) == 1 else sum(slopes, np.zeros(n))
    return H, g


def _rows(prog: Any, picks: _Picks) -> tuple[Array, Array, Array]:
    """Returns A (m, n), lower (m,) and upper (m,) of all constraints."""
    rows, lower, upper = [], [], []
    for binding in itertools.chain(
        prog.linear_equality_constraints(),
        prog.linear_constraints(),
        prog.bounding_box_constraints(),
    ):
        E, constraint = _pick(binding, prog, picks), binding.evaluator()
        A = constraint.GetDenseA()
        rows.append(A if E is None else A @ E)
        lower.append(constraint.lower_bound())
        upper.append(constraint.upper_bound())
    A = np.concatenate([np.zeros((0, prog.num_vars())), *rows])
    return (
        np.ascontiguousarray(A),
        np.concatenate([[], *lower]),
        np.concatenate([[], *upper]),
    )


def _size(H: Array, g: Array) -> float:
    """Returns the Frobenius norm of H; if it is 0, that of g; if both, 1.

    Raises ValueError if H or g is not finite: DAQP would call NaN a solution.
    """
    # A sum of squares is finite only if all are; H.T is contiguous.
    square, more = np.vdot(H.T, H.T), g @ g
    if not math.isfinite(square + more):
        if not (np.isfinite(H).all() and np.isfinite(g).all()):
            raise ValueError("cost of the QP: must be finite")
        return 1.0
    return math.sqrt(square) or math.sqrt(more) or 1.0


def _solution(
    *,
    H: Array,
    g: Array,
    A: Array,
    lower: Array,
    upper: Array,
    is_tentative: bool,
) -> tuple[Array, int]:
    """Returns DAQP's x (n,), and its flag."""
    size = _size(H, g)
    # Scaled, as DAQP treats values below 1e-11 as 0.
    if not 1.0 <= size <= 1e6:
        H, g, size = H / size, g / size, 1.0
    if len(A):
        squares = np.einsum("ij,ij->i", A, A)
        # DAQP ignores a row, whatever its bounds, if a' inv(H) a < 1e-11.
        if squares[squares.argmin()] < 1e-10 * size:
            A, lower, upper = _of_length_1(A, lower, upper)
        # DAQP may treat lower > upper as an equality.
        gaps = lower - upper
        if gaps[gaps.argmax()] > _TOLERANCE:
            return g, _INFEASIBLE
    x, _, flag, _ = daqp.solve(
        H=H.T, f=g, A=A, bupper=upper, blower=lower, primal_tol=_TOLERANCE
    )
    if is_tentative and flag in _DOUBTFUL:
        return x, _INFEASIBLE
    if flag not in _DOUBTFUL:
        return x, flag
    # With dependent rows and an ill-conditioned H, rounding may look like
    # infeasibility.
    A, lower, upper = _of_length_1(A, lower, upper)
    x, _, flag, _ = daqp.solve(
        H=H.T / size,
        f=g / size,
        A=A,
        bupper=upper,
        blower=lower,
        primal_tol=1e-8,
        eps_prox=0.01,
        eta_prox=1e-9,
        eq_reduction=1,
    )
    return x, flag


def _of_length_1(
    A: Array, lower: Array, upper: Array
) -> tuple[Array, Array, Array]:
    """Returns rows and bounds with non-zero rows scaled to length 1."""
    lengths = np.linalg.norm(A, axis=1)
    scale = 1.0 / np.where(lengths > 0.0, lengths, 1.0)
    return A * scale[:, None], scale * lower, scale * upper


def _fill(
    result: Any, prog: Any, solution: Array, outcome: solvers.SolutionResult
) -> None:
    """Writes the solution (n,) of `prog` into `result`.

    Only Drake's own solvers can set its variables and cost: one solves x =
    solution with that cost.
    """
    x = np.nan_to_num(solution)
    cost = _NO_COSTS.get(outcome, math.nan)
    if outcome is solvers.SolutionResult.kSolutionFound:
        cost = sum(
            float(prog.EvalBinding(binding, x)[0])
            for binding in [*prog.quadratic_costs(), *prog.linear_costs()]
        )
    solved: Any = solvers.MathematicalProgram()
    variables = prog.decision_variables()
    solved.AddDecisionVariables(variables)
    solved.AddLinearEqualityConstraint(np.eye(len(x)), x, variables)
    solved.AddQuadraticCost(
        Q=np.diag(0.0 * x), b=0.0 * x, c=cost, vars=variables, is_convex=True
    )
    solvers.MakeSolver(solvers.ChooseBestSolver(solved)).Solve(
        prog=solved, initial_guess=None, solver_options=None, result=result
    )
    result.set_x_val(solution)
    result.set_solution_result(outcome)
