"""Oracles: the table of CoP points by hand, shapely, and symmetry."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.cop_waypoints import CopWaypointParams, cop_waypoints
from nadia_balance.core.walking import FootPose, Phase
from tests.example_walks import (
    SOLE,
    at_rest,
    mirrored,
    moved,
    random_walks,
    standing,
    walk,
)

PARAMS = CopWaypointParams()


def test_the_first_step_of_a_walk_of_30_cm():
    """Oracle: the table of algorithms.md 1.4, worked out by hand.

    The left foot takes over level with the right one: entry without step
    length; the right foot then goes 0.3 m ahead: ball at 0.3 / 8 m, exit at
    the end of its range.  In mid-transfer: half-way from exit to entry.
    """
    path = cop_waypoints(walk(0.3, num_steps=1), SOLE, PARAMS)
    left_exit = [0.08, 0.1]
    expected = [
        [0.0, 0.0],
        [0.0, 0.015],
        [0.0, 0.13],
        [0.0375, 0.115],
        left_exit,
        left_exit,
        [0.15, 0.0],
        [0.15, 0.0],
        [0.15, 0.0],
    ]
    np.testing.assert_allclose(path.points, expected, atol=1e-15)
    swing = [0.5 * 0.85 * 0.7, 0.5 * 0.85 * 0.7, 0.15 * 0.7]
    np.testing.assert_allclose(
        path.durations, [0.15, 0.15, *swing, 0.4, 0.4, 10.0], atol=1e-15
    )
    assert path.num_present == 2


def test_a_foot_that_lands_in_front_is_entered_at_its_front():
    """Oracle: by hand; the trailing foot is 0.3 m behind."""
    path = cop_waypoints(walk(0.3, num_steps=2), SOLE, PARAMS)
    entry, exit_ = np.array([0.3 - 0.04, -0.13]), np.array([0.08, 0.1])
    np.testing.assert_allclose(path.points[6], 0.5 * (entry + exit_))
    np.testing.assert_allclose(path.points[7], entry)


def test_walking_in_place_leans_inside_only():
    """Oracle: the inside offsets of the table, by hand."""
    points = cop_waypoints(walk(0.0, num_steps=3), SOLE, PARAMS).points
    np.testing.assert_allclose(points[:, 0], 0.0, atol=1e-15)
    left, right = [0.13, 0.115, 0.1, 0.1], [-0.13, -0.115, -0.1, -0.1]
    expected = [0, 0.015, *left, -0.015, *right, 0.015, *left, 0, 0, 0]
    np.testing.assert_allclose(points[:, 1], expected, atol=1e-15)


def test_a_swing_begins_where_the_cop_is():
    """Oracle: the same walk, seen from its first transfer."""
    start = walk(0.3)
    before = cop_waypoints(start, SOLE, PARAMS)
    swing = replace(
        start,
        phase=Phase.SWING,
        duration=0.7,
        start=at_rest(before.points[2]),
    )
    path = cop_waypoints(swing, SOLE, PARAMS)
    np.testing.assert_array_equal(path.points, before.points[2:])
    np.testing.assert_allclose(path.durations, before.durations[2:])
    assert path.num_present == 3


def test_standing_goes_to_the_middle_and_rests():
    """Oracle: half the final transfer to go, half to settle, then rest."""
    path = cop_waypoints(standing(start=at_rest([0.1, 0.1])), SOLE, PARAMS)
    expected = [[0.1, 0.1], [0, 0], [0, 0], [0, 0]]
    np.testing.assert_array_equal(path.points, expected)
    np.testing.assert_allclose(path.durations, [0.4, 0.4, 10.0])
    assert path.num_present == 2


def test_standing_does_not_anticipate_the_steps_to_come():
    """Oracle: standing without steps."""
    waiting = replace(walk(0.3), phase=Phase.STANDING, duration=0.8)
    path = cop_waypoints(waiting, SOLE, PARAMS)
    np.testing.assert_array_equal(path.points, np.zeros((4, 2)))


def test_a_transfer_without_steps_is_the_final_one():
    """Oracle: the schedule's own duration, and the middle of the feet."""
    final = replace(walk(num_steps=0), duration=0.6)
    path = cop_waypoints(final, SOLE, PARAMS)
    np.testing.assert_array_equal(path.points, np.zeros((4, 2)))
    np.testing.assert_allclose(path.durations, [0.3, 0.3, 10.0])


def test_the_present_phase_lasts_as_the_schedule_says():
    """Oracle: the sum of its segments."""
    path = cop_waypoints(replace(walk(), duration=0.05), SOLE, PARAMS)
    assert sum(path.durations[:2]) == pytest.approx(0.05)
    assert sum(path.durations[2:5]) == pytest.approx(0.7)
    assert sum(path.durations[5:7]) == pytest.approx(0.3)


@pytest.mark.parametrize("duration", [0.0, 1e-9])
def test_no_segment_is_too_short_to_compute(duration):
    """Oracle: the clamp of algorithms.md 1.2."""
    path = cop_waypoints(replace(walk(), duration=duration), SOLE, PARAMS)
    assert min(path.durations) == 1e-5


