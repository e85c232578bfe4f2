"""Capsules for links, which do not overlap where the robot just stands."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RotationMatrix

from nadia_balance.new_robot.anatomy import Anatomy
from nadia_balance.new_robot.figures import Figures
from nadia_balance.new_robot.notes import Notes
from nadia_balance.new_robot.tree import Array, Link, Tree

# Links that are smaller have none, of the length of a leg [-].
_SMALLEST = 0.25
_THICKNESS = 0.9  # of the mean of a link's other extents
_BONE = 0.15  # radius of a thigh or shin of which nothing is known [-]
# What is nearer, where it stands, is made thinner, at the most so much.
_CLEARANCE, _THINNEST = 0.03, 0.5
SHOE_ABOVE_SOLE = 0.004  # [m]


@dataclass
class Capsule:
    """In the frame of its link; its axis is z of its own."""

    X_LG: RigidTransform
    radius: float  # [m]
    length: float  # between the centres of its ends [m]

    def ends(self) -> Array:
        """The two centres (2, 3)."""
        half = 0.5 * self.length
        return np.stack([self.X_LG @ [0.0, 0.0, z] for z in (-half, half)])


Capsules = dict[str, list[Capsule]]
Pairs = set[frozenset[str]]


def fit_capsules(
    tree: Tree, anatomy: Anatomy, figures: Figures, notes: Notes
) -> tuple[Capsules, Pairs]:
    """Returns the capsules by link, and the pairs that may not touch.

    Of a leg only thigh, shin and foot have any.  The pairs are neighbours, with
    no other link that has capsules in between, and what overlaps where the
    robot stands although it was made thinner.
    """
    feet = anatomy.feet.values()
    capsules = {foot: _shoe(figures) for foot in feet}
    of_legs = {
        tree.joints[name].child
        for leg in anatomy.legs.values()
        for name in leg.joints
    }
    for leg in anatomy.legs.values():
        knee = tree.joints[leg.knee]
        for name, upper, lower in (
            (knee.parent, leg.hip_pitch, leg.knee),
            (knee.child, leg.knee, leg.ankle_pitch),
        ):
            capsule = _fitted(tree.links[name], figures.legs.length)
            if not capsule:
                notes.guessed.append(f"the thickness of {name}")
            capsules[name] = [capsule or _bone(tree, name, upper, lower)]
    for name, link in tree.links.items():
        if name not in of_legs:
            if capsule := _fitted(link, figures.legs.length):
                capsules[name] = [capsule]
    ignored = _neighbours(tree, set(capsules))
    poses = tree.poses(figures.posture)
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


def _fitted(link: Link, leg: float) -> Capsule | None:
    """A capsule as long as the link, of about its thickness."""
    shapes = link.collisions or link.visuals
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


def _bone(tree: Tree, link: str, upper: str, lower: str) -> Capsule:
    """From one joint to the next, in the frame of `link`."""
    poses = tree.poses()
    ends = [
        poses[link].inverse() @ poses[tree.joints[name].child].translation()
        for name in (upper, lower)
    ]
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    R = RotationMatrix.MakeFromOneVector(along, 2)
    X_LG = RigidTransform(R, 0.5 * (ends[0] + ends[1]))
    return Capsule(X_LG, _BONE * length, (1.0 - 2.0 * _BONE) * length)


def _shoe(figures: Figures) -> list[Capsule]:
    """Two, side by side, within the sole's rectangle and just above it."""
    length = figures.toe - figures.heel
    radius = min(2.0 / 3.0 * figures.half_width, 0.25 * length)
    centre = 0.5 * (figures.heel + figures.toe)
    z = figures.sole_z + SHOE_ABOVE_SOLE + radius
    along = RotationMatrix.MakeYRotation(0.5 * np.pi)
    y = figures.half_width - radius
    return [
        Capsule(
            RigidTransform(along, [centre, side * y, z]),
            radius,
            0.9 * length - 2.0 * radius,
        )
        for side in (1.0, -1.0)
    ]


def _neighbours(tree: Tree, shaped: set[str]) -> Pairs:
    """Pairs of `shaped` links with none of them between."""

    def above(link: str) -> str | None:
        while link != tree.root:
            link = tree.joint_to(link).parent
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
    """Makes the two thinner until they are apart; False if that fails.

    Shoes stay as they are.
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
    """Between two segments (2, 3), over points 1/40 apart."""
    shares = np.linspace(0.0, 1.0, 41)[:, None]
    points, others = (
        ends[0] + shares * (ends[1] - ends[0]) for ends in (first, second)
    )
    return float(np.linalg.norm(points[:, None] - others, axis=2).min())
