"""Shapes of links: soles that are found, capsules that are fitted."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RotationMatrix
from scipy.spatial import ConvexHull, QhullError

import nadia_balance.new_robot.description as robots
from nadia_balance.core.math.arrays import Array

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

Shapes = dict[str, list[robots.Shape]]  # by link
Pairs = set[frozenset[str]]


@dataclass
class SolePlane:
    """The plane of a sole in the frame of its link."""

    down: Array  # (3,), its unit normal, out of the foot
    depth: float  # distance of the plane from the link's origin [m]
    points: Array  # (k, 3), on the plane
    area: float  # of their convex hull [m^2]
    source: str


def find_sole(foot: robots.Link, down: Array) -> SolePlane:
    """Returns the plane of the sole; `down` (3,) is its approximate normal.

    The plane is that of the collision shapes, or of the visual ones if their
    sole is more than twice as large, or the only flat one.

    Raises ValueError: no shape is flat below.
    """
    weight = {robots.COLLIDING: 2.0, robots.VISUAL: 1.0}
    found = [sole_plane(foot.of(role), down, role) for role in weight]
    if not any(found):
        why = "must have a shape with a flat side below"
        also = f"; {foot.missing}" if foot.missing else ""
        raise ValueError(f"foot {foot.name}: {why}{also}")
    return max(filter(None, found), key=lambda p: weight[p.source] * p.area)


def sole_plane(shapes: list, down: Array, source: str) -> SolePlane | None:
    """The supporting plane with the largest area of the convex hull."""
    if not shapes:
        return None
    points = np.concatenate([shape.points() for shape in shapes])
    hull = ConvexHull(_thickened(points))
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
    lowest = [s.points() for s in shapes]
    for i, shape in enumerate(shapes):
        if shape.kind in ("sphere", "capsule"):
            lowest[i] = shape.spine(2).T + shape.size["radius"] * normal
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


def fit_capsules(
    robot: robots.Description, anatomy: robots.Anatomy, fields, notes
) -> Pairs:
    """Replaces the collision shapes of `robot` by capsules.

    `fields` are those of robot.yaml.  In a leg only thigh, shin and foot have
    some.  Returns pairs of links that do not collide: neighbours, and those
    that overlap where the robot stands.
    """
    feet, legs = anatomy.feet.values(), anatomy.legs.values()
    capsules: Shapes = {foot: _shoe(**fields["sole"]) for foot in feet}
    smallest = _SMALLEST * fields["legs"]["length"]
    of_legs = {robot.joints[name].child for leg in legs for name in leg.joints}
    for leg in legs:
        at, _ = robot.hinges(leg.pitches, robot.poses())
        knee = robot.joints[leg.knee]
        for i, name in enumerate((knee.parent, knee.child)):
            capsules[name] = _fitted(robot.links[name], smallest)
            if not capsules[name]:
                ends = robot.poses()[name].inverse() @ at[i : i + 2].T
                capsules[name] = [_bone(*ends.T)]
                notes.add("guessed", "the thickness of", name)
    for name, link in robot.links.items():
        if name not in of_legs and (fitted := _fitted(link, smallest)):
            capsules[name] = fitted
    ignored = set()
    for link in capsules:
        above = [j.parent for j in robot.chain(link) if j.parent in capsules]
        ignored |= {frozenset((link, holder)) for holder in above[-1:]}
    poses = robot.poses(fields["posture"])
    for pair in map(frozenset, itertools.combinations(capsules, 2)):
        if pair in ignored or pair == set(feet):
            continue
        if not _thinned(sorted(pair), capsules, poses, feet):
            ignored.add(pair)
            line = "may pass through each other: they overlap where it stands"
            notes.add("changed", line, " and ".join(sorted(pair)))
    for name, link in robot.links.items():
        link.shapes = link.of(robots.VISUAL) + capsules.get(name, [])
    heel, toe, y, z = fields["sole"].values()
    for foot, *corner in itertools.product(feet, (heel, toe), (y, -y)):
        X_LG = RigidTransform([*corner, z + _SPHERE])
        robot.links[foot].shapes.append(_solid("sphere", X_LG, radius=_SPHERE))
    return ignored


def _solid(kind: str, X: RigidTransform, **size: float) -> robots.Shape:
    sizes = {key: np.array([value]) for key, value in size.items()}
    return robots.Shape(robots.COLLIDING, kind, sizes, X)


def _thickened(points: Array) -> Array:
    """The points (n, 3), and copies of them aside if they have no volume."""
    away = points - points[0]
    for axis in np.linalg.eigh(away.T @ away)[1].T:
        if np.ptp(points @ axis) < _THINNEST_PLATE:
            points = np.concatenate((points, points + _THINNEST_PLATE * axis))
    return points


def _fitted(link: robots.Link, smallest: float) -> list[robots.Shape]:
    """A capsule about `link`; none if it is smaller than `smallest` [m]."""
    shapes = link.of(robots.COLLIDING) or link.shapes
    points = np.concatenate([np.zeros((0, 3)), *(s.points() for s in shapes)])
    if not shapes or np.ptp(points, axis=0).max() < smallest:
        return []
    T_BL, extents = trimesh.bounds.oriented_bounds(_thickened(points))
    order = np.argsort(extents)  # the longest becomes z
    R_BG = np.eye(3)[:, order]
    R_BG[:, 0] *= np.linalg.det(R_BG)
    R_LB = T_BL[:3, :3].T
    R_LG = RotationMatrix.ProjectToRotationMatrix(R_LB @ R_BG)
    small, middle, large = extents[order]
    radius = 0.25 * _THICKNESS * (small + middle)
    length = max(large - 2.0 * radius, 0.01 * large)
    X_LG = RigidTransform(R_LG, -R_LB @ T_BL[:3, 3])
    return [_solid("capsule", X_LG, radius=radius, length=length)]


def _bone(upper: Array, lower: Array) -> robots.Shape:
    length = np.linalg.norm(lower - upper)
    R = RotationMatrix.MakeFromOneVector(lower - upper, 2)
    X_LG = RigidTransform(R, 0.5 * (upper + lower))
    size = {"radius": _BONE * length, "length": (1.0 - 2.0 * _BONE) * length}
    return _solid("capsule", X_LG, **size)


def _shoe(x_min, x_max, half_width, z) -> list[robots.Shape]:
    """Two parallel capsules within the sole's rectangle, just above it."""
    length = x_max - x_min
    radius = min(2.0 / 3.0 * half_width, 0.25 * length)
    x, y = 0.5 * (x_min + x_max), half_width - radius
    z += _SHOE_ABOVE_SOLE + radius
    along = RotationMatrix.MakeYRotation(0.5 * np.pi)
    poses = [RigidTransform(along, [x, side, z]) for side in (y, -y)]
    size = {"radius": radius, "length": 0.9 * length - 2.0 * radius}
    return [_solid("capsule", X, **size) for X in poses]


def _thinned(links: list[str], capsules: Shapes, poses, feet) -> bool:
    """Makes capsules not of feet thinner until links are apart, if it can."""
    share = 1.0
    for pair in itertools.product(*(capsules[link] for link in links)):
        both = list(zip(links, pair, strict=True))
        first, second = (poses[link] @ each.spine(41) for link, each in both)
        apart = first[:, :, None] - second[:, None, :]
        room = float(np.linalg.norm(apart, axis=0).min()) - _CLEARANCE
        radii = {link: float(each.size["radius"][0]) for link, each in both}
        room -= sum(radii[link] for link in links if link in feet)
        soft = sum(radii[link] for link in links if link not in feet)
        share = min(share, room / soft if soft else 1.0)
    if share < _THINNEST:
        return False
    for capsule in (c for n in links if n not in feet for c in capsules[n]):
        capsule.size["length"] += 2.0 * capsule.size["radius"] * (1.0 - share)
        capsule.size["radius"] *= share
    return True