@pytest.mark.parametrize("previewed", [1, 2, 3, 4])
def test_sees_no_more_steps_than_it_previews(previewed):
    """Oracle: the walk that ends there, with the next transfer's duration."""
    params = replace(PARAMS, num_previewed_steps=previewed)
    path = cop_waypoints(walk(num_steps=4), SOLE, params)
    last = 0.8 if previewed == 4 else 0.3
    short = replace(walk(num_steps=previewed), final_transfer_duration=last)
    params = replace(PARAMS, num_previewed_steps=9)
    expected = cop_waypoints(short, SOLE, params)
    np.testing.assert_array_equal(path.points, expected.points)
    np.testing.assert_array_equal(path.durations, expected.durations)


@given(random_walks())
def test_entry_ball_and_exit_are_in_the_stance_foot(schedule):
    """Oracle: shapely's distance to the edge of the stance sole in W."""
    points = cop_waypoints(schedule, SOLE, PARAMS).points
    first = 2 if schedule.phase is Phase.TRANSFER else 0
    feet = schedule.feet
    for i, step in enumerate(schedule.footsteps[:3]):
        sole = shapely.Polygon(feet[step.side.other].to_world(SOLE))
        k = first + 5 * i
        for point in points[max(k, 1) : k + 4]:  # the entry of a swing is past
            assert sole.contains(shapely.Point(point))
            assert sole.exterior.distance(shapely.Point(point)) >= 0.01 - 1e-12
        feet = feet.with_foot(step.side, step.pose)
    middle = 0.5 * (feet.left.p_WF + feet.right.p_WF)[:2]
    np.testing.assert_allclose(points[-3:], [middle] * 3, atol=1e-15)


@given(random_walks())
def test_left_and_right_are_alike(schedule):
    """Oracle: the mirror image of the walk."""
    path = cop_waypoints(schedule, SOLE, PARAMS)
    image = cop_waypoints(mirrored(schedule), SOLE, PARAMS)
    np.testing.assert_allclose(
        image.points, path.points * [1.0, -1.0], atol=1e-12
    )


@given(random_walks(), st.floats(-4, 4), st.floats(-9, 9))
def test_all_places_and_directions_are_alike(schedule, angle, shift):
    """Oracle: the walk turned and moved as a whole."""
    path = cop_waypoints(schedule, SOLE, PARAMS)
    elsewhere = moved(schedule, angle, np.array([shift, 1.0]))
    place = FootPose([shift, 1.0, 0.0], angle)
    np.testing.assert_allclose(
        cop_waypoints(elsewhere, SOLE, PARAMS).points,
        place.to_world(path.points),
        atol=1e-12,
    )


def test_refuses_a_swing_without_a_footstep():
    """Oracle: there is nowhere to swing to."""
    schedule = replace(walk(num_steps=0), phase=Phase.SWING)
    with pytest.raises(ValueError, match="a swing needs the step in the air"):
        cop_waypoints(schedule, SOLE, PARAMS)


def test_the_same_foot_may_step_twice():
    """Oracle: the other foot carries both times, by hand."""
    start = walk(0.0, num_steps=1)
    (step,) = start.footsteps
    path = cop_waypoints(replace(start, footsteps=(step, step)), SOLE, PARAMS)
    np.testing.assert_allclose(
        path.points[7:11, 1], [0.13, 0.115, 0.1, 0.1], atol=1e-15
    )


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("transfer_split", 0.0, "in (0, 1)"),
        ("swing_split", 1.0, "in (0, 1)"),
        ("swing_shift_fraction", math.nan, "in (0, 1)"),
        ("mid_weight", -0.1, "in (0, 1)"),
        ("margin", -0.01, ">= 0"),
        ("margin", math.nan, ">= 0"),
        ("num_previewed_steps", 0, ">= 1"),
    ],
)
def test_refuses_bad_params(name, value, rule):
    """Oracle: the message names field, value and what is allowed."""
    params = replace(PARAMS, **{name: value})
    with pytest.raises(ValueError) as caught:
        params.validate()
    assert str(caught.value) == f"{name} = {value}: must be {rule}"


def test_validates_its_cop_points_too():
    """Oracle: a point with an empty range."""
    params = CopWaypointParams()
    params.ball.min_x = 1.0
    with pytest.raises(ValueError, match=r"ball\.min_x = 1\.0: must be"):
        params.validate()
    CopWaypointParams().validate()


@pytest.mark.parametrize("phase", [Phase.TRANSFER, Phase.SWING])
def test_tells_which_points_go_along_with_the_first_step(phase):
    """Oracle: the points, when the step is put elsewhere, sideways."""
    schedule = walk(0.2, num_steps=4)
    schedule = replace(schedule, phase=phase, duration=0.5)
    step, *later = schedule.footsteps
    aside = FootPose(step.pose.p_WF + [0.0, -0.1, 0.0], step.pose.yaw)
    steps = (replace(step, pose=aside), *later)
    path, other = (
        cop_waypoints(s, SOLE, PARAMS)
        for s in (schedule, replace(schedule, footsteps=steps))
    )
    shifts = (other.points - path.points) / [1.0, -0.1]
    np.testing.assert_allclose(shifts[:, 0], 0.0, atol=1e-15)
    np.testing.assert_allclose(shifts[:, 1], path.step_shares, atol=1e-12)
    assert set(path.step_shares.tolist()) == {0.0, 0.5, 1.0}
