"""Identification of pelvis, torso, legs and feet in a tree of links."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.new_robot import Named, Notes
from nadia_balance.new_robot.description import Description, Joint
from nadia_balance.new_robot.shapes import Array

LEG_JOINTS = (6, 7)
# Smallest cosine to the lateral axis, or of the up axis to the legs [-].
ALONG = 0.75
_JOINTS_OF_A_LEG = ("hip_pitch", "knee", "ankle_pitch")


@dataclass
class Leg:
    """Names of one leg's foot and joints."""

    foot: str
    joints: list[str]  # from the pelvis to the foot
    hip_pitch: str = ""
    knee: str = ""
    ankle_pitch: str = ""


@dataclass
class Anatomy:
    """Names and axes of a robot at zero posture, in its root."""

    pelvis: str
    torso: str
    legs: dict[Side, Leg]
    axes: Array  # (3, 3): forward, left, up, one a column

    @property
    def feet(self) -> dict[Side, str]:
        """The foot links by side."""
        return {side: leg.foot for side, leg in self.legs.items()}


def two_legs(robot: Description, named: Named) -> tuple[str, list[Leg]]:
    """Returns the pelvis and the two legs, in arbitrary order.

    The legs are the heaviest pair of unbranched chains with the same number of
    joints, 6 or 7, that start at one link.  No joint of `robot` is fixed.

    Raises:
        ValueError: no such pair exists, or a named link does not exist.
    """
    leaves = [link for link in robot.links if not robot.children(link)]
    feet = [_link(robot, n) for n in (named.left_foot, named.right_foot) if n]
    pelvis = named.pelvis and _link(robot, named.pelvis)
    pairs = []
    for pair in itertools.combinations(dict.fromkeys(leaves + feet), 2):
        start, legs = _fork(robot, pair, pelvis)
        if set(feet) <= set(pair) and _are_legs(robot, legs):
            mass = sum(robot.mass(robot.below(leg[0].child)) for leg in legs)
            pairs.append((mass, start, pair, legs))
    if not pairs:
        lengths = {leaf: len(robot.chain(leaf)) for leaf in leaves}
        ends = ", ".join(f"{n} to {leaf}" for leaf, n in lengths.items())
        raise ValueError(
            "legs: must be two, of 6 or 7 joints each (without ankle roll a "
            f"sole does not stay level); numbers of joints: {ends or 'none'}"
        )
    _, start, pair, legs = max(pairs, key=lambda found: found[0])
    names = [[joint.name for joint in leg] for leg in legs]
    return start, list(map(Leg, pair, names))


def _fork(
    robot: Description, pair: tuple[str, str], pelvis: str
) -> tuple[str, list[list[Joint]]]:
    """The pelvis, or the link where two chains part, and what is below it."""
    chains = [robot.chain(link) for link in pair]
    start = pelvis or robot.root
    if not pelvis:
        for one, other in zip(*chains, strict=False):
            start = one.child if one is other else start
    return start, [
        list(itertools.dropwhile(lambda joint: joint.parent != start, chain))
        for chain in chains
    ]


def _are_legs(robot: Description, legs: list[list[Joint]]) -> bool:
    inner = [joint.child for leg in legs for joint in leg[:-1]]
    return (
        len(legs[0]) == len(legs[1])
        and len(legs[0]) in LEG_JOINTS
        and all(len(robot.children(link)) == 1 for link in inner)
    )


def _link(robot: Description, name: str) -> str:
    found = robot.holder(name)
    if found not in robot.links:
        known = ", ".join(sorted(robot.links))
        raise ValueError(f"link {name}: must be one of {known}")
    return found


def check_leg_joints(robot: Description, legs: Sequence[Leg]) -> None:
    """Raises ValueError that names a joint of a leg that cannot be driven."""
    for joint in [robot.joints[name] for leg in legs for name in leg.joints]:
        limits = f"[{joint.lower}, {joint.upper}] rad"
        for wrong, why in (
            (
                joint.type != "revolute",
                f"is {joint.type}: must be revolute, in a leg",
            ),
            (joint.mimics, "must not be a mimic, in a leg"),
            (not joint.effort, "must have an effort limit"),
            (
                joint.upper - joint.lower < 0.1,
                f"limits = {limits}: must leave it some range",
            ),
        ):
            if wrong:
                raise ValueError(f"joint {joint.name}: {why}")


def find_torso(robot: Description, pelvis: str, legs: Sequence[Leg]) -> str:
    """Returns the link of which arms and head are children, or `pelvis`."""
    link = pelvis
    of_legs = {joint for leg in legs for joint in leg.joints}
    while True:
        children = [
            joint.child
            for joint in robot.children(link)
            if joint.name not in of_legs
        ]
        masses = {child: robot.mass(robot.below(child)) for child in children}
        heaviest = max(masses, key=masses.__getitem__, default="")
        least = max(0.6 * sum(masses.values()), robot.mass([link]))
        if not heaviest or masses[heaviest] < least:
            return link
        link = heaviest


def vertical(robot: Description, legs: Sequence[Leg]) -> Array:
    """Returns up (3,): the root's axis nearest to the legs' direction."""
    poses = robot.poses()
    ends = [
        (poses[robot.joints[leg.joints[0]].child], poses[leg.foot])
        for leg in legs
    ]
    upward = [hip.translation() - foot.translation() for hip, foot in ends]
    return _snapped(np.mean(upward, axis=0), "the legs")


