"""Foothold adjustment by capture regions (Nadia paper, Sec. IV and V).

The foot lands in a place: a region of the ground within a reachability region.
Flat ground is one region.  The paper's rules choose the reachability region
(`goals`); the foothold is the closest to the nominal one in its places.  Dead
bands and waiting times are not from the paper.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from nadia_balance.core.body.reachability import BASE, distance_between
from nadia_balance.core.body.swing_detour import UNDER_WAY
from nadia_balance.core.math import polygon
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
    Place,
    ReachRulesParams,
    SwingGeometry,
    capture_region,
)
from nadia_balance.core.walking.state import (
    Adjustment,
    ContactSchedule,
    FootPose,
    Footstep,
    Immutable,
    WalkingState,
    number_of_ticks,
)

_BISECTION = (0.5, 0.25, 0.125, 0.0625, 0.03125)  # shares of the way [-]
_HALVINGS = 4  # bisection steps for a feasible margin, to 1/16 [-]
_KEPT = 0.5  # share of the margin that suffices on the previous ground [-]


@dataclass(frozen=True, eq=False)
class CaptureRegions(Immutable):
    """Polygons (n, 2) [m] in W and footholds, for display."""

    regions: tuple[Array, ...] = ()  # C_1, ..., C_N
    reach: Array = field(default_factory=lambda: np.empty((0, 2)))
    nominal: FootPose | None = None
    adjusted: FootPose | None = None

    def __post_init__(self) -> None:
        for region in (*self.regions, self.reach):
            region.flags.writeable = False


def unadjusted(schedule: ContactSchedule) -> Adjustment:
    """The planned next foothold, as an adjustment that changes nothing.

    Args:
        schedule: feet and footsteps.

    Returns:
        The adjustment; without steps, that of the present foothold.
    """
    if schedule.footsteps:
        step = schedule.footsteps[0]
    else:
        side = schedule.support_side.other
        step = Footstep(
            side=side,
            pose=schedule.feet[side],
            transfer_duration=0.0,
            swing_duration=0.0,
        )
    return Adjustment(step, step.pose)


def current_adjustment(state: WalkingState) -> Adjustment:
    """The adjustment in force.

    Args:
        state: walking state.

    Returns:
        The adjustment; that of the planned foothold, if none is in force.
    """
    return state.adjustment or unadjusted(state.schedule)


def touchdown_interval(
    state: WalkingState,
    time_gain: float,
    params: CaptureRegionStepAdjusterParams,
) -> tuple[float, float]:
    """The times at which the new foot may be loaded.

    Args:
        state: walking state.
        time_gain: expected change of the clock, negative if it is held [s].
        params: `waiting_time` counts.

    Returns:
        The earliest and the latest load from now [s].
    """
    earliest = max(state.remaining_time - time_gain, 0.0)
    return earliest, earliest + params.waiting_time


@dataclass(frozen=True, eq=False)
class Landing(Immutable):
    """Possible touchdowns of the swing foot, as predicted in one tick.

    Args:
        geometry: polygons of the swing; others are computed on first use.
        icp: ICP (2,) in W [m].
        touchdown: earliest and latest touchdown from now [s].
        foot: position of the swing foot (2,) in W [m]; None if the touchdown
            times do not depend on the foothold.
    """

    geometry: SwingGeometry
    icp: Array
    touchdown: tuple[float, float]
    foot: Array | None = None

    @cached_property
    def one_step(self) -> Array:
        """C_1 (n, 2) [m] in W, for a foot without extent."""
        return self.geometry.one_step_region(self.icp, self.touchdown)

    @cached_property
    def capture_region(self) -> Array:
        """C_N (n, 2) [m] in W."""
        return capture_region(self.one_step, self.geometry.offsets[-1])

    def on_arrival(
        self, region: Array, least: float, under_way: bool = False
    ) -> Array:
        """C_N for a touchdown as early as possible in a region of footholds.

        The foothold is the point of `region` closest to the present C_N.  The
        touchdown time is that of the path round the stance foot.

        Args:
            region: polygon (n, 2) in W [m].
            least: least touchdown time from now [s].
            under_way: whether the foot moves there already, which takes less.

        Returns:
            The capture region (k, 2) in W [m].
        """
        if self.foot is None:
            return self.capture_region
        soonest = self.time_to(
            polygon.closest_point(region, self.capture_region)[0]
        )
        if under_way:
            soonest *= UNDER_WAY
        return capture_region(
            self._one_step_from(max(soonest, least)), self.geometry.offsets[-1]
        )

    def missed(self, adjustment: Adjustment) -> float:
        """Distance of a foothold from C_N if later steps hurry.

        C_N is that of the touchdown there, of a foot under way at full speed,
        but not before the clock.

        Args:
            adjustment: the foothold.

        Returns:
            The distance [m]; 0 inside.
        """
        p = adjustment.pose.p_WF[:2]
        soonest = max(self.touchdown[0], UNDER_WAY * self.time_to(p))
        region = self.geometry.hurried_region(self._one_step_from(soonest))
        return math.dist(p, polygon.project(p, region))

    def _one_step_from(self, soonest: float) -> Array:
        """C_1 (n, 2) [m] in W for a touchdown at `soonest` [s] or later."""
        first, last = self.touchdown
        return self.geometry.one_step_region(
            self.icp, (soonest, soonest + last - first)
        )

    def time_to(self, goal: Array) -> float:
        """Time of the foot from rest to its landing.

        Args:
            goal: foothold (2,) in W [m].

        Returns:
            The time [s]; 0 without `foot`.
        """
        if self.foot is None:
            return 0.0
        return self.geometry.model.detour.time_of_way(
            start=self.foot,
            goal=goal,
            stance=self.geometry.stance,
            swing=self.geometry.swing,
        )


def propose_adjustment(
    state: WalkingState,
    landing: Landing,
    params: CaptureRegionStepAdjusterParams,
    period: float,
) -> Adjustment:
    """The adjustment of the step in the air for this tick.

    The foothold may change from lift-off on; in the last `freeze_time` only if
    the swing is prolonged for it.  That is for a foothold which the foot cannot
    reach in time, if it misses the capture region by less, although the ICP
    diverges meanwhile: a foot that is pushed outward late in its swing would
    else land where the other one has to cross it.
    Erratum: the paper's swings are only shortened.

    Args:
        state: walking state, in a swing.
        landing: possible touchdowns of this tick.
        params: times and margins.
        period: of a tick [s].

    Returns:
        The adjustment; the one in force, if nothing changes.
    """
    current = current_adjustment(state)
    target = adjust_foothold(
        current=current, landing=landing, params=params, period=period
    )
    left, lead = state.remaining_time, state.gained_time
    early = left + max(lead, 0.0)
    late = left + lead + params.prolongation
    if current.prolonged:  # once granted, the time is kept
        early = late
        target = replace(target, prolonged=current.prolonged)
    soon = current
    if landing.touchdown[0] >= params.freeze_time:
        soon = in_time(current, target, landing=landing, time=early)
    if soon is target or target.pose == current.pose or landing.foot is None:
        return soon
    later = in_time(current, target, landing=landing, time=late)
    if landing.missed(later) > (
        landing.missed(soon) - params.rules.distance_hysteresis
    ):
        return soon
    return replace(later, prolonged=params.prolongation)


def adjust_foothold(
    current: Adjustment,
    landing: Landing,
    params: CaptureRegionStepAdjusterParams,
    period: float,
) -> Adjustment:
    """The adjustment that puts the foot into the capture region.

        minimise    |p - nominal| - distance_hysteresis on the previous ground
        subject to  p in one of the `goals`, not on the stance foot.

    The nominal foothold, not the last one, is projected onto the `goals`, so
    that the foothold returns when the ICP does: after `return_time` if the
    present one captures it, too.

    Args:
        current: adjustment in force.
        landing: possible touchdowns of this tick.
        params: margins and times.
        period: of a tick [s].

    Returns:
        The adjustment; `current` if no ground is in reach.
    """
    nominal, region = current.nominal.pose, landing.capture_region
    covered = polygon.contains(nominal.p_WF[:2], region, -params.margin)
    if covered and landing.geometry.allows(nominal):
        ticks = current.covered_ticks + 1
        if (
            current.moved
            and ticks < number_of_ticks(params.return_time, period)
            and polygon.contains(current.pose.p_WF[:2], region)
        ):
            return replace(current, covered_ticks=ticks)
        return Adjustment(current.nominal, nominal)

    def cost(option: tuple[Place, Array]) -> float:
        place, point = option
        bonus = _is_last(place, current) * params.rules.distance_hysteresis
        return math.dist(point, nominal.p_WF[:2]) - bonus

    closest = [
        (goal.place, _foothold(nominal, goal, landing.geometry))
        for goal in goals(landing, current, params)
    ]
    options = [(place, point) for place, point in closest if point is not None]
    if not options:
        return current
    place, target = min(options, key=cost)
    pose = current.pose
    if math.dist(target, pose.p_WF[:2]) >= params.dead_band:
        pose = landing.geometry.model.foot_at(target, nominal)
    return Adjustment(current.nominal, pose, place.reach, ground=place.ground)


class Goal(NamedTuple):
    """A place, and the part (n, 2) [m] of it that captures the ICP.

    If none does, the part is the point (1, 2) closest to the capture region.
    """

    place: Place
    part: Array


def goals(
    landing: Landing,
    current: Adjustment,
    params: CaptureRegionStepAdjusterParams,
) -> list[Goal]:
    """The goals of one reachability region (Nadia paper, Sec. V).

    Rule 1: base if it intersects the capture region; rule 2: else the
    cross-over region that shares most area with it; rule 3: else the closest
    place, at the earliest time the foot can be there (`_closest`).  Goals are
    `margin` deep inside the capture region, or about as deep as possible.  On
    the previous place, half of it suffices, so that noise does not move the
    foot to other ground.
    Erratum: as printed, rule 1 prefers any sliver of base to a short step
    across, and the choice flips with noise; hence margin and hysteresis.
    Its rule 3 compares all regions at the same time, but a cross-over step
    takes longer, while the ICP diverges, and a step after it has to return.

    Args:
        landing: possible touchdowns of this tick.
        current: adjustment in force.
        params: margin and rules.

    Returns:
        The goals; none if no ground is in reach.
    """
    A, b = polygon.halfspaces(landing.capture_region)
    places = [Goal(place, place.polygon) for place in landing.geometry.places]
    rules, depth = params.rules, params.margin
    options = _preferred(_clipped(places, A, b - depth), current, rules)
    if not options:
        captured = _preferred(_clipped(places, A, b), current, rules)
        options, depth = _deepest(captured, A, b, margin=params.margin)
    if not options:
        return [_closest(places, landing, current, params)] if places else []
    chosen = [goal.place for goal in options]
    last = [goal for goal in places if _is_last(goal.place, current)]
    if last and last[0].place not in chosen:
        options += [
            goal
            for goal in _clipped(last, A, b - _KEPT * depth)
            if goal.place.reach == chosen[0].reach
        ]
    return options


def _is_last(place: Place, current: Adjustment) -> bool:
    """True if the present, moved foothold was chosen in this place."""
    return current.moved and (
        (place.reach, place.ground) == (current.region, current.ground)
    )


def _clipped(options: Iterable[Goal], A: Array, b: Array) -> list[Goal]:
    """Returns the parts of `options` with A p <= b that have an area."""
    cut = (Goal(place, polygon.clip_all(part, A, b)) for place, part in options)
    return [goal for goal in cut if len(goal.part)]


def _preferred(
    options: list[Goal], current: Adjustment, rules: ReachRulesParams
) -> list[Goal]:
    """Returns the options of one reachability region, by rules 1 and 2."""
    by_reach: dict[str, list[Goal]] = {}
    for goal in options:
        by_reach.setdefault(goal.place.reach, []).append(goal)

    def preference(reach: str) -> float:
        shared = sum(polygon.area(goal.part) for goal in by_reach[reach])
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
    low, high = 0.0, margin
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        deeper = _clipped(options, A, b - middle)
        if deeper:
            options, low = deeper, middle
        else:
            high = middle
    return options, low


def _closest(
    places: list[Goal],
    landing: Landing,
    current: Adjustment,
    params: CaptureRegionStepAdjusterParams,
) -> Goal:
    """Returns the goal of rule 3.

    It is in the base, if later steps that hurry capture from there, and the
    legs are not about to cross; else in the closest of the cross-over regions
    from which they do; else in the closest of all.
    """
    A, b = polygon.halfspaces(landing.geometry.hurried_region(landing.one_step))
    hurried = {goal.place.reach for goal in _clipped(places, A, b)}
    across = hurried - {BASE}
    if BASE in hurried and not (current.moved and current.region in across):
        reaches = {BASE}
    else:
        reaches = across or {goal.place.reach for goal in places}

    def distance(place: Place) -> float:
        is_last = _is_last(place, current)
        captures = landing.on_arrival(
            place.polygon, params.least_time_to_land, is_last
        )
        gap = distance_between(place.polygon, captures)
        return gap - is_last * params.rules.distance_hysteresis

    options = [goal.place for goal in places if goal.place.reach in reaches]
    place = min(options, key=distance)
    nearest, _ = polygon.closest_point(place.polygon, landing.capture_region)
    return Goal(place, nearest[None])


def _foothold(
    nominal: FootPose, goal: Goal, geometry: SwingGeometry
) -> Array | None:
    """Returns the goal's point (2,) [m] closest to `nominal`; None if blocked.

    If this point is on the stance foot, the closest point in front of, behind
    or beside that foot is returned.
    """
    start = nominal.p_WF[:2]
    target = polygon.project(start, goal.part)
    if not geometry.blocked(target):
        return target
    free = goal.part
    if len(free) == 1:  # the point closest to the capture region
        start, free = target, goal.place.polygon
    return min(
        [polygon.project(start, part) for part in geometry.free_parts(free)],
        key=lambda p: math.dist(p, start),
        default=None,
    )


def in_time(
    current: Adjustment, target: Adjustment, landing: Landing, time: float
) -> Adjustment:
    """The adjustment `target`, limited to what the foot can reach in time.

    The foothold moves on from that of `current` only as far as the swing foot
    can be before touchdown, or the foot would be dragged along the ground.  The
    nominal foothold is always allowed.

    Args:
        current: adjustment in force.
        target: desired adjustment.
        landing: possible touchdowns of this tick.
        time: of the touchdown from now [s].

    Returns:
        The adjustment, in the place in which its foothold lies.
    """
    p, q = current.pose.p_WF[:2], target.pose.p_WF[:2]
    if (
        target.pose == current.pose
        or not target.moved
        or UNDER_WAY * landing.time_to(q) <= time
    ):
        return target
    geometry, result, share = landing.geometry, current, 0.0
    for part in _BISECTION:
        point = p + (share + part) * (q - p)
        place = geometry.place_at(point, target.region)
        if place is not None and UNDER_WAY * landing.time_to(point) <= time:
            result = Adjustment(
                target.nominal,
                geometry.model.foot_at(point, target.nominal.pose),
                place.reach,
                ground=place.ground,
                prolonged=target.prolonged,
            )
            share += part
    return result


def lacks_ground(landing: Landing) -> bool:
    """Whether the capture region is in reach, but not on the ground.

    Args:
        landing: possible touchdowns of this tick.

    Returns:
        True if C_N shares area with a reachability region, and with none of
        the footholds within them.
    """
    geometry = landing.geometry
    if geometry.model.ground is None:
        return False
    A, b = polygon.halfspaces(landing.capture_region)
    if any(len(polygon.clip_all(p.polygon, A, b)) for p in geometry.places):
        return False
    return any(
        len(polygon.clip_all(region, A, b))
        for region in geometry.regions.values()
    )


def capture_regions(landing: Landing, adjustment: Adjustment) -> CaptureRegions:
    """The regions and footholds behind an adjustment, for display.

    Args:
        landing: possible touchdowns of this tick.
        adjustment: the proposed one.

    Returns:
        C_1, ..., C_N, the reachability region, and both footholds.
    """
    geometry = landing.geometry
    return CaptureRegions(
        regions=(
            *(
                capture_region(landing.one_step, offsets)
                for offsets in geometry.offsets[:-1]
            ),
            landing.capture_region,
        ),
        # A region chosen before cross-over was switched off is missing.
        reach=geometry.regions.get(adjustment.region, geometry.regions[BASE]),
        nominal=adjustment.nominal.pose,
        adjusted=adjustment.pose,
    )
