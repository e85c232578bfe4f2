"""Anatomy of a robot: its legs, its torso, its sides and its axes."""

import itertools
import re
from collections.abc import Mapping, Sequence

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import Side
from nadia_balance.new_robot.description import (
    Anatomy,
    Description,
    Joint,
    Leg,
    Notes,
)
from nadia_balance.new_robot.shapes import find_sole
from nadia_balance.parameters.bounds import require

FEET = {"right_foot": Side.RIGHT, "left_foot": Side.LEFT}
# Smallest cosine to the lateral axis, or of the up axis to the legs [-].
ALONG = 0.75
_OBLIQUE = 0.64  # the same of a hip's pitch axis: 50 degrees [-]
# The ranges of a knee that bends as far forward as back differ by less [rad].
_EITHER_WAY = 0.3
# A last pitch joint this near to one that is no knee, in bones, is a toe's.
_TOE = 0.6
# Axes within 3 degrees of one of the base's are along that.
SQUARE = np.cos(np.deg2rad(3.0))
# The middle of a sole nearer to the ankle, in its length, tells no direction.
_CENTRED = 0.05
_SIDES = {"l": 1, "left": 1, "r": -1, "right": -1}
_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")

# Links that the user names: of pelvis, torso, left_foot and right_foot.
Names = Mapping[str, str]


def two_legs(robot: Description, named: Names) -> list[Leg]:
    """Finds the two legs; the root becomes the pelvis.

    They are the pair of unbranched chains with the same number of joints, 6 or
    7, that start at one link, with the largest product of mass and mean effort
    limit.

    Args:
        robot: without fixed joints.
        named: links of which the user tells the names.

    Returns:
        The legs, in arbitrary order.

    Raises:
        ValueError: no such pair exists, or a named link does not exist.
    """
    if named.get("pelvis"):
        robot.reroot(robot.holder(named["pelvis"]))
    leaves = [link for link in robot.links if not robot.children(link)]
    feet = [robot.holder(named[name]) for name in FEET if named.get(name)]
    pairs = []
    for pair in itertools.combinations(dict.fromkeys(leaves + feet), 2):
        chains = [robot.chain(link) for link in pair]
        shared = sum(a is b for a, b in zip(*chains, strict=False))
        one, other = (chain[shared:] for chain in chains)
        if (
            len(one) == len(other)
            and len(one) in (6, 7)
            and set(feet) <= set(pair)
            and len(set(feet)) == len(feet)
            and not (named.get("pelvis") and shared)
            and all(
                len(robot.children(joint.child)) == 1
                for joint in one[:-1] + other[:-1]
            )
        ):
            mass = sum(
                robot.mass(robot.below(chain[0].child))
                for chain in (one, other)
            )
            # Arms may be as heavy, not as strong.
            strength = 1.0 + np.mean(
                _efforts(robot, one) + _efforts(robot, other)
            )
            pairs.append((mass * strength, pair, one, other))
    require(
        len(pairs) > 0,
        "legs: must be two, of 6 or 7 joints each (without ankle roll a "
        "sole does not stay level); numbers of joints: "
        + ", ".join(f"{len(robot.chain(end))} to {end}" for end in leaves),
    )
    _, pair, one, other = max(pairs, key=lambda pair: pair[0])
    robot.reroot(one[0].parent)
    return [
        Leg(foot, [joint.name for joint in chain])
        for foot, chain in zip(pair, (one, other), strict=True)
    ]


def _efforts(robot: Description, chain: Sequence[Joint]) -> list[float]:
    """The effort limits [N m]; 0 for one beyond the weight times the chain.

    It is no motor's, but stands in a file for a limit that nobody knows.
    """
    points, _ = robot.hinges([joint.name for joint in chain], robot.poses())
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    largest = GRAVITY * robot.mass(robot.links) * float(length)
    return [joint.effort * (joint.effort <= largest) for joint in chain]


def _torso(robot: Description, legs: Sequence[Leg]) -> str:
    """The link of which arms and head are children, or the pelvis."""
    link = robot.root
    of_legs = {leg.joints[0] for leg in legs}
    while True:
        masses = {
            joint.child: robot.mass(robot.below(joint.child))
            for joint in robot.children(link)
            if joint.name not in of_legs
        }
        heaviest = max(masses, key=masses.__getitem__, default="")
        smallest = max(0.6 * sum(masses.values()), robot.mass([link]))
        if not heaviest or masses[heaviest] < smallest:
            return link
        link = heaviest


