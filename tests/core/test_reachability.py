"""Oracles: the paper's figures by hand; shapely; the other side's mirror."""

import math

import numpy as np
import pytest
import shapely

from nadia_balance.core.polygon import area, contains, convex_hull
from nadia_balance.core.reachability import (
    BACKWARD,
    BASE,
    FORWARD,
    ReachabilityParams,
    base_region,
    circle,
    cross_over_region,
    in_world,
    step_regions,
    total_region,
)
from nadia_balance.core.walking import FootPose, Side

PARAMS = ReachabilityParams(cross_over=True)
TRIANGLE = [[0.4, 0.2], [0.0, 0.5], [-0.4, 0.2]]


@pytest.mark.parametrize(
    ("x", "y", "inside"),
    [
        (0.0, 0.125, True),
        (0.0, 0.124, False),
        (0.0, 0.8, True),
        (0.0, 0.801, False),
        (0.999, 0.25, True),
        (-1.001, 0.25, False),
        (0.7, 0.65, False),
        (0.6, 0.6, True),
    ],
)
def test_base_region_is_four_quarter_ellipses(x, y, inside):
    """Oracle: (x / l)^2 + ((y - w_nom) / w)^2 <= 1."""
    assert ReachabilityParams().in_base_region(x, y) is inside


def test_the_base_polygon_is_inside_the_ellipse_and_touches_it():
    """Oracle: every vertex is on the ellipse; Fig. 5's extremes are vertices.

    An octagon has 0.9003 of the area of its circle, and so each half here.
    """
    polygon = base_region(PARAMS)
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
        (FORWARD, [math.sin(math.radians(20.0)), -0.1], 1.0),
        (BACKWARD, [-math.sin(math.radians(30.0)), 0.05], -1.0),
    ],
)
def test_the_cross_over_regions_are_slices_of_a_pie(region, first, length):
    """Oracle: Fig. 8 by hand: the tip, the crossed corner, the outer end.

    The corner is w_fwd, or w_bwd, past the centre line, where the ray at
    theta from the y axis through the tip is l sin(theta) from it.
    """
    polygon = cross_over_region(PARAMS, region)
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


def test_the_cross_over_regions_are_mirror_images_but_for_their_numbers():
    """Oracle: with the same numbers front and back, x changes sign."""
    alike = ReachabilityParams(width_backward=0.1, theta_backward_deg=20.0)
    front, back = (
        shapely.Polygon(cross_over_region(alike, region) * [sign, 1.0])
        for region, sign in ((FORWARD, 1.0), (BACKWARD, -1.0))
    )
    assert front.symmetric_difference(back).area < 1e-15


def test_without_cross_over_there_is_only_the_base_region():
    """Oracle: the names."""
    assert list(step_regions(ReachabilityParams())) == [BASE]
    assert list(step_regions(PARAMS)) == [BASE, FORWARD, BACKWARD]


def test_the_total_region_is_the_hull_and_covers_the_stance_foot():
    """Oracle: shapely's hull of the union."""
    union = shapely.union_all(
        [shapely.Polygon(p) for p in step_regions(PARAMS).values()]
    )
    total = shapely.Polygon(total_region(PARAMS))
    assert total.symmetric_difference(union.convex_hull).area < 1e-12
    assert union.area < total.area
    assert contains(np.zeros(2), total_region(PARAMS))


def test_the_base_region_can_be_any_convex_polygon():
    """Oracle: the polygon; a point in each of its parts."""
    params = ReachabilityParams(base_polygon=TRIANGLE)
    params.validate()
    assert shapely.Polygon(base_region(params)).equals(
        shapely.Polygon(TRIANGLE)
    )
    assert params.in_base_region(0.0, 0.45)
    assert params.in_base_region(0.4, 0.2)
    assert not params.in_base_region(0.3, 0.45)
    assert str(TRIANGLE) in params.describe()


def test_a_circle_is_drawn_from_inside():
    """Oracle: the radius, and the area of the regular polygon."""
    polygon = circle(2.0, 16)
    np.testing.assert_allclose(np.linalg.norm(polygon, axis=1), 2.0)
    expected = 0.5 * 16 * 4.0 * math.sin(2.0 * math.pi / 16)
    assert area(polygon) == pytest.approx(expected)


@pytest.mark.parametrize("swing", list(Side))
def test_regions_lie_on_the_swing_side_of_the_stance_foot(swing):
    """Oracle: a foothold by hand, and back by FootPose.to_sole."""
    stance = FootPose([2.0, -1.0, 0.3], 0.6)
    corners = np.array([[0.3, 0.2], [0.1, 0.5], [-0.2, 0.3]])
    polygon = in_world(corners, stance, swing)
    assert shapely.Polygon(polygon).exterior.is_ccw
    back = stance.to_sole(polygon) * [1.0, swing.sign]
    np.testing.assert_allclose(
        convex_hull(back), convex_hull(corners), atol=1e-12
    )


@pytest.mark.parametrize(
    "bad",
    [
        {"width_min": 0.3},
        {"length_forward": -1.0},
        {"return_share": 0.0},
        {"return_share": math.nan},
        {"length_backward": math.nan},
        {"width_max": 0.2},
        {"width_forward": -0.25},
        {"width_backward": math.inf},
        {"theta_forward_deg": 85.0},
        {"theta_backward_deg": math.nan},
        {"base_polygon": [[0.0, 0.1], [1.0, 0.2]]},
        {"base_polygon": [[0.0, 0.1], [1.0], [0.5, 0.5]]},
        {"base_polygon": [[0.0, 0.1], [1.0, math.nan], [0.5, 0.5]]},
        {"base_polygon": [[0, 0], [1, 0], [1, 1], [0.9, 0.1]]},
    ],
)
def test_refuses_bad_parameters(bad):
    """Oracle: the message names field and value."""
    (name, value), *_ = bad.items()
    with pytest.raises(ValueError) as error:
        ReachabilityParams(**bad).validate()
    assert str(value) in str(error.value)
    assert name in str(error.value)
