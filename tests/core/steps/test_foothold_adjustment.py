"""Oracles: shapely's distances, the paper's rules by hand, dense search."""

import copy
import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
import shapely
from shapely.ops import nearest_points

from nadia_balance.core.body import reachability
from nadia_balance.core.body.reachability import BACKWARD, BASE, FORWARD
from nadia_balance.core.math.arrays import rectangle
from nadia_balance.core.math.lipm import icp_after
from nadia_balance.core.math.polygon import contains, convex_hull
from nadia_balance.core.steps.capture_region import (
    Place,
    ReachRulesParams,
    capture_region,
)
from nadia_balance.core.steps.foothold_adjustment import (
    Landing,
    adjust_foothold,
    capture_regions,
    goals,
    in_time,
    lacks_ground,
    propose_adjustment,
    touchdown_interval,
    unadjusted,
)
from nadia_balance.core.walking.state import Adjustment, FootPose, WalkingState
from tests.core.body.test_ground import square
from tests.core.steps.test_capture_region import PARAMS, geometry, on_ground
from tests.example_walks import ALL, OMEGA, UNCROSSED, mirrored, moved, swing

TICK = 0.002
IN_PLACE = swing(length=0.0)
NOMINAL = IN_PLACE.footsteps[0].pose
GEOMETRY = geometry(IN_PLACE)


def geometry_with(**parts):
    """GEOMETRY, but for these parts."""
    changed = copy.copy(GEOMETRY)
    vars(changed).update(parts)
    return changed


PUSHES = [[0.0, 0.0], [0.2, 0.0], [-0.25, 0.1], [0.0, -0.2], [0.2, -0.2]]
PUSHES += [[0.1, 0.1], [0.0, 0.1], [0.0, 0.3], [0.15, 0.2]]


def state_at(t, schedule=IN_PLACE, adjustment=None):
    return WalkingState(
        schedule, time_in_phase=t, elapsed=t, adjustment=adjustment
    )


def landing(state, icp, polygons=GEOMETRY, params=PARAMS, time_adjustment=0.0):
    times = touchdown_interval(state, time_adjustment, params)
    return Landing(polygons, np.array(icp), times)


def propose(state, icp, params=PARAMS, time_adjustment=0.0, on=ALL):
    polygons = geometry(state.schedule, params, on)
    return propose_adjustment(
        state,
        landing(state, icp, polygons, params, time_adjustment),
        params,
        TICK,
    )


def region_at(t, icp, params=PARAMS, on=ALL):
    """C_N of IN_PLACE at the time `t` of its swing."""
    times = IN_PLACE.duration - t
    polygons = geometry(IN_PLACE, params, on)
    one_step = polygons.one_step_region(
        np.array(icp), (times, times + params.waiting_time)
    )
    return capture_region(one_step, polygons.offsets[-1])


@dataclass(frozen=True, eq=False)
class Given(Landing):
    """A landing with this capture region."""

    capture_region: np.ndarray = None


def given(region, kind=Given, **parts):
    """GEOMETRY, but for these parts, and a capture region (n, 2)."""
    polygons = geometry_with(**parts)
    return kind(polygons, np.zeros(2), (0.3, 0.8), capture_region=region)


def adjust(current, region, period=TICK, **parts):
    """The adjustment for that."""
    return adjust_foothold(current, given(region, **parts), PARAMS, period)


STEP = IN_PLACE.footsteps[0]


def at(x, y, region=BASE, **more):
    """An adjustment of IN_PLACE's step."""
    pose = FootPose([x, y, 0.0])
    return Adjustment(STEP, pose, region, **more)


# Which region: the rules.

RULES = replace(
    PARAMS,
    margin=0.0,
    rules=ReachRulesParams(
        area_margin=2.0, hysteresis=1.5, distance_hysteresis=0.1
    ),
)
# Towers of unit width on the x axis: a capture region below them of depth 10
# shares with each tower as much as the tower reaches down.
ABOVE = convex_hull(rectangle(20.0, 10.0) - [0.0, 5.0])
NAMES = (BASE, FORWARD, BACKWARD)


def tower(x, depth):
    """A unit-wide region at `x` that shares the area `depth` with ABOVE."""
    return convex_hull(rectangle(1, 5 + depth) + [x + 0.5, 0.5 * (5 - depth)])


