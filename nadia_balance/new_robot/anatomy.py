"""Identification of pelvis, torso, legs and feet in a tree of links."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from nadia_balance.core.walking import Side
from nadia_balance.new_robot.notes import Notes
from nadia_balance.new_robot.tree import Array, Joint, Tree

LEG_JOINTS = range(5, 8)
# Smallest cosine to the lateral axis, or of the up axis to the legs [-].
ALONG = 0.75
_JOINTS_OF_A_LEG = ("hip_pitch", "knee", "ankle_pitch")


@dataclass
class Named:
    """Names given by the user; parts with an empty name are identified."""

    pelvis: str = ""
    torso: str = ""
    left_foot: str = ""
    right_foot: str = ""
    hip_pitch: str = ""  # "left,right"
    knee: str = ""
    ankle_pitch: str = ""


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
    """Names and directions of a robot at zero posture, in its root's axes."""

    pelvis: str
    torso: str
    legs: dict[Side, Leg] = field(default_factory=dict)
    forward: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    left: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    up: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    @property
    def feet(self) -> dict[Side, str]:
        """The foot links by side."""
        return {side: leg.foot for side, leg in self.legs.items()}


def two_legs(tree: Tree, named: Named) -> tuple[str, list[Leg]]:
    """Returns the pelvis and the two legs, in arbitrary order.

    The legs are the heaviest pair of unbranched chains with the same number of
    joints, 5 to 7, that start at one link.  No joint of `tree` is fixed.

    Raises:
        ValueError: no such pair exists, or a named link does not exist.
    """
    leaves = [link for link in tree.links if not tree.children(link)]
    feet = [named.left_foot, named.right_foot]
    feet = [_link(tree, foot) for foot in feet if foot]
    pairs = []
    for pair in itertools.combinations(list(dict.fromkeys(leaves + feet)), 2):
        if not set(feet) <= set(pair):
            continue
        chains = [tree.chain(link) for link in pair]
        shared = [a for a, b in zip(*chains, strict=False) if a is b]
        start = shared[-1].child if shared else tree.root
        legs = [chain[len(shared) :] for chain in chains]
        if named.pelvis:
            start = _link(tree, named.pelvis)
            if any(start not in {j.parent for j in leg} for leg in legs):
                continue
            legs = [_from(leg, start) for leg in legs]
        if _are_legs(tree, legs):
            mass = sum(tree.mass(leg[0].child) for leg in legs)
            pairs.append((mass, start, pair, legs))
    if not pairs:
        ends = ", ".join(
            f"{len(tree.chain(leaf))} to {leaf}" for leaf in leaves
        )
        raise ValueError(
            "legs: must be two, of 5 to 7 joints each; numbers of joints: "
            f"{ends or 'none'}"
        )
    _, start, pair, legs = max(pairs, key=lambda found: found[0])
    return start, [
        Leg(foot, [joint.name for joint in leg])
        for foot, leg in zip(pair, legs, strict=True)
    ]


def _are_legs(tree: Tree, legs: list[list[Joint]]) -> bool:
    inner = [joint.child for leg in legs for joint in leg[:-1]]
    return (
        len(legs[0]) == len(legs[1])
        and len(legs[0]) in LEG_JOINTS
        and all(len(tree.children(link)) == 1 for link in inner)
    )


def _from(chain: list[Joint], link: str) -> list[Joint]:
    return chain[[joint.parent for joint in chain].index(link) :]


def _link(tree: Tree, name: str) -> str:
    found = tree.holder(name)
    if found not in tree.links:
        known = ", ".join(sorted(tree.links))
        raise ValueError(f"link {name}: must be one of {known}")
    return found


def check_leg_joints(tree: Tree, legs: Sequence[Leg]) -> None:
    """Raises ValueError that names a joint of a leg that cannot be driven."""
    for name in [joint for leg in legs for joint in leg.joints]:
        joint = tree.joints[name]
        if joint.type != "revolute":
            raise ValueError(
                f"joint {name}: is {joint.type}: must be revolute, in a leg"
            )
        if joint.mimics:
            raise ValueError(f"joint {name}: must not be a mimic, in a leg")
        if not joint.effort:
            raise ValueError(f"joint {name}: must have an effort limit")
        if joint.upper - joint.lower < 0.1:
            raise ValueError(
                f"joint {name}: limits = [{joint.lower}, {joint.upper}] rad: "
                "must leave it some range"
            )


def find_torso(tree: Tree, pelvis: str, legs: Sequence[Leg]) -> str:
    """Returns the link of which arms and head are children, or `pelvis`."""
    link = pelvis
    of_legs = {joint for leg in legs for joint in leg.joints}
    while True:
        joints = [j for j in tree.children(link) if j.name not in of_legs]
        masses = {joint.child: tree.mass(joint.child) for joint in joints}
        heaviest = max(masses, key=masses.__getitem__, default="")
        if not heaviest or masses[heaviest] < max(
            0.6 * sum(masses.values()), tree.links[link].mass
        ):
            return link
        link = heaviest


