"""What a live session tells of made-up walks and falls."""

import math

import numpy as np
import pytest

from nadia_balance.core.steps.foothold_adjustment import CaptureRegions
from nadia_balance.core.walking.state import FootPose
from nadia_balance.results.live_watches import (
    REMEMBERED,
    FallWatch,
    VelocityWatch,
    clipped_words,
    velocity_lines,
)

TICK = 0.02
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
LANDED = CaptureRegions()  # outside of a swing


def swing(captures_from: float, foot_at: float) -> CaptureRegions:
    """C_N is [captures_from, ... + 1] along x, the reach [0, 1].

    The foothold is at `foot_at` [m].
    """
    return CaptureRegions(
        regions=(SQUARE + [9.0, 0.0], SQUARE + [captures_from, 0.0]),
        reach=SQUARE.copy(),
        nominal=FootPose([0.0, 0.5, 0.0]),
        adjusted=FootPose([foot_at, 0.5, 0.0]),
    )


def reason_after(looks) -> str:
    """The reason after these looks, a TICK apart."""
    watch = FallWatch()
    for i, look in enumerate(looks):
        watch.update(i * TICK, *look)
    return watch.reason()


def test_a_foothold_that_captures_is_no_reason():
    """Oracle: the foothold is inside; what is left is the largest ICP error."""
    looks = [(swing(0.3, 0.5), 0.04), (LANDED, 0.31), (None, 0.2)]
    assert reason_after(looks) == "ICP error 0.31 m"
    assert FallWatch().reason() == ""
    assert reason_after([(None, None)]) == ""  # a policy has no ICP


def test_says_by_how_much_the_foot_that_landed_has_missed():
    """Oracle: by hand, along x: C_N begins 0.21 m beyond the foothold.

    A later step, and what a foot in the air misses then, come too late.
    """
    looks = [(swing(0.6, 0.5), 0.1), (swing(0.71, 0.5), 0.1), (LANDED, 0.2)]
    reason = "foothold outside the capture region by 0.21 m"
    later = (swing(0.9, 0.1), 0.3)
    assert reason_after(looks) == reason
    assert reason_after([*looks, later, (LANDED, 0.3)]) == reason
    assert reason_after([*looks, later]) == reason


def test_says_that_no_foothold_in_reach_captures():
    """Oracle: by hand: the reach ends at 1 m, C_N begins at 1.3 m."""
    reason = reason_after([(swing(1.3, 1.0), 0.4)])
    assert reason == "capture region out of reach by 0.30 m"


def test_names_the_joint_that_was_too_fast_and_what_came_first():
    """Oracle: by hand; at its limit, a joint is not too fast."""
    slow, fast = (None, 0.1, "knee", 1.0), (None, 0.1, "left_knee", 1.13)
    assert reason_after([slow]) == "ICP error 0.10 m"
    knee = "left_knee at 113 % of its speed"
    assert reason_after([slow, fast, (None, 0.1, "hip", 1.02)]) == knee
    missed = (swing(0.71, 0.5), 0.1)
    foothold = "foothold outside the capture region by 0.21 m"
    assert reason_after([fast, missed]) == f"{knee}, {foothold}"
    assert reason_after([missed, fast]) == f"{foothold}, {knee}"


def test_forgets_what_was_more_than_a_second_ago():
    """Oracle: the clock: a step that missed, from which it recovered."""
    looks = [(swing(0.71, 0.5), 0.1), *[(LANDED, 0.02)] * 49]
    assert reason_after(looks).startswith("foothold outside")
    looks += [(LANDED, 0.02)] * round(REMEMBERED / TICK)
    assert reason_after(looks) == "ICP error 0.02 m"


def test_the_velocity_is_that_of_a_circle_seen_from_the_robot():
    """Oracle: a circle by 0.3 m/s and 0.4 rad/s to the left.

    The chord of the arc in the window is shorter, by sin(a) / a.  The heading
    passes half a turn.
    """
    watch, speed, turn, window = VelocityWatch(1.6), 0.3, 0.4, 1.6
    for time in np.arange(0.0, 12.0, TICK):
        angle = turn * time
        across = 1.0 - math.cos(angle)
        place = speed / turn * np.array([math.sin(angle), across])
        velocity = watch.update(time, place, math.remainder(angle, math.tau))
    half = 0.5 * turn * window
    chord = speed * math.sin(half) / half
    assert velocity == pytest.approx([chord, 0.0, turn], abs=1e-9)


def test_the_sway_of_two_steps_does_not_count():
    """Oracle: a sine whose period is the window, sideways."""
    watch = VelocityWatch(1.6)
    for time in np.arange(0.0, 4.0, TICK):
        sway = 0.05 * math.sin(2.0 * math.pi * time / 1.6)
        velocity = watch.update(time, np.array([0.3 * time, sway]), 0.0)
    assert velocity == pytest.approx([0.3, 0.0, 0.0], abs=1e-9)
    assert not VelocityWatch(1.6).update(0.0, np.zeros(2), 0.0).any()


def test_tells_forward_always_and_what_else_is_commanded():
    """Oracle: the words of the page."""
    walked = np.array([0.29, 0.1, 0.0])
    (line,) = velocity_lines(np.array([0.3, 0.0, 0.0]), walked)
    assert line == "commanded 0.30, walks 0.29 m/s"
    walked = np.array([-0.001, -0.08, 0.2])
    assert velocity_lines(np.array([0.0, -0.1, 0.2]), walked) == [
        "commanded 0.00, walks 0.00 m/s",
        "left: commanded -0.10, walks -0.08 m/s",
        "turn: commanded 0.20, walks 0.20 rad/s",
    ]


def test_says_what_is_taken_of_a_command_that_is_too_fast():
    """Oracle: by hand; nothing of one within the limits, or at them."""
    limits = np.array([[-0.5, -0.3, -0.8], [0.85, 0.3, 0.8]])
    words = "more than it can walk: "
    for command, said in (
        ((0.85, 0.0, 0.0), ""),
        ((-0.3, 0.18, 0.4), ""),  # 0.6, 0.6 and 0.5 of them
        ((0.9, 0.0, 0.0), f"{words}0.85 of 0.90 m/s forward is taken"),
        (
            (-0.6, 0.0, 1.28),  # 1.2 and 1.6: twice of what it can
            f"{words}-0.30 of -0.60 m/s forward, 0.64 of 1.28 rad/s turn is "
            "taken",
        ),
    ):
        assert clipped_words(np.array(command), limits) == said