def chosen(places, before=None, margin=0.0, late=None, ground=0, **regions):
    """The goals in these places (name, ground, polygon).

    On arrival the capture region is `arrival`, or 0.7 m off where it is `late`;
    if later steps hurry, it is `hurried`.
    """
    arrival, hurried = map(regions.get, ("arrival", "hurried"))
    hurried = ABOVE if hurried is None else hurried

    class Case(Given):
        def on_arrival(self, region, least, under_way=False):
            assert least == RULES.least_time_to_land
            if arrival is not None:
                return arrival
            return self.capture_region - [0.0, 0.7 * (region is late)]

    places = tuple(Place(*place) for place in places)
    case = given(ABOVE, Case, places=places, hurried_region=lambda _: hurried)
    current = unadjusted(IN_PLACE)
    if before is not None:
        current = at(9.0, 9.0, before, ground=ground)
    return goals(case, current, replace(RULES, margin=margin))


def towers(base, forward, backward):
    """Three regions that share so much with ABOVE; less than 0 is apart."""
    depths = zip(
        NAMES, (0.0, 2.0, -2.0), (base, forward, backward), strict=True
    )
    return [(name, 0, tower(x, depth)) for name, x, depth in depths]


@pytest.mark.parametrize(
    ("shared", "expected"),
    [
        # Rule 1: base, if it shares anything ...
        ((1.0, 1.9, 1.9), BASE),
        ((0.1, -1.0, -1.0), BASE),
        # ... but not if a cross-over region shares more than twice that.
        ((1.0, 2.1, 0.5), FORWARD),
        ((1.0, 0.5, 2.1), BACKWARD),
        # Rule 2: the cross-over region that shares more.
        ((-1.0, 0.5, 0.4), FORWARD),
        ((-0.01, 0.4, 0.5), BACKWARD),
        # Rule 3: the closest.
        ((-1.0, -2.0, -3.0), BASE),
        ((-2.0, -1.0, -3.0), FORWARD),
        ((-3.0, -2.0, -1.0), BACKWARD),
    ],
)
def test_the_three_rules(shared, expected):
    """Oracle: the truth table of Fig. 9, with the area margin of 2."""
    (goal,) = chosen(towers(*shared))
    assert goal.place.reach == expected


@pytest.mark.parametrize("before", NAMES)
@pytest.mark.parametrize(
    ("shared", "expected"),
    [
        # Preferences of base : forward, doubled for base, are 1 : 1.4.
        ((0.5, 1.4, 0.0), {BASE: BASE, FORWARD: FORWARD, BACKWARD: FORWARD}),
        # 1.4 : 1.
        ((0.7, 1.0, 0.0), {BASE: BASE, FORWARD: FORWARD, BACKWARD: BASE}),
        # 1 : 1.6, which is more than the hysteresis of 1.5.
        ((0.5, 1.6, 0.0), dict.fromkeys(NAMES, FORWARD)),
        ((0.8, 1.0, 0.0), dict.fromkeys(NAMES, BASE)),
        # Apart by 1 and 1.05 m, and by 1 and 1.15 m.
        ((-1.0, -1.05, -3.0), {BASE: BASE, FORWARD: FORWARD, BACKWARD: BASE}),
        ((-1.0, -1.15, -3.0), dict.fromkeys(NAMES, BASE)),
    ],
)
def test_the_last_region_is_kept_unless_another_is_clearly_better(
    before, shared, expected
):
    """Oracle: by hand, hysteresis 1.5 and 0.1 m."""
    (goal,) = chosen(towers(*shared), before)
    assert goal.place.reach == expected[before]


def test_the_region_reached_too_late_is_farther_and_its_goal_where_it_was():
    """Oracle: by hand: forward is nearer by 0.5 m, and 0.7 m have passed."""
    places = towers(-1.0, -0.5, -3.0)
    (goal,) = chosen(places)
    assert goal.place.reach == FORWARD
    (goal,) = chosen(places, late=places[1][-1])
    assert goal.place.reach == BASE
    corner = convex_hull(np.array([[0.0, 1.0], [1.0, 2.0], [0.0, 2.0]]))
    (goal,) = chosen([(BASE, 0, corner)], late=corner, margin=0.1)
    np.testing.assert_allclose(goal.part, [[0.0, 1.0]], atol=1e-15)


