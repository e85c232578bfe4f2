"""Oracles: the ICP's flow, shapely, planes in space, figures by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.reachability import BASE, in_world, total_region
from nadia_balance.core.math.arrays import rectangle
from nadia_balance.core.math.lipm import icp_after
from nadia_balance.core.math.polygon import contains, convex_hull
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
    geometry_key,
)
from nadia_balance.core.walking.vocabulary import FootPose, Side
from tests.core.body.test_ground import square
from tests.core.steps.test_capture_region import random_points
from tests.example_walks import ALL, MODEL, OMEGA, SOLE, UNCROSSED, moved, swing

PARAMS = CaptureRegionStepAdjusterParams()


def geometry(schedule, params=PARAMS, on=ALL):
    return SwingGeometry(schedule, params, MODEL, on)


def test_n_is_no_more_than_the_steps_in_the_queue():
    """Oracle: three, or fewer if there are fewer."""
    for queued, expected in (1, 1), (2, 2), (5, 3):
        assert len(geometry(swing(num_steps=queued)).offsets) == expected


def test_later_steps_hurry_only_if_swings_adapt():
    """Oracle: steps that were planned to take 0.6 of the time, and C_N."""
    planned, quick = (
        swing(transfer=part * 0.2, swing=part * 0.5) for part in (1.0, 0.6)
    )
    one_step, slow = rectangle(0.2, 0.1), replace(ALL, swing=False)
    for found, expected in (
        (geometry(planned), geometry(quick, on=slow)),
        (geometry(planned, on=slow), geometry(planned)),
    ):
        hurried = found.hurried_region(one_step)
        expected = expected.capture_region(one_step)
        np.testing.assert_allclose(hurried, expected, rtol=0, atol=1e-12)


def test_random_turning_steps_that_recover_start_in_the_region():
    """Oracle: the ICP's flow.

    The CoP rests at q of the stance foot, then in the middle of each new foot.
    The steps are in the reach of the foot that stands, with its own yaw, and
    the ICP has to be above the third foothold in the end.
    """
    rng, icp = np.random.default_rng(3), np.array([0.1, 0.05])
    schedule = swing(length=0.2, turn=0.4, num_steps=4, transfer=0.2, swing=0.5)
    # The third step is quicker: not all contractions are alike.
    steps = list(schedule.footsteps)
    steps[2] = replace(steps[2], transfer_duration=0.1, swing_duration=0.4)
    schedule = replace(schedule, footsteps=tuple(steps))
    found, reach = geometry(schedule), total_region(MODEL.reach, True)

    for _ in range(15):
        moves = [
            random_points(
                rng,
                in_world(reach, FootPose(yaw=step.pose.yaw), step.side.other),
                1,
            )[0]
            for step in steps[:2]
        ]
        q = random_points(rng, found.foot, 1)[0]

        def outcome(foothold, q=q, moves=moves):
            """How far the ICP is from the last foot in the end."""
            xi = icp_after(icp, q, OMEGA, 0.3)
            for move, duration in zip(moves, (0.7, 0.5), strict=True):
                xi = icp_after(xi, foothold, OMEGA, duration)
                foothold = foothold + move
            return xi - foothold

        # The outcome is linear in the first foothold: find its zero.
        rates = [outcome(np.eye(2)[k]) - outcome(np.zeros(2)) for k in (0, 1)]
        foothold = np.linalg.solve(np.array(rates).T, -outcome(np.zeros(2)))
        one_step = found.one_step_region(icp, (0.3, 0.3))
        assert contains(foothold, found.capture_region(one_step), 1e-6)


@pytest.mark.parametrize("yaw", [0.0, 0.4, -0.7])
def test_a_foothold_is_blocked_where_the_soles_would_meet(yaw):
    """Oracle: shapely's distance of the soles, in front, behind, inside."""
    rng = np.random.default_rng(5)
    schedule = moved(swing(num_steps=1), 0.3, [1.0, 2.0])
    step = schedule.footsteps[0]
    step = replace(step, pose=FootPose(step.pose.p_WF, 0.3 + yaw))
    schedule = replace(schedule, footsteps=(step,))
    clearance = 0.01
    found = geometry(schedule, replace(PARAMS, sole_clearance=clearance))
    stance = schedule.feet.left
    sole = shapely.Polygon(stance.to_world(SOLE))
    blocked = 0
    for _ in range(500):
        p = stance.to_world(rng.uniform([-0.4, -0.4], [0.4, 0.05], (1, 2)))[0]
        foot = FootPose([*p, 0.0], 0.3 + yaw)
        gap = shapely.Polygon(foot.to_world(SOLE)).distance(sole)
        if gap < clearance * (1.0 - 1e-9):
            assert found.blocked(p)
        elif found.blocked(p):  # near a corner, or to the outer side
            outside = stance.to_sole(p)[1] > 0.0
            assert outside or gap < clearance * math.sqrt(2.0) * 1.01
        blocked += found.blocked(p)
    assert 50 < blocked < 300


