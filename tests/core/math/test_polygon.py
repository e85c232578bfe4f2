"""Oracles: shapely, by hand, and the same loops in Python."""

import math
from itertools import permutations

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from nadia_balance.core.math import polygon
from nadia_balance.core.math.arrays import rectangle
from tests.core.math import python_polygons as python

# On a grid of 1 cm, so that many are on one line or coincide, while no
# triangle is so flat that its orientation is a matter of rounding.
GRID = st.tuples(st.integers(-30, 30), st.integers(-30, 30))
POINT = GRID.map(lambda p: 0.01 * np.array(p))
POINTS = st.lists(GRID, min_size=1, max_size=12).map(
    lambda points: 0.01 * np.array(points)
)
POLYGON = POINTS.map(polygon.convex_hull).filter(lambda hull: len(hull) > 2)
FLOAT = st.floats(-1.0, 1.0, allow_subnormal=False)
ROUNDED = st.lists(st.tuples(FLOAT, FLOAT), min_size=3, max_size=12).map(
    lambda points: polygon.convex_hull(np.array(points))
)


@given(POINTS)
def test_the_hull_is_that_of_shapely_with_true_corners_only(points):
    """Oracles: shapely's boundary; every three vertices in a row turn left.

    Of points on a line there are the ends, of one point itself.
    """
    hull = polygon.convex_hull(points)
    expected = shapely.MultiPoint(points).convex_hull
    ours = shapely.MultiPoint(hull).convex_hull
    assert ours.hausdorff_distance(expected) < 1e-12
    if len(hull) < 3:
        assert len(hull) == min(len(np.unique(points, axis=0)), 2)
        return
    before, after = np.roll(hull, 1, axis=0), np.roll(hull, -1, axis=0)
    u, v = (hull - before).T, (after - hull).T
    assert np.all(u[0] * v[1] - u[1] * v[0] > 1e-5)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [0, 4, 9])
def test_no_hull_of_what_is_not_finite(value, place):
    """Oracle: the message has the value; wherever it is, inside or outside."""
    points = np.array([[0, 0], [1, 0], [0.4, 0.5], [1, 1], [0, 1]], float)
    points.flat[place] = value
    with pytest.raises(ValueError, match=rf"{value}.*: must be finite"):
        polygon.convex_hull(points)


@given(
    st.lists(
        st.tuples(st.integers(-3, 3), st.sampled_from([0.0, 0.3, 0.7, 1.0])),
        min_size=3,
        max_size=9,
    ),
    st.booleans(),
)
def test_the_hull_is_right_where_an_edge_is_upright_but_for_rounding(
    points, across
):
    """Oracle: shapely's hull, of two columns or rows that are not straight."""
    jitter, heights = np.array(points).T
    columns = np.where(heights > 0.5, 0.11, 0.3) + 1e-17 * jitter
    points = np.column_stack([columns, np.sin(40.0 * heights)])
    points = points[:, ::-1] if across else points
    hull = polygon.convex_hull(points)
    expected = shapely.MultiPoint(points).convex_hull
    ours = shapely.MultiPoint(hull).convex_hull
    assert ours.hausdorff_distance(expected) < 1e-9
    assert len(hull) < 3 or polygon.area(hull) > 1e-12


@given(POLYGON, POINT)
def test_halfspaces_measure_how_far_outside_a_point_is(hull, point):
    """Oracle: the definition of a convex polygon, edge by edge."""
    A, b = polygon.halfspaces(hull)
    np.testing.assert_allclose(np.linalg.norm(A, axis=1), 1.0, atol=1e-15)
    ends = np.roll(hull, -1, axis=0)
    for vertex in hull, ends:  # both ends of each edge are on its line
        on_line = np.einsum("ij,ij->i", A, vertex)
        np.testing.assert_allclose(on_line, b, atol=1e-15)
    inside = shapely.Polygon(hull).distance(shapely.Point(point)) < 1e-12
    assert np.all(A @ point <= b + 1e-12) == inside


@pytest.mark.parametrize("n", [1, 2])
def test_no_halfspaces_without_an_inside(n):
    """Oracle: the message tells the number of vertices."""
    with pytest.raises(ValueError, match=f"{n} vertices"):
        polygon.halfspaces(np.eye(2)[:n])


