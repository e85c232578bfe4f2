"""Oracles: shapely's distances, the plan's own ICP, by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from nadia_balance.core.foothold_adjustment import (
    CaptureRegions,
    Landing,
    adjust_foothold,
    capture_regions,
    propose_adjustment,
    touchdown_interval,
    unadjusted,
)
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.lipm import icp_after
from nadia_balance.core.polygon import contains, convex_hull
from nadia_balance.core.reach_rules import ReachRulesParams
from nadia_balance.core.reachability import (
    BASE,
    FORWARD,
    ReachabilityParams,
)
from nadia_balance.core.swing_geometry import swing_geometry
from nadia_balance.core.walking import (
    Adjustment,
    FootPose,
    Phase,
    WalkingState,
    rectangle,
)
from tests.example_walks import (
    OMEGA,
    SOLE,
    mirrored,
    moved,
    phases,
    standing,
    walk,
)

TICK = 0.002
CROSSING = ReachabilityParams(cross_over=True)
PARAMS = CaptureRegionStepAdjusterParams(reachability=CROSSING)


def swing(**gait):
    """The first swing of a walk: the right foot's."""
    schedule = walk(**gait)
    duration = schedule.footsteps[0].swing_duration
    return replace(schedule, phase=Phase.SWING, duration=duration)


def geometry(schedule, params=PARAMS):
    return swing_geometry(schedule, SOLE, params, OMEGA)


IN_PLACE = swing(length=0.0)
NOMINAL = IN_PLACE.footsteps[0].pose
GEOMETRY = geometry(IN_PLACE)
PUSHES = [
    [0.0, 0.0],
    [0.2, 0.0],
    [-0.25, 0.1],
    [0.0, -0.2],
    [0.2, -0.2],
    [0.1, 0.1],
    [0.0, 0.1],
    [0.0, 0.3],
    [0.15, 0.2],
]


def state_at(t, schedule=IN_PLACE, adjustment=None):
    return WalkingState(
        schedule, time_in_phase=t, elapsed=t, adjustment=adjustment
    )


def landing(state, icp, found=GEOMETRY, params=PARAMS, time_adjustment=0.0):
    times = touchdown_interval(state, time_adjustment, params)
    return Landing(found, np.array(icp), OMEGA, times)


def propose(state, icp, params=PARAMS, time_adjustment=0.0):
    found = geometry(state.schedule, params)
    return propose_adjustment(
        state,
        landing(state, icp, found, params, time_adjustment),
        params,
        TICK,
    )


def region_at(t, icp, params=PARAMS):
    """C_N of IN_PLACE at the time `t` of its swing."""
    times = IN_PLACE.duration - t
    found = geometry(IN_PLACE, params)
    one_step = found.one_step_region(
        np.array(icp), OMEGA, (times, times + params.waiting_time)
    )
    return found.capture_region(one_step)


def is_adjusted(adjustment):
    return adjustment.pose is not adjustment.nominal.pose


# Where to.


def depth_of(region, reach):
    """How deep the reach goes into the region [m], to 1e-6; both shapely's."""
    low, high = 0.0, 1.0
    while high - low > 1e-6:
        depth = 0.5 * (low + high)
        inner = region.buffer(-depth, join_style="mitre")
        low, high = (depth, high) if inner.intersects(reach) else (low, depth)
    return low


@pytest.mark.parametrize("margin", [0.0, 0.04])
@pytest.mark.parametrize("push", PUSHES)
def test_the_foot_goes_to_the_closest_good_foothold(push, margin):
    """Oracle: shapely: region shrunk by the margin, cut with the reach.

    Where the region is less deep, as deep as can be but for margin / 16;
    where it is out of reach, as near as can be.
    """
    params = CaptureRegionStepAdjusterParams(margin=margin, dead_band=0.0)
    icp = np.array([0.0, 0.07]) + push
    found = shapely.Point(propose(state_at(0.35), icp, params).pose.p_WF[:2])
    region = shapely.Polygon(region_at(0.35, icp, params))
    reach = shapely.Polygon(GEOMETRY.regions[BASE])
    assert reach.distance(found) < 1e-9
    if not region.intersects(reach):
        expected = region.distance(reach)
        assert region.distance(found) == pytest.approx(expected, abs=1e-9)
        return
    margin = min(margin, depth_of(region, reach) - margin / 16)
    goal = region.buffer(-margin, join_style="mitre").intersection(reach)
    assert goal.distance(found) < 1e-7
    expected = goal.distance(shapely.Point(NOMINAL.p_WF[:2]))
    distance = found.distance(shapely.Point(NOMINAL.p_WF[:2]))
    slack = 1e-7 if margin == params.margin else 0.01
    assert distance == pytest.approx(expected, abs=slack)