def _snapped(direction: Array, subject: str) -> Array:
    i = int(np.abs(direction).argmax())
    require(
        abs(direction[i]) >= ALONG * np.linalg.norm(direction),
        f"{subject}: must lie along an axis of the root's frame, all "
        f"joints at 0; now {np.round(direction, 3)} m",
    )
    return np.asarray(np.sign(direction[i]) * np.eye(3)[i])


def find_anatomy(
    robot: Description, legs: Sequence[Leg], named: Names, notes: Notes
) -> Anatomy:
    """Finds torso, sides and axes of a robot.

    Forward is opposite to the motion of the feet when the knees bend from
    straight to the farther end of their ranges; if they do not agree, from the
    ankles to the middles of the soles; if these are below the ankles, by the
    sides in the names.

    Args:
        robot: its root is the pelvis.
        legs: both, in any order; get the pitch joints.
        named: links of which the user tells the names.
        notes: get what was guessed.

    Returns:
        The anatomy.

    Raises:
        ValueError: it cannot be told, or a named torso is of a leg.
    """
    poses = robot.poses()
    feet = np.array([poses[leg.foot].translation() for leg in legs])
    hips, _ = robot.hinges([leg.joints[0] for leg in legs], poses)
    up = _snapped(np.mean(hips - feet, axis=0), "the legs")
    across = feet[0] - feet[1]
    lateral = _snapped(across - up * (up @ across), "the feet")
    for leg in legs:
        leg.pitches = _pitches(robot, leg, lateral)
    lateral = _across_knees(robot, legs, lateral=lateral, up=up, notes=notes)
    axes = np.stack([np.cross(lateral, up), lateral, up], axis=1)
    sign = _sign(robot, legs, named, axes=axes)
    sides = dict(zip(Side, legs if sign > 0.0 else legs[::-1], strict=True))
    torso = (
        robot.holder(named["torso"])
        if named.get("torso")
        else _torso(robot, legs)
    )
    for leg in legs:
        require(
            torso not in robot.below(robot.joints[leg.joints[0]].child),
            f"torso = {torso!r}: must not be of the leg to {leg.foot}",
        )
    notes.add(
        "guessed",
        f"pelvis {robot.root}, torso {torso}, feet "
        + ", ".join(leg.foot for leg in sides.values()),
    )
    for side, leg in sides.items():
        hip, knee, ankle = leg.pitches
        notes.add(
            "guessed",
            f"{side.value} leg: hip pitch {hip}, knee {knee}, "
            f"ankle pitch {ankle}",
        )
    return Anatomy(torso=torso, legs=sides, axes=axes * [sign, sign, 1.0])


def _sign(
    robot: Description, legs: Sequence[Leg], named: Names, *, axes: Array
) -> float:
    """+1 if the first of the `axes` is forward, and legs[0] left; or -1."""
    for name, side in FEET.items():
        if named.get(name):
            is_first = robot.holder(named[name]) == legs[0].foot
            return float(side.sign if is_first else -side.sign)
    knees = [Knee(robot, leg, axes) for leg in legs]
    ahead = [knee.min_bend + knee.max_bend for knee in knees]
    if min(ahead) < _EITHER_WAY and max(ahead) > -_EITHER_WAY:
        ahead = [_sole_ahead(robot, leg, axes) for leg in legs]
        if abs(sum(ahead)) < 2.0 * _CENTRED:
            signs = [side_signs((leg.foot, *leg.joints)) for leg in legs]
            require(
                signs in ([{1}, {-1}], [{-1}, {1}]),
                f"feet {' and '.join(leg.foot for leg in legs)}: knees, soles "
                "and names do not tell which way is forward: --left-foot must",
            )
            return float(signs[0].pop())
    return 1.0 if sum(ahead) > 0.0 else -1.0


def _sole_ahead(robot: Description, leg: Leg, axes: Array) -> float:
    """How far the middle of a sole is ahead of its ankle, in its length [-]."""
    poses = robot.poses()
    X_RF = poses[leg.foot]
    sole = find_sole(
        robot.links[leg.foot], X_RF.rotation().inverse() @ -axes[:, 2]
    )
    ahead = (X_RF @ sole.points.T).T @ axes[:, 0]
    (ankle,), _ = robot.hinges(leg.pitches[2:], poses)
    middle = 0.5 * (ahead.min() + ahead.max()) - ankle @ axes[:, 0]
    return float(middle / np.ptp(ahead))


