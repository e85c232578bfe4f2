"""Oracles: footholds by hand; shapely's distance to the base region."""

import math
import re
from dataclasses import replace

import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.body.reachability import base_region
from nadia_balance.core.plan.gait import (
    Foothold,
    Gait,
    StepVector,
    make_footsteps,
    middle,
    walking_start,
    within_reach,
)
from nadia_balance.core.walking.state import (
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    Side,
)
from tests.example_walks import FEET, MODEL

REACH = MODEL.reach


def steps_of(**gait):
    """The footsteps of a robot that stands about the origin."""
    return make_footsteps(Gait(**gait), FEET, REACH)


def test_the_middle_is_between_the_feet_also_across_half_a_turn():
    """Oracle: by hand."""
    for left, right, yaw in (0.1, 0.3, 0.2), (3.1, -3.1, math.pi):
        feet = FootPoses(FootPose(yaw=left), FootPose(yaw=right))
        assert middle(feet).yaw == pytest.approx(yaw)


def test_footholds_are_taken_as_given():
    """Oracle: by hand, in the frame between the feet."""
    a = Foothold(side="left", x=0.2, y=0.2)
    b = Foothold(side="right", x=0.3, y=-0.1, yaw_deg=-20)
    steps = steps_of(footholds=[a, b])
    assert steps[0].pose.p_WF == pytest.approx([0.2, 0.2, 0.0])
    assert steps[1].pose.yaw == pytest.approx(math.radians(-20))


def test_the_start_may_be_anywhere():
    """Oracle: a rotated and shifted start gives rotated, shifted steps."""
    frame = FootPose([2.0, -1.0, 0.0], 0.7)

    def moved(pose):
        xy = frame.to_world(pose.p_WF[:2])
        return FootPose([*xy, 0.0], pose.yaw + frame.yaw)

    gait = Gait(num_steps=5, step=StepVector(length=0.2, yaw_deg=10))
    there = FootPoses(moved(FEET.left), moved(FEET.right))
    here, there = (make_footsteps(gait, at, REACH) for at in (FEET, there))
    for a, b in zip(here, there, strict=True):
        assert b.pose.p_WF == pytest.approx(moved(a.pose).p_WF)
        assert b.pose.yaw == pytest.approx(a.pose.yaw + frame.yaw)


@pytest.mark.parametrize(
    ("gait", "message"),
    [
        ({"first_swing": "middle"}, "first_swing = 'middle'"),
        (
            {"footholds": [Foothold(side=s, y=-0.1) for s in ["right"] * 2]},
            "footholds[1].side = 'right'",
        ),
        ({"num_steps": 1, "steps": [StepVector()]}, "num_steps, steps"),
        # Beyond the extents of the base region.
        ({"num_steps": 2, "step": StepVector(length=1.2)}, "step 1 (right)"),
        ({"num_steps": 4, "step": StepVector(sideways=0.2)}, "must be within"),
    ],
)
def test_bad_commands_are_refused(gait, message):
    """Oracle: the message names the field and the value."""
    with pytest.raises(ValueError, match=re.escape(message)):
        steps_of(**gait)


@pytest.mark.parametrize(("step_width", "width"), [(0.3, 0.3), (None, 0.25)])
def test_stands_with_the_feet_side_by_side_about_the_origin(step_width, width):
    """Oracle: the gait's step width, or the robot's; at rest in between."""
    schedule = walking_start(Gait(step_width=step_width), MODEL).schedule
    assert schedule.phase is Phase.STANDING
    assert schedule.duration == math.inf and schedule.footsteps == ()
    for side in Side:
        y = 0.5 * side.sign * width
        assert schedule.feet[side].p_WF == pytest.approx([0.0, y, 0.0])
    for point in schedule.start.com, schedule.start.cop:
        assert point.tolist() == [0.0, 0.0]


def test_waits_and_then_shifts_to_the_foot_that_does_not_swing_first():
    """Oracle: the gait; footholds say themselves which foot swings first."""
    left = Gait(num_steps=2, first_swing="left", final_transfer_duration=0.9)
    hold = Gait(footholds=[Foothold(side="left", y=0.2)])
    for gait in left, hold:
        state = walking_start(replace(gait, standing_duration=0.7), MODEL)
        assert state.schedule.duration == 0.7
        assert state.schedule.footsteps[0].side is Side.LEFT
        assert state.schedule.support_side is Side.RIGHT
    now = walking_start(replace(left, standing_duration=0.0), MODEL).schedule
    assert now.final_transfer_duration == 0.9 and now.duration > 0.0


def step(side, x, y, yaw=0.0):
    return Footstep(side, FootPose([x, y, 0.0], yaw), 0.3, 0.7)


def in_place(count, first=Side.RIGHT):
    """Steps onto the spots where the feet stand."""
    sides = [first, first.other] * count
    return tuple(step(s, 0.0, 0.125 * s.sign) for s in sides[:count])


@given(x=st.floats(-2.0, 2.0), y=st.floats(-2.0, 2.0))
@pytest.mark.parametrize("meant", [(0.0, 0.25), (0.3, 0.35)])
def test_the_way_back_goes_by_a_share_of_the_reach(meant, x, y):
    """Oracle: shapely's distance to the base region, shrunk by shapely."""
    landed = step(Side.LEFT, 0.0, 0.125)
    command = step(Side.RIGHT, meant[0], 0.125 - meant[1])
    feet = FEET.with_foot(Side.LEFT, FootPose([x, y, 0.0]))
    taken, *_ = within_reach((command,), feet, REACH, landed)
    whole = region = shapely.Polygon(base_region(REACH))
    if math.hypot(x, y - 0.125) > 0.05:
        narrow = shapely.affinity.scale(whole, 0.5, 1.0, origin=meant)
        wide = shapely.affinity.scale(whole, 0.5, 0.7, origin=meant)
        both = zip(narrow.exterior.coords, wide.exterior.coords, strict=True)
        corners = [(u, min(v, max(w, meant[1]))) for (u, v), (_, w) in both]
        region = shapely.MultiPoint(corners).convex_hull & whole
    asked, placed = (
        shapely.Point(p[0] - x, y - p[1])  # in the left sole's frame, mirrored
        for p in (command.pose.p_WF, taken.pose.p_WF)
    )
    away = region.distance(asked)
    if placed != asked:
        assert asked.distance(placed) == pytest.approx(away, abs=1e-9)
    else:  # the ellipse reaches beyond the polygon inside of it
        assert away < 0.08


def test_a_step_as_it_was_meant_may_take_all_of_the_reach():
    """Oracle: identity, though it is longer than a way back would be."""
    landed = step(Side.LEFT, 0.0, 0.125)
    command = step(Side.RIGHT, 0.9, -0.125)
    (taken,) = within_reach((command,), FEET, REACH, landed)
    assert taken is command
    off = FootPose([-0.06, 0.125, 0.0])
    displaced = FEET.with_foot(Side.LEFT, off)
    (taken,) = within_reach((command,), displaced, REACH, landed)
    assert taken.pose.p_WF[0] == pytest.approx(0.95 - 0.06, abs=0.01)