@pytest.mark.parametrize("push", PUSHES)
@pytest.mark.parametrize("yaw", [0.0, 0.3, -0.5])
def test_the_foot_is_never_put_on_the_other_one(push, yaw):
    """Oracle: shapely: the soles' distance; the point is within reach."""
    schedule = swing(length=0.0, turn=yaw)
    found = geometry(schedule)
    stance = shapely.Polygon(schedule.feet.left.to_world(SOLE))
    for t in 0.1, 0.3, 0.5, 0.6:
        for scale in 0.5, 1.0, 2.0:
            icp = np.array([0.0, 0.07]) + scale * np.array(push)
            adjustment = propose(state_at(t, schedule), icp)
            sole = shapely.Polygon(adjustment.pose.to_world(SOLE))
            assert sole.distance(stance) > PARAMS.sole_clearance * 0.999
            reach = found.regions[adjustment.region]
            p = adjustment.pose.p_WF[:2]
            assert contains(p, reach, 1e-9) or not is_adjusted(adjustment)


def test_a_push_inward_crosses_the_legs_only_if_they_may_be_crossed():
    """Oracle: Fig. 9, middle: in front, beside and off the stance foot."""
    icp = [0.0, 0.16]
    crossed = propose(state_at(0.3), icp)
    assert crossed.region == FORWARD
    x, y, _ = crossed.pose.p_WF
    assert x > 0.25 and y > -0.125 + 0.125
    base_only = CaptureRegionStepAdjusterParams()
    uncrossed = propose(state_at(0.3), icp, base_only)
    assert uncrossed.region == BASE
    assert uncrossed.pose.p_WF[1] <= 0.125 - 0.125 + 1e-12


def test_yaw_and_height_stay():
    """Oracle: the nominal foothold's."""
    step = replace(
        IN_PLACE.footsteps[0], pose=FootPose([0.0, -0.125, 0.07], 0.2)
    )
    schedule = replace(IN_PLACE, footsteps=(step, *IN_PLACE.footsteps[1:]))
    found = propose(state_at(0.3, schedule), [0.3, 0.0])
    assert is_adjusted(found)
    assert found.pose.p_WF[2] == 0.07
    assert found.pose.yaw == 0.2


@pytest.mark.parametrize("push", PUSHES)
def test_left_and_right_are_mirror_images(push):
    """Oracle: y and yaw change sign."""
    schedule = swing(length=0.1, turn=0.2)
    icp = np.array([0.05, 0.07]) + push
    here = propose(state_at(0.3, schedule), icp)
    there = propose(state_at(0.3, mirrored(schedule)), icp * [1.0, -1.0])
    assert here.region == there.region
    assert there.pose.yaw == -here.pose.yaw
    np.testing.assert_allclose(
        there.pose.p_WF, here.pose.p_WF * [1.0, -1.0, 1.0], atol=1e-9
    )