def side_signs(names: Sequence[str]) -> set[int]:
    """The sides that are words of names.

    Args:
        names: of links and joints.

    Returns:
        +1 for left, -1 for right, or both.
    """
    words = {word.lower() for name in names for word in _WORDS.findall(name)}
    return {_SIDES[word] for word in words & _SIDES.keys()}


def _across_knees(
    robot: Description,
    legs: Sequence[Leg],
    *,
    lateral: Array,
    up: Array,
    notes: Notes,
) -> Array:
    """The lateral axis of a robot whose base is turned, by its knees' axes."""
    _, axes = robot.hinges([leg.knee for leg in legs], robot.poses())
    mean = np.sign(axes @ lateral) @ axes
    mean -= up * (up @ mean)
    mean /= np.linalg.norm(mean)
    if mean @ lateral > SQUARE:
        return lateral
    turn = np.degrees(np.arccos(mean @ lateral))
    notes.add("changed", f"turned by {turn:.0f} deg, as its knees", robot.root)
    return np.asarray(mean)


def _pitches(robot: Description, leg: Leg, lateral: Array) -> list[str]:
    """The joints of hip, knee and ankle about the `lateral` axis.

    The knee has the longest bones, and the hip's is the most lateral above it.
    """
    points, axes = robot.hinges(leg.joints, robot.poses())
    cosines = np.abs(axes @ lateral)
    *upper, ankle = np.flatnonzero(cosines > ALONG).tolist() or [0]
    bones = {
        i: min(np.linalg.norm(points[end] - points[i]) for end in (0, ankle))
        for i in upper
    }
    knee = max(upper, key=bones.__getitem__, default=0)
    hip = int(np.argmax(cosines[:knee].round(3))) if knee else 0
    names = [leg.joints[i] for i in (*upper, ankle)]
    require(
        knee > 0 and cosines[hip] > _OBLIQUE,
        f"leg to {leg.foot}: must have hip, knee and ankle about the "
        f"lateral axis; it has {', '.join(names)}",
    )
    require(
        upper[-1] == knee or bones[upper[-1]] >= _TOE * bones[knee],
        f"joint {names[-1]}: must be welded, --fix {names[-1]}: it looks like "
        "a toe's",
    )
    return [leg.joints[i] for i in (hip, knee, ankle)]


class Knee:
    """A knee in the plane of its leg; its bend is > 0 if the foot moves back.

    `at_zero` is the bend at joint angle 0 [rad], `sense` the sign of d bend /
    d angle, `min_bend` and `max_bend` are the ends of its range [rad].
    """

    def __init__(self, robot: Description, leg: Leg, axes: Array) -> None:
        """Measures it, all joints of the leg at 0.

        Args:
            robot: with the leg.
            leg: with its pitch joints.
            axes: (3, 3): forward, left, up in the root, one a column.
        """
        points, hinges = robot.hinges(
            leg.pitches, robot.poses(dict.fromkeys(leg.joints, 0.0))
        )
        sense = np.sign(hinges[1] @ axes[:, 1])
        forward = np.cross(sense * hinges[1], axes[:, 2])
        forward /= np.linalg.norm(forward)
        along = np.cross(forward, sense * hinges[1])
        a, b = np.diff(points @ np.stack([forward, along], axis=1), axis=0)
        self.bones = [float(np.linalg.norm(bone)) for bone in (a, b)]
        self.at_zero = float(np.arctan2(a[1] * b[0] - a[0] * b[1], a @ b))
        self.sense = float(sense)
        joint = robot.joints[leg.knee]
        self.min_bend, self.max_bend = sorted(
            self.at_zero + self.sense * end
            for end in (joint.lower, joint.upper)
        )

    def angle(self, bend: float) -> float:
        """Returns the joint angle of a bend.

        Args:
            bend: from straight [rad].

        Returns:
            The angle [rad].
        """
        return self.sense * (bend - self.at_zero)

    def longest(self) -> float:
        """Returns the largest distance from hip to ankle.

        Returns:
            The distance [m], by the law of cosines.
        """
        cosine = np.cos(min(max(0.0, self.min_bend), self.max_bend))
        a, b = self.bones
        return float(np.sqrt(a**2 + b**2 + 2.0 * (a * b * cosine)))
