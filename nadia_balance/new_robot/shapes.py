"""Shapes of links: soles that are found, capsules that are fitted."""

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RotationMatrix
from scipy.spatial import ConvexHull, QhullError  # type: ignore[import-untyped]

from nadia_balance.core.math.arrays import Array
from nadia_balance.new_robot.description import (
    COLLIDING,
    VISUAL,
    Anatomy,
    Description,
    Link,
    Notes,
    Poses,
    Shape,
    Vector,
)
from nadia_balance.parameters.bounds import require

# Tolerances for points on the plane, of meshes and of round solids [m].
_ON_PLANE = {"mesh": 0.002, "cylinder": 1e-4, "ellipsoid": 1e-4}
_ON_PLANE_EXACT = 0.0025
_SAME_NORMAL = np.cos(np.deg2rad(3.0))
_DOWNWARD = np.cos(np.deg2rad(50.0))
_WIDTHS = 10001  # of rectangles that are compared
_SMALLEST = 0.25  # size of a link with a capsule [leg length]
_THICKNESS = 0.9  # diameter over the mean of a link's shorter extents [-]
_BONE = 0.15  # radius over length of a thigh or shin without shapes [-]
# Capsules nearer [m] in the standing posture get thinner, to this share [-].
_CLEARANCE, _THINNEST = 0.03, 0.5
_SHOE_ABOVE_SOLE = 0.004  # [m]
_THINNEST_PLATE = 1e-4  # [m]
_SPHERE = 0.005  # radius of the spheres at the soles' corners [m]
# A sole counts by its area times this: shapes to look at are often larger.
_WEIGHT = {COLLIDING: 2.0, VISUAL: 1.0}

Shapes = dict[str, list[Shape]]  # by link
Pairs = set[frozenset[str]]


@dataclass
class SolePlane:
    """The plane of a sole in the frame of its link."""

    down: Array  # (3,), its unit normal, out of the foot
    depth: float  # distance of the plane from the link's origin [m]
    points: Array  # (k, 3), on the plane
    area: float  # of their convex hull [m^2]
    source: str  # role of the shapes

    @property
    def extents(self) -> Array:
        """Length and width (2,) [m], in a frame whose z axis is normal."""
        return np.asarray(np.ptp(self.points[:, :2], axis=0))


def find_sole(foot: Link, down: Array) -> SolePlane:
    """Finds the plane of the sole.

    It is that of the collision shapes, or of the visual ones if their sole is
    more than twice as large, or the only flat one.

    Args:
        foot: the link.
        down: approximate normal (3,) of the sole, in the link.

    Returns:
        The plane.

    Raises:
        ValueError: no shape is flat below.
    """
    planes = [sole_plane(foot.of(role), down, role) for role in _WEIGHT]
    require(
        any(planes),
        f"foot {foot.name}: must have a shape with a flat side below"
        + (f"; {foot.missing}" if foot.missing else ""),
    )
    return max(
        filter(None, planes),
        key=lambda plane: _WEIGHT[plane.source] * plane.area,
    )


def sole_plane(
    shapes: Sequence[Shape], down: Array, source: str
) -> SolePlane | None:
    """Finds the supporting plane of shapes that faces down.

    Of the planes through faces of their convex hull it is the one in which, up
    to 3 degrees, the area is largest.

    Args:
        shapes: of one link.
        down: approximate normal (3,) of the plane, in the link.
        source: role of the shapes.

    Returns:
        The plane; None: no side is flat.
    """
    normal = _flattest_normal(shapes, down) if shapes else None
    if normal is None:
        return None
    # A round shape touches the ground with its point farthest along the normal.
    lowest = [
        shape.spine(2).T + shape.size["radius"] * normal
        if shape.kind in ("sphere", "capsule")
        else shape.points()
        for shape in shapes
    ]
    depth = max(float((points @ normal).max()) for points in lowest)
    flat = np.concatenate(
        [
            p[p @ normal > depth - _ON_PLANE.get(shape.kind, _ON_PLANE_EXACT)]
            for p, shape in zip(lowest, shapes, strict=True)
        ]
    )
    across = np.linalg.svd(normal[None])[2][1:]
    try:
        area = ConvexHull(flat @ across.T).volume
    except (QhullError, ValueError):  # collinear, or too few
        return None
    return SolePlane(
        down=normal, depth=depth, points=flat, area=area, source=source
    )