@pytest.mark.parametrize("push", PUSHES)
def test_a_walk_elsewhere_is_adjusted_alike(push):
    """Oracle: the same walk, turned and moved.

    By rule 3, short edges of the region, which are those of the reach times
    E^2, may be parallel to the reach: then the point is open by their length.
    """
    angle, shift = 2.5, np.array([10.0, -20.0])
    c, s = math.cos(angle), math.sin(angle)
    R = np.array([[c, -s], [s, c]])
    icp = np.array([0.0, 0.07]) + push
    here = propose(state_at(0.3), icp)
    there = propose(
        state_at(0.3, moved(IN_PLACE, angle, shift)), R @ icp + shift
    )
    assert here.region == there.region
    lost = not contains(here.pose.p_WF[:2], region_at(0.3, icp))
    np.testing.assert_allclose(
        there.pose.p_WF[:2],
        R @ here.pose.p_WF[:2] + shift,
        atol=1e-3 if lost else 1e-9,
        rtol=0.0,
    )


def test_a_nominal_foothold_out_of_reach_is_brought_within():
    """Oracle: the reach, though the capture region covers the foothold."""
    step = IN_PLACE.footsteps[0]  # legs that are crossed already
    step = replace(step, pose=FootPose([0.0, 0.05, 0.0]))
    schedule = replace(IN_PLACE, footsteps=(step, *IN_PLACE.footsteps[1:]))
    base_only = CaptureRegionStepAdjusterParams()
    found = propose(state_at(0.1, schedule), [0.0, 0.085], base_only)
    assert contains(step.pose.p_WF[:2], region_at(0.1, [0.0, 0.085]))
    assert found.pose.p_WF[1] == pytest.approx(0.0, abs=1e-12)


def test_the_region_of_the_last_tick_is_kept_if_it_is_nearly_as_good():
    """Oracle: the same ICP with either past, and with none.

    Here a cross-over in front shares three times the area of the base region,
    which is more than twice, but not by the hysteresis of 4.
    """
    rules = ReachRulesParams(area_margin=2.0, hysteresis=4.0)
    params = replace(PARAMS, rules=rules)
    icp, step = [0.15, 0.13], IN_PLACE.footsteps[0]
    assert propose(state_at(0.3), icp, params).region == FORWARD
    elsewhere = FootPose([0.3, -0.1, 0.0])
    for region in BASE, FORWARD:
        before = Adjustment(step, elsewhere, region)
        state = state_at(0.3, adjustment=before)
        assert propose(state, icp, params).region == region


# When.


def test_without_a_push_the_very_same_pose_comes_back():
    """Oracle: object identity, which spares the state machine a new plan."""
    found = propose(state_at(0.3), [0.0, 0.07])
    assert found.pose is NOMINAL
    assert found.nominal is IN_PLACE.footsteps[0]
    assert (found.region, found.covered_ticks) == (BASE, 0)


OUT = [0.2, 0.0]  # an ICP that needs a step forward


@pytest.mark.parametrize(
    ("elapsed", "t", "gain", "moves"),
    [
        (0.008, 0.008, 0.0, False),  # the first four ticks
        (0.010, 0.010, 0.0, True),
        (0.600, 0.640, 0.0, True),
        (0.600, 0.651, 0.0, False),  # less than 0.05 s is left
        (0.400, 0.640, 0.0091, True),
        (0.400, 0.640, 0.0111, False),  # ... or will be, after this tick
        (0.600, 0.660, -0.0111, True),  # more is left if the clock is held
        (0.600, 0.660, -0.0091, False),
        (0.700, 0.700, 0.0, False),  # late
    ],
)
def test_nothing_moves_early_and_late_in_a_swing(elapsed, t, gain, moves):
    """Oracle: by hand, 0.7 s of swing; with and without an adjustment."""
    state = replace(state_at(t), elapsed=elapsed)
    assert is_adjusted(propose(state, OUT, PARAMS, gain)) == moves
    pose = FootPose([0.03, -0.125, 0.0])
    before = Adjustment(IN_PLACE.footsteps[0], pose, FORWARD, 3)
    after = propose(replace(state, adjustment=before), OUT, PARAMS, gain)
    assert (after is before) == (not moves)


def test_nothing_moves_when_it_is_switched_off_or_nothing_swings():
    """Oracle: the nominal pose; a rest for a robot without footsteps."""
    off = replace(PARAMS, enabled=False)
    assert not is_adjusted(propose(state_at(0.3), OUT, off))
    transfer = replace(IN_PLACE, phase=Phase.TRANSFER)
    assert not is_adjusted(propose(state_at(0.1, transfer), OUT))
    rest = unadjusted(standing())
    assert rest.pose is standing().feet.right
    assert rest.nominal.side.value == "right"


