"""Convex polygons in the plane: (n, 2) vertices [m], counter-clockwise.

They run in every control tick: the loops are compiled, in geometry.c.  Their
results are those of the same loops in Python to the last bit.  Decisions
between candidates that are equal but for rounding do not depend on the
processor, as those of numpy's matrix product and complex numbers do.
"""

import ctypes
import itertools
from collections.abc import Iterable
from typing import Any

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.geometry import FLOAT, doubles, library, room

Point = tuple[float, float]
Halfspaces = tuple[Array, Array]  # A (k, 2), b (k,) with A p <= b

_POINT = 16  # bytes


def as_array(points: list[Point]) -> Array:
    """Points as an array, twice as fast as by np.array.

    Args:
        points: n points [m].

    Returns:
        Array (n, 2) [m].
    """
    # np.array treats each pair as a sequence.
    return np.fromiter(
        itertools.chain.from_iterable(points), float, 2 * len(points)
    ).reshape(-1, 2)


def convex_hull(points: Array) -> Array:
    """The convex hull of points, by Andrew's monotone chain.

    Args:
        points: points (n, 2) [m].

    Returns:
        Vertices (k, 2) [m], counter-clockwise and strictly convex: one if all
        points coincide, two if they are on one line.

    Raises:
        ValueError: NaN or infinity.
    """
    data = doubles(points)
    n = len(data) // _POINT
    vertices = room(6 * n)
    count = library.hull(data, n, vertices)
    if count < 0:
        raise ValueError(f"points = {points.tolist()}: must be finite")
    return np.ndarray((count, 2), FLOAT, vertices)


def hull(points: Iterable[Point]) -> list[Point]:
    """The convex hull of few points.

    Args:
        points: points [m].

    Returns:
        Vertices [m], as of `convex_hull`.

    Raises:
        ValueError: NaN or infinity.
    """
    return [(x, y) for x, y in convex_hull(as_array(list(points))).tolist()]


def halfspaces(polygon: Array) -> Halfspaces:
    """The half-spaces whose intersection {p : A p <= b} is the polygon.

    Args:
        polygon: vertices (n, 2) [m].

    Returns:
        A (n, 2) [-], the unit outward normals of the edges, and b (n,) [m]:
        b - d describes the polygon shrunk by d.

    Raises:
        ValueError: fewer than 3 vertices, so no interior.
    """
    vertices = doubles(polygon)
    n = _size(vertices, least=3)
    result = room(3 * n)
    library.halfspaces(vertices, n, result)
    A: Array = np.ndarray((n, 2), FLOAT, result)
    b: Array = np.ndarray(n, FLOAT, result, n * _POINT)
    return A, b


def _size(vertices: bytes, least: int = 1) -> int:
    n = len(vertices) // _POINT
    if n < least:
        raise ValueError(f"{n} vertices: must be {least} or more")
    return n


def contains(point: Array, polygon: Array, tolerance: float = 0.0) -> bool:
    """Whether a point is in a polygon.

    Args:
        point: point (2,) [m].
        polygon: vertices (n, 2) [m]; also of a point or a line.
        tolerance: by which its edges are moved outward [m].

    Returns:
        True if it is inside, or on an edge.
    """
    vertices = doubles(polygon)
    n = _size(vertices)
    limit = ctypes.c_double(tolerance)
    return bool(library.contains(doubles(point), vertices, n, limit))


def project(point: Array, polygon: Array) -> Array:
    """Minimises |p - point| subject to p in the polygon.

    Args:
        point: point (2,) [m].
        polygon: vertices (n, 2) [m]; also of a point or a line.

    Returns:
        The closest point p (2,) [m].
    """
    vertices = doubles(polygon)
    result = room(2)
    library.project(doubles(point), vertices, _size(vertices), result)
    return np.ndarray(2, FLOAT, result)