def test_the_foot_is_under_way_to_the_region_of_before_alone():
    """Oracle: by hand: forward is farther by 0.5 m; from rest, 0.7 m pass."""

    class Case(Given):
        def on_arrival(self, region, least, under_way=False):
            return self.capture_region - [0.0, 0.7 * (not under_way)]

    places = tuple(Place(*place) for place in towers(-0.5, -1.0, -3.0))
    case = given(ABOVE, Case, places=places, hurried_region=lambda _: ABOVE)
    for before, expected in ((BASE, BASE), (FORWARD, FORWARD)):
        (goal,) = goals(case, at(9.0, 9.0, before), RULES)
        assert goal.place.reach == expected
    (goal,) = goals(case, unadjusted(IN_PLACE), RULES)
    assert goal.place.reach == BASE


def test_the_region_is_one_that_hurried_later_steps_capture():
    """Oracle: by hand: the base is nearer, but only forward is captured."""
    places, above = towers(-1.0, -2.0, -3.0), rectangle(1.0, 1.0) + [2.5, 2.2]
    (goal,) = chosen(places, hurried=convex_hull(above))
    assert goal.place.reach == FORWARD
    np.testing.assert_allclose(goal.part, [[2.0, 2.0]], atol=1e-15)


@pytest.mark.parametrize(
    ("base", "before", "expected"),
    [
        (-3.0, None, BACKWARD),
        (-3.0, FORWARD, BACKWARD),
        (-2.0, None, BASE),
        (-2.0, BASE, BASE),
        (-2.0, FORWARD, BACKWARD),  # it crosses already
    ],
)
def test_of_two_ways_across_the_closer_one_is_taken(base, before, expected):
    """Oracle: by hand: backward is 1 m nearer, forward shares more area.

    The base, where hurried later steps capture from it, is taken first.
    """
    hurried = convex_hull(rectangle(4.1, 5.8) + [0.95, 0.0])
    places = towers(base, -2.0, -1.0)
    (goal,) = chosen(places, before, hurried=hurried)
    assert goal.place.reach == expected


def test_a_region_that_is_captured_on_arrival_is_no_gap_away():
    """Oracle: by hand: a strip across base, and 0.4 m below forward.

    No corner of either is in the other, the next is 0.5 m off.
    """
    places = (FORWARD, 0, tower(2.0, -2.9)), (BASE, 0, tower(0.0, -1.5))
    strip = convex_hull(rectangle(40.0, 0.5) + [0.0, 2.25])
    (goal,) = chosen(places, arrival=strip)
    assert goal.place.reach == BASE


def test_the_goal_is_as_deep_inside_as_asked_or_nearly_the_deepest():
    """Oracle: by hand: 0.3 m below the edge; or all of 0.2 m but 0.3 / 16."""
    (goal,) = chosen(towers(1.0, 0, 0), margin=0.3)
    expected = np.array([[0, -1], [1, -1], [1, -0.3], [0, -0.3]])
    assert convex_hull(goal.part) == pytest.approx(expected, abs=1e-12)
    (goal,) = chosen(towers(0.2, -1, -1), margin=0.3)
    assert len(goal.part) > 2 and np.all(goal.part[:, 1] <= -0.2 + 0.3 / 16)
    assert np.min(goal.part[:, 1]) == pytest.approx(-0.2)


def test_all_ground_of_a_reach_counts_and_is_left_to_choose_from():
    """Oracle: by hand: base has two parts of 0.4, and forward 1.5 (x 2)."""
    stones = [(BASE, k, tower(2.0 * k, 0.4)) for k in range(2)]
    options = chosen([*stones, (FORWARD, 2, tower(9.0, 1.5))])
    assert [goal.place.ground for goal in options] == [0, 1]
    options = chosen([*stones, (FORWARD, 2, tower(9.0, 1.7))])
    assert [goal.place.ground for goal in options] == [2]
    assert chosen([]) == []


def test_half_the_margin_suffices_on_the_ground_of_before():
    """Oracle: by hand: 0.16 m and 0.14 m of 0.3 m, on stones 0 and 1."""
    for depth, kept in (0.16, [1, 0]), (0.14, [1]):
        stones = [(BASE, 0, tower(0.0, depth)), (BASE, 1, tower(2.0, 0.4))]
        options = chosen(stones, margin=0.3)
        assert [goal.place.ground for goal in options] == [1]
        options = chosen(stones, BASE, margin=0.3)
        assert [goal.place.ground for goal in options] == kept


# Where to.


