"""Lengths that robot.yaml need not give, measured in the URDF."""

import itertools
import math
from dataclasses import replace

import numpy as np
from pydrake.geometry import (
    Capsule,
    Convex,
    GeometryId,
    Mesh,
    SceneGraphInspector,
    Sphere,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from nadia_balance.robot_params import RobotParams

_PITCH = 0.75  # least |y| of a pitch axis; also of slanted hips [-]
_LEVEL = 1e-3  # points of a foot so near to its lowest one are of the sole [m]
_DIGITS = 3  # lengths are rounded to millimetres


def with_lengths(
    params: RobotParams,
    given: dict,
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
) -> RobotParams:
    """Returns `params` with the lengths that the tree `given` lacks.

    `plant` contains only the robot, with the shapes in `inspector`.  Soles are
    the ground points of the feet's collision shapes; legs are measured between
    their pitch axes, and left alone unless each has three.

    Raises:
        ValueError: a foot has no collision shape.
    """
    feet = params.left_foot_body, params.right_foot_body
    sole = _filled(params.sole, _sole(plant, inspector, feet), given, "sole")
    context = plant.CreateDefaultContext()
    left, right = (_position(plant, context, foot) for foot in feet)
    legs = {"hip_width": left[1] - right[1]}
    hip, knee, ankle = _pitch_axes(plant, context, feet[0])
    if hip is not None:
        legs["length"] = _apart(hip, knee) + _apart(knee, ankle)
        legs["ankle_height"] = ankle[2] - left[2] - sole.z
    for joint, angle in params.posture.items():
        plant.GetJointByName(joint).set_angle(context, angle)
    com = plant.CalcCenterOfMassPositionInWorld(context)[2]
    if hip is not None:
        hips = [_pitch_axes(plant, context, foot)[0][2] for foot in feet]
        legs["com_above_hip"] = com - 0.5 * sum(hips)
    ground = [_position(plant, context, foot, sole.z)[2] for foot in feet]
    params = replace(
        params, sole=sole, legs=_filled(params.legs, legs, given, "legs")
    )
    return _filled(params, {"com_height": com - 0.5 * sum(ground)}, given)


def _filled(params, measured: dict, given: dict, part: str = ""):
    """Returns the dataclass with `measured` values not in `part` of `given`."""
    tree = given.get(part) or {} if part else given
    return replace(
        params,
        **{
            name: round(float(value), _DIGITS)
            for name, value in measured.items()
            if name not in tree
        },
    )


def _position(
    plant: MultibodyPlant, context: Context, body: str, z: float = 0.0
) -> np.ndarray:
    """Position (3,) [m] in W of the point [0, 0, z] of a body."""
    X_WB = plant.GetBodyByName(body).EvalPoseInWorld(context)
    return X_WB @ np.array([0.0, 0.0, z])


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    """Distance [m] of two pitch axes in the sagittal plane."""
    return math.hypot(a[0] - b[0], a[2] - b[2])


def _pitch_axes(
    plant: MultibodyPlant, context: Context, foot: str
) -> list[np.ndarray | None]:
    """Positions (3,) [m] in W of the joints about y: hip, knee, ankle.

    All are None if the leg has not three of them, as with oblique hip axes.
    """
    joints = map(plant.get_joint, plant.GetJointIndices())
    above = {joint.child_body().name(): joint for joint in joints}
    found, link = [], foot
    while (joint := above.get(link)) and joint.num_positions() < 2:
        X_WJ = joint.frame_on_child().CalcPoseInWorld(context)
        if joint.num_positions() == 1 and joint.type_name() == "revolute":
            axis = X_WJ.rotation() @ joint.revolute_axis()
            if abs(axis[1]) > _PITCH:
                found.append(X_WJ.translation())
        link = joint.parent_body().name()
    return found[::-1] if len(found) == 3 else [None] * 3


def _sole(
    plant: MultibodyPlant, inspector: SceneGraphInspector, feet: tuple[str, str]
) -> dict[str, float]:
    """The largest rectangle, symmetric about y = 0, in the ground points."""
    ends = []
    for foot in feet:
        body = plant.GetBodyByName(foot)
        shapes = plant.GetCollisionGeometriesForBody(body)
        points = [np.empty((0, 3))]
        points += [_low_points(inspector, shape) for shape in shapes]
        points = np.vstack(points)
        if not len(points):
            raise ValueError(f"foot {foot}: must have a collision shape")
        lowest = points[:, 2].min()
        low, high = (
            extreme(points[points[:, 2] < lowest + _LEVEL], axis=0)
            for extreme in (np.min, np.max)
        )
        ends.append((low[0], -high[0], -min(-low[1], high[1]), lowest))
    x_min, x_max, half_width, z = np.max(ends, axis=0)
    return {"x_min": x_min, "x_max": -x_max, "half_width": -half_width, "z": z}


def _low_points(
    inspector: SceneGraphInspector, shape: GeometryId
) -> np.ndarray:
    """Points (n, 3) [m] of a shape, in the frame of its body.

    Lowest points of balls, corners of hulls, otherwise of the bounding box.
    """
    form, X_BG = inspector.GetShape(shape), inspector.GetPoseInFrame(shape)
    if isinstance(form, Sphere | Capsule):
        half = 0.5 * form.length() if isinstance(form, Capsule) else 0.0
        ends = np.array([[0.0, 0.0, -half], [0.0, 0.0, half]])
        return (X_BG @ ends.T).T - [0.0, 0.0, form.radius()]
    if isinstance(form, Convex | Mesh):
        hull = inspector.GetConvexHull(shape)
        points = [hull.vertex(i) for i in range(hull.num_vertices())]
        return (X_BG @ np.array(points).T).T
    box = inspector.GetObbInGeometryFrame(shape)
    if box is None:  # a half space
        return np.empty((0, 3))
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    return (X_BG @ box.pose() @ (signs * box.half_width()).T).T
