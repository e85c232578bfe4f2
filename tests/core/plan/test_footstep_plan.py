"""Oracles: shapely for regions; arithmetic and mirror images for steps."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from nadia_balance.core.body.ground import Ground, Region
from nadia_balance.core.body.reachability import base_region, step_regions
from nadia_balance.core.math.arrays import rectangle
from nadia_balance.core.plan.footstep_plan import (
    FootstepPlan,
    FootstepPlannerParams,
    pace,
    room_inside,
    velocity_limits,
    within_limits,
)
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.core.walking.state import (
    Adjustment,
    FootPose,
    Side,
    WalkingState,
)
from tests import example_walks as walks
from tests.example_walks import ALL, FEET, MODEL, OMEGA, SOLE

PARAMS = FootstepPlannerParams()
ADJUSTER = CaptureRegionStepAdjusterParams()
PLAN = FootstepPlan(PARAMS, MODEL, ADJUSTER)
STILL = np.zeros(3)
LIMITS = velocity_limits(PARAMS, MODEL)
EDGE = 0.5 * 0.25 + 0.5 * 0.12  # of the outer edge of a sole, standing [m]


def asked(icp=(0.0, 0.0), command=STILL, velocity=None, **changes):
    """The footsteps of a robot that stands, or swings as `schedule` says."""
    schedule = changes.pop("schedule", walks.standing())
    feet = changes.pop("feet", schedule.feet)
    values = {"reference": np.zeros(2), "on": ALL, "feet": feet} | changes
    return changes.pop("plan", PLAN).footsteps(
        WalkingState(schedule),
        np.array(command if velocity is None else velocity, dtype=float),
        np.array(command, dtype=float),
        np.array(icp, dtype=float),
        values["reference"],
        values["feet"],
        values["on"],
    )


@pytest.mark.parametrize(
    ("icp", "steps"),
    [
        ((0.139, 0.0), False),
        ((0.141, 0.0), True),
        ((0.0, EDGE + 14e-3), False),
        ((0.0, EDGE + 16e-3), True),
        ((-0.145, -0.1), True),
    ],
)
def test_steps_as_soon_as_the_icp_leaves_the_soles_and_not_before(icp, steps):
    """Oracle: 15 mm beyond soles of 0.25 m x 0.12 m, 0.25 m apart, by hand.

    Without the mechanism, it does not step at all.
    """
    assert bool(asked(icp)) is steps
    assert asked(icp, on=MECHANISMS["icp_only"]) == ()


def captured(icp: np.ndarray, side: Side) -> int:
    """The fewest steps, the first of `side`, whose C_n meets the reach."""
    stance = FEET[side.other]
    mirror = np.array([1.0, side.sign])
    usable = ADJUSTER.usable_foot(SOLE) * mirror + stance.p_WF[:2]
    soonest = PARAMS.recovery_transfer_duration + PLAN.min_swing_duration
    corners = []
    for time in soonest, soonest + ADJUSTER.waiting_time:
        growth = math.exp(OMEGA * time)
        corners += [q + growth * (icp - q) for q in usable]
    region = shapely.MultiPoint(corners).convex_hull
    reach = shapely.MultiPoint(
        np.vstack(list(step_regions(MODEL.reach, True).values()))
    ).convex_hull
    places = [
        shapely.Polygon(polygon * mirror + stance.p_WF[:2])
        for polygon in step_regions(MODEL.reach, True).values()
    ]
    duration = (
        PARAMS.recovery_transfer_duration + PARAMS.recovery_swing_duration
    )
    shrink = math.exp(-OMEGA * duration)
    for count in range(1, ADJUSTER.num_steps + 1):
        offsets = shapely.Point(0.0, 0.0)
        for step in range(count - 1, 0, -1):
            foot = side if step % 2 == 0 else side.other
            reached = np.array(reach.exterior.coords) * [1.0, foot.sign]
            inner = np.array(shapely.get_coordinates(offsets))
            sums = (reached[:, None] + inner[None]).reshape(-1, 2) * shrink
            points = np.vstack([sums, [[0.0, 0.0]]])
            offsets = shapely.MultiPoint(points).convex_hull
        inner = shapely.get_coordinates(offsets)
        outer = shapely.get_coordinates(region)
        whole = shapely.MultiPoint(
            (outer[:, None] - inner[None]).reshape(-1, 2)
        ).convex_hull
        if any(place.intersection(whole).area > 1e-6 for place in places):
            return count
    return ADJUSTER.num_steps + 1


@pytest.mark.parametrize("angle", np.radians([0, 40, 75, 150, 200, 245, 320]))
@pytest.mark.parametrize("distance", [0.24, 0.3])
def test_no_fewer_steps_capture_the_icp_than_are_queued(angle, distance):
    """Oracle: C_n by shapely, at the earliest touchdown.

    A foot that is later, since its way is long, can need more, not fewer.
    """
    icp = distance * np.array([math.cos(angle), math.sin(angle)])
    steps = asked(icp)
    fewest = min(captured(icp, side) for side in Side)
    assert min(fewest, ADJUSTER.num_steps) <= len(steps)
    assert all(step.reactive for step in steps)
    assert steps[0].swing_duration == PARAMS.recovery_swing_duration
    sides = [step.side for step in steps]
    assert all(a is b.other for a, b in zip(sides, sides[1:], strict=False))
    fewest_steps = captured(icp, steps[0].side)
    assert fewest_steps <= len(steps) + 1


@pytest.mark.parametrize("sign", [1, -1])
def test_a_wide_stepper_steps_outward_a_narrow_one_across(sign):
    """Oracle: by hand: a foot can go 0.8 m out, or 0.4 m.

    From 0.4 m, the outer foot could not be beyond the ICP in time.
    """
    outer = Side.LEFT if sign > 0 else Side.RIGHT
    icp = 0.24 * sign
    assert asked((0.0, icp))[0].side is outer
    narrow = replace(MODEL.reach, width_max=0.4)
    plan = FootstepPlan(PARAMS, replace(MODEL, reach=narrow), ADJUSTER)
    assert asked((0.0, icp), plan=plan)[0].side is outer.other


@settings(max_examples=20)
@given(
    x=st.floats(-0.3, 0.3),
    y=st.floats(-0.3, 0.3),
    command=st.tuples(*(st.floats(-0.5, 0.5),) * 3),
    turn=st.floats(-3.0, 3.0),
)
def test_mirrored_and_turned_it_does_the_same(x, y, command, turn):
    """Oracle: the same walk, mirrored and turned, step by step."""
    command, icp = np.array(command), np.array([x, y])
    here = walks.standing()
    steps = asked(icp, command, schedule=here)
    mirror = walks.mirrored(here)
    flip = np.array([1.0, -1.0])
    there = asked(icp * flip, command * [1.0, -1.0, -1.0], schedule=mirror)
    assert len(steps) == len(there)
    if not abs(y) < 1e-3:  # else either foot may be the better one
        for one, two in zip(steps, there, strict=True):
            assert one.side is two.side.other
            expected = one.pose.p_WF[:2] * flip
            assert two.pose.p_WF[:2] == pytest.approx(expected, abs=1e-9)
            assert two.pose.yaw == pytest.approx(-one.pose.yaw, abs=1e-9)
    shift = np.array([0.7, -0.2])
    turned = walks.moved(here, turn, shift)
    c, s = math.cos(turn), math.sin(turn)
    R = np.array([[c, -s], [s, c]])
    away = asked(
        R @ icp + shift, command, schedule=turned, reference=R @ STILL[:2]
    )
    assert [step.side for step in away] == [step.side for step in steps]
    for one, two in zip(steps, away, strict=True):
        expected = R @ one.pose.p_WF[:2] + shift
        assert two.pose.p_WF[:2] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    "command",
    [
        (0.3, 0.0, 0.0),
        (-0.25, 0.0, 0.0),
        (0.0, 0.12, 0.0),
        (0.0, -0.02, 0.0),
        (0.2, 0.1, 0.0),
    ],
)
def test_two_steps_take_the_robot_as_far_as_it_was_told(command):
    """Oracle: the way 2 v T of two steps; the widths of the feet by hand."""
    steps = asked(command=command)
    T = PARAMS.swing_duration + PARAMS.transfer_duration
    forward, left, _ = np.array(command) * T
    room = room_inside(MODEL)
    poses = [step.pose.p_WF for step in steps]
    assert len(steps) == PARAMS.num_steps
    for k in (1, 3):
        expected = 0.5 * (poses[k] + poses[k - 1])
        assert expected[0] == pytest.approx((k + 0.5) * forward)
    for k in (2, 3):
        displacement = poses[k] - poses[k - 2]
        assert displacement[:2] == pytest.approx([2.0 * forward, 2.0 * left])
    widths = [abs(a[1] - b[1]) for a, b in zip(poses, poses[1:], strict=False)]
    narrow = 0.25 - min(abs(left), room)
    assert min(widths) == pytest.approx(narrow)
    wide = 0.25 + 2.0 * abs(left) - min(abs(left), room)
    assert max(widths) == pytest.approx(wide)


def test_turning_steps_turn_the_frame_between_the_feet():
    """Oracle: v T of yaw a step, about the same point."""
    steps = asked(command=(0.0, 0.0, 0.6))
    T = PARAMS.swing_duration + PARAMS.transfer_duration
    yaws = [step.pose.yaw for step in steps]
    assert yaws == pytest.approx([0.6 * T * k for k in (1, 2, 3, 4)])
    for step in steps:
        assert math.hypot(*step.pose.p_WF[:2]) == pytest.approx(0.125)
    assert steps[0].side is Side.LEFT  # that leads


@given(share=st.tuples(*(st.floats(-1.0, 1.0),) * 3))
def test_steps_are_within_reach_and_in_time(share):
    """Oracle: shapely's distance to the base region; the least time of way."""
    lower, upper = LIMITS
    command = 0.5 * (lower + upper) + 0.5 * np.array(share) * (upper - lower)
    stance = FEET
    base = shapely.Polygon(base_region(MODEL.reach)).buffer(1e-6)
    for step in asked(command=command):
        foot = stance[step.side.other]
        p_F = foot.to_sole(step.pose.p_WF[:2]) * [1.0, step.side.sign]
        assert base.contains(shapely.Point(p_F)) or MODEL.reach.in_base_region(
            *p_F
        )
        stance = stance.with_foot(step.side, step.pose)