@pytest.mark.parametrize("push", PUSHES[1::2])
def test_the_foot_goes_to_the_closest_good_foothold(push):
    """Oracle: shapely: the region, cut with the reach; else the least gap."""
    params = replace(PARAMS, margin=0.0, dead_band=0.0)
    icp = np.array([0.0, 0.07]) + push
    proposal = propose(state_at(0.35), icp, params, on=UNCROSSED)
    foothold = shapely.Point(proposal.pose.p_WF[:2])
    region = shapely.Polygon(region_at(0.35, icp, params, UNCROSSED))
    reach = shapely.Polygon(GEOMETRY.regions[BASE])
    assert reach.distance(foothold) < 1e-9
    goal = region.intersection(reach)
    if goal.is_empty:
        expected = region.distance(reach)
        assert region.distance(foothold) == pytest.approx(expected, abs=1e-9)
        return
    assert goal.distance(foothold) < 1e-7
    nominal = shapely.Point(NOMINAL.p_WF[:2])
    expected = goal.distance(nominal)
    assert foothold.distance(nominal) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("captured", ["everything", "a spot out of reach"])
def test_a_goal_on_the_stance_foot_gives_way_to_the_nearest_beside_it(captured):
    """Oracle: shapely: the reach but for |x| < 0.255 m and y > 0.

    Nearest to the nominal foothold, or to the point that is next to the spot.
    """
    reach = GEOMETRY.regions[FORWARD]
    free = shapely.Polygon(reach) - shapely.box(-0.255, 0.0, 0.255, 9.0)
    pose = FootPose([0.15, 0.02, 0.0])
    current = Adjustment(replace(STEP, pose=pose), pose, FORWARD)
    region, nearest = rectangle(4.0, 4.0), shapely.Point(0.15, 0.02)
    if captured != "everything":
        region = rectangle(0.02, 0.02) + [0.12, 0.12]
        nearest, _ = nearest_points(*map(shapely.Polygon, (reach, region)))
    adjusted = adjust(current, region, places=(Place(FORWARD, 0, reach),))
    p = shapely.Point(adjusted.pose.p_WF[:2])
    assert free.distance(p) < 1e-9
    assert p.distance(nearest) == pytest.approx(free.distance(nearest))


def test_the_mirror_and_a_turned_world_change_nothing():
    """Oracle: symmetry.

    By rule 3, short edges of the region, which are those of the reach times
    E^2, may be parallel to the reach: then the point is open by their length.
    """
    angle, shift = 2.5, np.array([10.0, -20.0])
    R, flip = FootPose(yaw=angle).rotation, np.array([1.0, -1.0])
    schedule = swing(length=0.1, turn=0.2)
    elsewhere = moved(schedule, angle, shift)
    for push in PUSHES:
        icp = np.array([0.05, 0.07]) + push
        here = propose(state_at(0.3, schedule), icp)
        there = propose(state_at(0.3, mirrored(schedule)), icp * flip)
        moved_on = propose(state_at(0.3, elsewhere), R @ icp + shift)
        assert here.region == there.region == moved_on.region
        assert there.pose.yaw == -here.pose.yaw
        p = here.pose.p_WF[:2]
        np.testing.assert_allclose(there.pose.p_WF[:2], p * flip, atol=1e-9)
        now = landing(state_at(0.3, schedule), icp, geometry(schedule))
        error = 1e-9 if contains(p, now.capture_region) else 1e-3
        foothold = moved_on.pose.p_WF[:2]
        assert foothold == pytest.approx(R @ p + shift, abs=error)


def test_a_nominal_foothold_out_of_reach_is_brought_within():
    """Oracle: the reach, though the capture region covers the foothold."""
    # Legs that are crossed already.
    step = replace(STEP, pose=FootPose([0.0, 0.05, 0.0]))
    schedule = replace(IN_PLACE, footsteps=(step, *IN_PLACE.footsteps[1:]))
    adjusted = propose(state_at(0.1, schedule), [0.0, 0.085], on=UNCROSSED)
    assert contains(step.pose.p_WF[:2], region_at(0.1, [0.0, 0.085]))
    assert adjusted.pose.p_WF[1] == pytest.approx(0.0, abs=1e-12)


# When.


OUT = [0.2, 0.0]  # an ICP that needs a step forward


