"""Identification of pelvis, torso, legs and feet in a tree of links."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.new_robot import Named, Notes
from nadia_balance.new_robot.description import Description

# Smallest cosine to the lateral axis, or of the up axis to the legs [-].
ALONG = 0.75


@dataclass
class Leg:
    """Names of one leg's foot and joints."""

    foot: str
    joints: list[str]  # from the pelvis to the foot
    pitches: list[str] = field(default_factory=list)  # of hip, knee and ankle

    @property
    def knee(self) -> str:
        """The joint between thigh and shin."""
        return self.pitches[1]


@dataclass
class Anatomy:
    """Names and axes of a robot at zero posture, in its root."""

    torso: str
    legs: dict[Side, Leg]
    axes: Array  # (3, 3): forward, left, up, one a column

    @property
    def feet(self) -> dict[Side, str]:
        """The foot links by side."""
        return {side: leg.foot for side, leg in self.legs.items()}


def two_legs(robot: Description, named: Named) -> list[Leg]:
    """Returns the two legs, in arbitrary order; the root becomes the pelvis.

    The legs are the heaviest pair of unbranched chains with the same number of
    joints, 6 or 7, that start at one link.  No joint of `robot` is fixed.

    Raises ValueError: no such pair exists, or a named link does not exist.
    """
    if named.pelvis:
        robot.reroot(robot.holder(named.pelvis))
    leaves = [link for link in robot.links if not robot.children(link)]
    feet = [robot.holder(n) for n in (named.left_foot, named.right_foot) if n]
    pairs = []
    for pair in itertools.combinations(dict.fromkeys(leaves + feet), 2):
        chains = [robot.chain(link) for link in pair]
        shared = sum(one is other for one, other in zip(*chains, strict=False))
        one, other = legs = [chain[shared:] for chain in chains]
        inner = [joint.child for leg in legs for joint in leg[:-1]]
        if (
            len(one) == len(other)
            and len(one) in (6, 7)
            and set(feet) <= set(pair)
            and not (named.pelvis and shared)
            and all(len(robot.children(link)) == 1 for link in inner)
        ):
            mass = sum(robot.mass(robot.below(leg[0].child)) for leg in legs)
            names = [[joint.name for joint in leg] for leg in legs]
            found = list(map(Leg, pair, names))
            pairs.append((mass, one[0].parent, found))
    if not pairs:
        ends = [f"{len(robot.chain(leaf))} to {leaf}" for leaf in leaves]
        raise ValueError(
            "legs: must be two, of 6 or 7 joints each (without ankle roll a "
            "sole does not stay level); numbers of joints: " + ", ".join(ends)
        )
    _, pelvis, found = max(pairs, key=lambda pair: pair[0])
    robot.reroot(pelvis)
    return found


def _torso(robot: Description, legs: Sequence[Leg]) -> str:
    """The link of which arms and head are children, or the pelvis."""
    link, of_legs = robot.root, {leg.joints[0] for leg in legs}
    while True:
        children = [j for j in robot.children(link) if j.name not in of_legs]
        masses = {j.child: robot.mass(robot.below(j.child)) for j in children}
        heaviest = max(masses, key=masses.__getitem__, default="")
        least = max(0.6 * sum(masses.values()), robot.mass([link]))
        if not heaviest or masses[heaviest] < least:
            return link
        link = heaviest


def _snapped(direction: Array, what: str) -> Array:
    i = int(np.abs(direction).argmax())
    if abs(direction[i]) < ALONG * np.linalg.norm(direction):
        why = "must lie along an axis of the root's frame, all joints at 0"
        raise ValueError(f"{what}: {why}; now {np.round(direction, 3)} m")
    return np.sign(direction[i]) * np.eye(3)[i]


def find_anatomy(
    robot: Description, legs: Sequence[Leg], named: Named, notes: Notes
) -> Anatomy:
    """Returns the anatomy; the root of `robot` is the pelvis.

    Forward is opposite to the motion of the feet when the knees bend, or, if
    they do not agree, from the ankles to the feet's centres of mass.
    """
    poses, ends = robot.poses(), [leg.foot for leg in legs]
    feet = np.array([poses[foot].translation() for foot in ends])
    hips, _ = robot.hinges([leg.joints[0] for leg in legs], poses)
    up = _snapped(np.mean(hips - feet, axis=0), "the legs")
    across = feet[0] - feet[1]
    lateral = _snapped(across - up * (up @ across), "the feet")
    _find_pitches(robot, legs, lateral, named)
    forward = np.cross(lateral, up)
    # +1 if legs[0] is the left one, -1 if it is the right one.
    ahead = [_back(robot, leg, forward) for leg in legs]
    if min(ahead) * max(ahead) < 1e-4:
        toes = [poses[n] @ robot.links[n].M.get_com() for n in ends]
        ahead = [forward @ p for p in np.subtract(toes, feet)]
    sign = 1.0 if sum(ahead) > 0.0 else -1.0
    for name, side in ((named.right_foot, -1.0), (named.left_foot, 1.0)):
        if name:
            sign = side if robot.holder(name) == legs[0].foot else -side
    sides = dict(zip(Side, legs if sign > 0.0 else legs[::-1], strict=True))
    torso = named.torso and robot.holder(named.torso) or _torso(robot, legs)
    names = ", ".join(leg.foot for leg in sides.values())
    notes.add("guessed", f"pelvis {robot.root}, torso {torso}, feet {names}")
    for side, leg in sides.items():
        hip, knee, ankle = leg.pitches
        line = f"hip pitch {hip}, knee {knee}, ankle pitch {ankle}"
        notes.add("guessed", f"{side.value} leg: {line}")
    axes = np.stack([sign * forward, sign * lateral, up], axis=1)
    return Anatomy(torso, sides, axes)


def _find_pitches(
    robot: Description, legs: Sequence[Leg], lateral: Array, named: Named
) -> None:
    known = [joint for leg in legs for joint in leg.joints]
    whats = ("hip_pitch", "knee", "ankle_pitch")
    by_user = {what: getattr(named, what).split(",") for what in whats}
    for what, names in by_user.items():
        for name in {*names} - {*known, ""}:
            why = f"must be one of {', '.join(known)}"
            raise ValueError(f"{what} {name}: {why}")
    for leg in legs:
        points, axes = robot.hinges(leg.joints, robot.poses())
        at = dict(zip(leg.joints, points, strict=True))
        along = np.abs(axes @ lateral) > ALONG
        pitch = list(itertools.compress(leg.joints, along))
        if len(pitch) < 3:
            why = "must have hip, knee and ankle about the lateral axis"
            has = ", ".join(pitch) or "none"
            raise ValueError(f"leg to {leg.foot}: {why}; it has {has}")
        own = [
            next((name for name in names if name in leg.joints), "")
            for names in by_user.values()
        ]
        hip, ankle = own[0] or pitch[0], own[2] or pitch[-1]
        ends = [at[hip], at[ankle]]
        far = {
            n: np.linalg.norm(ends - at[n], axis=1).min() for n in pitch[1:-1]
        }
        knee = own[1] or max(far, key=far.get)
        leg.pitches = [hip, knee, ankle]


def _back(robot: Description, leg: Leg, forward: Array) -> float:
    """Difference [m] of the foot's ranges backward and forward by the knee."""
    knee = robot.joints[leg.knee]
    lower, middle, upper = (
        robot.poses({leg.knee: angle})[leg.foot].translation()
        for angle in (knee.lower, knee.nearest(0.0), knee.upper)
    )
    return float(forward @ (2.0 * middle - lower - upper))
