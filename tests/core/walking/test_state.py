"""Oracles: hand-computed frames; shapely; the papers' figures."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from shapely import affinity

from nadia_balance.core.walking.state import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
    support_polygon,
    whole_ticks,
)
from tests.example_walks import SOLE, random_walks

POSE = FootPose([1.0, 2.0, 0.5], math.pi / 2)
FEET = FootPoses(FootPose([0.0, 0.1, 0.0]), FootPose([0.0, -0.1, 0.0]))
START = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))


def schedule(phase=Phase.SWING, side=Side.LEFT):
    """Nothing to do but that phase."""
    return ContactSchedule(phase, side, 0.7, FEET, (), START)


def test_points_go_to_the_world_and_back():
    """Oracle: by hand, a quarter turn; then the identity."""
    points = np.array([[0.2, 0.0], [0.0, 0.1]])
    world = POSE.to_world(points)
    assert world == pytest.approx(np.array([[1.0, 2.2], [0.9, 2.0]]))
    assert POSE.to_sole(world) == pytest.approx(points)


@pytest.mark.parametrize("time", [0.006, -0.004, math.nan, math.inf])
def test_a_time_that_is_no_number_of_ticks_is_refused(time):
    """Oracle: by hand, in ticks of 4 ms."""
    assert whole_ticks("delay", 0.012, 0.004) == 3
    with pytest.raises(ValueError, match=f"^delay = {time}: must be a mult"):
        whole_ticks("delay", time, 0.004)


def test_a_foot_has_a_normal():
    with pytest.raises(ValueError, match=r"^normal = .*nan.*: must be finite"):
        FootPose(normal=[0.0, 0.0, math.nan])


@pytest.mark.parametrize("support", list(Side))
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_legs_are_crossed_beyond_the_centre_line(support, yaw):
    """Oracle: by hand, in the frame of the support foot."""
    stance = FootPose([1.0, 2.0, 0.0], yaw)
    for out, crossed in ((0.01, False), (-0.01, True)):
        offset = np.array([[-0.3, support.other.sign * out]])
        other = FootPose(np.append(stance.to_world(offset), 0.0), yaw)
        feet = FootPoses(stance, stance).with_foot(support.other, other)
        taken = replace(schedule(), support_side=support, feet=feet)
        assert taken.legs_crossed is crossed


@pytest.mark.parametrize(
    "value", [POSE, FEET, START, schedule(), WalkingState(schedule())]
)
def test_clones_share_the_value(value):
    """Oracle: identity; numpy would make the copies writeable again."""
    assert copy.deepcopy(value) is value


def sole_in_world(foot):
    """The sole, placed by shapely."""
    turned = affinity.rotate(
        shapely.Polygon(SOLE), foot.yaw, origin=(0, 0), use_radians=True
    )
    return affinity.translate(turned, foot.p_WF[0], foot.p_WF[1])


@given(random_walks())
def test_the_support_polygon_is_the_hull_of_the_soles_in_contact(schedule):
    """Oracle: shapely's hull of both soles, or of the stance sole alone."""
    feet = [schedule.feet.left, schedule.feet.right]
    if schedule.phase is Phase.SWING:
        feet = [schedule.feet[schedule.support_side]]
    expected = shapely.union_all([sole_in_world(f) for f in feet]).convex_hull
    ours = shapely.Polygon(support_polygon(schedule, SOLE))
    assert ours.symmetric_difference(expected).area < 1e-12
