"""Oracles: corners by hand; ways, by shapely; the ground under the sole."""

import math
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import LineString, box

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.swing_detour import (
    PEAK,
    SwingDetourParams,
    edges_on_way,
)
from nadia_balance.core.steps import swing_foot
from nadia_balance.core.walking.state import (
    FootPose,
    FootPoses,
    Side,
    WalkingState,
)
from nadia_balance.diagrams.terrain import Terrain
from tests.core.body.test_ground import square
from tests.example_walks import IDEAL_DETOUR, MODEL, SOLE, stepping

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
    assert left_swing(start, goal) == pytest.approx(expected, abs=1e-12)


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


PERIOD, FOOT_PARAMS = 0.002, swing_foot.SwingFootParams()
# All over the sole, 5 mm apart.
GRID = np.stack(
    np.meshgrid(np.linspace(-0.125, 0.125, 51), np.linspace(-0.06, 0.06, 25)),
    axis=-1,
).reshape(-1, 2)


def ground_height(ground, points):
    """The highest region at each of `points` (n, 2)."""
    heights = np.full(len(points), -np.inf)
    for region in ground.regions:
        outline = shapely.Polygon(region.polygon)
        inside = shapely.intersects_xy(outline, *points.T)
        heights[inside] = region.heights(points)[inside]
    return heights


def swing(ground, start, goal, duration=1.2):
    """The right foot swings from start to goal, each (2,)."""
    lifted, landed = (ground.pose(np.array(p), 0.0, 0.0) for p in (start, goal))
    stance = FootPose([*start, 0.0] + np.array([0, 0.25, 0]))
    feet = FootPoses(stance, lifted)
    return stepping(feet, landed, duration=duration)


def swing_on(course, *way_and_duration):
    """That swing on this ground, what moves its foot, and the edges there."""
    ground = Terrain(name=course).ground(SOLE)
    schedule = swing(ground, *way_and_duration)
    model = replace(MODEL, ground=ground, detour=SwingDetourParams())
    foot = swing_foot.SwingFoot(FOOT_PARAMS, model, PERIOD)
    edges = edges_on_way(schedule, ground, FOOT_PARAMS.clearance)
    return ground, schedule, foot, edges


@pytest.mark.parametrize(
    ("course", "start", "goal"),
    [
        ("stairs", (0.15, -0.125), (0.78, -0.125)),  # two steps up
        ("stairs", (3.06, -0.125), (3.70, -0.125)),  # and down
        ("tilted_blocks", (0.13, 0.125), (0.51, 0.125)),
        ("tilted_blocks", (1.74, -0.125), (2.15, -0.125)),
    ],
)
def test_a_swing_meets_no_edge_and_lands_in_time(course, start, goal):
    """Oracle: points all over the sole, every 20 ms; speed and time."""
    ground, schedule, foot, edges = swing_on(course, start, goal, 1.2)
    lifted, landed = schedule.feet.right, schedule.footsteps[0].pose
    motion, least = swing_foot.at_rest(lifted), math.inf
    for tick in range(1, 601):
        t = tick * PERIOD
        state = WalkingState(schedule, t, elapsed=t)
        motion, _ = foot.motion(motion, state, edges)
        if tick % 10 == 0 and 150 <= tick < 590:
            s = t / 1.2
            s = s * s * (3.0 - 2.0 * s)
            n = (1.0 - s) * lifted.normal + s * landed.normal
            pose = FootPose(motion[0, :3], 0.0, n / np.linalg.norm(n))
            points, slope = pose.outline(GRID), n[:2] / n[2]
            sole = pose.p_WF[2] - (points - pose.p_WF[:2]) @ slope
            least = min(least, np.min(sole - ground_height(ground, points)))
    assert least > 0.0
    assert motion[0, :3] == pytest.approx(landed.p_WF, abs=0.002)
    assert motion[1, 2] == pytest.approx(-FOOT_PARAMS.touchdown_velocity)