def test_limits_are_those_of_reach_foot_speed_and_step_time():
    """Oracle: by hand, of a foot of at most 2 m/s."""
    detour = replace(MODEL.detour, max_speed=2.0, max_acceleration=100.0)
    slow = replace(MODEL, detour=detour)
    lower, upper = velocity_limits(PARAMS, slow)
    # Steps of 0.45 x 0.8 s: 0.9 of 0.27 s at 2 m/s, half of this way is ahead.
    assert upper[0] == pytest.approx(0.243 / 0.36)
    assert lower[0] == pytest.approx(-0.243 / 0.36)
    # Half of the width from 0.25 to 0.8 m, and the room.
    aside = 0.5 * (0.5 * 0.55 + 0.0625)
    assert upper[1] == pytest.approx(aside / 0.36)
    assert upper[2] == pytest.approx(math.radians(30.0) / 0.36)
    assert pace(PARAMS, slow, np.array([0.3, 0.0, 0.0])) == 1.0
    quick = pace(PARAMS, slow, np.array([0.0, 0.4, 0.0]))
    assert quick == pytest.approx((aside / 0.8) / 0.4)
    # Shares of 1.2 and 1.6 of two limits of long steps are 2 at once.
    both = np.array([0.0, 1.2 * aside, 1.6 * math.radians(30.0)]) / 0.8
    assert pace(PARAMS, slow, both) == pytest.approx(0.5)


