"""The sole of a foot: its plane, and the largest rectangle in it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from nadia_balance.core.math.arrays import Array
from nadia_balance.new_robot.description import COLLIDING, VISUAL, Link, Shape

# Tolerances for points on the plane, of meshes and of round solids [m].
_ON_PLANE = {"mesh": 0.002, "cylinder": 1e-4, "ellipsoid": 1e-4}
_ON_PLANE_EXACT = 0.0025
_SAME_NORMAL = np.cos(np.deg2rad(3.0))
_DOWNWARD = np.cos(np.deg2rad(50.0))
_WIDTHS = 10001  # of rectangles that are compared


@dataclass
class SolePlane:
    """The plane of a sole in the frame of its link."""

    down: Array  # (3,), its unit normal, out of the foot
    depth: float  # distance of the plane from the link's origin [m]
    points: Array  # (k, 3), on the plane
    area: float  # of their convex hull [m^2]
    source: str


def find_sole(foot: Link, down: Array) -> SolePlane:
    """Returns the plane of the sole; `down` (3,) is its approximate normal.

    The plane is that of the collision shapes, or of the visual ones if their
    sole is more than twice as large, or the only flat one.

    Raises ValueError: no shape is flat below.
    """
    roles = (COLLIDING, VISUAL)
    found = [sole_plane(foot.of(role), down, role) for role in roles]
    if not any(found):
        why = "must have a shape with a flat side below"
        also = f"; {foot.missing}" if foot.missing else ""
        raise ValueError(f"foot {foot.name}: {why}{also}")
    weight = {COLLIDING: 2.0, VISUAL: 1.0}
    return max(filter(None, found), key=lambda p: weight[p.source] * p.area)


def sole_plane(
    shapes: Sequence[Shape], down: Array, source: str
) -> SolePlane | None:
    """The supporting plane with the largest area of the convex hull."""
    if not shapes:
        return None
    hull = ConvexHull(np.concatenate([shape.points() for shape in shapes]))
    first, *others = hull.points[hull.simplices].swapaxes(0, 1)
    sides = np.cross(*(corners - first for corners in others))
    areas = 0.5 * np.linalg.norm(sides, axis=1)
    normals = hull.equations[:, :3]
    below = normals @ down > _DOWNWARD
    areas, normals = areas[below], normals[below]
    alike = normals @ normals.T > _SAME_NORMAL
    if not len(areas):
        return None
    near = alike[int((alike @ areas).argmax())]
    normal = areas[near] @ normals[near]
    normal /= np.linalg.norm(normal)
    # A round shape touches the ground with its point farthest along the normal.
    lowest = [
        s.spine(2).T + s.size["radius"] * normal
        if s.kind in ("sphere", "capsule")
        else s.points()
        for s in shapes
    ]
    depth = max(float((points @ normal).max()) for points in lowest)
    on_plane = [
        p[p @ normal > depth - _ON_PLANE.get(shape.kind, _ON_PLANE_EXACT)]
        for p, shape in zip(lowest, shapes, strict=True)
    ]
    flat = np.concatenate(on_plane)
    across = np.linalg.svd(normal[None])[2][1:]
    try:
        area = ConvexHull(flat @ across.T).volume
    except (QhullError, ValueError):  # collinear, or too few
        return None
    return SolePlane(normal, depth, flat, area, source)


def largest_rectangle(soles: Sequence[Array]) -> tuple[float, float, float]:
    """Returns x_min, x_max and half-width [m] of the largest rectangle.

    It is symmetric about y = 0 and within the hulls of all `soles`, points
    (k, 2) [m].  Raises ValueError: no such rectangle exists.
    """
    sides = np.concatenate([ConvexHull(sole).equations for sole in soles])
    a_x, a_y, c = sides.T
    ahead, behind = a_x > 1e-9, a_x < -1e-9
    beside = ~(ahead | behind)
    widest = min(-c[beside] / np.abs(a_y[beside]), default=np.inf)
    widest = min(widest, *(float(np.abs(sole[:, 1]).max()) for sole in soles))
    widths = np.linspace(0.0, max(widest, 0.0), _WIDTHS)
    room = -c[:, None] - np.abs(a_y)[:, None] * widths  # a_x x <= room
    heels = (room[behind] / a_x[behind, None]).max(axis=0)
    toes = (room[ahead] / a_x[ahead, None]).min(axis=0)
    i = int((widths * (toes - heels)).argmax())
    if not toes[i] > heels[i] or not widest > 0.0:
        raise ValueError("soles: must have a part on y = 0 in common")
    return float(heels[i]), float(toes[i]), float(widths[i])
