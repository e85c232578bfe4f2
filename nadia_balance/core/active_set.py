"""A warm-started active-set method for strictly convex QPs.

Its one building block is the QP with equality constraints only: first a few
quick guesses of the active rows, then a method that cannot cycle.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.qp_programs import Array, EqualityQp, Mask, QpProblem

Flags = NDArray[np.bool_]

_QUICK_ROUNDS = 3
_MAX_SOLVES = 40  # takes as long as the interior point that then takes over
_PRIMAL_TOLERANCE = 1e-8  # times the largest equality bound, at least 1
_DUAL_TOLERANCE = 1e-9  # times the largest cost gradient, at least 1


class InfeasibleError(Exception):
    """The constraints exclude each other."""


@dataclass
class _Iterate:
    """Optimum x (n,) of the QP whose only rows are the active ones (m,)."""

    qp: EqualityQp
    problem: QpProblem
    active: Mask
    x: Array = field(default_factory=lambda: np.zeros(0))
    multipliers: Array = field(default_factory=lambda: np.zeros(0))
    solves: int = 0

    def __post_init__(self) -> None:
        self.primal_limit = _PRIMAL_TOLERANCE * _size(self.problem.b_eq)
        self.dual_limit = _DUAL_TOLERANCE * _size(self.problem.g)
        self.one_sided = self.problem.lower != self.problem.upper

    def solve(self) -> tuple[Array, Array]:
        self.solves += 1
        return self.qp.solve(self.problem, self.active)

    def pull(self, multipliers: Array) -> Array:
        """Multipliers (m,), positive where the sign is wrong."""
        return np.asarray(self.active * multipliers * self.one_sided)


def solve_active_set(
    qp: EqualityQp, problem: QpProblem, guess: Mask
) -> tuple[Array | None, Mask, int]:
    """Returns the optimum x (n,) or None, the active rows (m,), the solves.

    x is the optimum if the active rows hold as equalities, their multipliers
    have the right signs and no other row is violated (Nocedal and Wright,
    Numerical Optimization, Theorem 16.4).  Quick rounds drop all rows of the
    wrong sign and add all violated ones; one or two are mostly enough, but
    they could cycle.

    Raises:
        ValueError: NaN or infinity in the problem.
    """
    now = _Iterate(qp, problem, _existing(problem, guess))
    for _ in range(_QUICK_ROUNDS):
        now.x, now.multipliers = now.solve()
        excess = problem.excess(now.x)
        violated = excess > now.primal_limit
        wrong = now.pull(now.multipliers) > now.dual_limit
        good = problem.violation(now.x, excess) <= now.primal_limit
        if good and not wrong.any():
            return now.x, now.active, now.solves
        problem.require_finite()
        if np.isnan(now.x).any():  # the active rows contradict each other
            now.active = np.zeros_like(guess)
            break
        add = violated & (now.active == 0)
        now.active = _with(problem, now.x, now.active, add)
        now.active[wrong] = 0
    try:
        return _solve_dual(now), now.active, now.solves
    except InfeasibleError:
        return None, now.active, now.solves


def _solve_dual(now: _Iterate) -> Array | None:
    """Adds the most violated row, time and again; None if that takes long.

    Dual active-set method of Goldfarb and Idnani, A numerically stable dual
    method for solving strictly convex quadratic programs, Mathematical
    Programming 27 (1983).  The cost grows with every row that is added, so
    that no set of rows comes back.
    """
    _make_dual_feasible(now)
    while now.solves < _MAX_SOLVES:
        excess = now.problem.excess(now.x)
        if now.problem.violation(now.x, excess) <= now.primal_limit:
            return now.x
        excess[now.active != 0] = 0.0
        row = int(excess.argmax())
        now.active = _with(
            now.problem, now.x, now.active, np.arange(excess.size) == row
        )
        while not _approach(now, row) and now.solves < _MAX_SOLVES:
            pass
    return None


def _make_dual_feasible(now: _Iterate) -> None:
    """Drops rows until all multipliers have the right sign."""
    while True:
        now.x, now.multipliers = now.solve()
        wrong = now.pull(now.multipliers) > now.dual_limit
        if np.isnan(now.x).any():
            wrong = now.active != 0
        if not wrong.any():
            return
        now.active[wrong] = 0


def _approach(now: _Iterate, row: int) -> bool:
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


def _dependence(now: _Iterate, row: int) -> Array:
    """How the multipliers (m,) can change while x stays where it is."""
    others = np.flatnonzero(now.active)
    others = others[others != row]
    rows = np.concatenate((now.problem.A_eq, now.problem.C[others]))
    share = np.linalg.lstsq(rows.T, now.problem.C[row], rcond=None)[0]
    step = np.zeros(now.active.size)
    step[row] = -now.active[row]
    step[others] = now.active[row] * share[now.problem.b_eq.size :]
    return step


def _existing(problem: QpProblem, active: Mask) -> Mask:
    """Returns `active` without the bounds that are infinite."""
    bound = np.where(active < 0, problem.lower, problem.upper)
    return np.where(np.isfinite(bound), active, 0).astype(np.int8)


def _with(problem: QpProblem, x: Array, active: Mask, add: Flags) -> Mask:
    """Returns `active` with the violated bounds of the rows `add`."""
    nearest = np.where(problem.C @ x < problem.lower, -1, 1)
    return np.where(add, nearest, active).astype(np.int8)


def _size(values: Array) -> float:
    return max(1.0, float(np.abs(values).max(initial=0.0)))