def _snapped(direction: Array, what: str) -> Array:
    """The nearest of the six unit vectors along the axes of the root."""
    i = int(np.abs(direction).argmax())
    if abs(direction[i]) < ALONG * np.linalg.norm(direction):
        raise ValueError(
            f"{what}: must lie along an axis of the root's frame, all joints "
            f"at 0; they lie along {np.round(direction, 3)} m"
        )
    return np.sign(direction[i]) * np.eye(3)[i]


def find_anatomy(
    robot: Description,
    legs: Sequence[Leg],
    toes: Sequence[Array],
    named: Named,
    notes: Notes,
) -> Anatomy:
    """Returns the anatomy; the root of `robot` is the pelvis.

    Forward is opposite to the motion of the feet when the knees bend, or, if
    that is not known, the direction of the `toes` (2, 3): the vectors from each
    foot's origin to the centre of its sole, in the root's axes.
    """
    up, poses = vertical(robot, legs), robot.poses()
    feet = [poses[leg.foot].translation() for leg in legs]
    across = feet[0] - feet[1]
    lateral = _snapped(across - up * (up @ across), "the feet")
    for leg, several in zip(legs, _by_leg(named, legs), strict=True):
        _find_pitch(robot, leg, lateral, several)
    forward = np.cross(lateral, up)
    sign = (
        _first_is_left(robot, legs, named)
        or _sign([_goes_back(robot, leg, forward) for leg in legs])
        or _sign([forward @ toe for toe in toes])
        or 1.0
    )
    sides = dict(zip(Side, legs if sign > 0.0 else legs[::-1], strict=True))
    torso = _link(robot, named.torso) if named.torso else ""
    torso = torso or find_torso(robot, robot.root, legs)
    feet_names = ", ".join(leg.foot for leg in sides.values())
    notes.guessed += [
        f"pelvis {robot.root}, torso {torso}, feet {feet_names}",
        *(
            f"{side.value} leg: hip pitch {leg.hip_pitch}, knee {leg.knee}, "
            f"ankle pitch {leg.ankle_pitch}"
            for side, leg in sides.items()
        ),
    ]
    axes = np.stack([sign * forward, sign * lateral, up], axis=1)
    return Anatomy(robot.root, torso, sides, axes)


def _by_leg(named: Named, legs: Sequence[Leg]) -> list[dict[str, str]]:
    """The user's pitch joints of each leg; names may be in any order."""
    found: list[dict[str, str]] = [{}, {}]
    for what in _JOINTS_OF_A_LEG:
        for name in filter(None, getattr(named, what).split(",")):
            holders = [i for i, leg in enumerate(legs) if name in leg.joints]
            if not holders:
                known = ", ".join(joint for leg in legs for joint in leg.joints)
                raise ValueError(f"{what} {name}: must be one of {known}")
            found[holders[0]][what] = name
    return found


def _find_pitch(
    robot: Description, leg: Leg, lateral: Array, named: dict[str, str]
) -> None:
    """Finds hip, knee and ankle among the joints about the `lateral` axis."""
    poses, pitch, at = robot.poses(), [], {}
    for name in leg.joints:
        joint = robot.joints[name]
        X_RC = poses[joint.child]
        at[name] = X_RC.translation()
        if abs(lateral @ (X_RC.rotation() @ robot.axis(joint))) > ALONG:
            pitch.append(name)
    if len(pitch) < 3:
        raise ValueError(
            f"leg to {leg.foot}: must have three joints about the lateral "
            f"axis: hip, knee and ankle; it has {', '.join(pitch) or 'none'}"
        )
    leg.hip_pitch = named.get("hip_pitch", pitch[0])
    leg.ankle_pitch = named.get("ankle_pitch", pitch[-1])
    ends = at[leg.hip_pitch], at[leg.ankle_pitch]
    apart = {
        name: min(float(np.linalg.norm(at[name] - end)) for end in ends)
        for name in pitch[1:-1]
    }
    leg.knee = named.get("knee", max(apart, key=apart.__getitem__))


def _first_is_left(
    robot: Description, legs: Sequence[Leg], named: Named
) -> float:
    """1 if legs[0] is the left one by the user's names, -1 if right, else 0."""
    for name, sign in (named.left_foot, 1.0), (named.right_foot, -1.0):
        if name:
            return sign if robot.holder(name) == legs[0].foot else -sign
    return 0.0


def _sign(lengths: Sequence[float]) -> float:
    """The common sign of lengths [m]; 0 if they differ or are near 0."""
    return float(min(lengths) > 0.01) - float(max(lengths) < -0.01)


def _goes_back(robot: Description, leg: Leg, forward: Array) -> float:
    """Difference [m] of the foot's ranges backward and forward by the knee."""
    knee = robot.joints[leg.knee]
    at = [
        robot.poses({leg.knee: angle})[leg.foot].translation()
        for angle in (knee.lower, knee.nearest(0.0), knee.upper)
    ]
    return float(forward @ (2.0 * at[1] - at[0] - at[2]))
