"""The fields of robot.yaml that are measured on a robot."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from scipy.optimize import least_squares  # type: ignore[import-untyped]

from nadia_balance.core.body.com_height import leg_reach
from nadia_balance.core.body.model import LegGeometry
from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Side
from nadia_balance.new_robot.anatomy import ALONG, SQUARE, Knee
from nadia_balance.new_robot.description import (
    Anatomy,
    Description,
    Leg,
    Notes,
    Vector,
)
from nadia_balance.new_robot.shapes import (
    SolePlane,
    find_sole,
    largest_rectangle,
)
from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.scaling import Size, scaled

# Knee bends to try in the standing posture, the first feasible is used [rad].
_BENDS = np.arange(0.6, 0.2, -0.05)
# Distances of legs' pitch joints, and of joints elsewhere, from limits [rad].
_LEG_MARGIN, _ARM_MARGIN = 0.1, 0.15
_LEVEL = 0.01  # tolerance of level soles under the CoM [m], [rad]
_LONGEST_SOLE = 1.0  # [m]
_GAP = 0.05  # smallest between the standing soles [leg length]
_SAME_DEPTH = 0.004  # tolerated difference of the soles' depths [m]
_SAME_LENGTH = 0.01  # tolerated relative difference of the legs' lengths [-]
_NEVER_STRAIGHT = 0.1  # smallest bend of a knee [rad]
_LARGEST_LEAN = 1.0  # largest outward angle of a leg [rad]
_ASLANT = 0.035  # tilt across from which a leg or sole is drawn aslant [rad]
_LEAST_SHARE = 0.5  # of a sole, that its rectangle should have [-]
_FAR_BELOW = 0.3  # of the hips, where no pelvis is, in leg lengths [-]

Fields = dict[str, Any]  # of robot.yaml [m, rad]


def measure(robot: Description, anatomy: Anatomy, notes: Notes) -> Fields:
    """Measures the fields of robot.yaml.

    Args:
        robot: its pelvis, torso and feet get frames with x forward and z up.
        anatomy: of the robot.
        notes: get what was guessed.

    Returns:
        The fields [m, rad].

    Raises:
        ValueError: a foot has no sole, or it cannot stand with bent knees.
    """
    soles = _level_frames(robot, anatomy)
    hanging = _hanging(robot, anatomy, notes)
    heel, toe, half_width = largest_rectangle(
        [sole.points[:, :2] for sole in soles.values()]
    )
    _doubt_soles(soles, (toe - heel) * 2.0 * half_width, notes)
    depth = _mean_of_alike(
        [sole.depth for sole in soles.values()],
        tolerance=_SAME_DEPTH,
        subject=f"soles of {' and '.join(soles)}",
        place="under the ankles",
    )
    knees = {
        leg.knee: Knee(robot, leg, np.eye(3)) for leg in anatomy.legs.values()
    }
    lengths = [knee.longest() for knee in knees.values()]
    length = _mean_of_alike(
        lengths,
        tolerance=_SAME_LENGTH * float(np.mean(lengths)),
        subject=f"legs to {' and '.join(soles)}",
        place="long",
    )
    p_FS = np.array([0.5 * (heel + toe), 0.0, -depth])
    _raise_root(robot, anatomy, length=length, notes=notes)
    posture = _posture(
        robot, list(anatomy.legs.values()), knees, hanging=hanging, p_FS=p_FS
    )
    com_height, geometry = _geometry(
        robot, anatomy, posture=posture, p_FS=p_FS, length=length
    )
    step_width = max(geometry.hip_width, 2.0 * half_width + _GAP * length)
    fields: Fields = {
        "name": robot.name,
        "urdf": "robot.urdf",
        "pelvis_body": robot.root,
        "torso_body": anatomy.torso,
        "left_foot_body": anatomy.feet[Side.LEFT],
        "right_foot_body": anatomy.feet[Side.RIGHT],
        "sole": {
            "x_min": heel,
            "x_max": toe,
            "half_width": half_width,
            "z": -depth,
        },
        "com_height": com_height,
        "step_width": step_width,
        "posture": posture,
        "legs": asdict(geometry),
        "whole_body": _joint_limits(knees),
    }
    sole = soles[anatomy.feet[Side.LEFT]]
    for line in (
        f"sole {toe - heel:.3f} x {2.0 * half_width:.3f} m, of "
        f"{sole.extents[0]:.3f} x {sole.extents[1]:.3f} m that the "
        f"{sole.source} shapes have",
        f"legs {length:.3f} m, hips {geometry.hip_width:.3f} m apart, ankles "
        f"{geometry.ankle_height:.3f} m high",
        f"CoM {com_height:.3f} m high, soles {step_width:.3f} m apart; arms "
        "and spine at 0, or near it",
    ):
        notes.add("guessed", line)
    fields["reachability"] = _reach(
        fields, geometry, lean=_lean(robot, anatomy, hanging), notes=notes
    )
    return fields


def _geometry(
    robot: Description,
    anatomy: Anatomy,
    *,
    posture: Mapping[str, float],
    p_FS: Array,
    length: float,
) -> tuple[float, LegGeometry]:
    """Height of the CoM [m] and dimensions of the legs where it stands."""
    poses = robot.poses(posture)
    left, right = (poses[foot] @ p_FS for foot in anatomy.feet.values())
    ground = float(0.5 * (left + right)[2])
    com = robot.com(poses)
    pitches = [leg.pitches for leg in anatomy.legs.values()]
    hips, _, ankles = (
        robot.hinges(names, poses)[0].mean(axis=0)
        for names in zip(*pitches, strict=True)
    )
    ahead = (hips - com) - (ankles - 0.5 * (left + right))
    return float(com[2]) - ground, LegGeometry(
        length=length,
        ankle_height=float(ankles[2]) - ground,
        com_above_hip=float(com[2] - hips[2]),
        hip_ahead=float(ahead[0]),
        hip_width=float(left[1] - right[1]),
    )


def _reach(
    fields: Mapping[str, Any], legs: LegGeometry, *, lean: float, notes: Notes
) -> dict[str, float]:
    """Nadia's lengths and widths [m], scaled, at most the legs' reach."""
    length, width = leg_reach(legs, fields["com_height"], lean)
    notes.add(
        "guessed",
        f"legs reach {length:.3f} m forward and back, {width:.3f} m to the "
        "side; used up to Nadia's, by size",
    )
    nadias = scaled(ReachabilityParams(), size_of(fields))
    return widths(nadias) | {
        "length_forward": min(nadias.length_forward, length),
        "length_backward": min(nadias.length_backward, length),
        "width_nominal": fields["step_width"],
        "width_max": min(nadias.width_max, width),
    }


def _level_frames(robot: Description, anatomy: Anatomy) -> dict[str, SolePlane]:
    """Gives pelvis, torso and feet frames with x forward and z up.

    Those of the feet are along their soles, and across the ankles' axes; all
    origins stay.  Returns the soles of the feet, with points in the new frames.
    """
    forward, lateral, up = anatomy.axes.T
    R_RL = {link: pose.rotation() for link, pose in robot.poses().items()}
    soles = {
        foot: find_sole(robot.links[foot], R_RL[foot].inverse() @ -up)
        for foot in anatomy.feet.values()
    }
    ups = dict.fromkeys((robot.root, anatomy.torso), up)
    ups |= {foot: R_RL[foot] @ -sole.down for foot, sole in soles.items()}
    ahead = dict.fromkeys(ups, forward)
    for leg in anatomy.legs.values():
        _, (ankle,) = robot.hinges(leg.pitches[2:], robot.poses())
        if abs(ankle @ lateral) < SQUARE:
            ahead[leg.foot] = np.cross(
                np.sign(ankle @ lateral) * ankle, ups[leg.foot]
            )
    for link, z in ups.items():
        y = np.cross(z, ahead[link])
        y /= np.linalg.norm(y)
        axes: Vector = np.stack([np.cross(y, z), y, z])
        R_NL = RotationMatrix.ProjectToRotationMatrix(axes) @ R_RL[link]
        robot.move(link, RigidTransform(R_NL))
        if link in soles:
            soles[link].points = (R_NL @ soles[link].points.T).T
    return soles


def _raise_root(
    robot: Description, anatomy: Anatomy, *, length: float, notes: Notes
) -> None:
    """Moves the root's origin between the hips, if it is on the ground."""
    firsts = [leg.joints[0] for leg in anatomy.legs.values()]
    between = robot.hinges(firsts, robot.poses())[0].mean(axis=0)
    if between[2] > _FAR_BELOW * length:
        robot.move(robot.root, RigidTransform(np.negative(between)))
        notes.add(
            "changed",
            f"its origin is between the hips, not {between[2]:.2f} m below",
            robot.root,
        )


