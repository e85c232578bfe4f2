"""Where the foot in the air is to land, so that the robot recovers.

The Nadia paper, Sec. IV and V; the paper does not give the dead bands and
waiting times.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from nadia_balance.core.capture_region import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
)
from nadia_balance.core.polygon import contains, project
from nadia_balance.core.reachability import (
    BASE,
    Choice,
    choose_region,
    closest_point,
)
from nadia_balance.core.swing_detour import UNDER_WAY, time_of_way
from nadia_balance.core.walking import (
    Adjustment,
    Array,
    ContactSchedule,
    FootPose,
    Footstep,
    Immutable,
    Phase,
    WalkingState,
    number_of_ticks,
)

ROUNDING = 1e-6  # a foothold so far out is on the edge [m]
_BISECTION = tuple(0.5**i for i in range(1, 6))  # to 1/32 of the way [-]


@dataclass(frozen=True, eq=False)
class CaptureRegions(Immutable):
    """What there is to draw: polygons (n, 2) [m] in W, and two footholds."""

    regions: tuple[Array, ...] = ()  # C_1, ..., C_N
    reach: Array = field(default_factory=lambda: np.empty((0, 2)))
    nominal: FootPose | None = None
    adjusted: FootPose | None = None

    def __post_init__(self) -> None:
        for polygon in (*self.regions, self.reach):
            polygon.flags.writeable = False


def unadjusted(schedule: ContactSchedule) -> Adjustment:
    """The next foothold as planned; where the foot stands, if there is none."""
    if schedule.footsteps:
        step = schedule.footsteps[0]
    else:
        side = schedule.support_side.other
        step = Footstep(side, schedule.feet[side], 0.0, 0.0)
    return Adjustment(step, step.pose)


def current_adjustment(state: WalkingState) -> Adjustment:
    """Returns the adjustment in force; the planned foothold, if none is."""
    return state.adjustment or unadjusted(state.schedule)


def touchdown_interval(
    state: WalkingState,
    time_gain: float,
    params: CaptureRegionStepAdjusterParams,
) -> tuple[float, float]:
    """Returns between which times [s] from now the new foot takes the load.

    `time_gain` [s] will in all be added to the clock, negative while the clock
    is held: with the clock as it is, the legs cross for a touchdown that is
    too late, and then comes sooner.
    """
    earliest = max(state.remaining_time - time_gain, 0.0)
    return earliest, earliest + params.waiting_time


@dataclass(frozen=True, eq=False)
class Landing(Immutable):
    """Where and when the foot in the air may land, as seen in one tick.

    `icp` (2,) [m] in W; `touchdown` [s] from now.  `foot` (2,) [m] in W is
    where the foot is, None if nothing makes it land sooner than that.  The
    capture regions (n, 2) [m] are computed when they are asked for.
    """

    geometry: SwingGeometry
    icp: Array
    touchdown: tuple[float, float]
    foot: Array | None = None

    def at(
        self,
        icp: Array,
        touchdown: tuple[float, float],
        foot: Array | None = None,
    ) -> Landing:
        """Returns the same swing's landing as seen in another tick."""
        return replace(self, icp=icp, touchdown=touchdown, foot=foot)

    @cached_property
    def one_step(self) -> Array:
        """C_1, of a foot that is a point."""
        return self.geometry.one_step_region(self.icp, self.touchdown)

    @cached_property
    def capture_region(self) -> Array:
        """C_N."""
        return self.geometry.capture_region(self.one_step)

    def capture_regions(self) -> tuple[Array, ...]:
        """Returns C_1, ..., C_N."""
        inner = (
            self.geometry.capture_region(self.one_step, n)
            for n in range(len(self.geometry.offsets) - 1)
        )
        return *inner, self.capture_region

    def on_arrival(
        self, region: Array, least: float, under_way: bool = False
    ) -> Array:
        """Returns C_N of the time at which the foot is in `region` (n, 2) [m].

        At its point that is closest to the C_N of now, as soon as the foot can
        be there, by its way round the stance foot, but no sooner than in the
        `least` [s]; `under_way` to it already.
        """
        if self.foot is None:
            return self.capture_region
        g = self.geometry
        goal, _ = closest_point(region, self.capture_region)
        soonest = self._time_to(goal)
        if under_way:
            soonest *= UNDER_WAY
        soonest = max(soonest, least)
        first, last = self.touchdown
        times = soonest, soonest + last - first
        return g.capture_region(g.one_step_region(self.icp, times))

    def _time_to(self, goal: Array) -> float:
        """From rest to a landing at `goal` (2,) [m] in W; 0 without `foot`."""
        if self.foot is None:
            return 0.0
        g = self.geometry
        return time_of_way(self.foot, goal, g.stance, g.swing, g.detour)

    def adjust(
        self,
        current: Adjustment,
        params: CaptureRegionStepAdjusterParams,
        period: float,
    ) -> Adjustment:
        """Returns the adjustment for this tick of `period` [s]."""
        going = self.geometry.regions.get(_chosen(current) or "")

        def on_arrival(region: Array) -> Array:
            return self.on_arrival(
                region, params.least_time_to_land, region is going
            )

        return adjust_foothold(
            current,
            self.capture_region,
            self.geometry,
            params,
            period,
            on_arrival,
        )

    def in_time(
        self, current: Adjustment, wanted: Adjustment, time: float
    ) -> Adjustment:
        """Returns `wanted`, or as much of it as the foot can do in `time` [s].

        A foothold moves on from that of `current` only as far as the foot,
        which is under way, can be there before it lands; else it would be
        dragged along the ground.  The nominal foothold may always be taken.
        The papers do not ask for this.
        """
        p, q = current.pose.p_WF[:2], wanted.pose.p_WF[:2]
        nominal = wanted.nominal.pose
        if (
            wanted.pose is current.pose
            or wanted.pose is nominal
            or self._is_in_time(q, time)
        ):
            return wanted
        pose, share = current.pose, 0.0
        for part in _BISECTION:
            point = p + (share + part) * (q - p)
            if self._is_in_time(point, time) and (
                found := self._foothold(point, nominal)
            ):
                pose, share = found, share + part
        return replace(wanted, pose=pose)

    def _is_in_time(self, foothold: Array, time: float) -> bool:
        return UNDER_WAY * self._time_to(foothold) <= time

    def _foothold(self, point: Array, nominal: FootPose) -> FootPose | None:
        """The foot at `point` (2,) [m] in W; None if it cannot stand there."""
        within = any(
            contains(point, region, ROUNDING)
            for region in self.geometry.regions.values()
        )
        if not within or self.geometry.blocked(point):
            return None
        return FootPose(np.append(point, nominal.p_WF[2]), nominal.yaw)


