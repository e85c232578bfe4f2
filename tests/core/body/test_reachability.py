"""Oracles: the Nadia paper's figures by hand; shapely; symmetry."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.body import reachability
from nadia_balance.core.math.polygon import area, contains, convex_hull
from nadia_balance.core.walking.state import FootPose, Side

PARAMS = reachability.ReachabilityParams()


def test_base_region_is_four_quarter_ellipses():
    """Oracle: (x / l)^2 + ((y - w_nom) / w)^2 <= 1, by hand."""
    params = reachability.ReachabilityParams(length_backward=0.8)
    inside = (0.0, 0.125), (0.0, 0.8), (0.999, 0.25), (0.6, 0.6), (0.6, 0.15)
    beside = (0.0, 0.124), (0.0, 0.801), (-0.801, 0.25), (0.7, 0.65)
    for points, expected in (inside, True), ((*beside, (-0.6, 0.15)), False):
        for x, y in points:
            assert params.in_base_region(x, y) is expected, (x, y)


def test_the_base_polygon_is_inside_the_ellipse_and_touches_it():
    """Oracle: every vertex is on the ellipse; Fig. 5's extremes are vertices.

    An octagon has 0.9003 of the area of its circle, and so each half here.
    """
    polygon = reachability.base_region(PARAMS)
    assert len(polygon) == 8
    for x, y in polygon:
        assert PARAMS.in_base_region(x, y)
        assert not PARAMS.in_base_region(1.001 * x, 1.001 * (y - 0.25) + 0.25)
    for point in [1.0, 0.25], [-1.0, 0.25], [0.0, 0.125], [0.0, 0.8]:
        assert np.min(np.linalg.norm(polygon - point, axis=1)) < 1e-15
    ellipse = 0.5 * math.pi * (0.55 + 0.125)
    assert area(polygon) == pytest.approx(0.90032 * ellipse, rel=1e-5)


@pytest.mark.parametrize(
    ("region", "first", "length"),
    [
        (reachability.FORWARD, [math.sin(math.radians(20.0)), -0.1], 1.0),
        (reachability.BACKWARD, [-math.sin(math.radians(30.0)), 0.05], -1.0),
    ],
)
def test_the_cross_over_regions_are_slices_of_a_pie(region, first, length):
    """Oracle: Fig. 8 by hand: the tip, the crossed corner, the outer end.

    The corner is w_fwd, or w_bwd, past the centre line, where the ray at
    theta from the y axis through the tip is l sin(theta) from it.
    """
    polygon = reachability.cross_over_region(PARAMS, region)
    assert len(polygon) == 8
    for point in [0.0, 0.25], first, [0.0, 0.8]:
        assert np.min(np.linalg.norm(polygon - point, axis=1)) < 1e-15
    assert np.all(polygon[:, 0] * length > -1e-15)
    assert shapely.Polygon(polygon).exterior.is_ccw
    inward = math.dist([0.0, 0.25], [0.0, first[1]]) / math.sqrt(
        1.0 - first[0] ** 2
    )
    for x, y in polygon[np.linalg.norm(polygon - [0.0, 0.25], axis=1) > 1e-9]:
        width = inward if y < 0.25 else 0.55
        assert x**2 + ((y - 0.25) / width) ** 2 == pytest.approx(1.0)


def test_the_total_region_is_the_hull_and_covers_the_stance_foot():
    """Oracle: shapely's hull of the union."""
    regions = reachability.step_regions(PARAMS, cross_over=True).values()
    union = shapely.union_all([shapely.Polygon(p) for p in regions])
    found = reachability.total_region(PARAMS, cross_over=True)
    total = shapely.Polygon(found)
    assert total.symmetric_difference(union.convex_hull).area < 1e-12
    assert union.area < total.area and contains(np.zeros(2), found)


@pytest.mark.parametrize("swing", list(Side))
def test_regions_lie_on_the_swing_side_of_the_stance_foot(swing):
    """Oracle: a foothold by hand, and back by FootPose.to_sole."""
    stance = FootPose([2.0, -1.0, 0.3], 0.6)
    corners = np.array([[0.3, 0.2], [0.1, 0.5], [-0.2, 0.3]])
    polygon = reachability.in_world(corners, stance, swing)
    assert shapely.Polygon(polygon).exterior.is_ccw
    back = convex_hull(stance.to_sole(polygon) * [1.0, swing.sign])
    assert back == pytest.approx(convex_hull(corners), abs=1e-12)


GRID = st.tuples(st.integers(0, 20), st.integers(-20, 20))
POLYGON = (
    st.lists(GRID, min_size=3, max_size=10)
    .map(lambda points: convex_hull(0.1 * np.array(points)))
    .filter(lambda hull: len(hull) > 2)
)


@given(POLYGON, POLYGON, st.floats(0.01, 1.0), st.floats(0.0, 6.3))
def test_finds_the_closest_point_of_disjoint_polygons(left, right, gap, turn):
    """Oracle: shapely's distance between them, and from the point."""
    R = FootPose(yaw=turn).rotation
    left = (left * [-1.0, 1.0])[::-1] @ R.T
    right = (right + [gap, 0.0]) @ R.T
    point, found = reachability.closest_point(left, right)
    expected = shapely.Polygon(left).distance(shapely.Polygon(right))
    assert found == pytest.approx(expected, abs=1e-12)
    point = shapely.Point(point)
    assert shapely.Polygon(left).distance(point) < 1e-12
    assert shapely.Polygon(right).distance(point) == pytest.approx(expected)
