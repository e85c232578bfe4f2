"""CoM trajectories of Eq. 4 of the Nadia paper, from one linear system.

Within a segment of duration T, with the local time t in [0, T],

    x(t) = c0 e^(w (t - T)) + c1 e^(-w t) + c2 t^3 + c3 t^2 + c4 t + c5.

Counting the growing exponential from the end of the segment (Eq. 4: e^(w t))
keeps the system well conditioned however long the segment is.  The eCMP
x - xddot / w^2 is free of both exponentials, the ICP x + xdot / w of c1.
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

    The 6N x 6N system of the Nadia paper, below Eq. 4: the eCMP and its
    velocity at both ends of each segment, the CoM and its velocity continuous
    between segments, the CoM at the start, and the ICP on the eCMP at the end.
    All k axes share one factorisation.

    Args:
        durations: (N,) [s], positive.
        ecmp: (N + 1, k) [m], where the segments meet.
        com_start: (k,) [m].
        omega: natural frequency [rad/s].
    """
    n, k = len(durations), ecmp.shape[1]
    slope = (ecmp[1:] - ecmp[:-1]) / durations[:, None]
    values = np.zeros((n, 6, k))
    values[:, 0], values[:, 1] = ecmp[:-1], slope
    values[:, 2], values[:, 3] = ecmp[1:], slope
    values[-1, 4], values[-1, 5] = ecmp[-1], com_start
    system = segment_system(durations, omega).reshape(6 * n, 6 * n)
    solution = np.linalg.solve(system, values.reshape(6 * n, k))
    return np.asarray(solution.reshape(n, 6, k), dtype=float)


def segment_system(durations: Array, omega: float) -> Array:
    """Returns the matrix of solve_segments, (N, 6, N, 6).

    The axes are the segment and number of the condition, and the segment and
    number of the coefficient.
    """
    n = len(durations)
    com_0, velocity_0, ecmp_0, slope_0 = _rows(
        0.0 * durations, durations, omega
    )
    com_T, velocity_T, ecmp_T, slope_T = _rows(durations, durations, omega)
    system = np.zeros((n, 6, n, 6))
    i, j = np.arange(n), np.arange(n - 1)
    system[i, 0, i], system[i, 1, i] = ecmp_0, slope_0
    system[i, 2, i], system[i, 3, i] = ecmp_T, slope_T
    system[j, 4, j], system[j, 4, j + 1] = com_T[:-1], -com_0[1:]
    system[j, 5, j], system[j, 5, j + 1] = velocity_T[:-1], -velocity_0[1:]
    system[-1, 4, -1] = com_T[-1] + velocity_T[-1] / omega
    system[-1, 5, 0] = com_0[0]
    return system


def _rows(t: Array, durations: Array, omega: float) -> Array:
    """Returns rows for CoM, its velocity, eCMP and its velocity: (4, n, 6).

    For n segments, each at its own local time t (n,) [s].
    """
    rows = np.zeros((4, len(t), 6))
    com, velocity, ecmp, slope = rows
    com[:, 0], com[:, 1] = np.exp(omega * (t - durations)), np.exp(-omega * t)
    velocity[:, 0], velocity[:, 1] = omega * com[:, 0], -omega * com[:, 1]
    com[:, 5] = velocity[:, 4] = 1.0
    com[:, 4], com[:, 3], com[:, 2] = t, t * t, t * t * t
    velocity[:, 3], velocity[:, 2] = 2.0 * t, 3.0 * t * t
    ecmp[:, 2:], slope[:, 2:] = com[:, 2:], velocity[:, 2:]
    ecmp[:, 2] -= 6.0 * t / omega**2
    ecmp[:, 3] -= 2.0 / omega**2
    slope[:, 2] -= 6.0 / omega**2
    return rows
