"""Capture regions: where to step so as to recover in N steps or fewer.

All in W, or any other frame that all the arguments share.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from nadia_balance.core.minkowski_sum import minkowski_sum
from nadia_balance.core.polygon import (
    as_array,
    clip_all,
    contains,
    convex_hull,
    hull,
    intersection,
)
from nadia_balance.core.walking import Array

_ORIGIN = np.zeros((1, 2))
_FAR = 1e6  # farther than any reach, still far from rounding [-]


def transfer_factor(omega: float, duration: float) -> float:
    """Returns f >= 1: how much farther to step for a transfer that takes time.

    If the CoP moves from r_0 to r in a straight line within `duration` [s]
    after touchdown, then the ICP is at r in the end if
    r = r_0 + f (icp_touchdown - r_0), f = wT / (1 - e^-wT).
    Erratum: the Nadia paper, Eq. 9, puts all weight on r at once, f = 1.
    """
    x = omega * duration
    return x / -math.expm1(-x) if x > 0.0 else 1.0


def one_step_region(
    icp: Array,
    foot: Array,
    omega: float,
    touchdown: tuple[float, float],
    factor: float = 1.0,
) -> Array:
    """Returns C_1 (n, 2) [m]: where the ICP may be when the foot lands.

    For any course of the CoP within the stance polygon `foot` (k, 2) [m], and
    a landing at any time in the interval `touchdown` [s] from now; `factor`
    is that of `transfer_factor`.  The hull of icp + l (icp - q), of all
    vertices q and the two l = factor e^wt - 1.
    Erratum: the Nadia paper, Fig. 2, lets t go to infinity and cuts with a
    circle, so that the region jumps when the ICP leaves the foot.
    """
    scales = [factor * math.exp(omega * t) - 1.0 for t in touchdown]
    (x, y), corners = icp.tolist(), foot.tolist()
    copies = [
        (x + scale * (x - qx), y + scale * (y - qy))
        for scale in scales
        for qx, qy in corners
    ]
    return as_array(hull(copies))


def one_step_region_in_disc(
    icp: Array, foot: Array, omega: float, remaining_time: float, disc: Array
) -> Array:
    """Returns C_1 (n, 2) [m] as the Nadia paper draws it (Fig. 2).

    Landing at any time from `remaining_time` [s] on, within the convex
    polygon `disc` (m, 2) [m]; (0, 2) if it is out of there by then.  From
    inside the `foot` (k, 2) the ICP can be brought anywhere: all of the disc.
    """
    if contains(icp, foot):
        return disc
    away = icp - foot
    near = icp + math.expm1(omega * remaining_time) * away
    beyond = near + _FAR * away  # on the rays that the vertices leave by
    return intersection(convex_hull(np.concatenate([near, beyond])), disc)


def later_steps(
    reaches: Sequence[Array],
    contractions: Sequence[float],
    feet: Sequence[Array] = (),
) -> list[Array]:
    """Returns [D_1, ..., D_N], each (n, 2) [m]: what later steps are worth.

    D_n is the set of all offsets of the ICP from the foot that lands next,
    from which n - 1 further steps capture it (Nadia paper, Eq. 14):
    D_n = E_2 R_2 + E_2 E_3 R_3 + ... + E_2 ... E_n R_n, as Minkowski sums.
    `reaches` are R_2, ..., R_N [m], each about its own stance foot, so on
    alternating sides; `contractions` the E_n = e^-wT of the whole step from
    one touchdown to the next.  With `feet`, the CoP polygons G_1, ..., G_N [m]
    about the holds, the CoP may go anywhere in them instead of staying at
    the foot's centre: + (1 - E_2) G_1 + E_2 (1 - E_3) G_2 + ... + E_2 ... G_N.
    Erratum: the paper's R_b lacks the stance foot itself, without which the
    regions do not nest; here it is conv({0} u R).
    """
    total, scale = _ORIGIN, 1.0
    regions = [_with_foot(total, 1.0, feet, 0)]
    for n, (reach, E) in enumerate(zip(reaches, contractions, strict=True)):
        total = _with_foot(total, scale * (1.0 - E), feet, n)
        scale *= E
        reach = convex_hull(np.concatenate([_ORIGIN, reach]))
        total = minkowski_sum(total, scale * reach)
        regions.append(_with_foot(total, scale, feet, n + 1))
    return regions


def _with_foot(
    region: Array, scale: float, feet: Sequence[Array], n: int
) -> Array:
    return minkowski_sum(region, scale * feet[n]) if len(feet) else region


def capture_region(one_step: Array, offsets: Array) -> Array:
    """Returns C_n = C_1 + (-D_n), (k, 2) [m], for `offsets` = D_n."""
    return minkowski_sum(one_step, -offsets)


def usable_foot(
    sole: Array, front: float, back: float, inside: float, outside: float
) -> Array:
    """Returns the part (n, 2) [m] of `sole` that the CoP may be counted on.

    `sole` (k, 2) in the frame with y toward the swing side; so much [m] is
    cut off from its front, back, inner and outer side.

    Raises:
        ValueError: nothing is left.
    """
    upper = sole.max(axis=0) - [front, inside]
    lower = sole.min(axis=0) + [back, outside]
    axes = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    part = clip_all(sole, axes, np.concatenate([upper, -lower]))
    if not len(part):
        raise ValueError(
            f"foot_front = {front}, foot_back = {back}, foot_inside = "
            f"{inside}, foot_outside = {outside}: must leave some of the sole"
        )
    return part