def _flattest_normal(shapes: Sequence[Shape], down: Array) -> Array | None:
    """The normal (3,) below about which the hull's area is largest."""
    hull = ConvexHull(
        _thickened(np.concatenate([shape.points() for shape in shapes]))
    )
    first, second, third = hull.points[hull.simplices].swapaxes(0, 1)
    sides = np.cross(second - first, third - first)
    normals = hull.equations[:, :3]
    below = normals @ down > _DOWNWARD
    areas = 0.5 * np.linalg.norm(sides, axis=1)[below]
    normals = normals[below]
    if not len(areas):
        return None
    alike = normals @ normals.T > _SAME_NORMAL
    near = alike[int((alike @ areas).argmax())]
    normal = areas[near] @ normals[near]
    return np.asarray(normal / np.linalg.norm(normal))


def largest_rectangle(soles: Sequence[Array]) -> tuple[float, float, float]:
    """Finds the largest rectangle about the x axis within all soles.

    Maximise (x_max - x_min) * half_width subject to a_x x + a_y y + c <= 0 at
    the corners, for all sides (a_x, a_y, c) of the soles' hulls.

    Args:
        soles: points (k, 2) of each sole [m].

    Returns:
        x_min, x_max and half-width [m].

    Raises:
        ValueError: no such rectangle exists.
    """
    a_x, a_y, c = np.concatenate([ConvexHull(s).equations for s in soles]).T
    ahead = a_x > 1e-9
    behind = a_x < -1e-9
    beside = ~(ahead | behind)
    widest = min(
        min(-c[beside] / np.abs(a_y[beside]), default=np.inf),
        *(float(np.abs(sole[:, 1]).max()) for sole in soles),
    )
    widths = np.linspace(0.0, max(widest, 0.0), _WIDTHS)
    room = -c[:, None] - np.abs(a_y)[:, None] * widths  # a_x x <= room
    heels = (room[behind] / a_x[behind, None]).max(axis=0)
    toes = (room[ahead] / a_x[ahead, None]).min(axis=0)
    i = int((widths * (toes - heels)).argmax())
    require(
        toes[i] > heels[i] and widest > 0.0,
        "soles: must have a part on y = 0 in common",
    )
    return float(heels[i]), float(toes[i]), float(widths[i])


def fit_capsules(
    robot: Description,
    anatomy: Anatomy,
    fields: Mapping[str, Any],
    notes: Notes,
) -> Pairs:
    """Replaces the collision shapes of a robot by capsules.

    In a leg only thigh, shin and foot have some.

    Args:
        robot: gets the capsules, and spheres at the corners of the soles.
        anatomy: of the robot.
        fields: those of robot.yaml.
        notes: get what was guessed or changed.

    Returns:
        Pairs of links that do not collide: neighbours, and those that overlap
        where the robot stands.
    """
    sole = fields["sole"]
    feet = set(anatomy.feet.values())
    capsules: Shapes = {foot: _shoe(**sole) for foot in anatomy.feet.values()}
    _fit_links(
        robot,
        anatomy,
        capsules=capsules,
        smallest=_SMALLEST * fields["legs"]["length"],
        notes=notes,
    )
    ignored = _neighbours(robot, capsules)
    poses = robot.poses(fields["posture"])
    for pair in itertools.combinations(capsules, 2):
        if frozenset(pair) in ignored or set(pair) == feet:
            continue
        first, second = sorted(pair)
        if not _thinned(first, second, capsules, poses=poses, feet=feet):
            ignored.add(frozenset(pair))
            notes.add(
                "changed",
                "may pass through each other: they overlap where it stands",
                f"{first} and {second}",
            )
    for name, link in robot.links.items():
        link.shapes = link.of(VISUAL) + capsules.get(name, [])
    for foot, x, sign in itertools.product(
        anatomy.feet.values(), (sole["x_min"], sole["x_max"]), (1.0, -1.0)
    ):
        corner: Vector = [x, sign * sole["half_width"], sole["z"] + _SPHERE]
        robot.links[foot].shapes.append(
            _solid("sphere", RigidTransform(corner), radius=_SPHERE)
        )
    return ignored


def _fit_links(
    robot: Description,
    anatomy: Anatomy,
    *,
    capsules: Shapes,
    smallest: float,
    notes: Notes,
) -> None:
    """Adds `capsules` of thighs, shins and all links outside of the legs."""
    of_legs: set[str] = set()
    for leg in anatomy.legs.values():
        of_legs |= {robot.joints[name].child for name in leg.joints}
        points, _ = robot.hinges(leg.pitches, robot.poses())
        knee = robot.joints[leg.knee]
        for i, name in enumerate((knee.parent, knee.child)):
            capsules[name] = _fitted(robot.links[name], smallest)
            if not capsules[name]:
                ends = robot.poses()[name].inverse() @ points[i : i + 2].T
                capsules[name] = [_bone(ends[:, 0], ends[:, 1])]
                notes.add("guessed", "the thickness of", name)
    for name, link in robot.links.items():
        fitted = [] if name in of_legs else _fitted(link, smallest)
        if fitted:
            capsules[name] = fitted


