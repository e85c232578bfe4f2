"""Foothold adjustment by capture regions (Nadia paper, Sec. IV and V).

The dead bands and waiting times are not from the paper.
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

ROUNDING = 1e-6  # tolerance of a foothold on the edge of a region [m]
_BISECTION = tuple(0.5**i for i in range(1, 6))  # to 1/32 of the way [-]


@dataclass(frozen=True, eq=False)
class CaptureRegions(Immutable):
    """Polygons (n, 2) [m] in W and footholds, for display."""

    regions: tuple[Array, ...] = ()  # C_1, ..., C_N
    reach: Array = field(default_factory=lambda: np.empty((0, 2)))
    nominal: FootPose | None = None
    adjusted: FootPose | None = None

    def __post_init__(self) -> None:
        for polygon in (*self.regions, self.reach):
            polygon.flags.writeable = False


def unadjusted(schedule: ContactSchedule) -> Adjustment:
    """Returns the planned next foothold; without steps, the present one."""
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
    """Returns the earliest and latest load [s] from now on the new foot.

    `time_gain` [s] is the total expected change of the clock, negative while
    the clock is held.  Without it, the predicted touchdown is too late, and the
    legs may cross for an ICP that is not reached.
    """
    earliest = max(state.remaining_time - time_gain, 0.0)
    return earliest, earliest + params.waiting_time


@dataclass(frozen=True, eq=False)
class Landing(Immutable):
    """Possible touchdowns of the swing foot, as predicted in one tick.

    `icp` (2,) [m] in W; `touchdown` [s] from now.  `foot` (2,) [m] in W is the
    position of the swing foot; None if the touchdown times do not depend on
    the foothold.  Capture regions (n, 2) [m] are computed on first use.
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
        """C_1, for a foot without extent."""
        return self.geometry.one_step_region(self.icp, self.touchdown)

    @cached_property
    def capture_region(self) -> Array:
        """C_N (n, 2) [m] in W."""
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
        """Returns C_N for a touchdown as early as possible in `region` (n, 2).

        The foothold is the point of `region` [m] closest to the present C_N.
        The touchdown time is that of the path round the stance foot, at least
        `least` [s]; it is shorter if the foot is already `under_way` there.
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
        """Time [s] from rest to landing at `goal` (2,) [m]; 0 without foot."""
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
        """Returns `wanted`, limited to what the foot can reach in `time` [s].

        The foothold moves from that of `current` toward the wanted one only as
        far as the swing foot can reach before touchdown; otherwise it would
        be dragged along the ground.  The nominal foothold is always allowed.
        This limit is not in the papers.
        """
        p, q = current.pose.p_WF[:2], wanted.pose.p_WF[:2]
        nominal = wanted.nominal.pose
        if (
            wanted.pose == current.pose
            or not wanted.moved
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
        """Returns the foot at `point` (2,) [m] in W; None if not allowed."""
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

    The foothold does not change in the first `settling_time` of a swing, as
    the measured ICP jumps when the contacts change, nor in the last
    `freeze_time`.
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
    """Returns the regions and footholds behind the proposed `adjustment`."""
    regions = landing.geometry.regions
    return CaptureRegions(
        landing.capture_regions(),
        # A region chosen before cross-over was switched off is missing.
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

    The nominal foothold, not the last one, is projected onto the intersection
    of the capture region and the chosen reachability region, so that the
    foothold returns when the ICP does; a tick lasts `period` [s].
    `on_arrival` is that of `choose_region`.
    """
    nominal = current.nominal.pose
    if _covered(nominal.p_WF[:2], capture_region, geometry, params):
        holds = not current.moved or contains(
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
    """Returns the region chosen last; None if the foothold is nominal."""
    return current.region if current.moved else None


def _covered(
    nominal: Array,
    capture_region: Array,
    geometry: SwingGeometry,
    params: CaptureRegionStepAdjusterParams,
) -> bool:
    """True if the nominal foothold is reachable and in the capture region."""
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
    """Returns the nominal foothold, after `return_time` if the present `holds`.

    `holds` means that the present foothold is in the capture region as well.
    """
    nominal = current.nominal
    ticks = current.covered_ticks + 1
    if (
        not current.moved
        or ticks >= number_of_ticks(params.return_time, period)
        or not holds
    ):
        return Adjustment(nominal, nominal.pose)
    return Adjustment(nominal, current.pose, current.region, ticks)


def _target(
    nominal: Array, choice: Choice, geometry: SwingGeometry
) -> Array | None:
    """Returns the goal's point (2,) [m] closest to `nominal`; None if blocked.

    If this point is on the stance foot, the closest point in front of, behind
    or beside that foot is returned.
    """
    target = project(nominal, choice.goal)
    if not geometry.blocked(target):
        return target
    free = geometry.free_parts(choice.goal)
    if len(choice.goal) == 1:  # the region point closest to the capture region
        nominal = target
        free = geometry.free_parts(geometry.regions[choice.region])
    candidates = [project(nominal, part) for part in free]
    return min(candidates, key=lambda p: math.dist(p, nominal), default=None)
