"""Oracles: corners by hand; all ways, by shapely; rolled-out motions."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import LineString, box

from nadia_balance.core.body.swing_detour import PEAK
from nadia_balance.core.walking.vocabulary import FootPose, Side
from tests.example_walks import IDEAL_DETOUR

PARAMS = IDEAL_DETOUR
AHEAD, BESIDE = PARAMS.ahead, PARAMS.beside
FRONT, BACK = (AHEAD, BESIDE), (-AHEAD, BESIDE)


def left_swing(start, goal):
    """The way beside a stance sole in the origin, y toward the swing side."""
    return PARAMS.way_round(
        np.array(start), np.array(goal), FootPose(), Side.LEFT
    )


@pytest.mark.parametrize(
    ("start", "goal", "corners"),
    [
        ((0.0, 0.25), (0.0, 0.125), []),  # close beside
        ((0.34, -0.1), (-0.34, -0.1), [FRONT, BACK]),  # never the far side
        ((0.0, 0.125), (0.34, -0.1), [FRONT]),  # from within the clearance
        ((0.0, 0.25), (0.26, -0.05), [(0.26, BESIDE)]),  # lands close in front
        ((-0.26, 0.0), (0.0, 0.25), [(-0.26, BESIDE)]),  # starts close behind
        ((0.27, 0.05), (0.34, -0.1), []),  # already round
        ((0.2, 0.3), (0.2, 0.1), []),  # no way forward at all
    ],
)
def test_goes_round_the_right_corners(start, goal, corners):
    """Oracle: by hand."""
    expected = np.array([start, *corners, goal])
    np.testing.assert_allclose(
        left_swing(start, goal), expected, rtol=0.0, atol=1e-12
    )


def shortest_way(start, goal):
    """The length of the shortest way that leaves the stance foot alone."""
    kept_out = box(-AHEAD + 1e-9, -9.0, AHEAD - 1e-9, BESIDE - 1e-9)
    ways = [
        LineString([start, *corners, goal])
        for count in range(3)
        for corners in permutations([FRONT, BACK], count)
    ]
    return min(w.length for w in ways if not w.intersects(kept_out))


def outside():
    """A point that is in front of, behind or beside the stance foot."""
    near = st.floats(-0.7, 0.7)
    return st.tuples(near, near).filter(
        lambda p: abs(p[0]) >= AHEAD or p[1] >= BESIDE
    )


@given(outside(), outside())
def test_the_way_is_the_shortest(start, goal):
    """Oracle: all sequences of corners, and shapely's intersection."""
    way = left_swing(start, goal)
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    # shapely's box is smaller by 1e-9, to let the corners be touched.
    assert length == pytest.approx(shortest_way(start, goal), abs=1e-7)


@pytest.mark.parametrize("side", list(Side))
def test_the_way_moves_with_the_stance_foot(side):
    """Oracle: the same way in the frame of a stance foot that is turned."""
    stance = FootPose([0.4, -0.3, 0.05], 0.6)
    start, goal = (
        stance.to_world(np.array([[x, side.sign * y]]))[0]
        for x, y in ((0.0, 0.25), (0.34, -0.1))
    )
    way = stance.to_sole(PARAMS.way_round(start, goal, stance, side))
    expected = left_swing((0.0, 0.25), (0.34, -0.1)) * [1.0, side.sign]
    assert way == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("speed", [0.0, 1.0, 3.0])
def test_shortest_time_is_that_of_full_thrust_forth_and_back(speed):
    """Oracle: by bisection, when to brake so as to stop at the end."""
    way = np.array([[0.0, 0.0], [0.3, 0.0], [0.3, 0.4]])
    a, low, high = PARAMS.max_acceleration, 0.0, 1.0
    for _ in range(60):
        thrust = 0.5 * (low + high)
        top = speed + a * thrust
        stop = 0.5 * (speed + top) * thrust + 0.5 * top * top / a
        low, high = (thrust, high) if stop < 0.7 else (low, thrust)
    velocity = np.array([speed, 7.0])  # across the way: does not count
    found = PARAMS.shortest_time(way, velocity)
    assert found == pytest.approx(thrust + top / a, abs=1e-9)


@pytest.mark.parametrize("length", [0.0, 0.02, 0.05, 0.08, 0.089])
def test_a_foot_too_fast_to_stop_brakes_harder_or_comes_back(length):
    """Oracle: roll out the least constant braking, and then the way back."""
    speed, a = 2.5, 35.0  # stops within 0.0893 m
    params = replace(PARAMS, max_acceleration=a)
    braking = min(0.5 * speed**2 / max(length, 1e-9), PEAK * a)
    x, v, expected, dt = 0.0, speed, 0.0, 1e-6
    while v > 0.0:
        x, v, expected = x + v * dt, v - braking * dt, expected + dt
    back = np.array([[x, 0.0], [min(length, x), 0.0]])
    expected += params.shortest_time(back)  # from rest
    way = np.array([[0.0, 0.0], [length, 0.0]])
    found = params.shortest_time(way, np.array([speed, 0.0]))
    assert found == pytest.approx(expected, abs=1e-3)
