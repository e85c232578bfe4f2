"""Small dense quadratic programs, solved by a back-end chosen by name."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.solvers import (
    Binding,
    ChooseBestSolver,
    ClarabelSolver,
    ClpSolver,
    EvaluatorBase,
    MakeSolver,
    MathematicalProgram,
    MathematicalProgramResult,
    SolverOptions,
)

from nadia_balance.core.walking import Array

Mask = NDArray[np.int8]
Indices = NDArray[np.intp]

SOLVERS = ("active_set", "clarabel")

_MAX_ROUNDS = 6  # of the active set: what takes more of them mostly cycles
# Of rows of length 1: times the norm of the equality bounds, plus 1, plus the
# row's own value; times the norm of the cost's gradient, plus 1.
_PRIMAL_TOLERANCE, _DUAL_TOLERANCE = 1e-8, 1e-9
# Drake's default, 1e-12, takes rounding for contradiction.
_FEASIBILITY_TOLERANCE = 1e-7
# A hundredth of Clarabel's default: slack and multiplier are told apart.
_GAP_TOLERANCE = 1e-10


class QpProblem(NamedTuple):
    """Minimise 1/2 x'Hx + g'x, A_eq x = b_eq, lower <= C x <= upper."""

    H: Array
    g: Array
    A_eq: Array
    b_eq: Array
    C: Array
    lower: Array
    upper: Array

    def excess(self, value: Array) -> Array:
        """How far `value` (m,) = C x is outside its bounds, negative inside."""
        return np.asarray(np.maximum(self.lower - value, value - self.upper))

    def violation(self, x: Array, excess: Array) -> float:
        """The largest absolute violation of a constraint, NaN if x is."""
        violations = excess
        if self.b_eq.size:
            residual = np.abs(self.A_eq @ x - self.b_eq)
            violations = np.concatenate((residual, excess))
        if not violations.size:
            return 0.0 * float(x.sum())
        # numpy's max() takes five times as long; all three hand on a NaN.
        return max(float(violations[violations.argmax()]), 0.0)

    def scaled(self) -> "QpProblem":
        """The same problem, all rows about as long as 1; itself if they are.

        Else tolerances would not mean the same for all.  By powers of two,
        because these round nothing; what is within a factor of 1000 stays.

        Raises:
            ValueError: NaN or infinity, but for the bounds.
        """
        H, g, A, b, C, lower, upper = self
        squares = [np.einsum("ij,ij->i", rows, rows) for rows in (A, C)]
        every = np.concatenate(squares)
        finite = math.isfinite(np.vdot(H, H) + g @ g + b @ b)
        if finite and every.size:
            # argmin() finds a NaN, and takes a fifth of the time of min().
            least, most = every[every.argmin()], every[every.argmax()]
            if least == 0.0:  # rows of nothing, too
                least = np.min(every, initial=1.0, where=every > 0.0)
            if 1e-6 < least and most < 1e6:
                return self
        if not finite or not np.isfinite(every).all():
            self.require_finite()
        s, t = map(_scales, squares)
        rows, limits = t[:, None] * C, (t * lower, t * upper)
        return QpProblem(H, g, s[:, None] * A, s * b, rows, *limits)

    def bounds(self, rows: Indices, active: Mask) -> Array:
        """The bounds at which `rows` (k,) of the inequalities are active."""
        below = active[rows] < 0
        return np.where(below, self.lower[rows], self.upper[rows])

    def require_finite(self) -> None:
        """Raises ValueError naming the argument that is not finite."""
        for name in ("H", "g", "A_eq", "b_eq", "C"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} of the QP: must be finite")
        if not (self.lower < math.inf).all():
            raise ValueError("lower bound of the QP: must be < inf, not NaN")
        if not (self.upper > -math.inf).all():
            raise ValueError("upper bound of the QP: must be > -inf, not NaN")


def _scales(squares: Array) -> Array:
    """What brings rows with these squared lengths (m,) to 0.5 to 1."""
    return np.asarray(np.ldexp(1.0, -np.frexp(np.sqrt(squares))[1]))


class QpResult(NamedTuple):
    """What a solver found, and how.

    `x` (n,) is NaN unless `solved`.  `active` (m,) tells which bound of each
    inequality holds as an equality: -1 lower, 0 none, 1 upper.  `iterations`
    counts the programs solved, `fallback` tells that the interior point had
    to help, `violation` is the largest absolute violation of a constraint,
    NaN unless `solved`.
    """

    x: Array
    solved: bool
    active: Mask
    iterations: int
    fallback: bool = False
    violation: float = math.nan


class EqualityQp:
    """The QP with the active inequalities as equalities, in closed form.

    Drake's EqConstrainedQP solver.  The number of rows may change from call
    to call; the program needs one row to begin with.
    """

    def __init__(self, num_variables: int) -> None:
        self._program, self._cost, x = _program(num_variables)
        rows = self._program.AddLinearEqualityConstraint(
            np.zeros((1, num_variables)), np.zeros(1), x
        )
        # Kept, because each access takes as long as an update.
        self._rows = rows.evaluator()
        # As GetDualSolution wants it: to convert a binding takes 20 us.
        self._dual_key = Binding[EvaluatorBase](self._rows, rows.variables())
        # It has no public name, but is Drake's choice for all such programs.
        self._solver = MakeSolver(ChooseBestSolver(self._program))
        self._options = SolverOptions()
        self._options.SetOption(
            self._solver.solver_id(), "FeasibilityTol", _FEASIBILITY_TOLERANCE
        )
        self._result = MathematicalProgramResult()

    def solve(self, problem: QpProblem, active: Mask) -> tuple[Array, Array]:
        """Returns x (n,) and the multipliers of all inequalities (m,).

        A multiplier is the change of the cost per unit of the active bound:
        right are >= 0 at a lower, <= 0 at an upper bound.  x is NaN if the
        rows contradict each other, or are not finite.
        """
        A, b = problem.A_eq, problem.b_eq
        rows = active.nonzero()[0]
        if rows.size:
            A = np.concatenate((A, problem.C[rows]))
            b = np.concatenate((b, problem.bounds(rows, active)))
        multipliers = np.zeros(active.size)
        # A sum of squares is finite only if all are.  Drake would end the
        # process.
        if not math.isfinite(np.vdot(A, A) + b @ b):
            return np.full(problem.g.size, np.nan), multipliers
        # H.T is H in the order of memory that spares Drake a copy.
        self._cost.UpdateCoefficients(problem.H.T, problem.g, 0.0, True)
        self._rows.UpdateCoefficients(A, b)
        result = self._result
        self._solver.Solve(self._program, None, self._options, result)
        if not result.is_success():
            return np.full(problem.g.size, np.nan), multipliers
        if rows.size:
            dual = result.GetDualSolution(self._dual_key)
            multipliers[rows] = dual[problem.b_eq.size :]
        return np.asarray(result.get_x_val()), multipliers


class FullQp:
    """The whole QP, for Clarabel's interior-point method."""

    def __init__(
        self, num_variables: int, num_equalities: int, num_inequalities: int
    ) -> None:
        self._program, self._cost, x = _program(num_variables)
        # At least one row each, because Drake drops constraints without any.
        rows = np.zeros((max(1, num_equalities), num_variables))
        self._rows = self._program.AddLinearEqualityConstraint(
            rows, rows[:, 0], x
        )
        rows = np.zeros((max(1, num_inequalities), num_variables))
        self._limits = self._program.AddLinearConstraint(
            rows, rows[:, 0], rows[:, 0], x
        )
        self._options = SolverOptions()
        for name in ("tol_gap_abs", "tol_gap_rel"):
            self._options.SetOption(ClarabelSolver.id(), name, _GAP_TOLERANCE)

    def solve(self, problem: QpProblem) -> QpResult:
        """Returns what Clarabel finds, to its accuracy.

        Active is a bound whose multiplier is larger than its slack.
        """
        self._cost.UpdateCoefficients(problem.H, problem.g, is_convex=True)
        self._rows.evaluator().UpdateCoefficients(problem.A_eq, problem.b_eq)
        self._limits.evaluator().UpdateCoefficients(
            problem.C, problem.lower, problem.upper
        )
        result = ClarabelSolver().Solve(self._program, None, self._options)
        active = np.zeros(problem.lower.size, dtype=np.int8)
        x = np.full(problem.g.size, np.nan)
        if result.is_success():
            x = np.asarray(result.get_x_val())
            value = problem.C @ x
            multipliers = result.GetDualSolution(self._limits)
            active[multipliers > value - problem.lower] = -1
            active[-multipliers > problem.upper - value] = 1
        return QpResult(x, result.is_success(), active, 1)


