"""N-step capturability: the least number of steps that captures the ICP.

Based on the capture regions of the Nadia paper, Sec. IV, at one instant of
walking: n steps suffice if a reachable foothold is in C_n, and the foot can be
there in time.  The model is the linear inverted pendulum without hip torques.
"""

import itertools

import numpy as np

from nadia_balance.core.capture_region import later_steps
from nadia_balance.core.lipm import icp_after
from nadia_balance.core.mechanisms import Mechanisms
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.polygon import (
    clip_all,
    contains,
    convex_hull,
    halfspaces,
    minkowski_sum,
    project,
)
from nadia_balance.core.reachability import in_world
from nadia_balance.core.swing_detour import shortest_time, way_round
from nadia_balance.core.swing_geometry import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
    step_contractions,
    swing_geometry,
)
from nadia_balance.core.time_adjustment import TimingAdapterParams
from nadia_balance.core.walking import (
    Array,
    ContactSchedule,
    Footstep,
    Phase,
    Side,
    WalkingState,
)

LOST = -1  # no number of steps captures the robot

_TICK = 0.01  # spacing of the tried landing times [s]
_ROUNDING = 1e-9  # tolerance of a time [s]


def least_steps(
    state: WalkingState,
    icp: Array,
    swing: Array,
    adjuster: CaptureRegionStepAdjusterParams,
    timing: TimingAdapterParams,
    model: PointMassModel,
    on: Mechanisms,
) -> int:
    """Returns the least n such that n further steps capture the ICP, or LOST.

    `icp` (2,) [m] in W.  n = 0 if the ICP is in the CoP polygon of the feet in
    contact.  Otherwise the swing foot has to land in C_n, at the earliest when
    it can lift off and reach the foothold.  `swing` (12,) is the reference of
    the swing foot (see FootMotion), used during a swing only.
    """
    schedule = state.schedule
    support = usable_support(schedule, adjuster, model.sole)
    if contains(icp, support):
        return 0
    if not schedule.footsteps:
        return LOST
    foot, velocity = swing[:2], swing[3:5]
    if schedule.phase is not Phase.SWING:
        foot = schedule.feet[schedule.support_side.other].p_WF[:2]
        velocity = np.zeros(2)
    geometry = swing_geometry(schedule, adjuster, model, on)
    offsets = geometry.offsets
    if not on.step:
        offsets = planned_offsets(schedule.footsteps, adjuster, model)
    holds = footholds(state, geometry, adjuster, on)
    beside = geometry.swing.sign * model.detour.beside
    ahead = np.array(
        [[model.detour.ahead, beside], [-model.detour.ahead, beside]]
    )
    starts = [foot, *geometry.stance.to_world(ahead)]
    icps = _icps_after(icp, support, lift_off_time(state, timing, on), model)
    earliest, latest = swing_times(state, adjuster, timing, on)
    for n, region_offsets in enumerate(offsets, start=1):
        for landing in np.arange(earliest, latest + _ROUNDING, _TICK).tolist():
            region = _capture_region(
                icps, geometry, (landing, latest), region_offsets
            )
            for goal in _goals(holds, region, starts):
                way = way_round(
                    foot, goal, geometry.stance, geometry.swing, model.detour
                )
                if shortest_time(way, model.detour, velocity) <= landing:
                    return n
    return LOST


def usable_support(
    schedule: ContactSchedule,
    adjuster: CaptureRegionStepAdjusterParams,
    sole: Array,
) -> Array:
    """Returns the hull (n, 2) [m] in W of the usable soles in contact.

    These are the stance foot in a swing, else both feet; `sole` (k, 2) [m] is
    in the sole frame.
    """
    foot = adjuster.usable_foot(sole)
    parts = [
        in_world(foot, schedule.feet[side], side.other)
        for side in Side
        if schedule.in_contact(side)
    ]
    return convex_hull(np.concatenate(parts))


