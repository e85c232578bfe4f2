"""Oracles: hand-computed footholds; the reach as an ellipse."""

import math
import re

import numpy as np
import pytest

from nadia_balance.core.gait import Foothold, Gait, StepVector, make_footsteps
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import FootPose, FootPoses, Side

FEET = FootPoses(FootPose([0.0, 0.125, 0.0]), FootPose([0.0, -0.125, 0.0]))
REACH = ReachabilityParams()


def steps_of(**gait):
    """The footsteps of a robot that stands about the origin."""
    return make_footsteps(Gait(**gait), FEET, REACH)


def test_stepping_in_place_returns_to_the_same_footholds():
    """Oracle: the feet's own poses."""
    steps = steps_of(num_steps=4)
    assert [s.side for s in steps] == [Side.RIGHT, Side.LEFT] * 2
    for step in steps:
        assert step.pose.p_WF == pytest.approx(FEET[step.side].p_WF)


@pytest.mark.parametrize(("told", "width"), [(0.3, 0.3), (None, 0.25)])
def test_the_feet_land_as_far_apart_as_told_else_as_they_stood(told, width):
    """Oracle: by hand."""
    for step in steps_of(num_steps=2, step_width=told):
        y = 0.5 * step.side.sign * width
        assert step.pose.p_WF == pytest.approx([0.0, y, 0.0])


def test_every_forward_step_lands_one_length_ahead():
    """Oracle: by hand; the last step closes up."""
    steps = steps_of(num_steps=3, step=StepVector(length=0.3))
    x = [s.pose.p_WF[0] for s in steps]
    assert x == pytest.approx([0.3, 0.6, 0.9, 0.9])


def test_the_first_transfer_takes_its_own_time():
    """Oracle: the parameters."""
    steps = steps_of(num_steps=2, initial_transfer_duration=1.1)
    assert [s.transfer_duration for s in steps] == [1.1, 0.3]


def test_turning_six_times_15_degrees_is_a_right_angle():
    """Oracle: by hand."""
    gait = {"num_steps": 6, "step": StepVector(yaw_deg=15.0)}
    last = steps_of(**gait, first_swing="left")[5]
    assert last.pose.yaw == pytest.approx(math.pi / 2)
    assert last.pose.p_WF == pytest.approx([0.125, 0.0, 0.0], abs=1e-12)


def test_footholds_are_taken_as_given():
    """Oracle: by hand, in the frame between the feet."""
    a, b = (
        Foothold(side="left", x=0.2, y=0.2),
        Foothold(side="right", x=0.3, y=-0.1, yaw_deg=-20),
    )
    steps = steps_of(footholds=[a, b])
    assert steps[0].pose.p_WF == pytest.approx([0.2, 0.2, 0.0])
    assert steps[1].pose.yaw == pytest.approx(math.radians(-20))


def test_the_start_may_be_anywhere():
    """Oracle: a rotated and shifted start gives rotated, shifted steps."""
    turn, shift = 0.7, np.array([2.0, -1.0, 0.0])
    frame = FootPose(shift, turn)

    def moved(pose):
        xy = frame.to_world(pose.p_WF[None, :2])[0]
        return FootPose([*xy, 0.0], pose.yaw + turn)

    gait = Gait(num_steps=5, step=StepVector(length=0.2, yaw_deg=10))
    there = FootPoses(moved(FEET.left), moved(FEET.right))
    for a, b in zip(
        make_footsteps(gait, FEET, REACH),
        make_footsteps(gait, there, REACH),
        strict=True,
    ):
        assert b.pose.p_WF == pytest.approx(moved(a.pose).p_WF)
        assert b.pose.yaw == pytest.approx(a.pose.yaw + turn)


@pytest.mark.parametrize(
    "gait",
    [
        {"num_steps": 2, "step": StepVector(length=1.2)},
        {"num_steps": 4, "step": StepVector(sideways=0.2)},
        {"footholds": [Foothold(side="left", x=0.0, y=0.9)]},
        {"footholds": [Foothold(side="left", x=0.0, y=-0.05)]},
    ],
)
def test_a_step_out_of_reach_is_refused(gait):
    """Oracle: the base region's extents."""
    with pytest.raises(ValueError, match=r"step \d .* must be within"):
        steps_of(**gait)


@pytest.mark.parametrize(
    ("gait", "message"),
    [
        ({"num_steps": -1}, "num_steps = -1"),
        ({"swing_duration": -0.7}, "swing_duration = -0.7"),
        ({"transfer_duration": math.nan}, "transfer_duration = nan"),
        ({"step_width": 0.0}, "step_width = 0.0"),
        ({"first_swing": "middle"}, "first_swing = 'middle': must be left or"),
        (
            {"footholds": [Foothold(side="both")]},
            "footholds[0].side = 'both': must be left or right",
        ),
        (
            {"footholds": [Foothold(side=s, y=-0.1) for s in ["right"] * 2]},
            "footholds[1].side = 'right': must be left, as the feet take turns",
        ),
        ({"num_steps": 1, "steps": [StepVector()]}, "only one of"),
        (
            {"num_steps": 1, "step": StepVector(length=math.nan)},
            "step.length = nan: must be finite",
        ),
        (
            {"steps": [StepVector(), StepVector(yaw_deg=math.inf)]},
            "steps[1].yaw_deg = inf: must be finite",
        ),
        (
            {"footholds": [Foothold(x=-math.inf)]},
            "footholds[0].x = -inf: must be finite",
        ),
    ],
)
def test_bad_commands_are_refused(gait, message):
    """Oracle: the message names the field and the value."""
    with pytest.raises(ValueError, match=re.escape(message)):
        steps_of(**gait)
