"""Convex polygons in the plane: (n, 2) vertices [m], counter-clockwise.

Plain Python loops, as they run in every control tick: at four vertices they
take half of shapely's time.
"""

import itertools
import math
from collections.abc import Iterable

import numpy as np

from nadia_balance.core.math.arrays import Array

Point = tuple[float, float]
Halfspaces = tuple[Array, Array]  # A (k, 2), b (k,) with A p <= b

# Tolerances, far below relevant sizes and far above rounding errors:
_FLAT = 1e-12  # a triangle of half this area [m^2] is a line
_COINCIDENT = 1e-9  # vertices closer than this [m] are one
_PARALLEL = 1e-16  # edges with this cross product [m^2] have one direction

_NOTHING = np.empty((0, 2))


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
    """The convex hull of points.

    Args:
        points: points (n, 2) [m].

    Returns:
        Vertices (k, 2) [m], counter-clockwise and strictly convex: one if all
        points coincide, two if they are on one line.

    Raises:
        ValueError: NaN or infinity.
    """
    return as_array(hull([(x, y) for x, y in points.tolist()]))


def hull(points: Iterable[Point]) -> list[Point]:
    """The convex hull of few points, by Andrew's monotone chain.

    Args:
        points: points [m].

    Returns:
        Vertices [m], as of `convex_hull`.

    Raises:
        ValueError: NaN or infinity.
    """
    ordered = sorted(set(points))
    if not math.isfinite(sum(itertools.chain.from_iterable(ordered))):
        raise ValueError(f"points = {ordered}: must be finite")
    if len(ordered) < 3:
        return ordered
    vertices = _half_hull(ordered)[:-1] + _half_hull(reversed(ordered))[:-1]
    if _area(vertices) > _FLAT:
        return vertices
    # A line up to rounding: its ends.
    pairs = itertools.combinations(vertices, 2)
    return list(max(pairs, key=lambda ends: math.dist(*ends)))


def _half_hull(ordered: Iterable[Point]) -> list[Point]:
    """Returns the right-hand boundary along the direction of `ordered`."""
    chain: list[Point] = []
    for x, y in ordered:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2:]
            ux, uy = bx - ax, by - ay
            turn = ux * (y - ay) - uy * (x - ax)
            # On a line that is vertical up to rounding, b may be beyond p.
            if turn > _FLAT or (
                turn > 0.0 and ux * (x - bx) + uy * (y - by) < 0.0
            ):
                break
            chain.pop()
        chain.append((x, y))
    return chain


def _edges(polygon: Array) -> Iterable[tuple[Point, Point]]:
    """Returns the (start, end) pairs of all edges, in order."""
    vertices: list[Point] = polygon.tolist()
    return zip(vertices, vertices[1:] + vertices[:1], strict=True)


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
    if len(polygon) < 3:
        raise ValueError(f"{len(polygon)} vertices: a polygon needs 3 or more")
    normals, offsets = [], []
    for (x0, y0), (x1, y1) in _edges(polygon):
        length = math.hypot(x1 - x0, y1 - y0)
        nx, ny = (y1 - y0) / length, (x0 - x1) / length
        normals.append((nx, ny))
        offsets.append(nx * x0 + ny * y0)
    return as_array(normals), np.array(offsets)


def contains(point: Array, polygon: Array, tolerance: float = 0.0) -> bool:
    """Whether a point is in a polygon.

    Args:
        point: point (2,) [m].
        polygon: vertices (n, 2) [m]; also of a point or a line.
        tolerance: largest distance from the polygon [m].

    Returns:
        True if it is inside, or on an edge.
    """
    if len(polygon) < 3:
        return bool(
            np.linalg.norm(point - project(point, polygon)) <= tolerance
        )
    x, y = float(point[0]), float(point[1])
    for (ax, ay), (bx, by) in _edges(polygon):
        ux, uy = bx - ax, by - ay
        turn = ux * (y - ay) - uy * (x - ax)
        if not turn >= -tolerance * math.hypot(ux, uy):
            return False
    return True


def project(point: Array, polygon: Array) -> Array:
    """Minimises |p - point| subject to p in the polygon.

    Args:
        point: point (2,) [m].
        polygon: vertices (n, 2) [m]; also of a point or a line.

    Returns:
        The closest point p (2,) [m].
    """
    if len(polygon) > 2 and contains(point, polygon):
        return point
    p = (float(point[0]), float(point[1]))
    candidates = [_project_on_segment(p, a, b) for a, b in _edges(polygon)]
    return np.array(min(candidates, key=lambda c: math.dist(c, p)))


def _project_on_segment(p: Point, a: Point, b: Point) -> Point:
    dx, dy = b[0] - a[0], b[1] - a[1]
    squared = dx * dx + dy * dy
    if squared == 0.0:
        return a
    along = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / squared
    along = min(max(along, 0.0), 1.0)
    return a[0] + along * dx, a[1] + along * dy


