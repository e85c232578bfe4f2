"""Convex polygons in the plane: (n, 2) vertices [m], counter-clockwise.

Plain Python loops on purpose: at four to eight vertices they are several
times faster than numpy or shapely, and they run in every control tick.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import numpy as np

from nadia_balance.core.walking import Array

_Point = tuple[float, float]

# Far below what matters, far above rounding:
_FLAT = 1e-12  # a triangle of half this area [m^2] is a line
_PARALLEL = 1e-16  # edges with this cross product [m^2] have one direction
_COINCIDENT = 1e-9  # vertices closer than this [m] are one

_NOTHING = np.empty((0, 2))


def convex_hull(points: Array) -> Array:
    """Returns the hull of `points` (n, 2): counter-clockwise, strictly convex.

    Andrew's monotone chain.  One vertex if all points coincide, two if they
    are on one line.
    """
    ordered = sorted({(x, y) for x, y in points.tolist()})
    if len(ordered) < 3:
        return np.array(ordered)
    lower, upper = _half_hull(ordered), _half_hull(reversed(ordered))
    hull = lower[:-1] + upper[:-1]
    if area(np.array(hull)) <= _FLAT:  # a line, but for rounding
        pairs = itertools.combinations(hull, 2)
        hull = list(max(pairs, key=lambda ends: math.dist(*ends)))
    return np.array(hull)


def _half_hull(ordered: Iterable[_Point]) -> list[_Point]:
    """Returns the right-hand boundary met when going through `ordered`."""
    chain: list[_Point] = []
    for p in ordered:
        while len(chain) > 1 and _is_needless(chain[-2], chain[-1], p):
            chain.pop()
        chain.append(p)
    return chain


def _is_needless(a: _Point, b: _Point, p: _Point) -> bool:
    """True if `b` is on the inner side of a, p, or all but between them."""
    turn = _turn(a, b, p)
    if turn <= 0.0 or turn > _FLAT:
        return turn <= 0.0
    # On a line that is vertical but for rounding, b may be beyond a and p.
    return (b[0] - a[0]) * (p[0] - b[0]) + (b[1] - a[1]) * (p[1] - b[1]) >= 0.0


def _turn(a: _Point, b: _Point, p: _Point) -> float:
    """Returns twice the signed area of a, b, p: positive if p is left of ab."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def _edges(polygon: Array) -> list[tuple[_Point, _Point]]:
    """Returns the (start, end) pairs of all edges, in order."""
    vertices = [(x, y) for x, y in polygon.tolist()]
    return list(zip(vertices, vertices[1:] + vertices[:1], strict=True))


def halfspaces(polygon: Array) -> tuple[Array, Array]:
    """Returns A (n, 2), b (n,) [m] with the polygon = {p : A p <= b}.

    The rows of A are the unit outward normals of the edges, so that b - d
    describes the polygon shrunk by d.

    Raises:
        ValueError: fewer than 3 vertices: it has no inside.
    """
    if len(polygon) < 3:
        raise ValueError(f"{len(polygon)} vertices: a polygon needs 3 or more")
    normals, offsets = [], []
    for (x0, y0), (x1, y1) in _edges(polygon):
        length = math.hypot(x1 - x0, y1 - y0)
        nx, ny = (y1 - y0) / length, (x0 - x1) / length
        normals.append((nx, ny))
        offsets.append(nx * x0 + ny * y0)
    return np.array(normals), np.array(offsets)


def contains(point: Array, polygon: Array, tolerance: float = 0.0) -> bool:
    """True if `point` (2,) is in the polygon or `tolerance` [m] beside it."""
    if len(polygon) < 3:
        return bool(
            np.linalg.norm(point - project(point, polygon)) <= tolerance
        )
    p = (float(point[0]), float(point[1]))
    return all(
        _turn(a, b, p) >= -tolerance * math.dist(a, b)
        for a, b in _edges(polygon)
    )


def project(point: Array, polygon: Array) -> Array:
    """Returns the point (2,) of the polygon that is closest to `point` (2,).

    Also for the one or two vertices of a degenerate hull.
    """
    if len(polygon) > 2 and contains(point, polygon):
        return point
    p = (float(point[0]), float(point[1]))
    candidates = [_project_on_segment(p, a, b) for a, b in _edges(polygon)]
    return np.array(min(candidates, key=lambda c: math.dist(c, p)))