def propose_adjustment(
    state: WalkingState,
    landing: Landing,
    params: CaptureRegionStepAdjusterParams,
    period: float,
) -> Adjustment:
    """Returns the adjustment of the step in the air for this tick of `period`.

    The foothold stays as it is too early and too late in a swing; early,
    because the ICP jumps when the contacts change.
    """
    current = current_adjustment(state)
    if (
        state.schedule.phase is not Phase.SWING
        or state.elapsed < params.settling_time
        or landing.touchdown[0] < params.freeze_time
    ):
        return current
    wanted = landing.adjust(current, params, period)
    time = state.remaining_time + state.gained_time
    return landing.in_time(current, wanted, time)


def capture_regions(landing: Landing, adjustment: Adjustment) -> CaptureRegions:
    """Returns what led to the `adjustment` that was proposed."""
    regions = landing.geometry.regions
    return CaptureRegions(
        landing.capture_regions(),
        # Chosen before cross-over was switched off, a region exists no more.
        regions.get(adjustment.region, regions[BASE]),
        adjustment.nominal.pose,
        adjustment.pose,
    )


def adjust_foothold(
    current: Adjustment,
    capture_region: Array,
    geometry: SwingGeometry,
    params: CaptureRegionStepAdjusterParams,
    period: float,
    on_arrival: Callable[[Array], Array] | None = None,
) -> Adjustment:
    """Returns the adjustment that puts the foot into `capture_region` (n, 2).

    The nominal foothold, not the last one, is projected on what the capture
    region shares with the region that the rules choose, so that the foothold
    comes back with the ICP; a tick lasts `period` [s].  `on_arrival` is that of
    `choose_region`.  The result keeps the pose object of `current`, or that of
    the nominal foothold, unless the foothold moves.
    """
    nominal = current.nominal.pose
    if _covered(nominal.p_WF[:2], capture_region, geometry, params):
        holds = current.pose is nominal or contains(
            current.pose.p_WF[:2], capture_region
        )
        return return_to_nominal(current, holds, params, period)
    choice = choose_region(
        geometry.regions,
        capture_region,
        _chosen(current),
        params.rules,
        params.margin,
        on_arrival,
    )
    target = _target(nominal.p_WF[:2], choice, geometry)
    if (
        target is None
        or math.dist(target, current.pose.p_WF[:2]) < params.dead_band
    ):
        pose = current.pose
    else:
        pose = FootPose(np.append(target, nominal.p_WF[2]), nominal.yaw)
    return Adjustment(current.nominal, pose, choice.region)


def _chosen(current: Adjustment) -> str | None:
    """Returns the region that was chosen last, None if none was."""
    adjusted = current.pose is not current.nominal.pose
    return current.region if adjusted else None


def _covered(
    nominal: Array,
    capture_region: Array,
    geometry: SwingGeometry,
    params: CaptureRegionStepAdjusterParams,
) -> bool:
    """True if the foot can be put down as planned, and then recovers."""
    if not contains(nominal, capture_region, -params.margin):
        return False
    x, y = geometry.stance.to_sole(nominal).tolist()
    return geometry.reach.in_base_region(x, geometry.swing.sign * y)


def return_to_nominal(
    current: Adjustment,
    holds: bool,
    params: CaptureRegionStepAdjusterParams,
    period: float,
) -> Adjustment:
    """Waits for `return_time`, if the present foothold `holds` as well."""
    nominal = current.nominal
    ticks = current.covered_ticks + 1
    if (
        current.pose is nominal.pose
        or ticks >= number_of_ticks(params.return_time, period)
        or not holds
    ):
        return Adjustment(nominal, nominal.pose)
    return Adjustment(nominal, current.pose, current.region, ticks)


def _target(
    nominal: Array, choice: Choice, geometry: SwingGeometry
) -> Array | None:
    """Returns the goal's point (2,) [m] closest to `nominal`; None if blocked.

    If that is on the stance foot: in front of it, behind it, or to its side.
    """
    target = project(nominal, choice.goal)
    if not geometry.blocked(target):
        return target
    free = geometry.free_parts(choice.goal)
    if len(choice.goal) == 1:  # as near as possible to the capture region
        nominal = target
        free = geometry.free_parts(geometry.regions[choice.region])
    candidates = [project(nominal, part) for part in free]
    return min(candidates, key=lambda p: math.dist(p, nominal), default=None)
