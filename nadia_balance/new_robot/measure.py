"""Measurement of the lengths and the standing posture for robot.yaml."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.math import RotationMatrix
from scipy.optimize import least_squares

from nadia_balance.core.body.com_height import LegReach, leg_reach
from nadia_balance.core.body.model import LegGeometry
from nadia_balance.core.math.size import Size
from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.new_robot.anatomy import ALONG, Anatomy, Leg
from nadia_balance.new_robot.description import Description
from nadia_balance.new_robot.shapes import Array
from nadia_balance.new_robot.soles import SolePlane, largest_rectangle

# Knee bends to try in the standing posture, the first feasible is used [rad].
_BENDS = np.arange(0.6, 0.2, -0.05)
# Distances of the legs' pitch joints, and of all joints outside of the legs,
# from their limits [rad].
_LEG_MARGIN, _ARM_MARGIN = 0.1, 0.15
_LEVEL = 0.01  # tolerance of level soles under the CoM [m], [rad]
# Smallest gap between the standing soles [leg length].
_GAP = 0.05
_SAME_LENGTH = 0.01  # tolerated relative difference of the legs' lengths [-]
_NEVER_STRAIGHT = 0.1  # smallest bend of a knee [rad]
_MOST_LEAN = 1.0  # largest outward angle of a leg [rad]


@dataclass
class Sole:
    """The field `sole` of RobotParams [m]."""

    x_min: float
    x_max: float
    half_width: float
    z: float


@dataclass
class Measurements:
    """The measured fields of RobotParams; lengths in m, angles in rad."""

    sole: Sole
    legs: LegGeometry
    reach: LegReach
    com_height: float
    step_width: float
    posture: dict[str, float]
    # Lower and upper joint limits that keep the knees bent.
    knee_limits: dict[str, tuple[float, float]]

    @property
    def size(self) -> Size:
        """The size that scales Nadia's values to parameters not measured."""
        leg, sole = self.legs.length + self.legs.ankle_height, self.sole
        return Size(leg, sole.x_max - sole.x_min, 2.0 * sole.half_width)


def set_frames(
    robot: Description, anatomy: Anatomy, soles: Mapping[Side, SolePlane]
) -> dict[Side, Array]:
    """Rotates the frames of pelvis, torso and feet: x forward, z up.

    The frames of the feet are parallel to the soles; origins do not move.
    Returns the points (k, 2) [m] of the soles in the frames of the feet.
    """
    poses = robot.poses()
    turns = {}
    for side, foot in anatomy.feet.items():
        z = -soles[side].down
        y = np.cross(z, poses[foot].rotation().inverse() @ anatomy.axes[:, 0])
        y /= np.linalg.norm(y)
        turns[foot] = np.stack([np.cross(y, z), y, z], axis=1)
    for link in anatomy.pelvis, anatomy.torso:
        turns[link] = poses[link].rotation().inverse().matrix() @ anatomy.axes
    for link, turn in turns.items():
        robot.turn(link, RotationMatrix.ProjectToRotationMatrix(turn))
    anatomy.axes = np.eye(3)
    return {
        side: (soles[side].points @ turns[foot])[:, :2]
        for side, foot in anatomy.feet.items()
    }


def measure(
    robot: Description,
    anatomy: Anatomy,
    soles: Mapping[Side, Array],
    depth: float,
) -> Measurements:
    """Returns measured lengths and the posture of `robot`, after set_frames.

    `soles` are points (k, 2) [m] in the frames of the feet, at z = -`depth`.

    Raises:
        ValueError: the robot cannot stand with bent knees on level soles.
    """
    legs = list(anatomy.legs.values())
    heel, toe, half_width = largest_rectangle(list(soles.values()))
    knees = {leg.knee: _knee(robot, leg) for leg in legs}
    length = _length(anatomy, knees.values())
    p_FS = np.array([0.5 * (heel + toe), 0.0, -depth])
    posture = _posture(robot, legs, knees, p_FS)
    com, poses = robot.com(posture), robot.poses(posture)

    def height(names: list[str]) -> float:
        """Mean height [m] of joints."""
        links = [robot.joints[name].child for name in names]
        return float(np.mean([poses[link].translation()[2] for link in links]))

    left, right = (poses[leg.foot] @ p_FS for leg in legs)
    ground, across = float(0.5 * (left + right)[2]), float(left[1] - right[1])
    geometry = LegGeometry(
        length=length,
        ankle_height=height([leg.ankle_pitch for leg in legs]) - ground,
        com_above_hip=float(com[2]) - height([leg.hip_pitch for leg in legs]),
        hip_width=across,
    )
    com_height = float(com[2]) - ground
    return Measurements(
        sole=Sole(heel, toe, half_width, -depth),
        legs=geometry,
        reach=leg_reach(geometry, com_height, _lean(robot, anatomy)),
        com_height=com_height,
        step_width=max(across, 2.0 * half_width + _GAP * length),
        posture=posture,
        knee_limits={name: knee.limits() for name, knee in knees.items()},
    )


