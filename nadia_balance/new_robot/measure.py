"""Anatomy of a robot, and the fields of robot.yaml that are measured on it."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from scipy.optimize import least_squares

from nadia_balance.core.body.com_height import leg_reach
from nadia_balance.core.body.model import LegGeometry
from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Side
from nadia_balance.new_robot.description import Anatomy, Description, Leg, Notes
from nadia_balance.new_robot.shapes import find_sole, largest_rectangle
from nadia_balance.parameters.scaling import Size, scaled

FEET = {"right_foot": Side.RIGHT, "left_foot": Side.LEFT}
# Smallest cosine to the lateral axis, or of the up axis to the legs [-].
ALONG = 0.75
# Knee bends to try in the standing posture, the first feasible is used [rad].
_BENDS = np.arange(0.6, 0.2, -0.05)
# Distances of legs' pitch joints, and of joints elsewhere, from limits [rad].
_LEG_MARGIN, _ARM_MARGIN = 0.1, 0.15
_LEVEL = 0.01  # tolerance of level soles under the CoM [m], [rad]
# A last pitch joint this near to one that is no knee, in bones, is a toe's.
_TOE, _LONGEST_SOLE = 0.6, 1.0  # [-], [m]
_GAP = 0.05  # smallest between the standing soles [leg length]
_SAME_DEPTH = 0.004  # tolerated difference of the soles' depths [m]
_SAME_LENGTH = 0.01  # tolerated relative difference of the legs' lengths [-]
_NEVER_STRAIGHT = 0.1  # smallest bend of a knee [rad]
_MOST_LEAN = 1.0  # largest outward angle of a leg [rad]

# Links that the user names: of pelvis, torso, left_foot and right_foot.
Names = Mapping[str, str]
Fields = dict[str, Any]  # of robot.yaml [m, rad]


def two_legs(robot: Description, named: Names) -> list[Leg]:
    """Returns the two legs, in arbitrary order; the root becomes the pelvis.

    The legs are the pair of unbranched chains with the same number of joints, 6
    or 7, that start at one link, with the largest product of mass and mean
    effort limit.  No joint of `robot` is fixed.

    Raises ValueError: no such pair exists, or a named link does not exist.
    """
    if named.get("pelvis"):
        robot.reroot(robot.holder(named["pelvis"]))
    leaves = [link for link in robot.links if not robot.children(link)]
    feet = [robot.holder(named[name]) for name in FEET if named.get(name)]
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
            and len(set(feet)) == len(feet)
            and not (named.get("pelvis") and shared)
            and all(len(robot.children(link)) == 1 for link in inner)
        ):
            mass = sum(robot.mass(robot.below(leg[0].child)) for leg in legs)
            # Arms may be as heavy, not as strong.
            strength = 1.0 + np.mean([j.effort for leg in legs for j in leg])
            names = [[joint.name for joint in leg] for leg in legs]
            found = list(map(Leg, pair, names))
            pairs.append((mass * strength, one[0].parent, found))
    if not pairs:
        ends = [f"{len(robot.chain(leaf))} to {leaf}" for leaf in leaves]
        why = "without ankle roll a sole does not stay level"
        must = f"legs: must be two, of 6 or 7 joints each ({why}); numbers of"
        raise ValueError(f"{must} joints: {', '.join(ends)}")
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
    robot: Description, legs: Sequence[Leg], named: Names, notes: Notes
) -> Anatomy:
    """Returns the anatomy; the root of `robot` is the pelvis.

    Forward is opposite to the motion of the feet when the knees bend, or, if
    they do not agree, from the ankles to the feet's centres of mass.
    """
    poses, ends = robot.poses(), [leg.foot for leg in legs]
    feet = np.array([poses[end].translation() for end in ends])
    hips, _ = robot.hinges([leg.joints[0] for leg in legs], poses)
    up = _snapped(np.mean(hips - feet, axis=0), "the legs")
    across = feet[0] - feet[1]
    lateral = _snapped(across - up * (up @ across), "the feet")
    for leg in legs:
        leg.pitches = _pitches(robot, leg, lateral)
    forward = np.cross(lateral, up)
    # +1 if legs[0] is the left one, -1 if it is the right one.
    ahead = [_back(robot, leg, forward) for leg in legs]
    if min(ahead) * max(ahead) < 1e-4:
        toes = [poses[n] @ robot.links[n].M.get_com() for n in ends]
        ahead = [forward @ p for p in np.subtract(toes, feet)]
    sign = 1.0 if sum(ahead) > 0.0 else -1.0
    for foot, side in FEET.items():
        if named.get(foot):
            first = robot.holder(named[foot]) == legs[0].foot
            sign = float(side.sign if first else -side.sign)
    sides = dict(zip(Side, legs if sign > 0.0 else legs[::-1], strict=True))
    torso = _torso(robot, legs)
    if named.get("torso"):
        torso = robot.holder(named["torso"])
    names = ", ".join(leg.foot for leg in sides.values())
    notes.add("guessed", f"pelvis {robot.root}, torso {torso}, feet {names}")
    for side, leg in sides.items():
        hip, knee, ankle = leg.pitches
        line = f"hip pitch {hip}, knee {knee}, ankle pitch {ankle}"
        notes.add("guessed", f"{side.value} leg: {line}")
    axes = np.stack([sign * forward, sign * lateral, up], axis=1)
    return Anatomy(torso, sides, axes)


def _pitches(robot: Description, leg: Leg, lateral: Array) -> list[str]:
    """The joints of hip, knee and ankle about the `lateral` axis."""
    points, axes = robot.hinges(leg.joints, robot.poses())
    at = dict(zip(leg.joints, points, strict=True))
    along = np.abs(axes @ lateral) > ALONG
    pitches = list(itertools.compress(leg.joints, along))
    if len(pitches) < 3:
        why = "must have hip, knee and ankle about the lateral axis"
        has = ", ".join(pitches) or "none"
        raise ValueError(f"leg to {leg.foot}: {why}; it has {has}")
    hip, *inner, ankle = pitches
    ends = [at[hip], at[ankle]]
    far = {n: np.linalg.norm(ends - at[n], axis=1).min() for n in inner}
    knee = max(inner, key=far.__getitem__)
    if inner[-1] != knee and far[inner[-1]] < _TOE * far[knee]:
        why = f"must be welded, --fix {ankle}: it looks like a toe's"
        raise ValueError(f"joint {ankle}: {why}")
    return [hip, knee, ankle]


def _back(robot: Description, leg: Leg, forward: Array) -> float:
    """Difference [m] of the foot's ranges backward and forward by the knee."""
    knee = robot.joints[leg.knee]
    lower, middle, upper = (
        robot.poses({leg.knee: angle})[leg.foot].translation()
        for angle in (knee.lower, knee.nearest(0.0), knee.upper)
    )
    return float(forward @ (2.0 * middle - lower - upper))


