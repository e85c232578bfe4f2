"""Oracles: the ground under points all over the sole; figures by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.swing_detour import SwingDetourParams, edges_on_way
from nadia_balance.core.steps import swing_foot
from nadia_balance.core.walking.vocabulary import (
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.diagrams.terrain import Terrain
from tests.core.body.test_ground import square
from tests.example_walks import MODEL, SOLE, standing

PERIOD, PARAMS = 0.002, swing_foot.SwingFootParams()
# All over the sole, 5 mm apart.
GRID = np.stack(
    np.meshgrid(np.linspace(-0.125, 0.125, 51), np.linspace(-0.06, 0.06, 25)),
    axis=-1,
).reshape(-1, 2)


def ground_of(course):
    return Terrain(name=course).ground(SOLE)


def ground_height(ground, points):
    """The highest region at each of `points` (n, 2)."""
    heights = np.full(len(points), -np.inf)
    for region in ground.regions:
        inside = shapely.intersects_xy(
            shapely.Polygon(region.polygon), *points.T
        )
        heights[inside] = region.heights(points)[inside]
    return heights


def swing(ground, start, goal, duration=1.2):
    """The right foot swings from start to goal, each (2,)."""
    lifted, landed = (ground.pose(np.array(p), 0.0, 0.0) for p in (start, goal))
    feet = FootPoses(FootPose([*start, 0.0] + np.array([0, 0.25, 0])), lifted)
    return replace(
        standing(feet),
        phase=Phase.SWING,
        duration=duration,
        footsteps=(Footstep(Side.RIGHT, landed, 0.8, duration),),
    )


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
    ground = ground_of(course)
    model = replace(MODEL, ground=ground, detour=SwingDetourParams())
    schedule = swing(ground, start, goal)
    lifted, landed = schedule.feet.right, schedule.footsteps[0].pose
    edges = edges_on_way(schedule, ground, PARAMS.clearance)
    foot = swing_foot.SwingFoot(PARAMS, model, PERIOD)
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
            points = pose.outline(GRID)
            sole = pose.p_WF[2] - (points - pose.p_WF[:2]) @ (
                pose.normal[:2] / pose.normal[2]
            )
            least = min(least, np.min(sole - ground_height(ground, points)))
    assert least > 0.0
    assert motion[0, :3] == pytest.approx(landed.p_WF, abs=0.002)
    assert motion[1, 2] == pytest.approx(-PARAMS.touchdown_velocity)


def test_a_foot_that_is_high_when_its_clock_runs_out_comes_down_at_once():
    """Oracle: by hand: at 0.6 m/s, the last 1 cm at 0.2 m/s."""
    ground = ground_of("cinder_blocks")
    model = replace(MODEL, ground=ground, detour=SwingDetourParams())
    schedule = swing(ground, (1.74, -0.125), (2.15, -0.125), 0.9)
    edges = edges_on_way(schedule, ground, PARAMS.clearance)
    foot = swing_foot.SwingFoot(PARAMS, model, PERIOD)
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
    assert motion[1, 2] == pytest.approx(-PARAMS.touchdown_velocity)


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