def test_the_gain_of_time_is_that_much_less_time():
    """Oracle: the same swing, so much later."""
    found = propose(state_at(0.3), OUT, PARAMS, 0.2)
    later = propose(replace(state_at(0.5), elapsed=0.3), OUT)
    np.testing.assert_array_equal(found.pose.p_WF, later.pose.p_WF)


def test_within_the_dead_band_nothing_moves():
    """Oracle: by hand: a target just less, and just more, than 1 cm off."""
    for off, moves in (0.0098, False), (0.0102, True):
        # The region's edge, less the margin, is `off` ahead of the foothold.
        x = off - PARAMS.margin
        region = convex_hull(rectangle(2.0, 2.0) + [1.0 + x, -0.125])
        current = unadjusted(IN_PLACE)
        found = adjust_foothold(current, region, GEOMETRY, PARAMS, TICK)
        assert is_adjusted(found) == moves
        if moves:
            assert found.pose.p_WF[0] == pytest.approx(off)
        again = adjust_foothold(found, region, GEOMETRY, PARAMS, TICK)
        assert again.pose is found.pose


def shifted_region(x):
    """A region whose edge, less the margin, is at `x`."""
    edge = x - PARAMS.margin
    return convex_hull(rectangle(2.0, 2.0) + [1.0 + edge, -0.125])


def test_the_foot_follows_the_region_and_is_no_ratchet():
    """Oracle: by hand: 10, 20 and 5 cm ahead, to within the dead-band."""
    current = unadjusted(IN_PLACE)
    for x in 0.1, 0.2, 0.05:
        current = adjust_foothold(
            current, shifted_region(x), GEOMETRY, PARAMS, TICK
        )
        assert current.pose.p_WF[0] == pytest.approx(x)
        assert current.nominal is IN_PLACE.footsteps[0]


@pytest.mark.parametrize(
    ("period", "count"), [(0.001, 50), (0.002, 25), (0.01, 5), (0.05, 1)]
)
def test_the_foot_returns_when_it_could_for_50_ms(period, count):
    """Oracle: the count of the ticks, from the start after a gap."""

    def after_a_tick(current, region):
        return adjust_foothold(current, region, GEOMETRY, PARAMS, period)

    out = after_a_tick(unadjusted(IN_PLACE), shifted_region(0.1))
    covered = shifted_region(-0.01)
    current = out
    for ticks in range(1, count):
        current = after_a_tick(current, covered)
        assert current.pose is out.pose
        assert (current.covered_ticks, current.region) == (ticks, out.region)
    gap = after_a_tick(current, shifted_region(0.1))
    assert (gap.pose, gap.covered_ticks) == (out.pose, 0)
    current = gap
    for _ in range(count - 1):
        current = after_a_tick(current, covered)
    assert current.pose is out.pose
    current = after_a_tick(current, covered)
    assert current == unadjusted(IN_PLACE)
    assert current.pose is NOMINAL


def test_the_foot_returns_at_once_from_a_foothold_that_is_lost():
    """Oracle: a region that covers the nominal foothold, not the present."""
    pose = FootPose([0.5, -0.125, 0.0])
    current = Adjustment(IN_PLACE.footsteps[0], pose, FORWARD)
    region = convex_hull(rectangle(0.4, 0.4) + [0.0, -0.125])
    found = adjust_foothold(current, region, GEOMETRY, PARAMS, TICK)
    assert found.pose is NOMINAL


# Noise.

GAITS = [
    {"length": 0.0},
    {"length": 0.3},
    {"length": 0.5},
    {"length": -0.2},
    {"length": 0.0, "sideways": 0.1},
    {"length": 0.0, "turn": math.radians(15.0)},
    {"length": 0.0, "transfer": 0.2, "swing": 0.6},
]


