"""Measurement of the fields of robot.yaml: soles, legs, standing posture."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull, QhullError

from nadia_balance.core.body.com_height import leg_reach
from nadia_balance.core.body.model import LegGeometry
from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.bounds import Size, scaled
from nadia_balance.new_robot import Notes
from nadia_balance.new_robot import description as robots
from nadia_balance.new_robot.anatomy import ALONG, Anatomy, Leg

# Knee bends to try in the standing posture, the first feasible is used [rad].
_BENDS = np.arange(0.6, 0.2, -0.05)
# Distances of the legs' pitch joints, and of all joints outside of the legs,
# from their limits [rad].
_LEG_MARGIN, _ARM_MARGIN = 0.1, 0.15
_LEVEL = 0.01  # tolerance of level soles under the CoM [m], [rad]
# Smallest gap between the standing soles [leg length].
_GAP = 0.05
_SAME_DEPTH = 0.004  # tolerated difference of the soles' depths [m]
_SAME_LENGTH = 0.01  # tolerated relative difference of the legs' lengths [-]
_NEVER_STRAIGHT = 0.1  # smallest bend of a knee [rad]
_MOST_LEAN = 1.0  # largest outward angle of a leg [rad]
# Tolerances for points on the plane, of meshes and of round solids [m].
_ON_PLANE = {"mesh": 0.002, "cylinder": 1e-4, "ellipsoid": 1e-4}
_ON_PLANE_EXACT = 0.0025
_SAME_NORMAL = np.cos(np.deg2rad(3.0))
_DOWNWARD = np.cos(np.deg2rad(50.0))
_WIDTHS = 10001  # of rectangles that are compared

Fields = dict[str, Any]  # of robot.yaml [m, rad]


def measure(
    robot: robots.Description, anatomy: Anatomy, notes: Notes
) -> Fields:
    """Returns the fields of robot.yaml; sets the frames of `robot`.

    Raises ValueError: a foot has no sole, or it cannot stand on level ones with
    bent knees.
    """
    legs, feet = list(anatomy.legs.values()), list(anatomy.feet.values())
    forward, _, up = anatomy.axes.T
    R_RL = {link: pose.rotation() for link, pose in robot.poses().items()}
    soles = [find_sole(robot.links[f], R_RL[f].inverse() @ -up) for f in feet]
    depths = [sole.depth for sole in soles]
    # Frames of pelvis, torso and feet get x forward and z up, the feet's along
    # their soles; origins stay.
    ups = dict.fromkeys((robot.root, anatomy.torso), up)
    ups |= {
        f: R_RL[f] @ -sole.down for f, sole in zip(feet, soles, strict=True)
    }
    for link, z in ups.items():
        y = np.cross(z, forward)
        y /= np.linalg.norm(y)
        axes = np.stack([np.cross(y, z), y, z])
        R_NR = RotationMatrix.ProjectToRotationMatrix(axes)
        R_RL[link] = R_NR @ R_RL[link]  # now R_NL
        robot.move(link, RigidTransform(R_RL[link]))
    flat = [
        (R_RL[foot] @ sole.points.T)[:2].T
        for foot, sole in zip(feet, soles, strict=True)
    ]
    extents = [np.ptp(points, axis=0) for points in flat]
    for foot, (x, y) in zip(feet, extents, strict=True):
        if y > x:
            line = f"is wider than long, {y:.3f} and {x:.3f} m: is it turned?"
            notes.add("warning", f"the sole of {foot} {line}")
    heel, toe, half_width = largest_rectangle(flat)
    knees = {leg.knee: _knee(robot, leg) for leg in legs}
    lengths = [knee.longest() for knee in knees.values()]
    length, depth = float(np.mean(lengths)), float(np.mean(depths))
    for what, (left, right), most, where in (
        ("soles of", depths, _SAME_DEPTH, "under the ankles"),
        ("legs to", lengths, _SAME_LENGTH * length, "long"),
    ):
        if abs(left - right) > most:
            raise ValueError(
                f"{what} {' and '.join(feet)}: must be alike; they are "
                f"{left:.3f} and {right:.3f} m {where}"
            )
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
    geometry = LegGeometry(
        length=length,
        ankle_height=ankles - ground,
        com_above_hip=com - hips,
        hip_width=across,
    )
    able = leg_reach(geometry, com - ground, _lean(robot, anatomy))
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
    forward = min(nadias.length_forward, able.length)
    fields["reachability"] = widths(nadias) | {
        "length_forward": forward,
        "length_backward": forward,
        "width_nominal": step_width,
        "width_max": min(nadias.width_max, able.width_max),
    }
    x, y = extents[0]
    for line in (
        f"sole {toe - heel:.3f} x {2.0 * half_width:.3f} m, of {x:.3f} x "
        f"{y:.3f} m that the {soles[0].source} shapes have",
        f"legs {length:.3f} m, hips {across:.3f} m apart, ankles "
        f"{ankles - ground:.3f} m high",
        f"CoM {com - ground:.3f} m high, soles {step_width:.3f} m apart; arms "
        "and spine at 0, or near it",
        f"legs reach {able.length:.3f} m forward and back, "
        f"{able.width_max:.3f} m to the side; used up to Nadia's, by size",
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


def _lean(robot: robots.Description, anatomy: Anatomy) -> float:
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
        return self.sense * (bend - self.at_zero)

    def longest(self) -> float:
        """Largest distance [m] from hip to ankle, by the law of cosines."""
        bend = min(max(0.0, self.least), self.most)
        product = self.thigh * self.shin * np.cos(bend)
        return float(np.sqrt(self.thigh**2 + self.shin**2 + 2.0 * product))


def _knee(robot: robots.Description, leg: Leg) -> _Knee:
    poses, joint = robot.poses(dict.fromkeys(leg.joints, 0.0)), leg.knee
    points, axes = robot.hinges(leg.pitches, poses)
    thigh, shin = np.diff(points[:, [0, 2]], axis=0)
    at_zero = np.arctan2(thigh[1] * shin[0] - thigh[0] * shin[1], thigh @ shin)
    sense, knee = np.sign(axes[1, 1]), robot.joints[joint]
    bends = sorted(at_zero + sense * end for end in (knee.lower, knee.upper))
    lengths = map(np.linalg.norm, (thigh, shin))
    return _Knee(*map(float, (*lengths, at_zero, sense, *bends)))


def _posture(
    robot: robots.Description,
    legs: Sequence[Leg],
    knees: Mapping[str, _Knee],
    p_FS: Array,
) -> dict[str, float]:
    """Angles [rad] of all joints: knees bent, soles level under the CoM."""
    of_legs = {name for leg in legs for name in leg.joints}
    angles = {
        name: joint.nearest(0.0, 0.0 if name in of_legs else _ARM_MARGIN)
        for name, joint in robot.joints.items()
    }
    searched = [name for leg in legs for name in leg.pitches[::2]]
    bounds = [
        [robot.joints[name].nearest(end, _LEG_MARGIN) for name in searched]
        for end in (-np.inf, np.inf)
    ]

    def off(values: Array) -> Array:
        angles.update(zip(searched, map(float, values), strict=True))
        poses = robot.poses(angles)
        com, feet = robot.com(poses), [poses[leg.foot] for leg in legs]
        return np.array(
            [(X_RF @ p_FS - com)[0] for X_RF in feet]
            + [X_RF.rotation().matrix()[2, 0] for X_RF in feet]
        )

    for name, knee in knees.items():
        if knee.most < _BENDS[-1]:
            why = f"by {_BENDS[-1]:.2f} rad; it does by {knee.most:.2f} rad"
            goal = "must bend the knee, so that the foot goes back"
            raise ValueError(f"joint {name}: {goal}, {why}")
    for bend in _BENDS:
        for name, knee in knees.items():
            nearest = robot.joints[name].nearest
            angles[name] = nearest(knee.angle(bend), _LEG_MARGIN)
        start = np.clip(np.zeros(len(searched)), *bounds)
        found = least_squares(off, start, bounds=bounds)
        if np.abs(off(found.x)).max() < _LEVEL:
            return {n: a for n, a in angles.items() if abs(a) > 1e-4}
    raise ValueError(
        f"joints {', '.join(searched)}: must have the range to put level "
        f"soles under the CoM, the knees {_BENDS[-1]:.2f} rad from straight"
    )


@dataclass
class SolePlane:
    """The plane of a sole in the frame of its link."""

    down: Array  # (3,), its unit normal, out of the foot
    depth: float  # distance of the plane from the link's origin [m]
    points: Array  # (k, 3), on the plane
    area: float  # of their convex hull [m^2]
    source: str


def find_sole(foot: robots.Link, down: Array) -> SolePlane:
    """Returns the plane of the sole; `down` (3,) is its approximate normal.

    The plane is that of the collision shapes, or of the visual ones if their
    sole is more than twice as large, or the only flat one.

    Raises ValueError: no shape is flat below.
    """
    roles = (robots.COLLIDING, robots.VISUAL)
    found = [sole_plane(foot.of(role), down, role) for role in roles]
    if not any(found):
        why = "must have a shape with a flat side below"
        also = f"; {foot.missing}" if foot.missing else ""
        raise ValueError(f"foot {foot.name}: {why}{also}")
    weight = {robots.COLLIDING: 2.0, robots.VISUAL: 1.0}
    return max(filter(None, found), key=lambda p: weight[p.source] * p.area)


def sole_plane(
    shapes: Sequence[robots.Shape], down: Array, source: str
) -> SolePlane | None:
    """The supporting plane with the largest area of the convex hull."""
    if not shapes:
        return None
    hull = ConvexHull(np.concatenate([shape.points() for shape in shapes]))
    first, *others = hull.points[hull.simplices].swapaxes(0, 1)
    sides = np.cross(*(corners - first for corners in others))
    areas = 0.5 * np.linalg.norm(sides, axis=1)
    normals = hull.equations[:, :3]
    below = normals @ down > _DOWNWARD
    areas, normals = areas[below], normals[below]
    alike = normals @ normals.T > _SAME_NORMAL
    if not len(areas):
        return None
    near = alike[int((alike @ areas).argmax())]
    normal = areas[near] @ normals[near]
    normal /= np.linalg.norm(normal)
    # A round shape touches the ground with its point farthest along the normal.
    lowest = [
        s.spine(2).T + s.size["radius"] * normal
        if s.kind in ("sphere", "capsule")
        else s.points()
        for s in shapes
    ]
    depth = max(float((points @ normal).max()) for points in lowest)
    on_plane = [
        p[p @ normal > depth - _ON_PLANE.get(shape.kind, _ON_PLANE_EXACT)]
        for p, shape in zip(lowest, shapes, strict=True)
    ]
    flat = np.concatenate(on_plane)
    across = np.linalg.svd(normal[None])[2][1:]
    try:
        area = ConvexHull(flat @ across.T).volume
    except (QhullError, ValueError):  # collinear, or too few
        return None
    return SolePlane(normal, depth, flat, area, source)


def largest_rectangle(soles: Sequence[Array]) -> tuple[float, float, float]:
    """Returns x_min, x_max and half-width [m] of the largest rectangle.

    It is symmetric about y = 0 and within the hulls of all `soles`, points
    (k, 2) [m].  Raises ValueError: no such rectangle exists.
    """
    sides = np.concatenate([ConvexHull(sole).equations for sole in soles])
    a_x, a_y, c = sides.T
    ahead, behind = a_x > 1e-9, a_x < -1e-9
    beside = ~(ahead | behind)
    widest = min(-c[beside] / np.abs(a_y[beside]), default=np.inf)
    widest = min(widest, *(float(np.abs(sole[:, 1]).max()) for sole in soles))
    widths = np.linspace(0.0, max(widest, 0.0), _WIDTHS)
    room = -c[:, None] - np.abs(a_y)[:, None] * widths  # a_x x <= room
    heels = (room[behind] / a_x[behind, None]).max(axis=0)
    toes = (room[ahead] / a_x[ahead, None]).min(axis=0)
    i = int((widths * (toes - heels)).argmax())
    if not toes[i] > heels[i] or not widest > 0.0:
        raise ValueError("soles: must have a part on y = 0 in common")
    return float(heels[i]), float(toes[i]), float(widths[i])
