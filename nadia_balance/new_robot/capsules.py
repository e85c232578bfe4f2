"""Collision capsules of links that do not overlap in the standing posture."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RotationMatrix

from nadia_balance.new_robot import Notes
from nadia_balance.new_robot.anatomy import Anatomy
from nadia_balance.new_robot.description import (
    COLLIDING,
    VISUAL,
    Array,
    Description,
    Shape,
)
from nadia_balance.new_robot.measure import Measurements

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

    def ends(self) -> Array:
        """The centres (2, 3) [m] of its ends, in the link's frame."""
        half = 0.5 * self.length
        return np.stack([self.X_LG @ [0.0, 0.0, z] for z in (-half, half)])


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
    feet = anatomy.feet.values()
    capsules = {foot: _shoe(measured) for foot in feet}
    of_legs = {
        robot.joints[name].child
        for leg in anatomy.legs.values()
        for name in leg.joints
    }
    for leg in anatomy.legs.values():
        knee = robot.joints[leg.knee]
        for name, upper, lower in (
            (knee.parent, leg.hip_pitch, leg.knee),
            (knee.child, leg.knee, leg.ankle_pitch),
        ):
            capsule = _fitted(_shapes(robot, name), measured.legs.length)
            if not capsule:
                notes.guessed.append(f"the thickness of {name}")
            capsules[name] = [capsule or _bone(robot, name, upper, lower)]
    for name in robot.links:
        if name not in of_legs:
            if capsule := _fitted(_shapes(robot, name), measured.legs.length):
                capsules[name] = [capsule]
    ignored = _neighbours(robot, set(capsules))
    poses = robot.poses(measured.posture)
    for pair in map(frozenset, itertools.combinations(capsules, 2)):
        if pair in ignored or pair == frozenset(feet):
            continue
        if not _thinned(pair, capsules, poses, set(feet)):
            ignored.add(pair)
            notes.changed.append(
                f"{' and '.join(sorted(pair))} may pass through each other: "
                "they overlap where the robot stands"
            )
    return capsules, ignored


def _shapes(robot: Description, link: str) -> list[Shape]:
    return robot.shapes(link, COLLIDING) or robot.shapes(link, VISUAL)


def _fitted(shapes: Sequence[Shape], leg: float) -> Capsule | None:
    """A capsule with the length and about the thickness of a link."""
    if not shapes:
        return None
    points = np.concatenate([shape.points() for shape in shapes])
    if np.ptp(points, axis=0).max() < _SMALLEST * leg:
        return None
    to_box, extents = trimesh.bounds.oriented_bounds(points)
    order = np.argsort(extents)  # the longest becomes z
    R_BG = np.eye(3)[:, order]
    R_BG[:, 0] *= np.linalg.det(R_BG)
    X_LB = RigidTransform(
        RotationMatrix.ProjectToRotationMatrix(to_box[:3, :3].T),
        -to_box[:3, :3].T @ to_box[:3, 3],
    )
    small, middle, large = np.sort(extents)
    radius = 0.25 * _THICKNESS * (small + middle)
    length = max(large - 2.0 * radius, 0.01 * large)
    X_BG = RigidTransform(RotationMatrix(R_BG))
    return Capsule(X_LB @ X_BG, float(radius), float(length))


def _bone(robot: Description, link: str, upper: str, lower: str) -> Capsule:
    """A capsule from joint `upper` to joint `lower`, in the frame of `link`."""
    poses = robot.poses()
    ends = [
        poses[link].inverse() @ poses[robot.joints[name].child].translation()
        for name in (upper, lower)
    ]
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    R = RotationMatrix.MakeFromOneVector(along, 2)
    X_LG = RigidTransform(R, 0.5 * (ends[0] + ends[1]))
    return Capsule(X_LG, _BONE * length, (1.0 - 2.0 * _BONE) * length)


def _shoe(measured: Measurements) -> list[Capsule]:
    """Two parallel capsules within the sole's rectangle, just above it."""
    length = measured.toe - measured.heel
    radius = min(2.0 / 3.0 * measured.half_width, 0.25 * length)
    centre = 0.5 * (measured.heel + measured.toe)
    z = measured.sole_z + SHOE_ABOVE_SOLE + radius
    along = RotationMatrix.MakeYRotation(0.5 * np.pi)
    y = measured.half_width - radius
    return [
        Capsule(
            RigidTransform(along, [centre, side * y, z]),
            radius,
            0.9 * length - 2.0 * radius,
        )
        for side in (1.0, -1.0)
    ]


def _neighbours(robot: Description, shaped: set[str]) -> Pairs:
    """Pairs of `shaped` links without another one between them."""

    def above(link: str) -> str | None:
        while link != robot.root:
            link = robot.joint_to(link).parent
            if link in shaped:
                return link
        return None

    return {
        frozenset((link, holder)) for link in shaped if (holder := above(link))
    }


def _thinned(
    pair: frozenset[str],
    capsules: Capsules,
    poses: Mapping[str, RigidTransform],
    feet: set[str],
) -> bool:
    """Reduces the radii of a pair until it is apart; False if that fails.

    The capsules of feet are not changed.
    """
    links = sorted(pair)
    gaps = []
    for one, other in itertools.product(*(capsules[link] for link in links)):
        first, second = (
            poses[link] @ capsule.ends().T
            for link, capsule in zip(links, (one, other), strict=True)
        )
        thick = [
            capsule.radius
            for link, capsule in zip(links, (one, other), strict=True)
        ]
        fixed = sum(
            r for r, link in zip(thick, links, strict=True) if link in feet
        )
        room = _distance(first.T, second.T) - _CLEARANCE - fixed
        gaps.append((room, sum(thick) - fixed))
    share = min((room / soft if soft else 1.0) for room, soft in gaps)
    if share < _THINNEST:
        return False
    for link in set(links) - feet:
        for capsule in capsules[link]:
            capsule.length += 2.0 * capsule.radius * max(1.0 - share, 0.0)
            capsule.radius *= min(share, 1.0)
    return True


def _distance(first: Array, second: Array) -> float:
    """Distance [m] of two segments (2, 3), sampled at 41 points each."""
    shares = np.linspace(0.0, 1.0, 41)[:, None]
    points, others = (
        ends[0] + shares * (ends[1] - ends[0]) for ends in (first, second)
    )
    return float(np.linalg.norm(points[:, None] - others, axis=2).min())
