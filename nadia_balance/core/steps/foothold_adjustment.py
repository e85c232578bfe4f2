"""Foothold adjustment by capture regions (Nadia paper, Sec. IV and V).

The foot lands in a place: a region of the ground within a reachability region.
Flat ground is one region.  The paper's rules choose the reachability region
(`goals`); the foothold is the closest to the nominal one in its places.  Dead
bands and waiting times are not from the paper.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from nadia_balance.core.body.reachability import BASE, closest_point
from nadia_balance.core.body.swing_detour import UNDER_WAY
from nadia_balance.core.math import polygon as convex
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.steps import capture_region as capture
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.state import Adjustment, FootPose

Params = capture.CaptureRegionStepAdjusterParams

_BISECTION = tuple(0.5**i for i in range(1, 6))  # to 1/32 of the way [-]
_HALVINGS = 4  # bisection steps for a feasible margin, to 1/16 [-]
_KEPT = 0.5  # share of the margin that suffices on the previous ground [-]


@dataclass(frozen=True, eq=False)
class CaptureRegions(walking.Immutable):
    """Polygons (n, 2) [m] in W and footholds, for display."""

    regions: tuple[Array, ...] = ()  # C_1, ..., C_N
    reach: Array = field(default_factory=lambda: np.empty((0, 2)))
    nominal: FootPose | None = None
    adjusted: FootPose | None = None

    def __post_init__(self) -> None:
        for polygon in (*self.regions, self.reach):
            polygon.flags.writeable = False


def unadjusted(schedule: walking.ContactSchedule) -> Adjustment:
    """Returns the planned next foothold; without steps, the present one."""
    if schedule.footsteps:
        step = schedule.footsteps[0]
    else:
        side = schedule.support_side.other
        step = walking.Footstep(side, schedule.feet[side], 0.0, 0.0)
    return Adjustment(step, step.pose)


def current_adjustment(state: walking.WalkingState) -> Adjustment:
    """Returns the adjustment in force; the planned foothold, if none is."""
    return state.adjustment or unadjusted(state.schedule)


def touchdown_interval(
    state: walking.WalkingState, time_gain: float, params: Params
) -> tuple[float, float]:
    """Returns the earliest and latest load [s] from now on the new foot.

    `time_gain` [s] is the expected change of the clock, negative if it is held.
    """
    earliest = max(state.remaining_time - time_gain, 0.0)
    return earliest, earliest + params.waiting_time


@dataclass(frozen=True, eq=False)
class Landing(walking.Immutable):
    """Possible touchdowns of the swing foot, as predicted in one tick.

    `icp` (2,) [m] in W; `touchdown` [s] from now.  `foot` (2,) [m] in W is the
    position of the swing foot; None if the touchdown times do not depend on
    the foothold.  Capture regions (n, 2) [m] are computed on first use.
    """

    geometry: capture.SwingGeometry
    icp: Array
    touchdown: tuple[float, float]
    foot: Array | None = None

    @cached_property
    def one_step(self) -> Array:
        """C_1, for a foot without extent."""
        return self.geometry.one_step_region(self.icp, self.touchdown)

    @cached_property
    def capture_region(self) -> Array:
        """C_N (n, 2) [m] in W."""
        return capture.capture_region(self.one_step, self.geometry.offsets[-1])

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
        goal, _ = closest_point(region, self.capture_region)
        soonest = self.time_to(goal)
        if under_way:
            soonest *= UNDER_WAY
        one_step = self._one_step_from(max(soonest, least))
        return capture.capture_region(one_step, self.geometry.offsets[-1])

    def missed(self, adjustment: Adjustment) -> float:
        """Distance [m] of a foothold from C_N if later steps hurry.

        C_N is that of the touchdown there, of a foot under way at full speed,
        but not before the clock; 0 inside.
        """
        p = adjustment.pose.p_WF[:2]
        soonest = max(self.touchdown[0], UNDER_WAY * self.time_to(p))
        one_step = self._one_step_from(soonest)
        region = self.geometry.hurried_region(one_step)
        return math.dist(p, convex.project(p, region))

    def _one_step_from(self, soonest: float) -> Array:
        """C_1 (n, 2) [m] in W for a touchdown at `soonest` [s] or later."""
        first, last = self.touchdown
        times = soonest, soonest + last - first
        return self.geometry.one_step_region(self.icp, times)

    def time_to(self, goal: Array) -> float:
        """Time [s] from rest to landing at `goal` (2,) [m]; 0 without foot."""
        if self.foot is None:
            return 0.0
        g = self.geometry
        return g.model.detour.time_of_way(self.foot, goal, g.stance, g.swing)


def propose_adjustment(
    state: walking.WalkingState, landing: Landing, params: Params, period: float
) -> Adjustment:
    """Returns the adjustment of the step in the air for this tick of `period`.

    The foothold does not change in the first `settling_time` of a swing, as
    the measured ICP jumps when the contacts change; in the last `freeze_time`
    only if the swing is prolonged for it.  That is for a foothold which the
    foot cannot reach in time, if it misses the capture region by less, although
    the ICP diverges meanwhile: a foot that is pushed outward late in its swing
    would else land where the other one has to cross it.
    Erratum: the paper's swings are only shortened.
    """
    current = current_adjustment(state)
    if state.elapsed < params.settling_time:
        return current
    wanted = adjust_foothold(current, landing, params, period)
    left, lead = state.remaining_time, state.gained_time
    early, late = left + max(lead, 0.0), left + lead + params.prolongation
    if current.prolonged:  # once granted, the time is kept
        early, wanted = late, replace(wanted, prolonged=current.prolonged)
    soon = current
    if landing.touchdown[0] >= params.freeze_time:
        soon = in_time(current, wanted, landing, early)
    if soon is wanted or wanted.pose == current.pose or landing.foot is None:
        return soon
    later = in_time(current, wanted, landing, late)
    better = params.rules.distance_hysteresis
    if landing.missed(later) > landing.missed(soon) - better:
        return soon
    return replace(later, prolonged=params.prolongation)


def adjust_foothold(
    current: Adjustment, landing: Landing, params: Params, period: float
) -> Adjustment:
    """Returns the adjustment that puts the foot into the capture region.

    The nominal foothold, not the last one, is projected onto the `goals`, so
    that the foothold returns when the ICP does: after `return_time` if the
    present one captures it, too.  A tick lasts `period` [s].  The closest point
    counts; `distance_hysteresis` favors the previous ground.
    """
    nominal, region = current.nominal.pose, landing.capture_region
    covered = convex.contains(nominal.p_WF[:2], region, -params.margin)
    if covered and landing.geometry.allows(nominal):
        ticks = current.covered_ticks + 1
        enough = walking.number_of_ticks(params.return_time, period)
        waits = current.moved and ticks < enough
        if waits and convex.contains(current.pose.p_WF[:2], region):
            return replace(current, covered_ticks=ticks)
        return Adjustment(current.nominal, nominal)
    options = goals(landing, current, params)

    def cost(option: tuple[capture.Place, Array]) -> float:
        place, point = option
        kept = _is_last(place, current) * params.rules.distance_hysteresis
        return math.dist(point, nominal.p_WF[:2]) - kept

    found = [
        (goal.place, point)
        for goal in options
        if (point := _foothold(nominal, goal, landing.geometry)) is not None
    ]
    if not found:
        return current
    place, target = min(found, key=cost)
    pose = current.pose
    if math.dist(target, pose.p_WF[:2]) >= params.dead_band:
        pose = landing.geometry.foot_at(target, nominal)
    return Adjustment(current.nominal, pose, place.reach, ground=place.ground)


class Goal(NamedTuple):
    """A place, and the part (n, 2) [m] of it that captures the ICP.

    If none does, the part is the point (1, 2) closest to the capture region.
    """

    place: capture.Place
    part: Array


def goals(landing: Landing, current: Adjustment, params: Params) -> list[Goal]:
    """Returns the goals of one reachability region (Nadia paper, Sec. V).

    Rule 1: base if it intersects the capture region; rule 2: else the
    cross-over region that shares most area with it; rule 3: else the closest
    place, at the earliest time the foot can be there, of the region that rules
    1 and 2 choose if later steps hurry.  Goals are `margin` deep
    inside the capture region, or about as deep as possible.  On the previous
    place, half of it suffices, so that noise does not move the foot to another
    ground region.  Empty if no ground is in reach.
    Erratum: as printed, rule 1 prefers any sliver of base to a short step
    across, and the choice flips with noise; hence margin and hysteresis.
    Its rule 3 compares all regions at the same time, but a cross-over step
    takes longer, while the ICP diverges, and a step after it has to return.
    """
    A, b = convex.halfspaces(landing.capture_region)
    places = [Goal(place, place.polygon) for place in landing.geometry.places]
    rules, depth = params.rules, params.margin
    found = _preferred(_clipped(places, A, b - depth), current, rules)
    if not found:
        found = _preferred(_clipped(places, A, b), current, rules)
        found, depth = _deepest(found, A, b, params.margin)
    if not found:
        return [_closest(landing, current, params)] if places else []
    chosen = [goal.place for goal in found]
    last = [goal for goal in places if _is_last(goal.place, current)]
    if last and last[0].place not in chosen:
        kept = _clipped(last, A, b - _KEPT * depth)
        found += [g for g in kept if g.place.reach == chosen[0].reach]
    return found


def _is_last(place: capture.Place, current: Adjustment) -> bool:
    """True if the present, moved foothold was chosen in this place."""
    last = current.region, current.ground
    return current.moved and (place.reach, place.ground) == last


def _clipped(options: Iterable[Goal], A: Array, b: Array) -> list[Goal]:
    """Returns the parts of `options` with A p <= b that have an area."""
    cut = (Goal(place, convex.clip_all(part, A, b)) for place, part in options)
    return [goal for goal in cut if len(goal.part)]


def _preferred(
    options: list[Goal], current: Adjustment, rules: capture.ReachRulesParams
) -> list[Goal]:
    """Returns the options of one reachability region, by rules 1 and 2."""
    by_reach: dict[str, list[Goal]] = {}
    for goal in options:
        by_reach.setdefault(goal.place.reach, []).append(goal)

    def preference(reach: str) -> float:
        shared = sum(convex.area(goal.part) for goal in by_reach[reach])
        if reach == BASE:
            shared *= rules.area_margin
        if current.moved and reach == current.region:
            shared *= rules.hysteresis
        return shared

    return by_reach[max(by_reach, key=preference)] if by_reach else []


def _deepest(
    options: list[Goal], A: Array, b: Array, margin: float
) -> tuple[list[Goal], float]:
    """Returns the deepest parts within A p <= b, and their depth [m]."""
    best, low, high = options, 0.0, margin
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if deeper := _clipped(options, A, b - middle):
            best, low = deeper, middle
        else:
            high = middle
    return best, low


def _closest(landing: Landing, current: Adjustment, params: Params) -> Goal:
    """Returns the goal of rule 3.

    It is in the region that rules 1 and 2 choose if later steps hurry, or in
    any, if that is none; and closest to the capture region.
    """
    places = [Goal(place, place.polygon) for place in landing.geometry.places]
    A, b = convex.halfspaces(landing.geometry.hurried_region(landing.one_step))
    found = _preferred(_clipped(places, A, b), current, params.rules)
    options = {goal.place.reach for goal in found or places}

    least = params.least_time_to_land

    def gap(place: capture.Place) -> float:
        is_last = _is_last(place, current)
        captures, gap = landing.on_arrival(place.polygon, least, is_last), 0.0
        if not len(convex.intersection(place.polygon, captures)):
            _, gap = closest_point(place.polygon, captures)
        return gap - is_last * params.rules.distance_hysteresis

    place = min((g.place for g in places if g.place.reach in options), key=gap)
    nearest, _ = closest_point(place.polygon, landing.capture_region)
    return Goal(place, nearest[None])


def _foothold(
    nominal: FootPose, goal: Goal, geometry: capture.SwingGeometry
) -> Array | None:
    """Returns the goal's point (2,) [m] closest to `nominal`; None if blocked.

    If this point is on the stance foot, the closest point in front of, behind
    or beside that foot is returned.
    """
    start = nominal.p_WF[:2]
    target = convex.project(start, goal.part)
    if not geometry.blocked(target):
        return target
    free = goal.part
    if len(free) == 1:  # the point closest to the capture region
        start, free = target, goal.place.polygon
    points = [convex.project(start, part) for part in geometry.free_parts(free)]
    return min(points, key=lambda p: math.dist(p, start), default=None)


def in_time(
    current: Adjustment, wanted: Adjustment, landing: Landing, time: float
) -> Adjustment:
    """Returns `wanted`, limited to what the foot can reach in `time` [s].

    The foothold moves on from that of `current` only as far as the swing foot
    can be before touchdown, or the foot would be dragged along the ground.  The
    nominal foothold is always allowed.
    """

    def is_in_time(foothold: Array) -> bool:
        return UNDER_WAY * landing.time_to(foothold) <= time

    p, q = current.pose.p_WF[:2], wanted.pose.p_WF[:2]
    if wanted.pose == current.pose or not wanted.moved or is_in_time(q):
        return wanted
    geometry, result, share = landing.geometry, current, 0.0
    for part in _BISECTION:
        point = p + (share + part) * (q - p)
        place = geometry.place_at(point, wanted.region)
        if place is not None and is_in_time(point):
            pose = geometry.foot_at(point, wanted.nominal.pose)
            result = Adjustment(
                wanted.nominal, pose, place.reach, ground=place.ground
            )
            share += part
    return result


def capture_regions(landing: Landing, adjustment: Adjustment) -> CaptureRegions:
    """Returns the regions and footholds behind the proposed `adjustment`."""
    geometry, one_step = landing.geometry, landing.one_step
    inner = (
        capture.capture_region(one_step, offsets)
        for offsets in geometry.offsets[:-1]
    )
    regions = geometry.regions
    return CaptureRegions(
        (*inner, landing.capture_region),  # C_1, ..., C_N
        # A region chosen before cross-over was switched off is missing.
        regions.get(adjustment.region, regions[BASE]),
        adjustment.nominal.pose,
        adjustment.pose,
    )