def _program(num_variables: int) -> tuple[Any, Any, Any]:
    """A program with a quadratic cost: the program, the cost, its variables.

    Untyped, because Drake's stubs do not know NumPy's present array types.
    """
    program = MathematicalProgram()
    x = program.NewContinuousVariables(num_variables)
    H: Any = np.eye(num_variables)
    g: Any = np.zeros(num_variables)
    cost = program.AddQuadraticCost(H, g, x, is_convex=True)
    return program, cost.evaluator(), x


def solve_active_set(
    qp: EqualityQp, problem: QpProblem, guess: Mask
) -> QpResult:
    """Returns the optimum, or what is not `solved` if that takes too long.

    x is the optimum if the active rows hold as equalities, their multipliers
    have the right signs and no other row is violated (Nocedal and Wright,
    Numerical Optimization, Theorem 16.4).  Each round drops all rows of the
    wrong sign and adds all violated ones; one or two are mostly enough, but
    they could cycle.  `problem` is `scaled`.

    Raises:
        ValueError: NaN or infinity in the problem.
    """
    active = _existing(problem, guess)
    primal_limit = _PRIMAL_TOLERANCE * _size(problem.b_eq)
    dual_limit = _DUAL_TOLERANCE * _size(problem.g)
    for solves in range(1, _MAX_ROUNDS + 1):
        x, multipliers = qp.solve(problem, active)
        value = problem.C @ x
        excess = problem.excess(value)
        violation = whole = problem.violation(x, excess)
        if not violation <= primal_limit:
            excess -= _PRIMAL_TOLERANCE * np.abs(value)
            violation = problem.violation(x, excess)
        wrong = active * multipliers > dual_limit
        wrong &= problem.lower != problem.upper
        if violation <= primal_limit and not wrong.any():
            return QpResult(x, True, active, solves, violation=whole)
        problem.require_finite()
        if math.isnan(violation):  # the active rows contradict each other
            break
        violated = (excess > primal_limit) & (active == 0)
        nearest = np.where(value < problem.lower, -1, 1)
        active = np.where(violated, nearest, active).astype(np.int8)
        active[wrong] = 0
    return QpResult(np.full(problem.g.size, np.nan), False, active, solves)