def _lean(robot: Description, anatomy: Anatomy) -> float:
    """Largest outward angle [rad] of both legs by the ranges of roll joints.

    The sole stays level if the ankle has a roll joint; without one the ankle
    does not limit the angle, and the sole tilts.
    """
    poses, most = robot.poses(), _MOST_LEAN
    for side, leg in anatomy.legs.items():
        knee = leg.joints.index(leg.knee)
        for i, name in enumerate(leg.joints):
            joint = robot.joints[name]
            axis = poses[joint.child].rotation() @ robot.axis(joint)
            along = float(axis[0])
            if abs(along) > ALONG:
                # Hips rotate the leg outward, ankles the foot back inward.
                outward = side.sign * np.sign(along) * (1 if i < knee else -1)
                most = min(most, joint.upper if outward > 0 else -joint.lower)
    return max(most, 0.0)


@dataclass
class _Knee:
    """A knee in the x-z plane; its bend is > 0 if the foot moves back."""

    thigh: float  # [m]
    shin: float
    at_zero: float  # bend at joint angle 0 [rad]
    sense: float  # +-1, sign of d bend / d angle
    least: float  # smallest bend [rad]
    most: float  # largest bend [rad]

    def angle(self, bend: float) -> float:
        """The joint angle [rad] of a `bend` [rad]."""
        return self.sense * (bend - self.at_zero)

    def longest(self) -> float:
        """Largest distance [m] from hip to ankle, by the law of cosines."""
        bend = min(max(0.0, self.least), self.most)
        product = self.thigh * self.shin * np.cos(bend)
        return float(np.sqrt(self.thigh**2 + self.shin**2 + 2.0 * product))

    def limits(self) -> tuple[float, float]:
        """Limits [rad] of the joint angle that keep it bent, +-inf if none."""
        if self.least >= _NEVER_STRAIGHT:
            return -np.inf, np.inf
        angle = self.angle(_NEVER_STRAIGHT)
        return (angle, np.inf) if self.sense > 0.0 else (-np.inf, angle)


def _length(anatomy: Anatomy, knees: Iterable[_Knee]) -> float:
    """Mean length of the legs [m]; raises ValueError if they differ."""
    left, right = (knee.longest() for knee in knees)
    length = 0.5 * (left + right)
    if abs(left - right) > _SAME_LENGTH * length:
        raise ValueError(
            f"legs to {' and '.join(anatomy.feet.values())}: must be alike; "
            f"they are {left:.3f} and {right:.3f} m long"
        )
    return length


def _knee(robot: Description, leg: Leg) -> _Knee:
    poses = robot.poses(dict.fromkeys(leg.joints, 0.0))
    hip, knee, ankle = (
        poses[robot.joints[name].child].translation()[[0, 2]]
        for name in (leg.hip_pitch, leg.knee, leg.ankle_pitch)
    )
    thigh, shin = knee - hip, ankle - knee
    at_zero = np.arctan2(thigh[1] * shin[0] - thigh[0] * shin[1], thigh @ shin)
    joint = robot.joints[leg.knee]
    sense = np.sign((poses[joint.child].rotation() @ robot.axis(joint))[1])
    least, most = sorted(
        at_zero + sense * angle for angle in (joint.lower, joint.upper)
    )
    return _Knee(
        *map(float, map(np.linalg.norm, (thigh, shin))),
        *map(float, (at_zero, sense, least, most)),
    )


def _posture(
    robot: Description,
    legs: Sequence[Leg],
    knees: Mapping[str, _Knee],
    p_FS: Array,
) -> dict[str, float]:
    """Angles [rad] of all joints with bent knees and level soles under the CoM.

    Raises:
        ValueError: the ranges of the legs' joints are too small.
    """
    of_legs = {name for leg in legs for name in leg.joints}
    angles = {
        name: joint.nearest(0.0, 0.0 if name in of_legs else _ARM_MARGIN)
        for name, joint in robot.joints.items()
    }
    searched = [n for leg in legs for n in (leg.hip_pitch, leg.ankle_pitch)]
    joints = [robot.joints[name] for name in searched]
    bounds = [
        [joint.nearest(end, _LEG_MARGIN) for joint in joints]
        for end in (-np.inf, np.inf)
    ]

    def off(values: Array) -> Array:
        """Distances [m] of the soles from the CoM, and their slopes [rad]."""
        angles.update(zip(searched, map(float, values), strict=True))
        com, poses = robot.com(angles), robot.poses(angles)
        feet = [poses[leg.foot] for leg in legs]
        return np.array(
            [(X_RF @ p_FS - com)[0] for X_RF in feet]
            + [X_RF.rotation().matrix()[2, 0] for X_RF in feet]
        )

    for name, knee in knees.items():
        if knee.most < _BENDS[-1]:
            raise ValueError(
                f"joint {name}: must bend the knee, so that the foot goes back,"
                f" by {_BENDS[-1]:.2f} rad; it does by {knee.most:.2f} rad"
            )
    for bend in _BENDS:
        for name, knee in knees.items():
            nearest = robot.joints[name].nearest
            angles[name] = nearest(knee.angle(bend), _LEG_MARGIN)
        start = np.clip(np.zeros(len(joints)), *bounds)
        found = least_squares(off, start, bounds=bounds)
        if np.abs(off(found.x)).max() < _LEVEL:
            return {n: a for n, a in angles.items() if abs(a) > 1e-4}
    raise ValueError(
        f"joints {', '.join(searched)}: must have the range to put level "
        f"soles under the CoM, the knees {_BENDS[-1]:.2f} rad from straight"
    )