@pytest.mark.parametrize(
    ("elapsed", "t", "gain", "moves"),
    [
        (0.000, 0.000, 0.0, True),  # at lift-off
        (0.600, 0.640, 0.0, True),
        (0.600, 0.651, 0.0, False),  # less than 0.05 s is left
        (0.400, 0.640, 0.0091, True),
        (0.400, 0.640, 0.0111, False),  # ... or will be, after this tick
        (0.600, 0.660, -0.0111, True),  # more is left if the clock is held
        (0.600, 0.660, -0.0091, False),
        (0.700, 0.700, 0.0, False),  # late
    ],
)
def test_nothing_moves_late_in_a_swing(elapsed, t, gain, moves):
    """Oracle: by hand, 0.7 s of swing; with and without an adjustment."""
    state = replace(state_at(t), elapsed=elapsed)
    assert propose(state, OUT, PARAMS, gain).moved == moves
    before = at(0.03, -0.125, FORWARD, covered_ticks=3)
    after = propose(replace(state, adjustment=before), OUT, PARAMS, gain)
    assert (after is before) == (not moves)


def shifted_region(x):
    """A region whose edge, less the margin, is at `x`."""
    edge = x - PARAMS.margin
    return convex_hull(rectangle(2.0, 2.0) + [1.0 + edge, -0.125])


def test_within_the_dead_band_nothing_moves():
    """Oracle: by hand: a target just less, and just more, than 1 cm off."""
    for off, moves in (0.0098, False), (0.0102, True):
        region = shifted_region(off)
        current = unadjusted(IN_PLACE)
        adjusted = adjust(current, region)
        assert adjusted.moved == moves
        if moves:
            assert adjusted.pose.p_WF[0] == pytest.approx(off)
        again = adjust(adjusted, region)
        assert again.pose == adjusted.pose


@pytest.mark.parametrize(
    ("period", "count"), [(0.002, 25), (0.05, 1), (0.12, 1)]
)
def test_the_foot_returns_when_it_could_for_50_ms(period, count):
    """Oracle: the count of the ticks, from the start after a gap."""
    away, covered = shifted_region(0.1), shifted_region(-0.01)
    out = adjust(unadjusted(IN_PLACE), away, period)
    for ticks in (count - 1, count):
        current = adjust(out, away, period)
        assert (current.pose, current.covered_ticks) == (out.pose, 0)
        for _ in range(ticks):
            assert (current.pose, current.region) == (out.pose, out.region)
            current = adjust(current, covered, period)
    assert current == unadjusted(IN_PLACE)


def test_the_foot_returns_at_once_from_a_foothold_that_is_lost():
    """Oracle: a region that covers the nominal foothold, not the present."""
    region = convex_hull(rectangle(0.4, 0.4) + [0.0, -0.125])
    assert adjust(at(0.5, -0.125, FORWARD), region).pose == NOMINAL


def test_the_capture_region_on_arrival_is_of_the_time_of_the_way():
    """Oracle: by hand: 2 sqrt(way / acceleration) + settling, a straight way;
    so long as the latest landing is no longer waited for than now.
    """
    now, foot, icp = (0.4, 0.9), np.array([0.0, -0.125]), np.array([0.0, 0.4])
    case = Landing(GEOMETRY, icp, now, foot)
    ahead = foot + convex_hull(rectangle(0.2, 0.1)) + [0.3, -0.2]
    corner, _ = reachability.closest_point(ahead, case.capture_region)
    detour = GEOMETRY.model.detour
    t = 2.0 * math.sqrt(math.dist(foot, corner) / detour.max_acceleration)
    t += detour.settling
    for least, under_way, first in (
        (0.08, False, t),
        (0.08, True, math.sqrt(0.5) * t),
        (0.3, True, 0.3),
    ):
        one_step = GEOMETRY.one_step_region(icp, (first, first + 0.5))
        expected = capture_region(one_step, GEOMETRY.offsets[-1])
        region = case.on_arrival(ahead, least, under_way)
        np.testing.assert_allclose(region, expected, atol=1e-12)
    unhurried = Landing(GEOMETRY, icp, now)
    assert unhurried.on_arrival(ahead, 0.08) is unhurried.capture_region


# In time.

FOOT = np.array([0.0, -0.2])
LAST, WANTED = at(0.1, -0.25), at(0.6, -0.4)


def late_landing(foot=FOOT):
    return Landing(GEOMETRY, np.array(OUT), (0.1, 0.6), foot)


