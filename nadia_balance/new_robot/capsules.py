"""Collision capsules of links that do not overlap in the standing posture."""

import itertools
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RotationMatrix

from nadia_balance.new_robot import Notes
from nadia_balance.new_robot.anatomy import Anatomy
from nadia_balance.new_robot.description import Description
from nadia_balance.new_robot.measure import Measurements
from nadia_balance.new_robot.shapes import COLLIDING, VISUAL, Array

# Smallest size of a link with a capsule [leg length].
_SMALLEST = 0.25
_THICKNESS = 0.9  # diameter over the mean of a link's shorter extents [-]
_BONE = 0.15  # radius over length of a thigh or shin without shapes [-]
# Capsules that are nearer [m] in the standing posture are made thinner, to no
# less than this share of their radius [-].
_CLEARANCE, _THINNEST = 0.03, 0.5
SHOE_ABOVE_SOLE = 0.004  # [m]


@dataclass
class Capsule:
    """A capsule along z of its frame G, which has the pose X_LG in the link."""

    X_LG: RigidTransform
    radius: float  # [m]
    length: float  # between the centres of its ends [m]

    def points(self) -> Array:
        """Points (3, 41) [m] on its axis, from end to end, in the link."""
        z = 0.5 * self.length * np.linspace(-1.0, 1.0, 41)
        return self.X_LG @ np.stack([0.0 * z, 0.0 * z, z])


Capsules = dict[str, list[Capsule]]
Pairs = set[frozenset[str]]


def fit_capsules(
    robot: Description, anatomy: Anatomy, measured: Measurements, notes: Notes
) -> tuple[Capsules, Pairs]:
    """Returns the capsules by link, and the pairs whose collision is ignored.

    In a leg only thigh, shin and foot have capsules.  The pairs are neighbours
    (without another link with capsules between them), and links that would
    overlap in the standing posture even if made thinner.
    """
    feet, legs = set(anatomy.feet.values()), anatomy.legs.values()
    capsules = {foot: _shoe(measured) for foot in anatomy.feet.values()}
    smallest = _SMALLEST * measured.legs.length
    for leg in legs:
        ends = leg.hip_pitch, leg.knee, leg.ankle_pitch
        knee = robot.joints[leg.knee]
        for name, bone in zip(
            (knee.parent, knee.child), itertools.pairwise(ends), strict=True
        ):
            if not (capsule := _fitted(robot, name, smallest)):
                capsule = _bone(robot, name, *bone)
                notes.guessed.append(f"the thickness of {name}")
            capsules[name] = [capsule]
    of_legs = {robot.joints[name].child for leg in legs for name in leg.joints}
    for name in robot.links:
        if name not in of_legs:
            if capsule := _fitted(robot, name, smallest):
                capsules[name] = [capsule]
    ignored = _neighbours(robot, capsules)
    poses = robot.poses(measured.posture)
    for pair in map(frozenset, itertools.combinations(capsules, 2)):
        if pair in ignored or pair == feet:
            continue
        if not _thinned(sorted(pair), capsules, poses, feet):
            ignored.add(pair)
            notes.changed.append(
                f"{' and '.join(sorted(pair))} may pass through each other: "
                "they overlap where the robot stands"
            )
    return capsules, ignored


def _fitted(robot: Description, link: str, smallest: float) -> Capsule | None:
    """A capsule with the length and about the thickness of `link`.

    None if the link has no shapes or is smaller than `smallest` [m].
    """
    shapes = robot.shapes(link, COLLIDING) or robot.shapes(link, VISUAL)
    if not shapes:
        return None
    points = np.concatenate([shape.points() for shape in shapes])
    if np.ptp(points, axis=0).max() < smallest:
        return None
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
    return Capsule(X_LG, float(radius), float(length))


def _bone(robot: Description, link: str, upper: str, lower: str) -> Capsule:
    """A capsule from joint `upper` to joint `lower`, in the frame of `link`."""
    poses = robot.poses()
    first, last = (
        poses[link].inverse() @ poses[robot.joints[name].child].translation()
        for name in (upper, lower)
    )
    length = float(np.linalg.norm(last - first))
    R = RotationMatrix.MakeFromOneVector(last - first, 2)
    X_LG = RigidTransform(R, 0.5 * (first + last))
    return Capsule(X_LG, _BONE * length, (1.0 - 2.0 * _BONE) * length)


def _shoe(measured: Measurements) -> list[Capsule]:
    """Two parallel capsules within the sole's rectangle, just above it."""
    sole = measured.sole
    length = sole.x_max - sole.x_min
    radius = min(2.0 / 3.0 * sole.half_width, 0.25 * length)
    x = 0.5 * (sole.x_min + sole.x_max)
    y = sole.half_width - radius
    z = sole.z + SHOE_ABOVE_SOLE + radius
    along = RotationMatrix.MakeYRotation(0.5 * np.pi)
    poses = [RigidTransform(along, [x, side, z]) for side in (y, -y)]
    return [Capsule(X, radius, 0.9 * length - 2.0 * radius) for X in poses]


def _neighbours(robot: Description, shaped: Collection[str]) -> Pairs:
    """Pairs of `shaped` links without another one between them."""
    pairs = set()
    for link in shaped:
        above = [joint.parent for joint in robot.chain(link)]
        holders = [holder for holder in above if holder in shaped]
        pairs |= {frozenset((link, holder)) for holder in holders[-1:]}
    return pairs


def _thinned(
    links: list[str],
    capsules: Capsules,
    poses: Mapping[str, RigidTransform],
    feet: set[str],
) -> bool:
    """Reduces the radii of two links until they are apart; False if that fails.

    The capsules of feet are not changed.
    """
    share = 1.0
    for pair in itertools.product(*(capsules[link] for link in links)):
        first, second = (
            poses[link] @ capsule.points()
            for link, capsule in zip(links, pair, strict=True)
        )
        apart = first[:, :, None] - second[:, None, :]
        room = float(np.linalg.norm(apart, axis=0).min()) - _CLEARANCE
        soft = 0.0
        for link, capsule in zip(links, pair, strict=True):
            if link in feet:
                room -= capsule.radius
            else:
                soft += capsule.radius
        share = min(share, room / soft if soft else 1.0)
    if share < _THINNEST:
        return False
    for capsule in itertools.chain(*(capsules[n] for n in set(links) - feet)):
        capsule.length += 2.0 * capsule.radius * (1.0 - share)
        capsule.radius *= share
    return True
