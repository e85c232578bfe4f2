"""A warm-started active-set method for strictly convex QPs.

Its one building block is the QP with equality constraints only: first a few
quick guesses of the active rows, then a method that cannot cycle.
"""

from __future__ import annotations

import math

import numpy as np

from nadia_balance.core.dual_active_set import (
    InfeasibleError,
    Iterate,
    solve_dual,
    with_violated,
)
from nadia_balance.core.qp_programs import (
    EqualityQp,
    Mask,
    QpProblem,
    QpResult,
)

_QUICK_ROUNDS = 3


def solve_active_set(
    qp: EqualityQp, problem: QpProblem, guess: Mask
) -> QpResult:
    """Returns the optimum, or what is not `solved` if that takes too long.

    x is the optimum if the active rows hold as equalities, their multipliers
    have the right signs and no other row is violated (Nocedal and Wright,
    Numerical Optimization, Theorem 16.4).  Quick rounds drop all rows of the
    wrong sign and add all violated ones; one or two are mostly enough, but
    they could cycle.

    Raises:
        ValueError: NaN or infinity in the problem.
    """
    now = Iterate(qp, problem, _existing(problem, guess))
    for _ in range(_QUICK_ROUNDS):
        now.x, now.multipliers = now.solve()
        excess, wrong = problem.excess(now.x), now.wrong()
        violation = problem.violation(now.x, excess)
        if violation <= now.primal_limit and not wrong.size:
            return now.result(violation)
        problem.require_finite()
        if math.isnan(violation):  # the active rows contradict each other
            now.active = np.zeros_like(guess)
            break
        add = (excess > now.primal_limit) & (now.active == 0)
        now.active = with_violated(problem, now.x, now.active, add)
        now.active[wrong] = 0
    try:
        return solve_dual(now)
    except InfeasibleError:
        return now.no_result()


def _existing(problem: QpProblem, guess: Mask) -> Mask:
    """Returns a copy of `guess` without the bounds that are infinite."""
    active = guess.copy()
    rows = active.nonzero()[0]
    if rows.size:
        active[rows[np.isinf(problem.bounds(rows, active))]] = 0
    return active