def measure(robot: Description, anatomy: Anatomy, notes: Notes) -> Fields:
    """Returns the fields of robot.yaml; sets the frames of `robot`.

    Raises ValueError: a foot has no sole, or it cannot stand with bent knees.
    """
    legs, feet = list(anatomy.legs.values()), list(anatomy.feet.values())
    forward, _, up = anatomy.axes.T
    R_RL = {link: pose.rotation() for link, pose in robot.poses().items()}
    soles = [find_sole(robot.links[f], R_RL[f].inverse() @ -up) for f in feet]
    of_feet = list(zip(feet, soles, strict=True))
    depths = [sole.depth for sole in soles]
    # Frames of pelvis, torso and feet get x forward and z up, the feet's along
    # their soles; origins stay.
    ups = dict.fromkeys((robot.root, anatomy.torso), up)
    ups |= {foot: R_RL[foot] @ -sole.down for foot, sole in of_feet}
    for link, z in ups.items():
        y = np.cross(z, forward)
        y /= np.linalg.norm(y)
        axes = np.stack([np.cross(y, z), y, z])
        R_NR = RotationMatrix.ProjectToRotationMatrix(axes)
        R_RL[link] = R_NR @ R_RL[link]  # now R_NL
        robot.move(link, RigidTransform(R_RL[link]))
    flat = [(R_RL[foot] @ sole.points.T)[:2].T for foot, sole in of_feet]
    extents = [np.ptp(points, axis=0) for points in flat]
    for foot, (x, y) in zip(feet, extents, strict=True):
        if x > _LONGEST_SOLE:
            raise ValueError(f"sole of {foot}: {x:.3g} m long: mesh in mm?")
        if y > x:
            line = f"is wider than long, {y:.3f} and {x:.3f} m: is it turned?"
            notes.add("warning", f"the sole of {foot} {line}")
    heel, toe, half_width = largest_rectangle(flat)
    knees = {leg.knee: _Knee(robot, leg) for leg in legs}
    lengths = [knee.longest() for knee in knees.values()]
    length, depth = float(np.mean(lengths)), float(np.mean(depths))
    for what, (left, right), most, where in (
        ("soles of", depths, _SAME_DEPTH, "under the ankles"),
        ("legs to", lengths, _SAME_LENGTH * length, "long"),
    ):
        if abs(left - right) > most:
            are = f"they are {left:.3f} and {right:.3f} m {where}"
            both = " and ".join(feet)
            raise ValueError(f"{what} {both}: must be alike; {are}")
    p_FS = np.array([0.5 * (heel + toe), 0.0, -depth])
    posture = _posture(robot, legs, knees, p_FS)
    poses = robot.poses(posture)
    left, right = (poses[foot] @ p_FS for foot in feet)
    ground, across = float(0.5 * (left + right)[2]), float(left[1] - right[1])
    hips, _, ankles = (
        float(robot.hinges(names, poses)[0][:, 2].mean())
        for names in zip(*(leg.pitches for leg in legs), strict=True)
    )
    com = float(robot.com(poses)[2])
    heights = {"ankle_height": ankles - ground, "com_above_hip": com - hips}
    geometry = LegGeometry(length=length, hip_width=across, **heights)
    able, aside = leg_reach(geometry, com - ground, _lean(robot, anatomy))
    step_width = max(across, 2.0 * half_width + _GAP * length)
    sole = {"x_min": heel, "x_max": toe, "half_width": half_width, "z": -depth}
    fields: Fields = {
        "name": robot.name,
        "urdf": "robot.urdf",
        "pelvis_body": robot.root,
        "torso_body": anatomy.torso,
        "left_foot_body": feet[0],
        "right_foot_body": feet[1],
        "sole": sole,
        "com_height": com - ground,
        "step_width": step_width,
        "posture": posture,
        "legs": asdict(geometry),
        "whole_body": {"joint_lower_limits": {}, "joint_upper_limits": {}},
    }
    for name, knee in knees.items():
        if knee.least < _NEVER_STRAIGHT:
            which = "lower" if knee.sense > 0.0 else "upper"
            limits = fields["whole_body"][f"joint_{which}_limits"]
            limits[name] = knee.angle(_NEVER_STRAIGHT)
    # Nadia's lengths and widths, scaled, at most the legs' reach.
    nadias = scaled(ReachabilityParams(), size_of(fields))
    forward = min(nadias.length_forward, able)
    fields["reachability"] = widths(nadias) | {
        "length_forward": forward,
        "length_backward": forward,
        "width_nominal": step_width,
        "width_max": min(nadias.width_max, aside),
    }
    x, y = extents[0]
    for line in (
        f"sole {toe - heel:.3f} x {2.0 * half_width:.3f} m, of {x:.3f} x "
        f"{y:.3f} m that the {soles[0].source} shapes have",
        f"legs {length:.3f} m, hips {across:.3f} m apart, ankles "
        f"{ankles - ground:.3f} m high",
        f"CoM {com - ground:.3f} m high, soles {step_width:.3f} m apart; arms "
        "and spine at 0, or near it",
        f"legs reach {able:.3f} m forward and back, "
        f"{aside:.3f} m to the side; used up to Nadia's, by size",
    ):
        notes.add("guessed", line)
    return fields