@pytest.mark.parametrize("times", [0.9, 1.0, 5.0])
def test_two_speeds_at_once_share_the_way_that_a_foot_can_go(times):
    """Oracle: Pythagoras: of 0.6 and 0.8 of two limits all is taken."""
    both = np.array([0.6 * LIMITS[1, 0], 0.0, 0.8 * LIMITS[0, 2]])
    assert within_limits(times * both, LIMITS) == pytest.approx(
        min(times, 1.0) * both
    )


def test_the_speed_changes_by_the_acceleration_in_each_step():
    """Oracle: a T of speed a step, each with that at its own landing."""
    params = replace(PARAMS, acceleration=0.25)
    plan = FootstepPlan(params, MODEL, ADJUSTER)
    steps = asked(command=(0.5, 0.0, 0.0), velocity=STILL, plan=plan)
    lengths = np.diff([0.0, *(step.pose.p_WF[0] for step in steps)])
    T = PARAMS.swing_duration + PARAMS.transfer_duration
    assert lengths == pytest.approx([0.2 * T, 0.4 * T, 0.5 * T, 0.5 * T])


def test_a_walk_that_is_to_stop_closes_its_feet():
    """Oracle: by hand: the next foot beside the one that landed ahead.

    After a step that caught the robot, the weight shifts as from standing.
    """
    schedule = walks.swing(length=0.3)
    landed = schedule.footsteps[0].pose
    feet = schedule.feet.with_foot(Side.RIGHT, landed)
    reference = np.array([0.2, 0.0])
    (step,) = asked(
        reference,
        schedule=schedule,
        feet=feet,
        velocity=(0.3, 0.0, 0.0),
        reference=reference,
    )
    assert step.side is Side.LEFT and not step.reactive
    expected = landed.p_WF + [0.0, 0.25, 0.0]
    assert step.pose.p_WF == pytest.approx(expected)
    assert step.transfer_duration == 0.75 * PARAMS.transfer_duration
    caught = replace(schedule.footsteps[0], reactive=True)
    after = replace(schedule, footsteps=(caught,))
    (slow,) = asked(reference, schedule=after, feet=feet, reference=reference)
    assert slow.transfer_duration == PARAMS.initial_transfer_duration
    quick = asked(
        reference,
        command=(0.3, 0.0, 0.0),
        schedule=after,
        feet=feet,
        reference=reference,
    )
    assert quick[0].transfer_duration < 0.6 and len(quick) == PARAMS.num_steps
    feet = feet.with_foot(Side.LEFT, step.pose)
    assert (
        asked(reference, schedule=schedule, feet=feet, reference=reference)
        == ()
    )