def _hanging(
    robot: Description, anatomy: Anatomy, notes: Notes
) -> dict[str, float]:
    """Angles [rad] of rolls, at which legs and soles are not aslant.

    The first roll above the knee makes the knee's axis level, the first one
    below it the sole; {} if they are so at 0.
    """
    angles: dict[str, float] = {}
    for leg in anatomy.legs.values():
        _, axes = robot.hinges(leg.joints, robot.poses())
        knee = leg.joints.index(leg.knee)
        rolls = [i for i, axis in enumerate(axes) if abs(axis[0]) > ALONG]
        above = [leg.joints[i] for i in rolls if i < knee]
        below = [leg.joints[i] for i in rolls if i > knee]
        names = above[:1] + below[:1]
        tilts = partial(_tilts_across, robot, leg, names)
        if np.abs(tilts(np.zeros(len(names)))).max() < _ASLANT:
            continue
        ends = [
            [robot.joints[name].nearest(end, _LEG_MARGIN) for name in names]
            for end in (-np.inf, np.inf)
        ]
        solution = least_squares(tilts, np.mean(ends, axis=0), bounds=ends)
        if np.abs(solution.fun).max() > _LEVEL:
            notes.add(
                "warning", f"the sole of {leg.foot} is not level, upright"
            )
            continue
        turned = dict(zip(names, map(float, solution.x), strict=True))
        notes.add(
            "guessed",
            f"{leg.foot} hangs straight, its sole level, at "
            + ", ".join(f"{name} {x:.2f} rad" for name, x in turned.items()),
        )
        angles |= turned
    return angles