def size_of(fields: Fields) -> Size:
    """The size that scales Nadia's values to parameters not measured."""
    legs, sole = fields["legs"], fields["sole"]
    leg, width = legs["length"] + legs["ankle_height"], 2.0 * sole["half_width"]
    return Size(leg, sole["x_max"] - sole["x_min"], width)


def widths(reach: ReachabilityParams) -> dict[str, float]:
    """The lengths and widths [m] of a reach that robot.yaml has."""
    kinds = ("length_", "width_")
    return {k: v for k, v in vars(reach).items() if k.startswith(kinds)}


def _lean(robot: Description, anatomy: Anatomy) -> float:
    """Largest outward angle [rad] of both legs, by the ranges of rolls."""
    poses, most = robot.poses(), _MOST_LEAN
    for side, leg in anatomy.legs.items():
        _, axes = robot.hinges(leg.joints, poses)
        above = leg.joints.index(leg.knee)
        for i, name in enumerate(leg.joints):
            if abs(axes[i, 0]) > ALONG:
                # Hips rotate the leg outward, ankles the foot back inward.
                outward = side.sign * axes[i, 0] * (1 if i < above else -1)
                joint = robot.joints[name]
                most = min(most, joint.upper if outward > 0 else -joint.lower)
    return max(most, 0.0)