@pytest.mark.parametrize("time", [0.1, 0.125, 0.15])
def test_a_foothold_moves_on_as_far_as_the_foot_can_be_there(time):
    """Oracle: by hand: a foot under way goes a / 4 (sqrt(2) t - settling)^2."""
    detour = GEOMETRY.model.detour
    reach = math.sqrt(2.0) * time - detour.settling
    reach = 0.25 * detour.max_acceleration * reach**2
    last, goal = LAST.pose.p_WF[:2], WANTED.pose.p_WF[:2]
    circle = shapely.Point(FOOT).buffer(reach, quad_segs=256)
    line = shapely.LineString([last, goal])
    share = circle.intersection(line).length / line.length
    limited = in_time(LAST, WANTED, late_landing(), time)
    x, y = (limited.pose.p_WF[:2] - last) / (goal - last)
    assert x == pytest.approx(y)
    assert 0.1 < share - 1.0 / 32.0 - 1e-4 <= x <= share + 1e-4 < 0.9
    assert limited.pose.yaw == WANTED.pose.yaw


def strip(start, end):
    """The footholds with x from `start` to `end` and |y| < 1."""
    return rectangle(end - start, 2.0) + [0.5 * (start + end), 0.0]


@pytest.mark.parametrize(
    ("seen", "share", "place"),
    [
        # From x = 0.1 to 0.6 m; base ends at 0.3 m, forward begins at 0.2 m.
        (0.19, 5, (BASE, 1)),
        (0.25, 9, (FORWARD, 2)),
        # Nothing is between 0.41 and 0.47 m: 16 + 2 + 1 of 32.
        (0.45, 19, (FORWARD, 2)),
        (0.55, 28, (FORWARD, 3)),
        (0.11, 0, ("own", 7)),
    ],
)
def test_a_foothold_that_is_limited_is_in_the_place_in_which_it_lies(
    seen, share, place
):
    """Oracle: by hand: the binary digits of the way that is in time.

    `share` of it in 32nds: of the way to x = `seen`, or less where no ground
    is.  Without any, the foothold of before stays as it is.
    """
    places = (
        Place(BASE, 1, strip(-0.5, 0.3)),
        Place(FORWARD, 2, strip(0.2, 0.41)),
        Place(FORWARD, 3, strip(0.47, 0.9)),
    )
    polygons = geometry_with(places=places)

    class Case(Landing):
        def time_to(self, goal):
            return 0.0 if goal[0] <= seen else math.inf

    current = replace(LAST, region="own", ground=7)
    target = at(0.6, -0.25, FORWARD, ground=3)
    case = Case(polygons, np.array(OUT), (0.1, 0.6), FOOT)
    moved_on = in_time(current, target, case, 0.1)
    assert (moved_on.region, moved_on.ground) == place
    assert moved_on.pose.p_WF[0] == pytest.approx(0.1 + 0.5 * share / 32.0)
    assert moved_on.pose.p_WF[1] == pytest.approx(-0.25)
    assert moved_on.nominal is STEP
    assert (moved_on is current) == (share == 0)


def test_if_all_goals_are_on_the_stance_foot_nothing_changes():
    """Oracle: the very same adjustment, although the goal is elsewhere."""
    small = rectangle(0.1, 0.05) + IN_PLACE.feet.left.p_WF[:2]
    everywhere = convex_hull(rectangle(0.3, 0.3) + [0.0, 0.2])
    case = given(everywhere, places=(Place(BASE, 0, small),))
    current = replace(LAST, region=FORWARD, ground=4)
    assert goals(case, current, PARAMS)
    assert adjust_foothold(current, case, PARAMS, TICK) is current


def test_a_foothold_in_time_is_taken_as_it_is_and_one_too_late_not_at_all():
    """Oracle: the very objects; the nominal foothold, and a foot that no
    mechanism hurries, are left alone.
    """
    case = late_landing()
    assert in_time(LAST, WANTED, case, 0.5) is WANTED
    assert in_time(LAST, WANTED, case, 0.02).pose == LAST.pose
    back = unadjusted(IN_PLACE)
    assert in_time(LAST, back, case, 0.0) is back
    assert in_time(LAST, WANTED, late_landing(None), 0.0) is WANTED


def test_granted_time_is_kept_where_the_foothold_is_not_quite_in_reach():
    """Oracle: by hand; the foothold is between the last one and the wanted."""
    case = late_landing(FOOT)
    last, wanted = (replace(one, prolonged=0.2) for one in (LAST, WANTED))
    places = []
    for time in np.linspace(0.02, 0.5, 13):
        nearest = in_time(last, wanted, case, time)
        assert nearest.prolonged == 0.2
        places.append(nearest.pose.p_WF[:2])
    ends = [one.pose.p_WF[:2] for one in (LAST, WANTED)]
    away = [min(math.dist(place, end) for end in ends) for place in places]
    assert max(away) > 0.02