def _project_on_segment(p: _Point, a: _Point, b: _Point) -> _Point:
    dx, dy = b[0] - a[0], b[1] - a[1]
    squared = dx * dx + dy * dy
    if squared == 0.0:
        return a
    along = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / squared
    along = min(max(along, 0.0), 1.0)
    return a[0] + along * dx, a[1] + along * dy


def centroid(polygon: Array) -> Array:
    """Returns the centre of area (2,) [m]; the mean vertex if it has none."""
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
    """Returns the area [m^2]; 0 for fewer than three vertices."""
    twice = 0.0
    vertices = polygon.tolist()
    for i in range(2, len(vertices)):
        twice += _turn(vertices[0], vertices[i - 1], vertices[i])
    return 0.5 * twice


def _clip(
    vertices: list[_Point], nx: float, ny: float, offset: float
) -> list[_Point]:
    """One step of Sutherland and Hodgman's clipping: n . p <= offset."""
    kept: list[_Point] = []
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
    """Returns the part of the polygon with A p <= b, (m, 2).

    `A` (k, 2) and `b` (k,) [m] as of `halfspaces`.  (0, 2) if no area is left.
    """
    excess = polygon @ A.T - b
    if not len(polygon) or (excess.min(axis=0) >= 0.0).any():
        return _NOTHING
    cutting = np.flatnonzero(excess.max(axis=0) > 0.0)
    vertices = polygon.tolist()
    offsets = b[cutting].tolist()
    for (nx, ny), offset in zip(A[cutting].tolist(), offsets, strict=True):
        vertices = _clip(vertices, nx, ny, offset)
    # An edge between vertices that all but coincide would have no direction.
    last = vertices[-1:] + vertices[:-1]
    part = [
        p
        for p, q in zip(vertices, last, strict=True)
        if abs(p[0] - q[0]) + abs(p[1] - q[1]) > _COINCIDENT
    ]
    polygon = np.array(part).reshape(-1, 2)
    return polygon if area(polygon) > _FLAT else _NOTHING


def intersection(first: Array, second: Array) -> Array:
    """Returns what the polygons share, (n, 2); (0, 2) if they share no area."""
    return clip_all(first, *halfspaces(second))


def shrink(polygon: Array, distance: float) -> Array:
    """Returns the polygon of all points `distance` [m] or more inside.

    Raises:
        ValueError: no area is left.
    """
    A, b = halfspaces(polygon)
    inner = convex_hull(clip_all(polygon, A, b - distance))
    if len(inner) < 3:
        raise ValueError(
            f"distance = {distance}: nothing is left of the polygon"
        )
    return inner


def minkowski_sum(first: Array, second: Array) -> Array:
    """Returns {p + q : p in first, q in second}, by merging the edges.

    Both have to be counter-clockwise and strictly convex, as from
    `convex_hull`; one may be a single point or a line.
    """
    p, q = _from_lowest(first), _from_lowest(second)
    n, m = len(p), len(q)
    p.append(p[0])
    q.append(q[0])
    i = j = 0
    total: list[_Point] = []
    while i < n or j < m:
        a, b = p[i], q[j]
        total.append((a[0] + b[0], a[1] + b[1]))
        if i == n or j == m:
            turn = 1.0 if j == m else -1.0
        else:
            (ux, uy), (vx, vy) = p[i + 1], q[j + 1]
            turn = (ux - a[0]) * (vy - b[1]) - (uy - a[1]) * (vx - b[0])
        if turn >= -_PARALLEL:
            i += 1
        if turn <= _PARALLEL:
            j += 1
    return np.array(total)


def _from_lowest(polygon: Array) -> list[_Point]:
    """Returns the vertices; the lowest, and of these the leftmost, first."""
    vertices: list[_Point] = polygon.tolist()
    k = vertices.index(min(vertices, key=lambda v: (v[1], v[0])))
    return vertices[k:] + vertices[:k]
