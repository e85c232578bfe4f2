"""Oracles: shapely's distance to the base region; footholds by hand."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.footstep_plan import within_reach
from nadia_balance.core.reachability import ReachabilityParams, base_region
from nadia_balance.core.walking import FootPose, FootPoses, Footstep, Side

REACH = ReachabilityParams()
FEET = FootPoses(FootPose([0.0, 0.125, 0.0]), FootPose([0.0, -0.125, 0.0]))


def step(side, x, y, yaw=0.0):
    return Footstep(side, FootPose([x, y, 0.0], yaw), 0.3, 0.7)


def in_place(count, first=Side.RIGHT):
    """Steps onto the spots where the feet stand."""
    sides = [first, first.other] * count
    return tuple(step(s, 0.0, 0.125 * s.sign) for s in sides[:count])


def test_steps_within_reach_stay_the_same():
    """Oracle: identity."""
    steps = in_place(5)
    taken = within_reach(steps, FEET, REACH)
    assert all(a is b for a, b in zip(taken, steps, strict=True))


@given(
    x=st.floats(-1.0, 1.0),
    y=st.floats(-1.0, 1.0),
    yaw=st.floats(-1.0, 1.0),
    side=st.sampled_from(Side),
)
def test_a_step_out_of_reach_goes_to_the_nearest_place(x, y, yaw, side):
    """Oracle: shapely's distance from the foothold to the base region."""
    stance = FootPose([0.3, -0.2, 0.1], yaw)
    feet = FEET.with_foot(side.other, stance)
    wanted = step(side, x, y)
    (taken,) = within_reach((wanted,), feet, REACH)
    region = stance.to_world(base_region(REACH) * [1.0, side.sign])
    distance = shapely.Polygon(region).distance(shapely.Point(x, y))
    moved = np.linalg.norm(taken.pose.p_WF[:2] - [x, y])
    if moved > 0.0:
        assert moved == pytest.approx(distance, abs=1e-9)
    else:  # the ellipse reaches beyond the polygon inside of it
        assert distance < 0.08
    assert taken.pose.yaw == wanted.pose.yaw
    assert taken.pose.p_WF[2] == wanted.pose.p_WF[2]


@given(x=st.floats(-2.0, 2.0), y=st.floats(-2.0, 2.0))
def test_the_way_back_takes_a_share_of_the_reach(x, y):
    """Oracle: shapely's distance to the base region, shrunk by shapely."""
    landed = step(Side.LEFT, 0.0, 0.125)
    feet = FEET.with_foot(Side.LEFT, FootPose([x, y, 0.0]))
    taken, *_ = within_reach(in_place(1), feet, REACH, landed)
    share = REACH.return_share if math.hypot(x, y - 0.125) > 0.05 else 1.0
    far = shapely.box(-9.0, 0.25, 9.0, 9.0)  # beyond w_nom
    whole = shapely.Polygon(base_region(REACH))
    narrow = shapely.affinity.scale(whole, share, 1.0, origin=(0.0, 0.25))
    wide = shapely.affinity.scale(whole, share, share, origin=(0.0, 0.25))
    region = (narrow - far) | (wide & far)
    wanted, found = (
        shapely.Point(p[0] - x, y - p[1])  # in the left sole's frame, mirrored
        for p in ([0.0, -0.125], taken.pose.p_WF)
    )
    if found != wanted:
        assert wanted.distance(found) == pytest.approx(
            region.distance(wanted), abs=1e-9
        )
    else:  # the ellipse reaches beyond the polygon inside of it
        assert region.distance(wanted) < 0.08


def test_a_step_as_it_was_meant_may_take_all_of_the_reach():
    """Oracle: identity, though it is longer than a way back would be."""
    landed = step(Side.LEFT, 0.0, 0.125)
    wanted = step(Side.RIGHT, 0.9, -0.125)
    (taken,) = within_reach((wanted,), FEET, REACH, landed)
    assert taken is wanted
    displaced = FEET.with_foot(Side.LEFT, FootPose([-0.06, 0.125, 0.0]))
    (taken,) = within_reach((wanted,), displaced, REACH, landed)
    assert taken.pose.p_WF[0] == pytest.approx(0.7 - 0.06, abs=0.01)


@given(x=st.floats(-2.0, 2.0), y=st.floats(-2.0, 2.0))
def test_the_way_back_stays_in_a_region_of_ones_own(x, y):
    """Oracle: shapely's distance; a share of a triangle juts out of it."""
    corners = [[0.6, 0.25], [-0.3, 0.15], [-0.3, 0.4]]
    reach = ReachabilityParams(base_polygon=corners)
    landed = step(Side.LEFT, 0.0, 0.125)
    feet = FEET.with_foot(Side.LEFT, FootPose([x, y, 0.0]))
    taken, *_ = within_reach(in_place(1), feet, reach, landed)
    found = shapely.Point(taken.pose.p_WF[0] - x, y - taken.pose.p_WF[1])
    assert shapely.Polygon(corners).distance(found) < 1e-8


def test_crossed_legs_uncross_and_come_back():
    """Oracle: by hand, the left foot has crossed to y = -0.22."""
    feet = FEET.with_foot(Side.LEFT, FootPose([0.2, -0.22, 0.0]))
    steps = in_place(4)
    landed = step(Side.LEFT, 0.0, 0.125)
    first, second, third, _ = within_reach(steps, feet, REACH, landed)
    # The right foot must go at least w_min to the right of the left foot.
    assert first.pose.p_WF[1] <= -0.22 - 0.125 + 1e-9
    assert second.pose == steps[1].pose  # the left foot is back in its place
    assert third.pose == steps[2].pose