class _Knee:
    """A knee in the x-z plane; its bend [rad] is > 0 if the foot moves back."""

    def __init__(self, robot: Description, leg: Leg):
        poses = robot.poses(dict.fromkeys(leg.joints, 0.0))
        points, axes = robot.hinges(leg.pitches, poses)
        a, b = thigh, shin = np.diff(points[:, [0, 2]], axis=0)
        self.bones = [float(np.linalg.norm(bone)) for bone in (thigh, shin)]
        # The bend at joint angle 0, and the sign of d bend / d angle.
        self.at_zero = float(np.arctan2(a[1] * b[0] - a[0] * b[1], a @ b))
        self.sense, joint = float(np.sign(axes[1, 1])), robot.joints[leg.knee]
        ends = joint.lower, joint.upper
        bends = sorted(self.at_zero + self.sense * end for end in ends)
        self.least, self.most = bends

    def angle(self, bend: float) -> float:
        return self.sense * (bend - self.at_zero)

    def longest(self) -> float:
        """Largest distance [m] from hip to ankle, by the law of cosines."""
        cosine = np.cos(min(max(0.0, self.least), self.most))
        a, b = self.bones
        return float(np.sqrt(a**2 + b**2 + 2.0 * (a * b * cosine)))


def _posture(robot: Description, legs, knees, p_FS: Array) -> dict[str, float]:
    """Angles [rad] of all joints: knees bent, soles level under the CoM."""
    of_legs = {name for leg in legs for name in leg.joints}
    angles = {
        name: joint.nearest(0.0, 0.0 if name in of_legs else _ARM_MARGIN)
        for name, joint in robot.joints.items()
    }
    searched = [name for leg in legs for name in leg.pitches[::2]]
    hinges = [robot.joints[name] for name in searched]
    ends = -np.inf, np.inf
    bounds = [[j.nearest(end, _LEG_MARGIN) for j in hinges] for end in ends]

    def off(values: Array) -> Array:
        angles.update(zip(searched, map(float, values), strict=True))
        poses = robot.poses(angles)
        com, feet = robot.com(poses), [poses[leg.foot] for leg in legs]
        ahead = [(X_RF @ p_FS - com)[0] for X_RF in feet]
        tilts = [X_RF.rotation().matrix()[2, 0] for X_RF in feet]
        return np.array(ahead + tilts)

    least, goal = _BENDS[-1], "must bend the knee, so that the foot goes back"
    for name, knee in knees.items():
        if knee.most < least:
            why = f"by {least:.2f} rad; it does by {knee.most:.2f} rad"
            raise ValueError(f"joint {name}: {goal}, {why}")
    for bend in _BENDS:
        for name, knee in knees.items():
            nearest = robot.joints[name].nearest
            angles[name] = nearest(knee.angle(bend), _LEG_MARGIN)
        start = np.clip(np.zeros(len(searched)), *bounds)
        found = least_squares(off, start, bounds=bounds)
        if np.abs(off(found.x)).max() < _LEVEL:
            return {n: a for n, a in angles.items() if abs(a) > 1e-4}
    must = "must have the range to put level soles under the CoM, the knees"
    what = f"joints {', '.join(searched)}"
    raise ValueError(f"{what}: {must} {least:.2f} rad from straight")
