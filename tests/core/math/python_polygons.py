"""The loops of geometry.c in Python: what they are to be equal to, in bits."""

import itertools
import math

import numpy as np

FLAT, COINCIDENT, PARALLEL = 1e-12, 1e-9, 1e-16


def array(points):
    return np.array(points, float).reshape(-1, 2)


def edges(polygon):
    vertices = polygon.tolist()
    return list(zip(vertices, vertices[1:] + vertices[:1], strict=True))


def convex_hull(points):
    ordered = sorted({(x, y) for x, y in points.tolist()})
    if len(ordered) < 3:
        return array(ordered)
    vertices = _half_hull(ordered)[:-1] + _half_hull(ordered[::-1])[:-1]
    if area(array(vertices)) > FLAT:
        return array(vertices)
    pairs = itertools.combinations(vertices, 2)
    return array(max(pairs, key=lambda ends: math.dist(*ends)))


def _half_hull(ordered):
    chain = []
    for x, y in ordered:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2:]
            ux, uy = bx - ax, by - ay
            turn = ux * (y - ay) - uy * (x - ax)
            if turn > FLAT or (
                turn > 0.0 and ux * (x - bx) + uy * (y - by) < 0.0
            ):
                break
            chain.pop()
        chain.append((x, y))
    return chain


def halfspaces(polygon):
    normals, offsets = [], []
    for (x0, y0), (x1, y1) in edges(polygon):
        length = math.hypot(x1 - x0, y1 - y0)
        nx, ny = (y1 - y0) / length, (x0 - x1) / length
        normals.append((nx, ny))
        offsets.append(nx * x0 + ny * y0)
    return array(normals), np.array(offsets)


def contains(point, polygon, tolerance=0.0):
    if len(polygon) < 3:
        return math.dist(point, project(point, polygon)) <= tolerance
    return all(
        (bx - ax) * (point[1] - ay) - (by - ay) * (point[0] - ax)
        >= -tolerance * math.hypot(bx - ax, by - ay)
        for (ax, ay), (bx, by) in edges(polygon)
    )


def project(point, polygon):
    if len(polygon) > 2 and contains(point, polygon):
        return point
    candidates = [_on_segment(point, a, b) for a, b in edges(polygon)]
    return np.array(min(candidates, key=lambda p: math.dist(p, point)))


def _on_segment(p, a, b):
    dx, dy = b[0] - a[0], b[1] - a[1]
    squared = dx * dx + dy * dy
    if squared == 0.0:
        return a
    along = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / squared
    along = min(max(along, 0.0), 1.0)
    return a[0] + along * dx, a[1] + along * dy


def centroid(polygon):
    origin = polygon[0]
    area, x, y = 0.0, 0.0, 0.0
    for a, b in edges(polygon - origin):
        cross = a[0] * b[1] - a[1] * b[0]
        area += cross
        x += (a[0] + b[0]) * cross
        y += (a[1] + b[1]) * cross
    if area <= FLAT:
        return polygon.mean(axis=0)
    return np.array([origin[0] + x / (3 * area), origin[1] + y / (3 * area)])


def area(polygon):
    twice = 0.0
    for (ux, uy), (vx, vy) in itertools.pairwise(
        (polygon[1:] - polygon[0]).tolist()
    ):
        twice += ux * vy - uy * vx
    return 0.5 * twice


def clip_all(polygon, A, b):
    vertices = polygon.tolist()
    for (nx, ny), offset in zip(A.tolist(), b.tolist(), strict=True):
        excess = [nx * x + ny * y - offset for x, y in polygon.tolist()]
        if min(excess) >= 0.0:
            return np.empty((0, 2))
        if max(excess) > 0.0:
            vertices = _clip(vertices, nx, ny, offset)
    befores = vertices[-1:] + vertices[:-1]
    part = [
        p
        for p, q in zip(vertices, befores, strict=True)
        if abs(p[0] - q[0]) + abs(p[1] - q[1]) > COINCIDENT
    ]
    return array(part if part and area(array(part)) > FLAT else [])


def _clip(vertices, nx, ny, offset):
    kept = []
    for (x0, y0), (x, y) in zip(
        vertices[-1:] + vertices[:-1], vertices, strict=True
    ):
        over0, over = nx * x0 + ny * y0 - offset, nx * x + ny * y - offset
        if over0 * over < 0.0:
            s = over0 / (over0 - over)
            kept.append((x0 + s * (x - x0), y0 + s * (y - y0)))
        if over <= 0.0:
            kept.append((x, y))
    return kept


def minkowski_sum(first, second):
    total = []
    others, inner = _from_lowest(first), _from_lowest(second)
    j = 0
    for ax, ay, ux, uy in others:
        while j < len(inner):
            bx, by, vx, vy = inner[j]
            total.append((ax + bx, ay + by))
            turn = ux * vy - uy * vx
            if turn <= PARALLEL:
                j += 1
            if turn >= -PARALLEL:
                break
        else:  # the second polygon is complete
            bx, by, *_ = inner[0]
            total.append((ax + bx, ay + by))
    ax, ay, *_ = others[0]
    return array(total + [(ax + bx, ay + by) for bx, by, _, _ in inner[j:]])


def _from_lowest(polygon):
    k = np.lexsort(polygon.T)[0]
    starts = np.roll(polygon, -k, axis=0)
    return [(x, y, u - x, v - y) for (x, y), (u, v) in edges(starts)]


def closest_point(polygon, other):
    """By numpy's complex numbers; of equal gaps the processor chooses."""
    p, q = polygon @ [1.0, 1.0j], other @ [1.0, 1.0j]
    i, _, to_other = _closest_vertex(p, q)
    _, foot, to_polygon = _closest_vertex(q, p)
    z = p[i] if to_other <= to_polygon else foot
    return np.array([z.real, z.imag]), min(to_other, to_polygon)


def _closest_vertex(vertices, polygon):
    edges = np.roll(polygon, -1) - polygon
    apart = vertices[:, None] - polygon
    apart -= np.clip((apart / edges).real, 0.0, 1.0) * edges
    i, k = np.unravel_index(np.abs(apart).argmin(), apart.shape)
    return i, vertices[i] - apart[i, k], abs(apart[i, k])