def _tilts_across(
    robot: Description, leg: Leg, names: Sequence[str], values: Array
) -> Array:
    """Tilts (2,) [-] of a knee's axis and a sole, with joints at `values`."""
    poses = robot.poses(dict(zip(names, values, strict=True)))
    _, (axis,) = robot.hinges([leg.knee], poses)
    return np.array([axis[2], poses[leg.foot].rotation().matrix()[2, 1]])


def _doubt_soles(
    soles: Mapping[str, SolePlane], area: float, notes: Notes
) -> None:
    """Doubts soles that are no foot's, or much larger than `area` [m^2]."""
    turned = []
    for foot, sole in soles.items():
        length, width = sole.extents
        require(
            length <= _LONGEST_SOLE,
            f"sole of {foot}: {length:.3g} m long: mesh in mm?",
        )
        if width > length:
            turned.append(
                f"the sole of {foot} is wider than long, {width:.3f} and "
                f"{length:.3f} m: is it turned?"
            )
    turned = turned or [
        f"the rectangle is {100.0 * area / sole.area:.0f} % of the sole of "
        f"{foot}: is it turned?"
        for foot, sole in soles.items()
        if area < _LEAST_SHARE * sole.area
    ]
    for line in turned:
        notes.add("warning", line)


def _mean_of_alike(
    values: Sequence[float], tolerance: float, subject: str, place: str
) -> float:
    """The mean of two lengths [m] that must not differ by more."""
    left, right = values
    require(
        abs(left - right) <= tolerance,
        f"{subject}: must be alike; they are {left:.3f} and {right:.3f} m "
        f"{place}",
    )
    return float(np.mean(values))


def _joint_limits(knees: Mapping[str, Knee]) -> dict[str, dict[str, float]]:
    """Limits of joints [rad], with which no knee gets straight."""
    return {
        f"joint_{end}_limits": {
            name: knee.angle(_NEVER_STRAIGHT)
            for name, knee in knees.items()
            if knee.min_bend < _NEVER_STRAIGHT
            and (knee.sense > 0.0) == (end == "lower")
        }
        for end in ("lower", "upper")
    }


def size_of(fields: Mapping[str, Any]) -> Size:
    """Returns the size that scales Nadia's values to what is not measured.

    Args:
        fields: those of robot.yaml.

    Returns:
        Lengths of leg and sole [m].
    """
    legs = fields["legs"]
    sole = fields["sole"]
    return Size(
        leg=legs["length"] + legs["ankle_height"],
        sole_length=sole["x_max"] - sole["x_min"],
        sole_width=2.0 * sole["half_width"],
    )