def vertical(tree: Tree, legs: Sequence[Leg]) -> Array:
    """Returns up (3,): the root's axis nearest to the legs' direction."""
    poses = tree.poses()
    feet = [poses[leg.foot].translation() for leg in legs]
    hips = [
        poses[tree.joints[leg.joints[0]].child].translation() for leg in legs
    ]
    return _snapped(np.mean(hips, axis=0) - np.mean(feet, axis=0), "the legs")


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
    tree: Tree,
    pelvis: str,
    legs: Sequence[Leg],
    toes: Sequence[Array],
    named: Named,
    notes: Notes,
) -> Anatomy:
    """Returns the anatomy; the root of `tree` is the pelvis.

    Forward is opposite to the motion of the feet when the knees bend, or, if
    that is not known, the direction of the `toes` (2, 3): the vectors from each
    foot's origin to the centre of its sole, in the root's axes.
    """
    up = vertical(tree, legs)
    poses = tree.poses()
    feet = [poses[leg.foot].translation() for leg in legs]
    across = feet[0] - feet[1]
    lateral = _snapped(across - up * (up @ across), "the feet")
    for leg, several in zip(legs, _by_leg(named, legs), strict=True):
        _find_pitch(tree, leg, lateral, several)
    forward = np.cross(lateral, up)
    sign = _first_is_left(tree, legs, named)
    sign = sign or _sign([_goes_back(tree, leg, forward) for leg in legs])
    sign = sign or _sign([forward @ toe for toe in toes]) or 1.0
    ordered = legs if sign > 0.0 else legs[::-1]
    torso = _link(tree, named.torso) if named.torso else ""
    torso = torso or find_torso(tree, pelvis, legs)
    found = Anatomy(
        pelvis,
        torso,
        dict(zip(Side, ordered, strict=True)),
        sign * forward,
        sign * lateral,
        up,
    )
    notes.guessed.append(
        f"pelvis {pelvis}, torso {torso}, feet {', '.join(found.feet.values())}"
    )
    for side, leg in found.legs.items():
        notes.guessed.append(
            f"{side.value} leg: hip pitch {leg.hip_pitch}, knee {leg.knee}, "
            f"ankle pitch {leg.ankle_pitch}"
        )
    return found


def _by_leg(named: Named, legs: Sequence[Leg]) -> list[dict[str, str]]:
    """The user's pitch joints of each leg; names may be in any order."""
    found: list[dict[str, str]] = [{}, {}]
    for what in _JOINTS_OF_A_LEG:
        for name in filter(None, getattr(named, what).split(",")):
            holders = [leg for leg in legs if name in leg.joints]
            if not holders:
                known = ", ".join(joint for leg in legs for joint in leg.joints)
                raise ValueError(f"{what} {name}: must be one of {known}")
            found[[leg is holders[0] for leg in legs].index(True)][what] = name
    return found


def _find_pitch(
    tree: Tree, leg: Leg, lateral: Array, named: dict[str, str]
) -> None:
    """Finds hip, knee and ankle among the joints about the `lateral` axis."""
    poses = tree.poses()
    children = {name: tree.joints[name].child for name in leg.joints}
    pitch = [
        name
        for name, child in children.items()
        if abs(lateral @ (poses[child].rotation() @ tree.joints[name].axis))
        > ALONG
    ]
    if len(pitch) < 3:
        raise ValueError(
            f"leg to {leg.foot}: must have three joints about the lateral "
            f"axis: hip, knee and ankle; it has {', '.join(pitch) or 'none'}"
        )
    at = {name: poses[children[name]].translation() for name in leg.joints}
    leg.hip_pitch = named.get("hip_pitch", pitch[0])
    leg.ankle_pitch = named.get("ankle_pitch", pitch[-1])

    def apart(name: str) -> float:
        ends = at[leg.hip_pitch], at[leg.ankle_pitch]
        return min(float(np.linalg.norm(at[name] - end)) for end in ends)

    leg.knee = named.get("knee", max(pitch[1:-1], key=apart))


def _first_is_left(tree: Tree, legs: Sequence[Leg], named: Named) -> float:
    """1 if legs[0] is the left one by the user's names, -1 if right, else 0."""
    for name, sign in (named.left_foot, 1.0), (named.right_foot, -1.0):
        if name:
            return sign if tree.holder(name) == legs[0].foot else -sign
    return 0.0


def _sign(lengths: Sequence[float]) -> float:
    """The common sign of lengths [m]; 0 if they differ or are near 0."""
    low, high = min(lengths), max(lengths)
    return float(low > 0.01) - float(high < -0.01)


def _goes_back(tree: Tree, leg: Leg, forward: Array) -> float:
    """Difference [m] of the foot's ranges backward and forward by the knee."""
    knee = tree.joints[leg.knee]
    at = [
        tree.poses({leg.knee: angle})[leg.foot].translation()
        for angle in (knee.lower, knee.nearest(0.0), knee.upper)
    ]
    return float(forward @ (2.0 * at[1] - at[0] - at[2]))