def test_the_time_that_the_clock_has_gained_counts():
    """Oracle: 0.15 s of the clock; 0.05 s, and 0.1 s that it can give back."""
    for left, gained in ((0.15, 0.0), (0.05, 0.1)):
        t = IN_PLACE.duration - left
        state = replace(state_at(t, adjustment=LAST), elapsed=t - gained)
        case = Landing(GEOMETRY, np.array([0.5, -0.2]), (0.06, 0.5), FOOT)
        target = adjust_foothold(LAST, case, PARAMS, TICK)
        proposed = propose_adjustment(state, case, PARAMS, TICK)
        expected = in_time(LAST, target, case, 0.15)
        assert proposed.pose.p_WF[:2] == pytest.approx(expected.pose.p_WF[:2])
        assert proposed.pose.p_WF[0] < target.pose.p_WF[0]


@pytest.mark.parametrize("left", [0.03, 0.06])  # in the frozen time, before
@pytest.mark.parametrize("icp", [(-0.2, -0.35), (0.3, -0.3), (0.0, -0.15)])
def test_a_swing_is_prolonged_for_a_foothold_that_misses_less(icp, left):
    """Oracle: shapely's distances from the regions of both arrivals.

    The foot is over its nominal foothold when the ICP leaves on its side.
    """
    foot, first = NOMINAL.p_WF[:2], unadjusted(IN_PLACE)
    times = (left, left + PARAMS.waiting_time)
    case = Landing(GEOMETRY, np.array(icp), times, foot)
    target = adjust_foothold(first, case, PARAMS, TICK)

    def missed(pose):
        soonest = max(left, math.sqrt(0.5) * case.time_to(pose.p_WF[:2]))
        arrival = soonest, soonest + PARAMS.waiting_time
        one_step = GEOMETRY.one_step_region(case.icp, arrival)
        region = shapely.Polygon(GEOMETRY.hurried_region(one_step))
        return region.distance(shapely.Point(pose.p_WF[:2]))

    state = state_at(IN_PLACE.duration - left)
    proposed = propose_adjustment(state, case, PARAMS, TICK)
    late = left + PARAMS.prolongation
    later = in_time(first, target, case, late).pose
    soon = in_time(first, target, case, left).pose if left > 0.05 else NOMINAL
    pays = missed(later) < missed(soon) - PARAMS.rules.distance_hysteresis
    assert proposed.pose == (later if pays else soon)
    assert proposed.prolonged == (PARAMS.prolongation if pays else 0.0)
    assert pays == (np.hypot(*icp) > 0.2)
    never = replace(PARAMS, prolongation=0.0)
    other = propose_adjustment(state, case, never, TICK)
    assert (other.pose, other.prolonged) == (soon, 0.0)
    state = replace(state, adjustment=proposed)  # it lasts for the swing
    again = propose_adjustment(state, case, PARAMS, TICK)
    assert again.prolonged == proposed.prolonged
    assert missed(again.pose) <= missed(proposed.pose) + 1e-9


@pytest.mark.parametrize("gained", [-0.03, 0.0, 0.03])
@pytest.mark.parametrize("granted", [0.0, 0.04])
def test_a_prolonged_swing_ends_at_one_time_whatever_the_clock(gained, granted):
    """Oracle: by hand: a foot under way goes a / 4 (sqrt(2) t - settling)^2.

    t is the planned duration and the prolongation, less the elapsed time.  Once
    it is granted, nobody asks again what it is worth.
    """
    worth = 9.0 if granted else PARAMS.rules.distance_hysteresis
    rules = replace(PARAMS.rules, distance_hysteresis=worth)
    params = replace(PARAMS, prolongation=0.04, rules=rules)
    elapsed, foot = 0.66, NOMINAL.p_WF[:2]
    first = replace(unadjusted(IN_PLACE), prolonged=granted)
    state = state_at(elapsed + gained, adjustment=first)
    times = (0.06 if granted else 0.03, 0.5)
    case = Landing(GEOMETRY, np.array([0.4, -0.3]), times, foot)
    proposed = propose_adjustment(
        replace(state, elapsed=elapsed), case, params, TICK
    )
    detour, t = GEOMETRY.model.detour, IN_PLACE.duration + 0.04 - elapsed
    reach = math.sqrt(2.0) * t - detour.settling
    reach = 0.25 * detour.max_acceleration * reach**2
    target = adjust_foothold(first, case, params, TICK)
    way, whole = (
        math.dist(one.pose.p_WF[:2], foot) for one in (proposed, target)
    )
    assert reach - whole / 32.0 - 1e-9 <= way <= reach < whole
    assert proposed.prolonged == 0.04


