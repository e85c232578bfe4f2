"""In how few further steps a robot can be captured, by its capture regions.

The question behind the regions of the Nadia paper, Sec. IV, asked at a moment
of a walk: is there a foothold within reach that is in C_n, and can the foot be
there in time?  Of the linear inverted pendulum, and without the hips.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from nadia_balance.core.capture_region import capture_region
from nadia_balance.core.lipm import icp_after
from nadia_balance.core.next_step import NextStep
from nadia_balance.core.polygon import (
    clip_all,
    contains,
    convex_hull,
    halfspaces,
    project,
)
from nadia_balance.core.swing_detour import (
    SwingDetourParams,
    shortest_time,
    way_round,
)
from nadia_balance.core.swing_geometry import SwingGeometry
from nadia_balance.core.walking import Array

LOST = -1  # no number of steps captures the robot

_TOLERANCE = 0.002  # a tick: a foot that is so late is in time [s]


def least_steps(
    icp: Array,
    support: Array,
    next_step: Callable[[], NextStep | None],
    omega: float,
    detour: SwingDetourParams,
) -> int:
    """Returns the least n such that n further steps capture the ICP, or LOST.

    `icp` (2,) [m] in W.  The CoP can be in the polygon `support` (n, 2) [m]
    until the next swing begins, or in the stance foot's if it has begun: n = 0
    if it can hold the ICP there.  `next_step` is asked only if it cannot, and
    gives None if no step is to come.
    """
    if contains(icp, support):
        return 0
    step = next_step()
    if step is None:
        return LOST
    for n, offsets in enumerate(step.offsets, start=1):
        for time in step.lift_offs:
            icps = icps_at_lift_off(icp, support, omega, time)
            if _can_land(icps, step, offsets, omega, detour):
                return n
    return LOST


def icps_at_lift_off(
    icp: Array, support: Array, omega: float, time: float
) -> Array:
    """Returns where the ICP can be after `time` [s], (n, 2) [m].

    For any course of the CoP within the polygon `support` (k, 2) [m].
    """
    if time == 0.0:
        return icp[None]
    return convex_hull(
        np.array([icp_after(icp, q, omega, time) for q in support])
    )


def _can_land(
    icps: Array,
    step: NextStep,
    offsets: Array,
    omega: float,
    detour: SwingDetourParams,
) -> bool:
    """True if the foot can be in C_n = C_1 + (-offsets) in time.

    For any one of the `icps` (k, 2) [m], a polygon, when it is lifted.  The
    later the foot lands, the smaller is the region, and so no foothold is
    reached before the first time at which one could be if the region stayed
    as it is.  From there it is looked at again, until the foot is in time or
    the time is up.
    """
    landing, latest = step.swing
    while landing <= latest:
        touchdown = (landing, latest)
        one_step = _one_step_region(icps, step.geometry, omega, touchdown)
        region = capture_region(one_step, offsets)
        needed = _time_to_reach(region, step, detour)
        if needed <= landing + _TOLERANCE:
            return True
        landing = needed
    return False


def _one_step_region(
    icps: Array,
    geometry: SwingGeometry,
    omega: float,
    touchdown: tuple[float, float],
) -> Array:
    """C_1 (n, 2) [m] of all ICPs in the polygon `icps` (k, 2) [m].

    It is the hull of those of the corners: where the ICP will be is linear in
    where it is.
    """
    regions = [geometry.one_step_region(p, omega, touchdown) for p in icps]
    return convex_hull(np.concatenate(regions))


def _time_to_reach(
    region: Array, step: NextStep, detour: SwingDetourParams
) -> float:
    """How soon [s] the foot can be on a foothold in `region`, or infinite."""
    A, b = halfspaces(region)
    times = [math.inf]
    for part in step.footholds:
        if len(part) > 1:
            part = clip_all(part, A, b)
        elif not contains(part[0], region):
            continue
        if len(part):
            times.append(time_to_polygon(part, step, detour))
    return min(times)


def time_to_polygon(
    polygon: Array, step: NextStep, detour: SwingDetourParams
) -> float:
    """Returns how soon [s] the foot of `step` can be in `polygon` (n, 2) [m].

    The last stretch of the shortest way starts at the foot or at a corner of
    the stance foot, and ends at the point of the polygon closest to that.  If
    the foot moves, another way may take some milliseconds less.
    """
    stance, side = step.geometry.stance, step.geometry.swing
    beside = side.sign * detour.beside
    corners = np.array([[detour.ahead, beside], [-detour.ahead, beside]])
    ends = {
        tuple(project(start, polygon).tolist())
        for start in (step.foot, *stance.to_world(corners))
    }
    return min(
        shortest_time(
            way_round(step.foot, np.array(end), stance, side, detour),
            detour,
            step.foot_velocity,
        )
        for end in ends
    )
