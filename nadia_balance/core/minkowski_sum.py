"""Sums of convex polygons (n, 2) [m], counter-clockwise, edge by edge."""

from __future__ import annotations

from nadia_balance.core.polygon import Point, as_array
from nadia_balance.core.walking import Array

_PARALLEL = 1e-16  # edges with this cross product [m^2] have one direction

# From the vertex x, y [m] by dx, dy [m] to the next one.
Edge = tuple[float, float, float, float]


def minkowski_sum(first: Array, second: Array) -> Array:
    """Returns {p + q : p in first, q in second}.

    Both have to be counter-clockwise and strictly convex, as from
    `convex_hull`; one may be a single point or a line.
    """
    return merge(edges(first), edges(second))


def edges(polygon: Array) -> list[Edge]:
    """Returns all edges, from the lowest and of these the leftmost vertex."""
    vertices: list[Point] = polygon.tolist()
    upright = [(y, x) for x, y in vertices]
    k = upright.index(min(upright))
    starts = vertices[k:] + vertices[:k]
    return [
        (x, y, u - x, v - y)
        for (x, y), (u, v) in zip(starts, starts[1:] + starts[:1], strict=True)
    ]


def merge(first: list[Edge], second: list[Edge]) -> Array:
    """Returns the sum (n, 2) of two polygons given by their `edges`."""
    total: list[Point] = []
    j, num_second = 0, len(second)
    for ax, ay, ux, uy in first:
        while j < num_second:
            bx, by, vx, vy = second[j]
            total.append((ax + bx, ay + by))
            turn = ux * vy - uy * vx
            if turn <= _PARALLEL:
                j += 1
            if turn >= -_PARALLEL:
                break
        else:  # once round the second
            bx, by, *_ = second[0]
            total.append((ax + bx, ay + by))
    ax, ay, *_ = first[0]
    total += [(ax + bx, ay + by) for bx, by, _, _ in second[j:]]
    return as_array(total)
