"""What the next step of a walk may be, by the mechanisms that are on.

When its foot may be lifted, how long it may swing, where it may land, and what
the steps after it are worth.  All as the controller's own parameters say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.planned_offsets import planned_offsets
from nadia_balance.core.polygon import convex_hull
from nadia_balance.core.reachability import in_world
from nadia_balance.core.swing_geometry import SwingGeometry, swing_geometry
from nadia_balance.core.time_adjustment import TimingAdapterParams
from nadia_balance.core.walking import (
    Array,
    ContactSchedule,
    Phase,
    Side,
    WalkingState,
)


@dataclass(frozen=True, eq=False)
class NextStep:
    """What the next step may be; points (2,) and polygons (n, 2) [m] in W.

    `lift_offs` [s] from now are the times at which the swing may begin, 0 if
    the foot is in the air.  The swing, or what is left of it, takes between
    `swing[0]` and `swing[1]` [s], and as long as the foot needs from `foot`,
    with the velocity `foot_velocity` [m/s].  It ends on one of `footholds`,
    polygons or single points (1, 2).  `offsets` are the D_1, ..., D_N of
    `later_steps`, for the steps after it.
    """

    geometry: SwingGeometry
    lift_offs: tuple[float, ...]
    swing: tuple[float, float]
    foot: Array
    foot_velocity: Array
    footholds: tuple[Array, ...]
    offsets: tuple[Array, ...]


def next_step(
    state: WalkingState,
    foot: Array,
    foot_velocity: Array,
    sole: Array,
    omega: float,
    adjuster: CaptureRegionStepAdjusterParams,
    timing: TimingAdapterParams,
) -> NextStep:
    """Returns what the step in the air may be, or the next one on the ground.

    `foot` (2,) [m] and `foot_velocity` (2,) [m/s] are those of the swing foot
    in W; `sole` (k, 2) [m] are the corners of either sole in its own frame.
    There must be a footstep in the schedule.
    """
    steps = state.schedule.footsteps
    geometry = swing_geometry(state.schedule, sole, adjuster, omega)
    offsets = geometry.offsets
    if not adjuster.enabled:
        offsets = planned_offsets(steps, sole, adjuster, omega)
    return NextStep(
        geometry=geometry,
        lift_offs=lift_off_times(state, timing),
        swing=swing_times(state, adjuster.waiting_time, timing),
        foot=foot,
        foot_velocity=foot_velocity,
        footholds=_footholds(state, geometry, adjuster),
        offsets=offsets,
    )


def usable_support(
    schedule: ContactSchedule,
    sole: Array,
    adjuster: CaptureRegionStepAdjusterParams,
) -> Array:
    """Returns the hull (n, 2) [m] in W of the usable parts of what stands.

    Of the stance foot in a swing, else of both feet; what is usable is what
    the adjuster counts on for C_1.  `sole` (k, 2) [m] in the sole frame.
    """
    foot = adjuster.usable_foot(sole)
    parts = [
        in_world(foot, schedule.feet[side], side.other)
        for side in Side
        if schedule.in_contact(side)
    ]
    return convex_hull(np.concatenate(parts))


def lift_off_times(
    state: WalkingState, timing: TimingAdapterParams
) -> tuple[float, ...]:
    """Returns when [s] from now the swing can begin: hurried, and as planned.

    It has begun at 0 if the foot is in the air.
    """
    phase, planned = state.schedule.phase, state.remaining_time
    if phase is Phase.SWING:
        return (0.0,)
    least = max(timing.least_rest_of_transfer(state.elapsed), 0.0)
    if phase is Phase.STANDING:  # the transfer is still to come
        transfer = state.schedule.footsteps[0].transfer_duration
        least = planned + min(timing.min_transfer_duration, transfer)
        planned += transfer
    if not timing.transfer or least >= planned:
        return (planned,)
    return least, planned


def swing_times(
    state: WalkingState, waiting_time: float, timing: TimingAdapterParams
) -> tuple[float, float]:
    """Returns how long [s] the swing, or what is left of it, can take.

    The foot may take its load `waiting_time` [s] later than planned.
    """
    if state.schedule.phase is Phase.SWING:
        duration, elapsed = state.schedule.duration, state.elapsed
        planned = state.remaining_time
    else:
        duration = planned = state.schedule.footsteps[0].swing_duration
        elapsed = 0.0
    latest = planned + waiting_time
    if not timing.swing:
        return planned, latest
    return min(timing.least_rest_of_swing(duration, elapsed), planned), latest


def _footholds(
    state: WalkingState,
    geometry: SwingGeometry,
    adjuster: CaptureRegionStepAdjusterParams,
) -> tuple[Array, ...]:
    """Returns where the foot may land: polygons, and a point (1, 2), in W."""
    step = state.schedule.footsteps[0]
    swings = state.schedule.phase is Phase.SWING
    if not adjuster.enabled or (
        swings and state.remaining_time < adjuster.freeze_time
    ):
        return (step.pose.p_WF[None, :2],)
    nominal = state.adjustment.nominal if state.adjustment else step
    free = [
        part
        for region in geometry.regions.values()
        for part in geometry.free_parts(region)
    ]
    return (nominal.pose.p_WF[None, :2], *free)
