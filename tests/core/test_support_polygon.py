"""Oracle: shapely's hull of the soles, turned and moved by shapely."""

import math
from dataclasses import replace

import pytest
import shapely
from hypothesis import given
from shapely import affinity

from nadia_balance.core.support_polygon import support_polygon
from nadia_balance.core.walking import Phase, Side
from tests.example_walks import SOLE, random_walks, walk


def sole_in_world(foot):
    """The sole, placed by shapely."""
    turned = affinity.rotate(
        shapely.Polygon(SOLE), foot.yaw, origin=(0, 0), use_radians=True
    )
    return affinity.translate(turned, foot.p_WF[0], foot.p_WF[1])


@given(random_walks())
def test_is_the_hull_of_the_soles_in_contact(schedule):
    """Oracle: shapely's hull of both soles, or of the stance sole alone."""
    feet = [schedule.feet.left, schedule.feet.right]
    if schedule.phase is Phase.SWING:
        feet = [schedule.feet[schedule.support_side]]
    expected = shapely.union_all([sole_in_world(f) for f in feet]).convex_hull
    ours = shapely.Polygon(support_polygon(schedule, SOLE))
    assert ours.symmetric_difference(expected).area < 1e-12


@pytest.mark.parametrize("side", list(Side))
def test_a_swing_stands_on_the_stance_foot_alone(side):
    """Oracle: the area of one sole, and its centre, by hand."""
    schedule = replace(walk(), phase=Phase.SWING, support_side=side)
    polygon = shapely.Polygon(support_polygon(schedule, SOLE))
    assert polygon.area == pytest.approx(0.25 * 0.12)
    assert polygon.centroid.y == pytest.approx(math.copysign(0.125, side.sign))