def centroid(polygon: Array) -> Array:
    """The centroid of a polygon.

    Args:
        polygon: vertices (n, 2) [m].

    Returns:
        Centroid (2,) [m]; the mean vertex if the area is 0.
    """
    origin = polygon[0]
    area, x, y = 0.0, 0.0, 0.0
    for a, b in _edges(polygon - origin):
        cross = a[0] * b[1] - a[1] * b[0]
        area += cross
        x += (a[0] + b[0]) * cross
        y += (a[1] + b[1]) * cross
    if area <= _FLAT:
        return np.asarray(polygon.mean(axis=0))
    return np.array([origin[0] + x / (3 * area), origin[1] + y / (3 * area)])


def area(polygon: Array) -> float:
    """The area of a polygon.

    Args:
        polygon: vertices (n, 2) [m].

    Returns:
        Area [m^2]; 0 for fewer than three vertices.
    """
    return _area(polygon.tolist())


def _area(vertices: list[Point]) -> float:
    if len(vertices) < 3:
        return 0.0
    (x0, y0), (x, y), *others = vertices
    twice, ux, uy = 0.0, x - x0, y - y0
    for x, y in others:
        vx, vy = x - x0, y - y0
        twice += ux * vy - uy * vx
        ux, uy = vx, vy
    return 0.5 * twice


def _clip(
    vertices: list[Point], nx: float, ny: float, offset: float
) -> list[Point]:
    """Returns the part with n . p <= offset (Sutherland-Hodgman clipping)."""
    kept: list[Point] = []
    if not vertices:
        return kept
    x0, y0 = vertices[-1]
    over0 = nx * x0 + ny * y0 - offset
    for x, y in vertices:
        over = nx * x + ny * y - offset
        if over0 * over < 0.0:
            s = over0 / (over0 - over)
            kept.append((x0 + s * (x - x0), y0 + s * (y - y0)))
        if over <= 0.0:
            kept.append((x, y))
        x0, y0, over0 = x, y, over
    return kept


def clip_all(polygon: Array, A: Array, b: Array) -> Array:
    """The part {p in polygon : A p <= b}.

    Args:
        polygon: vertices (n, 2) [m].
        A: normals (k, 2) [-], as of `halfspaces`.
        b: offsets (k,) [m].

    Returns:
        Vertices (m, 2) [m]; (0, 2) if no area is left.
    """
    excess = polygon @ A.T - b
    if not len(polygon) or excess.min(axis=0).max() >= 0.0:
        return _NOTHING
    cutting = (excess.max(axis=0) > 0.0).nonzero()[0]
    vertices = polygon.tolist()
    for (nx, ny), offset in zip(
        A[cutting].tolist(), b[cutting].tolist(), strict=True
    ):
        vertices = _clip(vertices, nx=nx, ny=ny, offset=offset)
    # An edge between nearly coincident vertices would have no direction.
    part = [
        p
        for p, q in zip(vertices, vertices[-1:] + vertices[:-1], strict=True)
        if abs(p[0] - q[0]) + abs(p[1] - q[1]) > _COINCIDENT
    ]
    return as_array(part) if _area(part) > _FLAT else _NOTHING


def intersection(first: Array, second: Array) -> Array:
    """The intersection of two polygons.

    Args:
        first: vertices (n, 2) [m].
        second: vertices (k, 2) [m], at least 3.

    Returns:
        Vertices (m, 2) [m]; (0, 2) if it has no area.
    """
    return clip_all(first, *halfspaces(second))


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
    total: list[Point] = []
    others, edges = _from_lowest(first), _from_lowest(second)
    j = 0
    for ax, ay, ux, uy in others:
        while j < len(edges):
            bx, by, vx, vy = edges[j]
            total.append((ax + bx, ay + by))
            turn = ux * vy - uy * vx
            if turn <= _PARALLEL:
                j += 1
            if turn >= -_PARALLEL:
                break
        else:  # the second polygon is complete
            bx, by, *_ = edges[0]
            total.append((ax + bx, ay + by))
    ax, ay, *_ = others[0]
    total += [(ax + bx, ay + by) for bx, by, _, _ in edges[j:]]
    return as_array(total)


def _from_lowest(polygon: Array) -> list[tuple[float, float, float, float]]:
    """Returns vertices x, y [m] and vectors dx, dy [m] to the next ones.

    They begin with the lowest vertex; of several, with the leftmost.
    """
    vertices: list[Point] = polygon.tolist()
    upright = [(y, x) for x, y in vertices]
    k = upright.index(min(upright))
    starts = vertices[k:] + vertices[:k]
    return [
        (x, y, u - x, v - y)
        for (x, y), (u, v) in zip(starts, starts[1:] + starts[:1], strict=True)
    ]