@pytest.mark.parametrize("place", [(0.0, -0.3), (-0.4, -0.5)])
def test_a_foot_misses_by_its_landing_but_not_before_the_clock(place):
    """Oracle: shapely: the ICPs that CoPs in the corners lead to.

    The first foot is over the foothold, the second one 2 sqrt(way / a) away.
    """
    foothold, icp = at(0.0, -0.3), np.array([0.3, -0.5])
    way = math.dist(place, foothold.pose.p_WF[:2])
    t = 2.0 * math.sqrt(way / GEOMETRY.model.detour.max_acceleration)
    first = max(0.1, math.sqrt(0.5) * (t + GEOMETRY.model.detour.settling))
    case = Landing(GEOMETRY, icp, (0.1, 0.6), np.array(place))
    icps = [
        icp_after(icp, cop, OMEGA, time)
        for cop in GEOMETRY.foot
        for time in (first, first + 0.5)
    ]
    one_step = convex_hull(np.array(icps))
    region = shapely.Polygon(GEOMETRY.hurried_region(one_step))
    expected = region.distance(shapely.Point(foothold.pose.p_WF[:2]))
    assert expected > 0.01
    assert case.missed(foothold) == pytest.approx(expected)


@pytest.mark.parametrize(("shift", "kept"), [(0.01, "left"), (0.02, "right")])
def test_a_stone_is_kept_unless_another_one_is_clearly_nearer(shift, kept):
    """Oracle: by hand: two stones meet in front of the nominal foothold.

    The right one is nearer by twice the shift; the hysteresis is 3 cm.
    """
    sides = ("left", -0.25), ("right", 0.25)
    stones = tuple(square(name, x - shift, -0.2) for name, x in sides)
    polygons = on_ground(stones, IN_PLACE, UNCROSSED)
    everywhere = convex_hull(rectangle(2.0, 2.0))
    for last, expected in (None, "right"), (0, kept), (1, "right"):
        current = unadjusted(IN_PLACE)
        if last is not None:
            current = at(-0.3 + 0.6 * last, -0.2, ground=last)
        pose = adjust(current, everywhere, **vars(polygons)).pose
        assert polygons.model.ground.region_under(pose).name == expected


def test_ground_is_missed_where_the_capture_region_is_in_reach_of_none():
    """Oracle: shapely's areas, for pushes all around on plates of three sizes.

    On flat ground none is missed.
    """
    missed = []
    for side, icp in itertools.product((0.8, 1.2, 3.0), PUSHES):
        polygons = on_ground((square("plate", side=side),), IN_PLACE)
        case = landing(state_at(0.3), icp, polygons)
        captures = shapely.Polygon(case.capture_region)
        reach = shapely.union_all(
            [shapely.Polygon(region) for region in polygons.regions.values()]
        )
        held = shapely.union_all(
            [shapely.Polygon(place.polygon) for place in polygons.places]
        )
        expected = (
            captures.intersection(reach).area > 1e-9
            and captures.intersection(held).area <= 1e-9
        )
        assert lacks_ground(case) == expected
        assert not lacks_ground(landing(state_at(0.3), icp))
        missed.append((side, expected))
    sides = {side for side, expected in missed if expected}
    assert sides == {0.8, 1.2} and (0.8, False) in missed


# To draw.


def test_what_is_drawn_is_what_was_decided():
    """Oracle: the nested regions, the chosen reach, the two footholds.

    A region that is gone with cross-over is drawn as the base region.
    """
    adjustment, case = propose(state_at(0.3), OUT), landing(state_at(0.3), OUT)
    drawn = capture_regions(case, adjustment)
    assert len(drawn.regions) == 3
    assert drawn.regions[-1] is case.capture_region
    for inner, outer in itertools.pairwise(drawn.regions):
        assert all(contains(vertex, outer, 1e-12) for vertex in inner)
    assert drawn.reach is GEOMETRY.regions[adjustment.region]
    assert (drawn.nominal, drawn.adjusted) == (NOMINAL, adjustment.pose)
    assert not drawn.reach.flags.writeable
    base_only = geometry_with(regions={BASE: GEOMETRY.regions[BASE]})
    gone = replace(adjustment, region=FORWARD)
    drawn = capture_regions(landing(state_at(0.3), OUT, base_only), gone)
    assert drawn.reach is GEOMETRY.regions[BASE]