def _neighbours(robot: Description, capsules: Shapes) -> Pairs:
    """Pairs of links with capsules, of which none is between the two."""
    above = {
        link: [j.parent for j in robot.chain(link) if j.parent in capsules]
        for link in capsules
    }
    return {
        frozenset((link, holders[-1]))
        for link, holders in above.items()
        if holders
    }


def _solid(kind: str, X: RigidTransform, **size: float) -> Shape:
    return Shape(
        role=COLLIDING,
        kind=kind,
        size={key: np.array([value]) for key, value in size.items()},
        X_LG=X,
    )


def _thickened(points: Array) -> Array:
    """The points (n, 3), and copies of them aside if they have no volume."""
    away = points - points[0]
    for axis in np.linalg.eigh(away.T @ away)[1].T:
        if np.ptp(points @ axis) < _THINNEST_PLATE:
            points = np.concatenate((points, points + _THINNEST_PLATE * axis))
    return points


def _fitted(link: Link, smallest: float) -> list[Shape]:
    """A capsule about `link`; none if it is smaller than `smallest` [m]."""
    shapes = link.of(COLLIDING) or link.shapes
    points = np.concatenate([np.zeros((0, 3)), *(s.points() for s in shapes)])
    if not shapes or np.ptp(points, axis=0).max() < smallest:
        return []
    T_BL, extents = trimesh.bounds.oriented_bounds(_thickened(points))  # type: ignore[no-untyped-call]
    order = np.argsort(extents)  # the longest becomes z
    R_BG = np.eye(3)[:, order]
    R_BG[:, 0] *= np.linalg.det(R_BG)
    R_LB = T_BL[:3, :3].T
    small, middle, large = extents[order]
    radius = 0.25 * _THICKNESS * (small + middle)
    return [
        _solid(
            "capsule",
            RigidTransform(
                RotationMatrix.ProjectToRotationMatrix(R_LB @ R_BG),
                -R_LB @ T_BL[:3, 3],
            ),
            radius=radius,
            length=max(large - 2.0 * radius, 0.01 * large),
        )
    ]


def _bone(upper: Vector, lower: Vector) -> Shape:
    length = float(np.linalg.norm(lower - upper))
    return _solid(
        "capsule",
        RigidTransform(
            RotationMatrix.MakeFromOneVector(lower - upper, 2),
            0.5 * (upper + lower),
        ),
        radius=_BONE * length,
        length=(1.0 - 2.0 * _BONE) * length,
    )


def _shoe(
    x_min: float, x_max: float, half_width: float, z: float
) -> list[Shape]:
    """Two parallel capsules within the sole's rectangle, just above it."""
    length = x_max - x_min
    radius = min(2.0 / 3.0 * half_width, 0.25 * length)
    y = half_width - radius
    z += _SHOE_ABOVE_SOLE + radius
    return [
        _solid(
            "capsule",
            RigidTransform(
                RotationMatrix.MakeYRotation(0.5 * np.pi),
                cast(Vector, [0.5 * (x_min + x_max), side, z]),
            ),
            radius=radius,
            length=0.9 * length - 2.0 * radius,
        )
        for side in (y, -y)
    ]


def _thinned(
    first: str,
    second: str,
    capsules: Shapes,
    *,
    poses: Poses,
    feet: Collection[str],
) -> bool:
    """Makes capsules not of feet thinner until links are apart, if it can."""
    share = 1.0
    for one, other in itertools.product(capsules[first], capsules[second]):
        apart = (poses[first] @ one.spine(41))[:, :, None] - (
            poses[second] @ other.spine(41)
        )[:, None, :]
        room = float(np.linalg.norm(apart, axis=0).min()) - _CLEARANCE
        radii = {
            first: float(one.size["radius"][0]),
            second: float(other.size["radius"][0]),
        }
        room -= sum(r for link, r in radii.items() if link in feet)
        soft = sum(r for link, r in radii.items() if link not in feet)
        share = min(share, room / soft if soft else 1.0)
    if share < _THINNEST:
        return False
    for link in {first, second}.difference(feet):
        for capsule in capsules[link]:
            capsule.size["length"] += (
                2.0 * capsule.size["radius"] * (1.0 - share)
            )
            capsule.size["radius"] *= share
    return True
