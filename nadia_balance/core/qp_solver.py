"""Small dense quadratic programs, solved by a back-end chosen by name."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from pydrake.solvers import (
    ClarabelSolver,
    OsqpSolver,
    SolverOptions,
)

from nadia_balance.core.active_set import solve_active_set
from nadia_balance.core.qp_programs import (
    Array,
    EqualityQp,
    FullQp,
    Mask,
    QpProblem,
    QpResult,
)

__all__ = ["SOLVERS", "DenseQp", "QpResult"]

SOLVERS = ("active_set", "clarabel", "osqp")
# Polishing prints a line for each QP without active rows, whatever OSQP is told
# about printing.  A tighter tolerance makes up for it, in the same time.
_OSQP_OPTIONS = {
    "polishing": 0,
    "eps_abs": 1e-10,
    "eps_rel": 1e-10,
    "max_iter": 20_000,
}


class DenseQp:
    """Minimises 1/2 x'Hx + g'x, A_eq x = b_eq, lower <= C x <= upper.

    H (n, n) must be positive definite, bounds may be infinite.  The
    MathematicalProgram is built once, its coefficients are overwritten by
    each solve: no result depends on an earlier one, since the warm start is
    an argument.  Solvers:

    * "active_set": exact, and fast with a good guess of the active rows.  If
      it gives up, Clarabel solves the QP, and the result says so.
    * "clarabel", "osqp": without a guess, to their own accuracy.

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
        methods: dict[str, Callable[[QpProblem, Mask], QpResult]] = {
            "active_set": self._active_set,
            "clarabel": self._clarabel,
            "osqp": self._osqp,
        }
        if solver not in methods:
            raise ValueError(
                f"solver = {solver!r}: must be one of {', '.join(methods)}"
            )
        self._method = methods[solver]
        self._num_inequalities = num_inequalities
        self._equality_qp = EqualityQp(num_variables)
        self._full_qp = FullQp(num_variables, num_equalities, num_inequalities)

    def solve(
        self, problem: QpProblem, active_guess: Mask | None = None
    ) -> QpResult:
        """Solves the QP; `active_guess` (m,) is `active` of a similar one.

        Raises:
            ValueError: NaN in the problem, or infinity outside the bounds.
        """
        if active_guess is None:
            active_guess = np.zeros(self._num_inequalities, dtype=np.int8)
        return self._method(problem, active_guess)

    def _active_set(self, problem: QpProblem, guess: Mask) -> QpResult:
        found = solve_active_set(self._equality_qp, problem, guess)
        if found.solved:
            return found
        return self._referee(problem, found.iterations + 1)

    def _referee(self, problem: QpProblem, solves: int) -> QpResult:
        """Clarabel's answer, made exact if its active rows allow it."""
        x, active = self._full_qp.solve(problem, ClarabelSolver())
        found = _report(problem, x, active)
        if found.solved:
            exact = solve_active_set(self._equality_qp, problem, active)
            solves += exact.iterations
            found = exact if exact.solved else found
        return found._replace(iterations=solves, fallback=True)

    def _clarabel(self, problem: QpProblem, _: Mask) -> QpResult:
        problem.require_finite()
        x, active = self._full_qp.solve(problem, ClarabelSolver())
        return _report(problem, x, active)

    def _osqp(self, problem: QpProblem, _: Mask) -> QpResult:
        problem.require_finite()
        options = SolverOptions()
        for name, value in _OSQP_OPTIONS.items():
            options.SetOption(OsqpSolver.id(), name, value)
        x, active = self._full_qp.solve(problem, OsqpSolver(), options)
        return _report(problem, x, active)


def _report(problem: QpProblem, x: Array, active: Mask) -> QpResult:
    violation = problem.violation(x, problem.excess(x))
    solved = math.isfinite(violation)
    return QpResult(x, solved, active, 1, False, violation)