def widths(reach: ReachabilityParams) -> dict[str, float]:
    """Returns the fields of a reach that robot.yaml has.

    Args:
        reach: of the legs.

    Returns:
        Lengths and widths [m] by name.
    """
    return {
        name: value
        for name, value in asdict(reach).items()
        if name.startswith(("length_", "width_"))
    }


def _lean(
    robot: Description, anatomy: Anatomy, hanging: Mapping[str, float]
) -> float:
    """Largest outward angle [rad] of both legs, by the ranges of rolls."""
    lean = _LARGEST_LEAN
    for side, leg in anatomy.legs.items():
        _, axes = robot.hinges(leg.joints, robot.poses())
        above = leg.joints.index(leg.knee)
        for i, name in enumerate(leg.joints):
            if abs(axes[i, 0]) > ALONG:
                # Hips rotate the leg outward, ankles the foot back inward.
                outward = side.sign * axes[i, 0] * (1 if i < above else -1)
                joint, zero = robot.joints[name], hanging.get(name, 0.0)
                lean = min(
                    lean,
                    joint.upper - zero if outward > 0 else zero - joint.lower,
                )
    return max(lean, 0.0)


def _free(robot: Description, leg: Leg) -> list[str]:
    """The joints that put a sole under the CoM: pitches of hip and ankle.

    If that of the hip is oblique, or the knee's axis not lateral, all but the
    knee.
    """
    _, axes = robot.hinges(leg.pitches[:2], robot.poses())
    hip, knee = np.abs(axes[:, 1])
    if hip > ALONG and knee > SQUARE:
        return leg.pitches[::2]
    return [name for name in leg.joints if name != leg.knee]


def _posture(
    robot: Description,
    legs: Sequence[Leg],
    knees: Mapping[str, Knee],
    *,
    hanging: Mapping[str, float],
    p_FS: Array,
) -> dict[str, float]:
    """Angles [rad] of all joints: knees bent, soles level under the CoM."""
    for name, knee in knees.items():
        require(
            knee.max_bend >= _BENDS[-1],
            f"joint {name}: must bend the knee, so that the foot goes "
            f"back, by {_BENDS[-1]:.2f} rad; it does by "
            f"{knee.max_bend:.2f} rad (--left-foot tells which way is "
            "forward)",
        )
    of_legs = {name for leg in legs for name in leg.joints}
    angles = {
        name: joint.nearest(0.0, 0.0 if name in of_legs else _ARM_MARGIN)
        for name, joint in robot.joints.items()
    }
    angles.update(hanging)
    searched = [name for leg in legs for name in _free(robot, leg)]
    bounds = [
        [robot.joints[name].nearest(end, _LEG_MARGIN) for name in searched]
        for end in (-np.inf, np.inf)
    ]

    straight = robot.poses(hanging)
    places = {leg.foot: straight[leg.foot].translation() for leg in legs}

    def error(values: Array) -> Array:
        angles.update(zip(searched, map(float, values), strict=True))
        poses = robot.poses(angles)
        com = robot.com(poses)
        misses: list[float] = []
        for leg in legs:
            X_RF = poses[leg.foot]
            R = X_RF.rotation().matrix()
            # Ahead of the CoM [m], and its tilt [-].
            misses += [(X_RF @ p_FS - com)[0], R[2, 0]]
            if len(searched) > 2 * len(legs):
                # Its tilt across, its heading, and how far it moves aside [m].
                aside = X_RF.translation()[1] - places[leg.foot][1]
                misses += [R[2, 1], R[1, 0], aside]
        return np.array(misses)

    for bend in _BENDS:
        for name, knee in knees.items():
            angles[name] = robot.joints[name].nearest(
                knee.angle(bend), _LEG_MARGIN
            )
        solution = least_squares(
            error,
            np.clip(
                [hanging.get(name, 0.0) for name in searched],
                bounds[0],
                bounds[1],
            ),
            bounds=bounds,
        )
        if np.abs(error(solution.x)).max() < _LEVEL:
            return {n: a for n, a in angles.items() if abs(a) > 1e-4}
    raise ValueError(
        f"joints {', '.join(searched)}: must have the range to put level soles "
        f"under the CoM, the knees {_BENDS[-1]:.2f} rad from straight"
    )