def planned_offsets(
    steps: tuple[Footstep, ...],
    params: CaptureRegionStepAdjusterParams,
    model: PointMassModel,
) -> tuple[Array, ...]:
    """Returns D_1, ..., D_N [m] for steps to the planned footholds.

    The planned foothold replaces each region of `swing_geometry`: D_n is a
    single point (1, 2).  They do not nest, because a planned step is not
    skipped.
    """
    contractions = step_contractions(steps, params, model.omega)
    holds = [step.pose.p_WF[None, :2] for step in steps[: params.num_steps]]
    ways = [end - start for start, end in itertools.pairwise(holds)]
    return tuple(later_steps(ways, contractions, planned=True))


def lift_off_time(
    state: WalkingState, timing: TimingAdapterParams, on: Mechanisms
) -> float:
    """Returns the least time [s] until lift-off; 0 in a swing."""
    phase, left = state.schedule.phase, state.remaining_time
    if phase is Phase.SWING:
        return 0.0
    if phase is Phase.STANDING:  # the transfer is still to come
        transfer = state.schedule.footsteps[0].transfer_duration
        shortest = timing.min_transfer_duration if on.transfer else transfer
        return left + min(shortest, transfer)
    least = timing.min_transfer_duration - state.elapsed
    return min(max(least, 0.0), left) if on.transfer else left


def swing_times(
    state: WalkingState,
    adjuster: CaptureRegionStepAdjusterParams,
    timing: TimingAdapterParams,
    on: Mechanisms,
) -> tuple[float, float]:
    """Returns the least and largest rest [s] of the present or next swing.

    The largest includes the delay of the load by `waiting_time`.
    """
    duration = state.schedule.footsteps[0].swing_duration
    elapsed, planned = 0.0, duration
    if state.schedule.phase is Phase.SWING:
        duration, elapsed = state.schedule.duration, state.elapsed
        planned = state.remaining_time
    earliest = planned
    if on.swing:
        least = timing.least_rest_of_swing(duration, elapsed)
        earliest = min(least, planned)
    return earliest, planned + adjuster.waiting_time


def footholds(
    state: WalkingState,
    geometry: SwingGeometry,
    adjuster: CaptureRegionStepAdjusterParams,
    on: Mechanisms,
) -> list[Array]:
    """Returns the allowed footholds [m] in W: polygons and a point (1, 2)."""
    step = state.schedule.footsteps[0]
    swings = state.schedule.phase is Phase.SWING
    if not on.step or (swings and state.remaining_time < adjuster.freeze_time):
        return [step.pose.p_WF[None, :2]]
    nominal = state.adjustment.nominal if state.adjustment else step
    regions = geometry.regions.values()
    free = [part for region in regions for part in geometry.free_parts(region)]
    return [nominal.pose.p_WF[None, :2], *free]


def _icps_after(
    icp: Array, support: Array, time: float, model: PointMassModel
) -> Array:
    """Returns the set (n, 2) [m] of possible ICPs after `time` [s].

    The CoP may follow any trajectory in the polygon `support` (k, 2) [m].
    """
    if time == 0.0:
        return icp[None]
    return convex_hull(
        np.array([icp_after(icp, q, model.omega, time) for q in support])
    )


def _capture_region(
    icps: Array,
    geometry: SwingGeometry,
    touchdown: tuple[float, float],
    offsets: Array,
) -> Array:
    """Returns C_n (k, 2) [m] of all ICPs in the polygon `icps` (m, 2) [m].

    C_1 is the hull of the regions of the corners, as the ICP dynamics are
    linear.
    """
    corners = [geometry.one_step_region(p, touchdown) for p in icps]
    one_step = convex_hull(np.concatenate(corners))
    return minkowski_sum(one_step, -offsets)


def _goals(
    holds: list[Array], region: Array, starts: list[Array]
) -> list[Array]:
    """Returns the footholds (2,) [m] in `region` closest to each of `starts`.

    The last straight part of the shortest path begins at one of `starts`.
    """
    A, b = halfspaces(region)
    goals = []
    for hold in holds:
        if len(hold) == 1:
            if contains(hold[0], region):
                goals.append(hold[0])
        elif len(part := clip_all(hold, A, b)):
            goals += [project(start, part) for start in starts]
    return goals
