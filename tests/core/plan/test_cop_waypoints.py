"""Oracles: the offsets of the CoP points by hand, shapely, and symmetry."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.plan.cop_waypoints import (
    CopPointParams,
    CopPoints,
    IcpPlanParams,
    cop_waypoints,
)
from nadia_balance.core.walking.state import FootPose, Phase, Side
from tests.example_walks import SOLE, at_rest, standing, walk

POINTS = CopPoints(IcpPlanParams(), SOLE)
EXIT = CopPointParams(
    offset_inside=0.025, step_length_factor=1.0 / 3.0, max_x=0.08
)


def test_leans_to_the_other_foot_and_forward_with_the_step():
    """Oracle: a third of the step, clamped to [0, 0.08] m, by hand."""
    for length, x in (-0.3, 0.0), (0.0, 0.0), (0.15, 0.05), (0.3, 0.08):
        for side, y in (Side.LEFT, -0.025), (Side.RIGHT, 0.025):
            point = POINTS.cop_point(EXIT, side, length)
            np.testing.assert_allclose(point, [x, y], atol=1e-15)


@given(*[st.floats(-3, 3)] * 6)
def test_measures_the_step_from_toe_to_toe(x0, y0, yaw0, x1, y1, yaw1):
    """Oracle: all corners of the other sole, taken into the sole frame."""
    foot, other = FootPose([x0, y0, 0], yaw0), FootPose([x1, y1, 0], yaw1)
    toes = foot.to_sole(other.to_world(POINTS.corners))[:, 0]
    expected = max(toes) - 0.125
    assert POINTS.step_length(foot, other) == pytest.approx(expected, abs=1e-13)


def test_refuses_a_margin_that_leaves_nothing():
    """Oracle: half the width of the sole."""
    with pytest.raises(ValueError, match=r"^margin = 0\.06: must"):
        CopPoints(IcpPlanParams(margin=0.06), SOLE)


PARAMS = IcpPlanParams()


def test_the_first_step_of_a_walk_of_30_cm():
    """Oracle: the offsets of IcpPlanParams, by hand.

    The left foot takes over level with the right one: entry without step
    length; the right foot then goes 0.3 m ahead: ball at 0.3 / 8 m, exit at
    the end of its range.  In mid-transfer: half-way from exit to entry.
    """
    path = cop_waypoints(walk(0.3, num_steps=1), CopPoints(PARAMS, SOLE))
    entry_and_ball = [0.0, 0.13], [0.0375, 0.115]
    left_exit, middle = [0.08, 0.1], [0.15, 0.0]
    expected = [[0.0, 0.0], [0.0, 0.015], *entry_and_ball]
    expected += [left_exit] * 2 + [middle] * 3
    np.testing.assert_allclose(path.points, expected, atol=1e-15)
    swing = [0.5 * 0.85 * 0.7, 0.5 * 0.85 * 0.7, 0.15 * 0.7]
    expected = [0.15, 0.15, *swing, 0.4, 0.4, 10.0]
    np.testing.assert_allclose(path.durations, expected, atol=1e-15)


def test_a_foot_that_lands_in_front_is_entered_at_its_front():
    """Oracle: by hand; the trailing foot is 0.3 m behind."""
    path = cop_waypoints(walk(0.3, num_steps=2), CopPoints(PARAMS, SOLE))
    entry, exit_ = np.array([0.3 - 0.04, -0.13]), np.array([0.08, 0.1])
    np.testing.assert_allclose(path.points[6], 0.5 * (entry + exit_))
    np.testing.assert_allclose(path.points[7], entry)


def test_standing_goes_to_the_middle_and_rests_whatever_steps_come():
    """Oracle: half the final transfer to go, half to settle, then rest."""
    now = standing(start=at_rest([0.1, 0.1]))
    for schedule in now, replace(now, footsteps=walk().footsteps):
        path = cop_waypoints(schedule, CopPoints(PARAMS, SOLE))
        expected = [[0.1, 0.1], [0, 0], [0, 0], [0, 0]]
        np.testing.assert_array_equal(path.points, expected)
        np.testing.assert_allclose(path.durations, [0.4, 0.4, 10.0])


def test_no_segment_is_too_short_to_compute():
    """Oracle: the least duration, 10 us."""
    path = cop_waypoints(replace(walk(), duration=0.0), CopPoints(PARAMS, SOLE))
    assert min(path.durations) == 1e-5


@pytest.mark.parametrize("previewed", [1, 4])
def test_sees_no_more_steps_than_it_previews(previewed):
    """Oracle: the walk that ends there, with the next transfer's duration."""
    params = replace(PARAMS, num_previewed_steps=previewed)
    path = cop_waypoints(walk(num_steps=4), CopPoints(params, SOLE))
    last = 0.8 if previewed == 4 else 0.3
    short = replace(walk(num_steps=previewed), final_transfer_duration=last)
    params = replace(PARAMS, num_previewed_steps=9)
    expected = cop_waypoints(short, CopPoints(params, SOLE))
    np.testing.assert_array_equal(path.points, expected.points)
    np.testing.assert_array_equal(path.durations, expected.durations)


def test_refuses_a_swing_without_a_footstep():
    """Oracle: there is nowhere to swing to."""
    schedule = replace(walk(num_steps=0), phase=Phase.SWING)
    with pytest.raises(ValueError, match="a swing needs one in the air"):
        cop_waypoints(schedule, CopPoints(PARAMS, SOLE))


def test_a_path_is_made_once_whatever_it_starts_from():
    """Oracle: the cache's own count, and the path of another CopPoints.

    A foothold that moves asks for the path of its schedule, and the plan after
    it for the rest of it, from the ICP as it is then.
    """
    stance = CopPoints(PARAMS, SOLE)
    schedule = walk()
    later = replace(schedule, start=at_rest([0.01, 0.02]), start_time=0.2)
    cop_waypoints(schedule, stance)
    rest = cop_waypoints(later, stance)
    assert stance.route.cache_info().misses == 1
    expected = cop_waypoints(later, CopPoints(PARAMS, SOLE))
    np.testing.assert_array_equal(rest.points, expected.points)
    np.testing.assert_array_equal(rest.knots, expected.knots)
    np.testing.assert_allclose(rest.knots[:2], [0.2, 0.3])
