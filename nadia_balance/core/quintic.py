"""Motions of least jerk: straight to the end, or through a point before it.

Of all motions between two states (position, velocity, acceleration) in a given
time, the quintic has the least jerk, and so has the rest of it from any state
on it.  The same holds with a point to pass (Flash and Hogan 1985).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nadia_balance.core.walking import Array

STEP = 0.01  # between the times at which a point may be passed [s]


def quintic(
    start: Array, end: Array, horizon: Array, t: float | Array
) -> Array:
    """Follows the quintic from `start` to `end` for the time `t`.

    `start`, `end`, result: rows p, v, a, shape (3, n); `horizon` (n,) [s] is
    the time from start to end, >= t > 0, one for each column.  The result is
    (3, k, n) for k times of shape (k, 1).
    """
    return np.array(_follow(start, end, horizon, t))


def quintic_at(start: Array, end: Array, horizon: Array, t: float) -> Array:
    """Returns quintic(...), six times as fast for few columns and one time."""
    columns = zip(
        start.T.tolist(), end.T.tolist(), horizon.tolist(), strict=True
    )
    return np.array([_follow(a, b, h, t) for a, b, h in columns]).T


def _follow(start: Any, end: Any, h: Any, t: Any) -> tuple[Any, Any, Any]:
    """Returns p, v, a, be the arguments numbers or arrays."""
    p, v, a, c3, c4, c5 = _coefficients(start, end, h)
    s = t / h
    return (
        p + s * (v + s * (a + s * (c3 + s * (c4 + s * c5)))),
        (v + s * (2 * a + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h,
        (2 * a + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h),
    )


def _coefficients(start: Any, end: Any, h: Any) -> tuple[Any, ...]:
    """Returns those of the powers 0 to 5 of t / h."""
    (p0, v0, a0), (p1, v1, a1) = start, end
    v0, a0, v1, a1 = v0 * h, a0 * h * h, v1 * h, a1 * h * h
    gap = p1 - p0 - v0 - 0.5 * a0
    dv, da = v1 - v0 - a0, a1 - a0
    return (
        *(p0, v0, 0.5 * a0),
        10.0 * gap - 4.0 * dv + 0.5 * da,
        -15.0 * gap + 7.0 * dv - da,
        6.0 * gap - 3.0 * dv + 0.5 * da,
    )


def end_beyond(
    start: Array, end: Array, horizon: float, via: Array, t: float
) -> Array:
    """Returns the end (3, n) of the quintic that passes `via` (n,) at `t`.

    That quintic is, until `t` in (0, horizon) [s], the motion of least jerk
    from `start` through via to `end`, both (3, n).  At `t` its fifth
    derivative jumps, and it goes on to end.
    """
    h = horizon - t
    kink = np.array([[1.0], [5.0 / h], [20.0 / (h * h)]])
    times = np.full(via.size, horizon)
    missed = via - quintic_at(start, end, times, t)[0]
    moved = quintic_at(np.zeros((3, 1)), kink, times[:1], t)[0]
    return np.asarray(end + kink * (missed / moved))


def time_to_pass(start: Array, end: Array, horizon: float, via: Array) -> float:
    """Returns when to pass `via` (n,) on the way with the least jerk [s].

    Of the times a multiple of `STEP` before `horizon` [s] > STEP, which are
    the same ones seen from anywhere on the way.  The cost of the detour at t
    is the squared distance from the quintic to via, over (t (horizon - t))^5.
    """
    before_end = np.arange(STEP, horizon - 1e-9, STEP)
    t = horizon - before_end
    missed, s = np.zeros_like(t), t / horizon
    columns = zip(start.T.tolist(), end.T.tolist(), via.tolist(), strict=True)
    for begin, finish, point in columns:
        p, v, a, c3, c4, c5 = _coefficients(begin, finish, horizon)
        way = p + s * (v + s * (a + s * (c3 + s * (c4 + s * c5))))
        missed += (point - way) * (point - way)
    flat = t * before_end
    cost = missed / (flat * flat * flat * flat * flat)
    return float(t[cost.argmin()])
