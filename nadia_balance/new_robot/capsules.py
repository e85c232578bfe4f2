"""Collision capsules of links that do not overlap in the standing posture."""

import itertools
from collections.abc import Collection, Mapping

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RotationMatrix

from nadia_balance.core.math.arrays import Array
from nadia_balance.new_robot import Notes
from nadia_balance.new_robot import description as robots
from nadia_balance.new_robot.anatomy import Anatomy
from nadia_balance.new_robot.measure import Fields

# Smallest size of a link with a capsule [leg length].
_SMALLEST = 0.25
_THICKNESS = 0.9  # diameter over the mean of a link's shorter extents [-]
_BONE = 0.15  # radius over length of a thigh or shin without shapes [-]
# Capsules that are nearer [m] in the standing posture are made thinner, to no
# less than this share of their radius [-].
_CLEARANCE, _THINNEST = 0.03, 0.5
_SHOE_ABOVE_SOLE = 0.004  # [m]
_SPHERE = 0.005  # radius of the spheres at the soles' corners [m]

Shapes = dict[str, list[robots.Shape]]  # by link
Pairs = set[frozenset[str]]


def fit_capsules(
    robot: robots.Description, anatomy: Anatomy, fields: Fields, notes: Notes
) -> Pairs:
    """Replaces the collision shapes of `robot` by capsules.

    In a leg only thigh, shin and foot have some.  Returns pairs of links that
    do not collide: neighbours, and those that overlap where the robot stands.
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
                X_LR = robot.poses()[name].inverse()
                capsules[name] = [_bone(X_LR @ at[i], X_LR @ at[i + 1])]
                notes.add("guessed", "the thickness of", name)
    for name, link in robot.links.items():
        if name not in of_legs and (fitted := _fitted(link, smallest)):
            capsules[name] = fitted
    ignored = set()
    for link in capsules:
        above = [joint.parent for joint in robot.chain(link)]
        holders = [holder for holder in above if holder in capsules]
        ignored |= {frozenset((link, holder)) for holder in holders[-1:]}
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


def _fitted(link: robots.Link, smallest: float) -> list[robots.Shape]:
    """A capsule about `link`; none if it is smaller than `smallest` [m]."""
    shapes = link.of(robots.COLLIDING) or link.shapes
    points = np.concatenate([np.zeros((0, 3)), *(s.points() for s in shapes)])
    if not shapes or np.ptp(points, axis=0).max() < smallest:
        return []
    T_BL, extents = trimesh.bounds.oriented_bounds(points)
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


def _thinned(
    links: list[str],
    capsules: Shapes,
    poses: Mapping[str, RigidTransform],
    feet: Collection[str],
) -> bool:
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
    for capsule in itertools.chain(
        *(capsules[n] for n in links if n not in feet)
    ):
        capsule.size["length"] += 2.0 * capsule.size["radius"] * (1.0 - share)
        capsule.size["radius"] *= share
    return True
