"""The sole of a foot: its plane, and the largest rectangle in it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import ConvexHull, QhullError

from nadia_balance.new_robot.shapes import Array, Shape

# Tolerances for points on the plane, of meshes and of round solids [m].
_ON_PLANE = {"mesh": 0.002, "cylinder": 1e-4, "ellipsoid": 1e-4}
_ON_PLANE_EXACT = 0.0025
_SAME_NORMAL = np.cos(np.deg2rad(3.0))
_DOWNWARD = np.cos(np.deg2rad(50.0))


@dataclass
class SolePlane:
    """The plane of a sole in the frame of its link."""

    down: Array  # (3,), its unit normal, out of the foot
    depth: float  # distance of the plane from the link's origin [m]
    points: Array  # (k, 3), on the plane
    area: float  # of their convex hull [m^2]
    source: str


def larger_sole(
    colliding: Sequence[Shape], visual: Sequence[Shape], down: Array
) -> SolePlane | None:
    """Returns the plane of the sole; `down` (3,) is its approximate normal.

    The plane is that of the collision shapes, or of the visual ones if their
    sole is more than twice as large, or the only flat one.
    """
    first = sole_plane(colliding, down, "collision")
    second = sole_plane(visual, down, "visual")
    if first and second:
        return second if second.area > 2.0 * first.area else first
    return first or second


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
    lowest = [_lowest(shape, normal) for shape in shapes]
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


def _lowest(shape: Shape, normal: Array) -> Array:
    """Points (k, 3) of a shape; of a ball's, the farthest along `normal`."""
    if shape.kind not in ("sphere", "capsule"):
        return shape.points()
    radius, length = (
        float(shape.size.get(key, "0")) for key in ("radius", "length")
    )
    ends = 0.5 * length * np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    return (shape.X_LG @ ends.T).T + radius * normal


def largest_rectangle(soles: Sequence[Array]) -> tuple[float, float, float]:
    """Returns x_min, x_max and half-width [m] of the largest rectangle.

    It is symmetric about y = 0 and within the hulls of all `soles`, points
    (k, 2) [m].  Its length is a concave function of its width, so that the area
    has one maximum.

    Raises:
        ValueError: no such rectangle exists.
    """
    sides = np.concatenate([ConvexHull(sole).equations for sole in soles])
    a_x, a_y, c = sides.T
    ahead, behind = a_x > 1e-9, a_x < -1e-9
    beside = ~(ahead | behind)

    def ends(width: float) -> tuple[float, float]:
        """Heel and toe at y = +-width; heel > toe if the hulls are narrower."""
        room = -c - np.abs(a_y) * width  # a_x x <= room
        heel = (room[behind] / a_x[behind]).max()
        toe = (room[ahead] / a_x[ahead]).min()
        return float(heel), float(toe)

    widest = min(-c[beside] / np.abs(a_y[beside]), default=np.inf)
    widest = min(widest, *(float(np.abs(sole[:, 1]).max()) for sole in soles))

    def lost(width: float) -> float:
        heel, toe = ends(width)
        return -width * (toe - heel)

    if widest <= 0.0 or ends(0.0)[0] >= ends(0.0)[1]:
        raise ValueError("soles: must have a part on y = 0 in common")
    found = minimize_scalar(
        lost, bounds=(0.0, widest), method="bounded", options={"xatol": 1e-7}
    )
    # The maximum may be at the bound `widest`, which the search excludes.
    width = min(float(found.x), widest, key=lost)
    return *ends(width), width