@given(POINTS.map(polygon.convex_hull), POINT, st.floats(1e-9, 0.1))
def test_contains_the_points_within_the_tolerance(hull, point, tolerance):
    """Oracle: shapely's distance; beyond the corners it may be more."""
    shape = shapely.MultiPoint(hull).convex_hull
    distance = shape.distance(shapely.Point(point))
    found = polygon.contains(point, hull, tolerance)
    if distance <= tolerance - 1e-12:
        assert found
    if len(hull) > 2:
        A, b = polygon.halfspaces(hull)
        assume(abs(np.max(A @ point - b) - tolerance) > 1e-12)
        assert found == (np.max(A @ point - b) <= tolerance)


@given(POINTS.map(polygon.convex_hull), POINT)
def test_projects_to_the_closest_point(hull, point):
    """Oracle: shapely's distance to, and from, the projection."""
    shape = shapely.MultiPoint(hull).convex_hull
    projection = polygon.project(point, hull)
    expected = shape.distance(shapely.Point(point))
    assert math.dist(projection, point) == pytest.approx(expected, abs=1e-12)
    assert shape.distance(shapely.Point(projection)) < 1e-12


@given(POLYGON, st.floats(0.001, 0.1))
def test_shrinks_like_shapely_or_refuses(hull, distance):
    """Oracle: shapely's inward buffer with mitred corners."""
    expected = shapely.Polygon(hull).buffer(-distance, join_style="mitre")
    assume(expected.is_empty or expected.area > 1e-8)
    if expected.is_empty:
        with pytest.raises(ValueError, match=f"distance = {distance}"):
            polygon.shrink(hull, distance)
        return
    inner = shapely.Polygon(polygon.shrink(hull, distance))
    assert inner.symmetric_difference(expected).area < 1e-9


@given(POINTS.map(polygon.convex_hull))
def test_area_and_centroid_are_those_of_shapely(hull):
    """Oracle: shapely, also for a line or a point."""
    expected = shapely.MultiPoint(hull).convex_hull
    assert polygon.area(hull) == pytest.approx(expected.area, abs=1e-15)
    middle = np.ravel(expected.centroid.coords)
    np.testing.assert_allclose(polygon.centroid(hull), middle, atol=1e-12)


@given(POLYGON | ROUNDED.filter(lambda hull: len(hull) > 2), POLYGON)
def test_intersects_like_shapely(first, second):
    """Oracle: shapely, up to the vertices that count as one."""
    expected = shapely.Polygon(first).intersection(shapely.Polygon(second))
    shared = polygon.intersection(first, second)
    assert polygon.area(shared) == pytest.approx(expected.area, abs=1e-8)
    if len(shared):
        difference = shapely.Polygon(shared).symmetric_difference(expected)
        assert difference.area < 1e-8


def test_polygons_that_only_touch_share_nothing():
    """Oracle: by hand: two squares with a common side, and a common corner."""
    square = rectangle(1.0, 1.0)
    for shift in [1.0, 0.0], [1.0, 1.0], [1.0 - 1e-13, 0.0]:
        assert polygon.intersection(square, square + shift).shape == (0, 2)


@given(*[POINTS.map(polygon.convex_hull) | ROUNDED] * 2)
def test_the_minkowski_sum_is_the_hull_of_all_sums(first, second):
    """Oracle: the hull of the sums of all pairs of vertices, by shapely."""
    pairs = (first[:, None] + second).reshape(-1, 2)
    expected = shapely.MultiPoint(pairs).convex_hull
    total = polygon.minkowski_sum(first, second)
    assert len(total) < 3 or shapely.Polygon(total).exterior.is_ccw
    ours = shapely.MultiPoint(total).convex_hull
    # Edges that are parallel but for 1e-16 m^2 are merged.
    assert ours.hausdorff_distance(expected) < 1e-7
    assert len(total) <= len(first) + len(second)


# Points that are anywhere, on a grid, and but for rounding on one line.
ORDINARY = FLOAT.filter(lambda x: x == 0.0 or abs(x) > 1e-100)
ANYWHERE = st.lists(st.tuples(ORDINARY, ORDINARY), min_size=1, max_size=12)
NEARLY_ON_A_LINE = st.lists(
    st.tuples(
        st.integers(-3, 3).map(lambda k: 0.3 + 1e-17 * k),
        st.sampled_from([-0.3, 0.0, -0.0, 0.1, 0.7, 0.7 + 1e-9]),
    ),
    min_size=1,
    max_size=9,
)
CLOUD = POINTS | (ANYWHERE | NEARLY_ON_A_LINE).map(np.array)