def _existing(problem: QpProblem, guess: Mask) -> Mask:
    """Returns a copy of `guess` without the bounds that are infinite."""
    active = guess.copy()
    rows = active.nonzero()[0]
    if rows.size:
        active[rows[np.isinf(problem.bounds(rows, active))]] = 0
    return active


def _size(values: Array) -> float:
    return 1.0 + math.sqrt(values @ values)


class DenseQp:
    """Minimises 1/2 x'Hx + g'x, A_eq x = b_eq, lower <= C x <= upper.

    H (n, n) must be positive definite, bounds may be infinite.  The
    MathematicalProgram is built once, its coefficients are overwritten by
    each solve: no result depends on an earlier one, since the warm start is
    an argument.  Solvers:

    * "active_set": exact, and fast with a good guess of the active rows.  If
      it gives up, Clarabel solves the QP, and the result says so.
    * "clarabel": without a guess, to its own accuracy.

    Raises:
        ValueError: there is no solver of this name.
    """

    def __init__(
        self,
        num_variables: int,
        num_equalities: int,
        num_inequalities: int,
        solver: str = "active_set",
    ) -> None:
        if solver not in SOLVERS:
            raise ValueError(
                f"solver = {solver!r}: must be one of {', '.join(SOLVERS)}"
            )
        self._solver, self._num_inequalities = solver, num_inequalities
        self._equality_qp = EqualityQp(num_variables)
        self._full_qp = FullQp(num_variables, num_equalities, num_inequalities)

    def solve(
        self, problem: QpProblem, active_guess: Mask | None = None
    ) -> QpResult:
        """Solves the QP; `active_guess` (m,) is `active` of a similar one.

        Raises:
            ValueError: NaN in the problem, or infinity outside the bounds, or
                an infinite bound that nothing can meet.
        """
        scaled = problem.scaled()
        if self._solver == "clarabel":
            scaled.require_finite()
            found = self._full_qp.solve(scaled)
        else:
            if active_guess is None:
                active_guess = np.zeros(self._num_inequalities, dtype=np.int8)
            found = solve_active_set(self._equality_qp, scaled, active_guess)
            if not found.solved:
                found = self._fall_back(scaled, found)
        if scaled is problem and not math.isnan(found.violation):
            return found
        excess = problem.excess(problem.C @ found.x)
        return found._replace(violation=problem.violation(found.x, excess))

    def _fall_back(self, problem: QpProblem, failed: QpResult) -> QpResult:
        """Clarabel's answer, made exact if its active rows allow it."""
        found, solves = self._full_qp.solve(problem), failed.iterations + 1
        if found.solved:
            exact = solve_active_set(self._equality_qp, problem, found.active)
            solves += exact.iterations
            found = exact if exact.solved else found
        return found._replace(iterations=solves, fallback=True)


def largest_first(A: Array, b: Array) -> Array | None:
    """Returns the x (n,) of the largest x[0] with A x <= b; None: no such x.

    A linear program, by the simplex method.
    """
    program: Any = MathematicalProgram()  # its stubs know no Array
    x = program.NewContinuousVariables(A.shape[1])
    program.AddLinearConstraint(A, np.full(len(b), -np.inf), b, x)
    program.AddLinearCost(-x[0])
    result = ClpSolver().Solve(program)
    return np.asarray(result.GetSolution(x)) if result.is_success() else None
