"""Oracles: shapely, and by hand."""

import numpy as np
import pytest
import shapely
from hypothesis import given

from nadia_balance.core.minkowski_sum import edges, merge, minkowski_sum
from nadia_balance.core.polygon import area, convex_hull
from nadia_balance.core.walking import rectangle
from tests.polygon_examples import POINTS, POLYGON, ROUNDED


@given(
    POINTS.map(convex_hull) | ROUNDED,
    POINTS.map(convex_hull) | ROUNDED,
)
def test_the_minkowski_sum_is_the_hull_of_all_sums(first, second):
    """Oracle: the hull of the sums of all pairs of vertices, by shapely."""
    pairs = (first[:, None] + second).reshape(-1, 2)
    expected = shapely.MultiPoint(pairs).convex_hull
    total = minkowski_sum(first, second)
    ours = shapely.MultiPoint(total).convex_hull
    # Edges that are parallel but for 1e-16 m^2 are merged.
    assert ours.hausdorff_distance(expected) < 1e-7
    assert len(total) <= len(first) + len(second)


@given(POLYGON, POLYGON)
def test_the_minkowski_sum_is_counter_clockwise(first, second):
    """Oracle: the shoelace formula is positive and that of shapely."""
    total = minkowski_sum(first, second)
    assert area(total) == pytest.approx(shapely.Polygon(total).area)
    assert shapely.Polygon(total).exterior.is_ccw


def test_a_point_moves_and_a_line_stretches_a_square():
    """Oracle: by hand."""
    square = convex_hull(rectangle(2.0, 2.0))
    moved = minkowski_sum(square, np.array([[5.0, 7.0]]))
    np.testing.assert_array_equal(convex_hull(moved), square + [5.0, 7.0])
    line = np.array([[0.0, 0.0], [3.0, 0.0]])
    for total in minkowski_sum(square, line), minkowski_sum(line, square):
        expected = convex_hull(rectangle(5.0, 2.0) + [1.5, 0.0])
        np.testing.assert_array_equal(convex_hull(total), expected)
        assert len(total) == 4


@given(POLYGON)
def test_the_edges_go_round_from_the_lowest_vertex(polygon):
    """Oracle: the vertices, the lowest and leftmost first; edges lead on."""
    found = np.array(edges(polygon))
    starts, ways = found[:, :2], found[:, 2:]
    first = min(polygon.tolist(), key=lambda vertex: (vertex[1], vertex[0]))
    assert starts[0].tolist() == first
    assert {*map(tuple, starts)} == {*map(tuple, polygon)}
    np.testing.assert_allclose(
        starts + ways, np.roll(starts, -1, axis=0), atol=1e-15
    )


@given(POLYGON, POLYGON)
def test_edges_can_be_merged_in_any_order(first, second):
    """Oracle: the sum with the two polygons the other way round."""
    a, b = edges(first), edges(second)
    np.testing.assert_array_equal(merge(b, a), merge(a, b))