def same_bits(ours, expected):
    """Equal shapes and numbers; the signs of zeros, too."""
    ours, expected = np.asarray(ours), np.asarray(expected)
    return ours.shape == expected.shape and ours.tobytes() == expected.tobytes()


@given(CLOUD, POINT | ANYWHERE.map(lambda points: np.array(points[0])), FLOAT)
def test_what_is_compiled_has_the_bits_of_python(points, point, tolerance):
    """Oracle: the same loops in Python."""
    hull = polygon.convex_hull(points)
    assert same_bits(hull, python.convex_hull(points))
    expected = python.project(point, hull)
    assert same_bits(polygon.project(point, hull), expected)
    assert same_bits(polygon.area(hull), python.area(hull))
    assert same_bits(polygon.centroid(hull), python.centroid(hull))
    inside = python.contains(point, hull, tolerance)
    assert polygon.contains(point, hull, tolerance) == inside
    if len(hull) > 2:
        (A, b), (normals, offsets) = (
            polygon.halfspaces(hull),
            python.halfspaces(hull),
        )
        assert same_bits(A, normals) and same_bits(b, offsets)


@given(*[CLOUD.map(polygon.convex_hull)] * 2, POINT)
def test_two_polygons_have_the_bits_of_python(first, second, shift):
    """Oracle: the same loops in Python; gaps by numpy's complex numbers."""
    expected = python.minkowski_sum(first, second)
    assert same_bits(polygon.minkowski_sum(first, second), expected)
    if len(second) < 3:
        return
    second = second + shift
    A, b = polygon.halfspaces(second)
    expected = python.clip_all(first, A, b)
    assert same_bits(polygon.clip_all(first, A, b), expected)
    assert same_bits(polygon.intersection(first, second), expected)
    if len(first) > 2 and not len(expected):
        ours, gap = polygon.closest_point(first, second)
        numpys, expected = python.closest_point(first, second)
        assert gap == pytest.approx(expected, rel=1e-12, abs=1e-15)
        # Parallel edges have more than one closest point.
        assert math.dist(ours, polygon.project(ours, second)) <= gap + 1e-15


@pytest.mark.parametrize("kind", [int, np.float32, "transposed", list])
def test_whatever_numbers_are_in_memory(kind):
    """Oracle: the same polygon as C has it."""
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 3.0], [0.0, 3.0]])
    if kind == "transposed":
        given = np.ascontiguousarray(square.T).T
    else:
        given = square.tolist() if kind is list else square.astype(kind)
    assert polygon.area(given) == 6.0
    assert same_bits(polygon.convex_hull(given), polygon.convex_hull(square))


def test_normals_and_offsets_are_as_many():
    """Oracle: the message."""
    with pytest.raises(ValueError, match="4 normals, 3 offsets"):
        polygon.clip_all(rectangle(1.0, 1.0), np.ones((4, 2)), np.ones(3))


def test_a_gap_is_that_of_polygons_with_edges():
    """Oracle: the message: a point is no polygon; see `project`."""
    for pair in permutations([rectangle(1.0, 1.0), np.array([[3.0, 0.5]])]):
        with pytest.raises(ValueError, match="1 vertices: must be 2 or more"):
            polygon.closest_point(*pair)


@pytest.mark.parametrize(
    "of_nothing",
    [
        lambda none: polygon.contains(np.zeros(2), none),
        lambda none: polygon.project(np.zeros(2), none),
        lambda none: polygon.centroid(none),
        lambda none: polygon.closest_point(rectangle(1.0, 1.0), none),
        lambda none: polygon.minkowski_sum(none, rectangle(1.0, 1.0)),
    ],
)
def test_nothing_is_asked_of_no_vertices(of_nothing):
    """Oracle: the message; and of no points, the hull has none."""
    none = np.empty((0, 2))
    with pytest.raises(ValueError, match=r"0 vertices: must be [12] or more"):
        of_nothing(none)
    assert polygon.convex_hull(none).shape == (0, 2)
    assert polygon.clip_all(none, np.eye(2), np.ones(2)).shape == (0, 2)
    assert polygon.area(none) == 0.0