def test_stands_where_it_landed_if_the_feet_hold_it():
    """Oracle: by hand: the ICP between feet 0.5 m apart needs no quick step.

    The foot that is farther from it comes after.
    """
    schedule = walks.swing(length=0.0)
    ahead = FootPose([0.5, -0.125, 0.0])
    feet = schedule.feet.with_foot(Side.RIGHT, ahead)
    (step,) = asked((0.4, 0.0), schedule=schedule, feet=feet)
    assert step.side is Side.LEFT
    assert step.transfer_duration == PARAMS.initial_transfer_duration
    assert step.pose.p_WF == pytest.approx([0.5, 0.125, 0.0])
    (soon,) = asked((0.5, -0.1), schedule=schedule, feet=feet)
    early, late = PARAMS.transfer_duration, PARAMS.initial_transfer_duration
    expected = early + 0.025 / 0.125 * (late - early)  # 25 mm from its centre
    assert soon.transfer_duration == pytest.approx(expected)
    (back,) = asked((0.1, 0.0), schedule=schedule, feet=feet)
    assert back.side is Side.RIGHT


def test_a_push_has_priority_over_the_command():
    """Oracle: by hand; a smaller error than 8 cm is the walk's own."""
    schedule = walks.swing(length=0.0)
    for error, reactive in ((0.07, False), (0.3, True)):
        steps = asked((error, 0.0), schedule=schedule, command=(0.3, 0.0, 0.0))
        assert steps[0].reactive is reactive