def test_the_key_changes_with_all_that_the_geometry_depends_on():
    """Oracle: by hand; an adjusted foothold of the same yaw is no change."""
    schedule = swing()
    step, *later = schedule.footsteps

    def same(other, on=ALL):
        return geometry_key(schedule, ALL) == geometry_key(other, on)

    pose = FootPose([0.5, -0.3, 0.0], step.pose.yaw)
    adjusted = (replace(step, pose=pose), *later)
    assert same(replace(schedule, footsteps=adjusted))
    turned = (replace(step, pose=replace(pose, yaw=0.3)), *later)
    assert not same(replace(schedule, footsteps=turned))
    quicker = (step, replace(later[0], swing_duration=0.4), *later[1:])
    assert not same(replace(schedule, footsteps=quicker))
    feet = schedule.feet.with_foot(Side.LEFT, FootPose([0.1, 0.1, 0.0]))
    assert not same(replace(schedule, feet=feet))
    assert not same(replace(schedule, footsteps=(step,)))
    assert not same(schedule, UNCROSSED)
    assert not same(schedule, replace(ALL, swing=False))


def test_the_foot_is_cut_on_its_proper_sides():
    """Oracle: by hand: x -0.125..0.125, y -0.06 (outside)..0.06 (inside)."""
    params = CaptureRegionStepAdjusterParams(
        foot_front=0.01, foot_back=0.02, foot_inside=0.03, foot_outside=0.04
    )
    foot = convex_hull(params.usable_foot(rectangle(0.25, 0.12)))
    corners = [[-0.105, -0.02], [0.115, -0.02], [0.115, 0.03], [-0.105, 0.03]]
    np.testing.assert_allclose(foot, corners, atol=1e-15)


# The ground.


def on_ground(regions, schedule, on=ALL, model=MODEL):
    model = replace(model, ground=Ground(regions, SOLE))
    return SwingGeometry(schedule, PARAMS, model, on)


def raised(schedule, height):
    """The schedule, its stance foot at this height [m]."""
    foot = schedule.feet[schedule.support_side]
    pose = FootPose([*foot.p_WF[:2], height], foot.yaw)
    feet = schedule.feet.with_foot(schedule.support_side, pose)
    return replace(schedule, feet=feet)


def test_a_place_is_where_the_sole_is_on_the_region_and_in_reach():
    """Oracle: shapely: the margin, the turned sole, the reach, the rise.

    A stone is tilted by 15 degrees about an axis askew, seen from a foot that
    stands 0.3 m high: only a part of it is within 0.25 m of that height.
    """
    rng, yaw = np.random.default_rng(5), 0.4
    normal = [0.25, -0.1, 1.0]
    regions = (
        square("near", -0.45, -0.25, height=0.3),
        square("tilted", 0.3, -0.5, side=0.9, height=0.3, normal=normal),
    )
    schedule = raised(swing(length=0.1, turn=yaw), 0.3)
    model = replace(MODEL, reach=replace(MODEL.reach, rise_max=0.05))
    found = on_ground(regions, schedule, UNCROSSED, model)
    (reach,) = found.regions.values()
    stones = [
        shapely.Polygon(r.polygon).buffer(-0.02, join_style="mitre")
        for r in regions
    ]
    inside = [0, 0]
    for p in rng.uniform([-0.7, -0.9], [0.7, 0.0], (800, 2)):
        for k, (region, stone) in enumerate(zip(regions, stones, strict=True)):
            foot = FootPose([*p, 0.0], yaw, region.unit_normal)
            sole = shapely.Polygon(foot.outline(SOLE))
            x, y, z = region.normal  # the plane passes the middle at 0.3 m
            rise = -((p - region.polygon.mean(axis=0)) @ [x, y]) / z
            good = stone.covers(sole) and abs(rise) <= 0.05
            ours = [
                contains(p, place.polygon)
                for place in found.places
                if place.ground == k
            ]
            assert any(ours) == (good and contains(p, reach))
            inside[k] += any(ours)
    assert min(inside) > 20


def test_allows_feet_on_the_ground_side_by_side():
    """Oracle: by hand: on a stone, across its edge, on the stance foot."""
    found = on_ground((square("stone", 0.0, -0.1),), swing(length=0.0))
    for x, y, good in (0.0, -0.125, 1), (0.2, -0.125, 0), (0.0, 0.05, 0):
        assert found.allows(FootPose([x, y, 0.0])) == good
    assert found.place_at(np.array([0.0, -0.125])) == found.places[0]
    assert found.place_at(np.array([0.0, 0.05])) is None  # on the stance foot
    assert found.place_at(np.array([0.3, -0.125])) is None  # beside the stone
    assert found.places[0].reach == BASE