@pytest.mark.parametrize("gait", GAITS)
def test_a_walk_as_planned_is_left_alone(gait):
    """Oracle: the plan's ICP, 5 mm off to any side, and with noise.

    The noise of the ICP is that of a CoM velocity of 1 mm/s.
    """
    rng = np.random.default_rng(6)

    def plan_of(schedule):
        return plan_icp(schedule, SOLE, IcpPlanParams(), OMEGA)

    swings = 0
    for schedule, plan in phases(walk(**gait), plan_of):
        if schedule.phase is not Phase.SWING:
            continue
        swings += 1
        found = geometry(schedule)
        for angle in np.arange(4) * 0.5 * math.pi:
            off = 0.005 * np.array([math.cos(angle), math.sin(angle)])
            adjustment = None
            for t in np.arange(0.0, schedule.duration, 5 * TICK):
                noise = rng.normal(0.0, 1e-3 / OMEGA, 2)
                icp = plan.at(float(t)).icp + off + noise
                state = state_at(float(t), schedule, adjustment)
                adjustment = propose_adjustment(
                    state, landing(state, icp, found), PARAMS, TICK
                )
                assert adjustment.pose is schedule.footsteps[0].pose
                assert adjustment.region == BASE
    assert swings == 3


@pytest.mark.parametrize("push", PUSHES[1:])
def test_noise_neither_flips_the_region_nor_shakes_the_foothold(push):
    """Oracle: the same swing without noise: as many moves, but for one or two.

    The CoP rests, so that the ICP flows away from it; the noise is that of a
    CoM velocity of 1 mm/s, which the flow until touchdown amplifies.
    """
    rng, cop = np.random.default_rng(8), np.array([0.0, 0.125])
    outcomes = []
    for noise in 0.0, 1e-3 / OMEGA:
        start = np.array([0.0, 0.085]) + push
        adjustment, moves, flips = None, 0, 0
        for t in np.arange(0.3, 0.7, TICK):
            icp = icp_after(start, cop, OMEGA, float(t) - 0.3)
            icp = icp + rng.normal(0.0, noise, 2)
            state = state_at(float(t), adjustment=adjustment)
            found = propose_adjustment(state, landing(state, icp), PARAMS, TICK)
            if adjustment is not None:
                moves += found.pose is not adjustment.pose
                flips += found.region != adjustment.region
            adjustment = found
        outcomes.append((moves, flips, adjustment))
    (moves, flips, calm), (noisy_moves, noisy_flips, noisy) = outcomes
    assert noisy_flips == flips
    assert noisy_moves <= moves + 2
    assert noisy.region == calm.region
    gap = math.dist(noisy.pose.p_WF, calm.pose.p_WF)
    assert gap < 2.0 * PARAMS.dead_band


# To draw.


def test_what_is_drawn_is_what_was_decided():
    """Oracle: the nested regions, the chosen reach, the two footholds."""
    state, icp = state_at(0.3), np.array(OUT)
    adjustment = propose(state, icp)
    drawn = capture_regions(landing(state, icp), adjustment)
    assert len(drawn.regions) == 3
    np.testing.assert_array_equal(drawn.regions[-1], region_at(0.3, icp))
    for inner, outer in zip(drawn.regions, drawn.regions[1:], strict=False):
        assert all(contains(vertex, outer, 1e-12) for vertex in inner)
    assert drawn.reach is GEOMETRY.regions[adjustment.region]
    assert drawn.nominal is NOMINAL
    assert drawn.adjusted is adjustment.pose
    for polygon in (*drawn.regions, drawn.reach):
        assert not polygon.flags.writeable
    assert CaptureRegions().regions == ()


def test_a_region_that_is_gone_is_drawn_as_the_base_region():
    """Oracle: what the regions have; cross-over was just switched off."""
    state = state_at(0.3)
    before = Adjustment(IN_PLACE.footsteps[0], NOMINAL, FORWARD)
    base_only = replace(GEOMETRY, regions={BASE: GEOMETRY.regions[BASE]})
    drawn = capture_regions(landing(state, OUT, base_only), before)
    assert drawn.reach is GEOMETRY.regions[BASE]
