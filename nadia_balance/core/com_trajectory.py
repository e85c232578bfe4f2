"""CoM trajectories of Eq. 4 of the Nadia paper, from two recursions.

Within a segment of duration T, with the local time t in [0, T],

    x(t) = c0 e^(w (t - T)) + c1 e^(-w t) + c2 t^3 + c3 t^2 + c4 t + c5.

Counting the growing exponential from the end of the segment (Eq. 4: e^(w t))
keeps the numbers small however long the segment is.  The eCMP x - xddot / w^2
is free of both exponentials, the ICP x + xdot / w of c1.
"""

from __future__ import annotations

import math

import numpy as np

from nadia_balance.core.walking import Array


def rows_at(t: float, duration: float, omega: float) -> Array:
    """Returns what turns c0..c5 into CoM, ICP and eCMP at `t` [s]: (3, 6)."""
    u = 1.0 / omega
    grow, decay = math.exp(omega * (t - duration)), math.exp(-omega * t)
    t2, t3 = t * t, t * t * t
    return np.array(
        [
            [grow, decay, t3, t2, t, 1.0],
            [2.0 * grow, 0.0, t3 + 3.0 * u * t2, t2 + 2.0 * u * t, t + u, 1.0],
            [0.0, 0.0, t3 - 6.0 * u * u * t, t2 - 2.0 * u * u, t, 1.0],
        ]
    )


def solve_segments(
    durations: Array, ecmp: Array, com_start: Array, omega: float
) -> Array:
    """Returns the coefficients (N, 6, k) of N segments with a linear eCMP.

    They meet the 6N conditions below Eq. 4 of the Nadia paper: the eCMP and
    its velocity at both ends of each segment, the CoM and its velocity
    continuous between segments, the CoM at the start, and the ICP on the eCMP
    at the end.  The paper's 6N x 6N system need not be solved, though: c2 and
    c3 vanish, c4 and c5 are the eCMP's line, the ICP gives c0 from the last
    segment to the first, and then the CoM gives c1 from the first to the last.

    Args:
        durations: (N,) [s], positive.
        ecmp: (N + 1, k) [m], where the segments meet.
        com_start: (k,) [m].
        omega: natural frequency [rad/s].
    """
    start, end, T = ecmp[:-1], ecmp[1:], durations[:, None]
    slope, decay = (end - start) / T, np.exp(-omega * T)
    lead, zero = slope / omega, np.zeros_like(slope)
    icp = _chain(
        ecmp[-1],
        (start + lead - decay * (end + lead))[::-1],
        decay[::-1],
    )[-2::-1]
    c0 = 0.5 * (icp - end - lead)
    com = _chain(com_start, end - decay * start + c0 * (1.0 - decay**2), decay)
    c1 = com[:-1] - start - decay * c0
    return np.stack([c0, c1, zero, zero, slope, start], axis=1)


def _chain(first: Array, offsets: Array, factors: Array) -> Array:
    """Returns y (n + 1, k) with y_0 = first, y_i+1 = offset_i + factor_i y_i.

    In plain floats, since numpy takes longer for so few columns.
    """
    rates = factors[:, 0].tolist()
    columns = []
    for y, column in zip(first.tolist(), offsets.T.tolist(), strict=True):
        values = [y]
        for offset, rate in zip(column, rates, strict=True):
            y = offset + rate * y
            values.append(y)
        columns.append(values)
    return np.array(columns).T