@pytest.mark.parametrize("turn", [0.0, 2.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_foot_that_carries_the_robot_after_a_push_is_not_lifted(sign, turn):
    """Oracle: by hand, as above: a foot that goes 0.4 m out comes too late."""
    schedule = walks.moved(walks.walk(length=0.0), turn, np.array([0.4, 1.0]))
    schedule = schedule if sign > 0 else walks.mirrored(schedule)
    stays = schedule.support_side
    state = WalkingState(schedule, 0.1, 0.1)

    def other(aside, reach=0.4, on=ALL, state=state):
        """The feet are 0.25 m apart, the ICP is to be between them."""
        icp, reference = (
            schedule.feet[stays].to_world(np.array([0.0, -stays.sign * y]))
            for y in (aside, 0.125)
        )
        reach = replace(MODEL.reach, width_max=reach)
        plan = FootstepPlan(PARAMS, replace(MODEL, reach=reach), ADJUSTER)
        return plan.other_foot(state, icp, reference, schedule.feet, on)

    first, *_ = other(0.365)
    assert (first.side, first.reactive) == (stays, True)
    assert other(0.365, reach=0.8) is None  # it comes in time
    assert other(0.19) is None  # in the walk's own error
    assert other(-0.115) is None  # at the foot that stays
    assert other(0.365, on=replace(ALL, step=False)) is None
    steps = replace(schedule.footsteps[0], reactive=True)
    reactive = replace(state, schedule=replace(schedule, footsteps=(steps,)))
    assert other(0.365, state=reactive) is None


def swinging(time, **changes):
    """A walk at 0.3 m/s, so long in its first swing [s]."""
    state = WalkingState(walks.swing(length=0.21), time, time)
    return replace(state, **changes)


def test_a_foot_in_the_air_follows_a_new_command_until_it_is_too_late():
    """Oracle: by hand: beside its stance foot; 0.4 of 0.7 s."""
    speed = np.array([0.3, 0.0, 0.0])
    (step,) = PLAN.revised(swinging(0.2), speed, STILL)
    assert step.pose.p_WF == pytest.approx([0.0, -0.125, 0.0])
    assert PLAN.revised(swinging(0.29), speed, STILL) is None
    adjusted = Adjustment(
        swinging(0.2).schedule.footsteps[0], FootPose([0.4, -0.2, 0.0])
    )
    pushed = swinging(0.2, adjustment=adjusted)
    assert PLAN.revised(pushed, speed, STILL) is None
    steps = PLAN.revised(swinging(0.2), speed, -speed)
    assert steps[0].pose.p_WF[0] < 0.0 and len(steps) == PARAMS.num_steps


def test_a_transfer_is_given_up_if_the_feet_are_square():
    """Oracle: by hand; None if nothing has changed by 1 cm."""
    schedule = walks.walk(length=0.3)
    state = WalkingState(schedule, 0.1, 0.1)
    speed = np.array([0.2, 0.0, 0.0])
    assert PLAN.revised(state, speed, STILL) == ()
    steps = PLAN.queue(Side.RIGHT, FEET.left, speed, speed)
    same = replace(state, schedule=replace(schedule, footsteps=steps))
    assert PLAN.revised(same, 0.99 * speed, speed) is None


def stone(name, x, y):
    """A region of 0.34 m x 0.24 m."""
    corners = [x, y] + rectangle(0.34, 0.24)
    return Region(name=name, vertices=corners.tolist())


def test_steps_only_where_there_is_ground():
    """Oracle: by hand: two stones, the feet on them, and one 0.3 m ahead."""
    stones = stone("left", 0.0, 0.125), stone("right", 0.0, -0.125)
    ground = Ground((*stones, stone("ahead", 0.35, -0.125)), SOLE)
    plan = FootstepPlan(PARAMS, replace(MODEL, ground=ground), ADJUSTER)
    steps = asked(command=(0.3, 0.0, 0.0), plan=plan)
    for step in steps:
        assert ground.allows(step.pose)
    assert steps[0].side is Side.RIGHT
    assert 0.3 < steps[0].pose.p_WF[0] < 0.4  # it was told 0.24 m


def test_without_ground_it_does_not_step():
    """Oracle: by hand: the sole of the other foot has no stone to land on."""
    ground = Ground((stone("left", 0.0, 0.125),), SOLE)
    plan = FootstepPlan(PARAMS, replace(MODEL, ground=ground), ADJUSTER)
    assert plan.catching_steps(Side.RIGHT, FEET.left) == ()
    assert asked(command=(0.3, 0.0, 0.0), plan=plan) == ()


@pytest.mark.parametrize("yaw", [0.0, 2.0])
@pytest.mark.parametrize("duration", [0.25, 0.4, 0.55])
def test_the_weight_shifts_as_fast_as_the_icp_comes(duration, yaw):
    """Oracle: the pendulum, integrated, under a CoP that moves evenly.

    The ICP ends at the foot; the times of a walk are the least and the most.
    """
    turned = FEET.left.displaced(0.1, 0.0, yaw)
    feet = FEET.with_foot(Side.LEFT, turned)
    start, end = feet.right.p_WF[:2], feet.left.p_WF[:2]
    icp, n = end.copy(), 20000
    for i in reversed(range(n)):  # from its end to its beginning
        cop = start + (i + 0.5) / n * (end - start)
        icp = cop + (icp - cop) * math.exp(-OMEGA * duration / n)
    found = PLAN.shift(icp, Side.RIGHT, feet)
    assert found == pytest.approx(duration, abs=2e-4)
    aside = icp + 0.03 * np.array([start[1] - end[1], end[0] - start[0]])
    assert PLAN.shift(aside, Side.RIGHT, feet) == pytest.approx(found)
    assert PLAN.shift(start, Side.RIGHT, feet) == pytest.approx(0.6, abs=2e-4)
    assert PLAN.shift(end, Side.RIGHT, feet) == pytest.approx(0.2, abs=2e-4)