def test_a_foot_that_is_high_when_its_clock_runs_out_comes_down_at_once():
    """Oracle: by hand: at 0.6 m/s, the last 1 cm at 0.2 m/s."""
    way = (1.74, -0.125), (2.15, -0.125)
    _, schedule, foot, edges = swing_on("cinder_blocks", *way, 0.9)
    motion, late = swing_foot.at_rest(schedule.feet.right), None
    for tick in range(1, 500):
        elapsed = tick * PERIOD
        t = min(elapsed + 0.27 * (elapsed > 0.5), 0.9)
        state = WalkingState(schedule, t, elapsed=elapsed, waiting=t == 0.9)
        before = motion[1, 2]
        motion, _ = foot.motion(motion, state, edges)
        assert abs(motion[1, 2] - before) < 0.1
        height = motion[0, 2] - 0.3
        if late is None and state.waiting:
            late = elapsed + height / 0.6 + 0.01 / 0.2
            assert height > 0.05
        if height <= 0.0:
            break
    assert elapsed < late + 0.02
    assert motion[1, 2] == pytest.approx(-FOOT_PARAMS.touchdown_velocity)


def test_a_foot_that_brakes_beside_an_edge_does_not_jump():
    """Oracle: by hand: from 0.8 to 0.2 m/s on 9 mm takes 33 m/s^2."""
    step = (
        square("low", -0.75, side=2.0),
        square("up", 1.25, side=2.0, height=0.15),
    )
    ground = Ground(step, SOLE)
    schedule = swing(ground, (-0.1, -0.125), (0.45, -0.125), 0.7)
    edges = edges_on_way(schedule, ground, FOOT_PARAMS.clearance)
    detour = SwingDetourParams(max_acceleration=45.2)
    model = replace(MODEL, ground=ground, detour=detour)
    foot = swing_foot.SwingFoot(FOOT_PARAMS, model, 0.004)
    start = np.zeros((3, 4))
    start[0, :3] = schedule.footsteps[0].pose.p_WF + [-0.06, 0.0, 0.009]
    start[1, :3] = 0.3, 0.0, -0.8
    motion, _ = foot.motion(start, WalkingState(schedule, 0.66, 0.66), edges)
    assert motion[0, 2] == pytest.approx(start[0, 2] - 0.8 * 0.004, abs=4e-4)


def test_no_edge_is_on_level_ground_and_on_a_slope():
    """Oracle: by hand."""
    slope = square("slope", side=3.0, height=0.1, normal=[-0.17, 0.0, 1.0])
    for region in square("level", side=3.0), slope:
        ground = Ground((region,), SOLE)
        schedule = swing(ground, (0.0, -0.125), (0.5, -0.125))
        assert edges_on_way(schedule, ground, 0.03) is None
    both = Ground((square("a"), square("b", x=0.5, height=0.2)), SOLE)
    schedule = swing(both, (0.0, -0.125), (0.5, -0.125))
    edges = edges_on_way(schedule, both, 0.03)
    assert edges.top == pytest.approx(0.2)
    # 3 cm above, but for the last 10 cm of 50.
    s, there = np.linspace(0.0, 1.0, 41), edges.heights > 0.0
    above = 0.2 + 0.03 * np.minimum(5.0 * (1.0 - s), 1.0)
    assert there.sum() > 20
    assert edges.heights[there] == pytest.approx(above[there])
    # The toe is 0.125 m ahead, the edge at x = 0.25 m.
    for x, z, held in (0.0, 0.0, False), (0.08, 0.2, True), (0.08, 0.22, False):
        assert edges.are_in_the_way(np.array([x, -0.125, z])) == held


@pytest.mark.parametrize(("gap", "is_edge"), [(0.005, True), (0.015, False)])
def test_a_box_close_beside_the_way_is_an_edge(gap, is_edge):
    """Oracle: by hand; a foot sways by less than 1 cm."""
    y = -0.125 + SOLE[:, 1].min() - gap - 0.1
    box = square("box", 0.25, y, side=0.2, height=0.1)
    ground = Ground((square("low", side=3.0), box), SOLE)
    schedule = swing(ground, (0.0, -0.125), (0.5, -0.125))
    edges = edges_on_way(schedule, ground, 0.03)
    assert (edges is not None) == is_edge


def test_a_foot_comes_down_from_an_edge_in_the_last_fifth():
    """Oracle: by hand; the heel leaves the box at 85 % of the way."""
    heel = SOLE[:, 0].min()
    for share, drop in (0.85, 0.13), (0.75, 0.0):
        x = 0.5 * share + heel - 0.1
        box = square("box", x, -0.125, side=0.2, height=0.1)
        ground = Ground((square("low", side=3.0), box), SOLE)
        schedule = swing(ground, (-0.05, -0.125), (0.5, -0.125))
        edges = edges_on_way(schedule, ground, 0.03)
        assert edges.drop == pytest.approx(drop, abs=1e-6)
