"""A dual active-set method for strictly convex QPs, which cannot cycle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.qp_programs import (
    Array,
    EqualityQp,
    Indices,
    Mask,
    QpProblem,
    QpResult,
)

Flags = NDArray[np.bool_]

_MAX_SOLVES = 40  # takes as long as the interior point that then takes over
_PRIMAL_TOLERANCE = 1e-8  # times the norm of the equality bounds, plus 1
_DUAL_TOLERANCE = 1e-9  # times the norm of the cost's gradient, plus 1


class InfeasibleError(Exception):
    """The constraints exclude each other."""


class Iterate:
    """Optimum x (n,) of the QP whose only rows are the active ones (m,)."""

    x: Array
    multipliers: Array

    def __init__(self, qp: EqualityQp, problem: QpProblem, active: Mask):
        """Starts with the rows `active`; x is yet to be solved for."""
        self.qp, self.problem, self.active = qp, problem, active
        self.solves = 0
        self.primal_limit = _PRIMAL_TOLERANCE * _size(problem.b_eq)

    def solve(self) -> tuple[Array, Array]:
        """Returns x and the multipliers of the active rows."""
        self.solves += 1
        return self.qp.solve(self.problem, self.active)

    def pull(self, multipliers: Array) -> Array:
        """Multipliers (m,), positive where the sign is wrong."""
        one_sided = self.problem.lower != self.problem.upper
        return np.asarray(self.active * multipliers * one_sided)

    def wrong(self) -> Indices:
        """The active rows (k,) whose multiplier has the wrong sign."""
        rows = self.active.nonzero()[0]
        if not rows.size:
            return rows
        limit = _DUAL_TOLERANCE * _size(self.problem.g)
        return (self.pull(self.multipliers) > limit).nonzero()[0]

    def result(self, violation: float) -> QpResult:
        """What is found, if x is the optimum of the problem."""
        return QpResult(
            self.x, True, self.active, self.solves, False, violation
        )

    def no_result(self) -> QpResult:
        """What is found, if the problem is not solved."""
        nowhere = np.full(self.problem.g.size, np.nan)
        return QpResult(
            nowhere, False, self.active, self.solves, False, math.nan
        )


def solve_dual(now: Iterate) -> QpResult:
    """Adds the most violated row, time and again.

    Dual active-set method of Goldfarb and Idnani, A numerically stable dual
    method for solving strictly convex quadratic programs, Mathematical
    Programming 27 (1983).  The cost grows with every row that is added, so
    that no set of rows comes back.

    Raises:
        InfeasibleError: the constraints exclude each other.
    """
    _make_dual_feasible(now)
    while now.solves < _MAX_SOLVES:
        excess = now.problem.excess(now.x)
        violation = now.problem.violation(now.x, excess)
        if violation <= now.primal_limit:
            return now.result(violation)
        excess[now.active != 0] = 0.0
        row = int(excess.argmax())
        now.active = with_violated(
            now.problem, now.x, now.active, np.arange(excess.size) == row
        )
        while not _approach(now, row) and now.solves < _MAX_SOLVES:
            pass
    return now.no_result()


def _make_dual_feasible(now: Iterate) -> None:
    """Drops rows until all multipliers have the right sign."""
    while True:
        now.x, now.multipliers = now.solve()
        wrong = now.wrong()
        if np.isnan(now.x).any():
            wrong = now.active.nonzero()[0]
        if not wrong.size:
            return
        now.active[wrong] = 0


def _approach(now: Iterate, row: int) -> bool:
    """Moves to the bound of the new `row`; True if that is reached.

    On the way x and the multipliers are linear.  Where a multiplier would
    get the wrong sign its row is dropped, and the move ends.

    Raises:
        InfeasibleError: the active rows and the new one exclude each other.
    """
    x, multipliers = now.solve()
    independent = bool(now.problem.excess(x)[row] <= now.primal_limit)
    if independent:
        step = multipliers - now.multipliers
    else:
        step = _dependence(now, row)
    before, slope = now.pull(now.multipliers), now.pull(step)
    slope[row] = 0.0
    length = np.full(slope.size, np.inf)
    falls = slope > 0.0
    length[falls] = np.maximum(-before[falls], 0.0) / slope[falls]
    blocking = int(length.argmin())
    if independent and length[blocking] >= 1.0:
        now.x, now.multipliers = x, multipliers
        return True
    if np.isinf(length[blocking]):
        raise InfeasibleError
    if independent:
        now.x = now.x + length[blocking] * (x - now.x)
    now.multipliers = now.multipliers + length[blocking] * step
    now.multipliers[blocking] = 0.0
    now.active[blocking] = 0
    return False


def _dependence(now: Iterate, row: int) -> Array:
    """How the multipliers (m,) can change while x stays where it is."""
    others = np.flatnonzero(now.active)
    others = others[others != row]
    rows = np.concatenate((now.problem.A_eq, now.problem.C[others]))
    share = np.linalg.lstsq(rows.T, now.problem.C[row], rcond=None)[0]
    step = np.zeros(now.active.size)
    step[row] = -now.active[row]
    step[others] = now.active[row] * share[now.problem.b_eq.size :]
    return step


def with_violated(
    problem: QpProblem, x: Array, active: Mask, add: Flags
) -> Mask:
    """Returns `active` with the violated bounds of the rows `add`."""
    nearest = np.where(problem.C @ x < problem.lower, -1, 1)
    return np.where(add, nearest, active).astype(np.int8)


def _size(values: Array) -> float:
    return 1.0 + math.sqrt(values @ values)
