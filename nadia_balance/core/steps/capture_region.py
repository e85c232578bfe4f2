"""N-step capture regions: footholds from which N or fewer steps recover.

Nadia paper, Sec. IV.  All arguments of a function are in the same frame.
"""

import math
from collections.abc import Sequence

import numpy as np

from nadia_balance.core.math import polygon
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import minkowski_sum

_ORIGIN = np.zeros((1, 2))


def one_step_region(
    icp: Array, foot: Array, omega: float, touchdown: tuple[float, float]
) -> Array:
    """Returns C_1 (n, 2) [m], the one-step capture region.

    C_1 is the hull of icp + l (icp - q) over all vertices q of the stance
    polygon `foot` (k, 2) [m] and both l = e^wt - 1 at the ends t of the
    interval `touchdown` [s] from now: the ICPs at touchdown of all CoP
    trajectories within `foot` (Nadia paper, Eq. 9).
    Erratum: the Nadia paper, Fig. 2, lets t go to infinity and cuts with a
    circle, so that the region jumps when the ICP leaves the foot.

    Raises ValueError: NaN or infinity.
    """
    scales = [math.exp(omega * t) - 1.0 for t in touchdown]
    (x, y), corners = icp.tolist(), foot.tolist()
    copies = [
        (x + scale * (x - qx), y + scale * (y - qy))
        for scale in scales
        for qx, qy in corners
    ]
    return polygon.as_array(polygon.hull(copies))


def later_steps(
    reaches: Sequence[Array], contractions: Sequence[float]
) -> list[Array]:
    """Returns [D_1, ..., D_N], (n, 2) [m]: ICP offsets captured by later steps.

    D_n is the set of offsets of the ICP from the next foothold that n - 1 or
    fewer further steps capture.  The recursion runs from the last step to the
    first: D = {0} at the last foothold, then D <- conv({0} u E_k (R_k + D)),
    with Minkowski sums, as the robot may stop after any step, but cannot skip
    one.  `reaches` are R_2, ..., R_N [m], each about its own stance foot, so on
    alternating sides; `contractions` are E_k = e^-wT for the time T between
    touchdowns.

    The hull is exact for convex R_k, as a step may last longer than planned:
    it is the union of E (R + D) for 0 <= E <= E_k, and E = 0 means stopping.
    Erratum: the Nadia paper, Eq. 14, adds E^(n-1) R_n to C_n-1.  These regions
    do not nest where a foot cannot be put beneath the hip, and with 0 in each
    R_n, a step of zero length replaces a step of the other foot.
    """
    regions = []
    for n in range(len(reaches) + 1):
        offsets = _ORIGIN
        for k in reversed(range(n)):
            offsets = contractions[k] * minkowski_sum(reaches[k], offsets)
            offsets = polygon.convex_hull(np.concatenate([_ORIGIN, offsets]))
        regions.append(offsets)
    return regions


def capture_region(one_step: Array, offsets: Array) -> Array:
    """Returns C_n = C_1 + (-D_n), (k, 2) [m], for `offsets` = D_n."""
    return minkowski_sum(one_step, -offsets)