def closest_point(polygon: Array, other: Array) -> tuple[Array, float]:
    """Minimises |p - q| subject to p in a polygon, q in another one.

    The convex polygons must be disjoint.  One end of the gap is a vertex, so
    the vertices of each are projected onto all edges of the other.

    Args:
        polygon: vertices (n, 2) [m], at least 2.
        other: vertices (k, 2) [m], at least 2.

    Returns:
        The point p (2,) [m], and the gap [m].

    Raises:
        ValueError: a polygon without edges.
    """
    one, two = doubles(polygon), doubles(other)
    n, k = _size(one, least=2), _size(two, least=2)
    p = room(2)
    gap: float = library.closest_point(one, n, two, k, p)
    return np.ndarray(2, FLOAT, p), gap


def centroid(polygon: Array) -> Array:
    """The centroid of a polygon.

    Args:
        polygon: vertices (n, 2) [m].

    Returns:
        Centroid (2,) [m]; the mean vertex if the area is 0.
    """
    vertices = doubles(polygon)
    result = room(2)
    library.centroid(vertices, _size(vertices), result)
    return np.ndarray(2, FLOAT, result)


def area(polygon: Array) -> float:
    """The area of a polygon.

    Args:
        polygon: vertices (n, 2) [m].

    Returns:
        Area [m^2]; 0 for fewer than three vertices.
    """
    vertices = doubles(polygon)
    size: float = library.area(vertices, len(vertices) // _POINT)
    return size


def clip_all(polygon: Array, A: Array, b: Array) -> Array:
    """The part {p in polygon : A p <= b}.

    Args:
        polygon: vertices (n, 2) [m].
        A: normals (k, 2) [-], as of `halfspaces`.
        b: offsets (k,) [m].

    Returns:
        Vertices (m, 2) [m]; (0, 2) if no area is left.

    Raises:
        ValueError: not as many normals as offsets, or far from convex.
    """
    vertices, normals, offsets = doubles(polygon), doubles(A), doubles(b)
    n, k = len(vertices) // _POINT, len(normals) // _POINT
    if 2 * len(offsets) != len(normals):
        raise ValueError(f"{k} normals, {len(b)} offsets: must be as many")
    limit = 2 * (n + k)
    part = room(4 * limit)
    return _part(
        library.clip_all(vertices, n, normals, offsets, k, part, limit), part
    )


def _part(count: int, part: Any) -> Array:
    if count < 0:
        raise ValueError("polygon: must be convex")
    return np.ndarray((count, 2), FLOAT, part)


def intersection(first: Array, second: Array) -> Array:
    """The intersection of two polygons.

    Args:
        first: vertices (n, 2) [m].
        second: vertices (k, 2) [m], at least 3.

    Returns:
        Vertices (m, 2) [m]; (0, 2) if it has no area.
    """
    one, other = doubles(first), doubles(second)
    n, k = len(one) // _POINT, _size(other, least=3)
    limit = 2 * (n + k)
    part = room(4 * limit + 3 * k)
    return _part(library.intersection(one, n, other, k, part, limit), part)


def shrink(polygon: Array, distance: float, name: str = "distance") -> Array:
    """The polygon of all points at least `distance` inside.

    Args:
        polygon: vertices (n, 2) [m].
        distance: from all edges [m].
        name: what the message calls the distance.

    Returns:
        Vertices (k, 2) [m].

    Raises:
        ValueError: no area is left.
    """
    A, b = halfspaces(polygon)
    inner = convex_hull(clip_all(polygon, A, b - distance))
    if len(inner) < 3:
        raise ValueError(f"{name} = {distance}: must leave some of the polygon")
    return inner


def minkowski_sum(first: Array, second: Array) -> Array:
    """The polygon {p + q : p in first, q in second}.

    Both are counter-clockwise and strictly convex, as from `convex_hull`; one
    may be a single point or a line.

    Args:
        first: vertices (n, 2) [m].
        second: vertices (k, 2) [m].

    Returns:
        Vertices (m, 2) [m].
    """
    one, other = doubles(first), doubles(second)
    n, k = _size(one), _size(other)
    total = room(2 * (n + k))
    count = library.minkowski_sum(one, n, other, k, total)
    return np.ndarray((count, 2), FLOAT, total)
