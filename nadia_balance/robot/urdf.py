"""A robot's URDF: its strict reader, its checks, and lengths measured in it."""

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, cast
from xml.etree import ElementTree

import numpy as np
from pydrake.geometry import (
    Capsule,
    Convex,
    GeometryId,
    Mesh,
    SceneGraphInspector,
    Sphere,
)
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    Joint,
    ModelInstanceIndex,
    RevoluteJoint,
)
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.yaml_reader import naming
from nadia_balance.robot.params import RobotParams
from nadia_balance.robot.plants import actuators, is_pitch, joints, joints_above

T = TypeVar("T")

_MESHES = (".obj", ".gltf", ".vtk", ".stl", ".dae")
_JOINTS = ("revolute", "continuous", "fixed")
_LEVEL = 1e-3  # points of a foot so near to its lowest one are of the sole [m]
_DIGITS = 3  # lengths are rounded to millimetres


def add_urdf(plant: MultibodyPlant, urdf: Path) -> ModelInstanceIndex:
    """Adds the robot of a URDF to a plant.

    Args:
        plant: not finalized yet.
        urdf: file.

    Returns:
        The robot's model instance.

    Raises:
        ValueError: the URDF is malformed; Drake's warnings count as errors,
            because Drake then substitutes values of its own.
    """
    parser = Parser(plant)
    parser.SetStrictParsing()
    with naming(f"urdf = {urdf}"):
        instance = parser.AddModels(urdf)[0]
        _add_actuators(plant, instance, urdf)
    return instance


def check_urdf(urdf: Path) -> None:
    """Checks values that Drake accepts unchecked, or for which it aborts.

    Args:
        urdf: file.

    Raises:
        ValueError: a value is out of range.
        SyntaxError: the file is no XML.
    """
    root = ElementTree.parse(urdf).getroot()
    for link in root.iter("link"):
        name = link.get("name")
        for mass in link.iter("mass"):
            _require_positive(f"mass of {name}", mass.get("value"), "kg")
        for mesh in link.iter("mesh"):
            file = mesh.get("filename", "")
            require(
                file.lower().endswith(_MESHES),
                f"mesh of {name} = {file!r}: must end in {', '.join(_MESHES)}",
            )
    for joint in root.findall("joint"):
        name = joint.get("name")
        kind = joint.get("type", "")
        require(
            kind in _JOINTS and joint.find("mimic") is None,
            f"joint {name}: must be one of {', '.join(_JOINTS)}, and no mimic "
            f"(nadia-new-robot welds others); it is {kind}",
        )
        for limit in joint.iter("limit"):
            _require_positive(
                f"velocity limit of {name}", limit.get("velocity", "1"), "rad/s"
            )
            lower, upper = limit.get("lower", "0"), limit.get("upper", "0")
            require(
                not _number(lower) > _number(upper),
                f"lower limit of {name} = {lower}: must be <= its upper "
                f"limit = {upper}",
            )


def _number(text: str | None) -> float:
    """The number in `text`; NaN if it is none, which Drake reports itself."""
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan


def _require_positive(name: str, text: str | None, unit: str) -> None:
    require(
        0.0 < _number(text) < math.inf,
        f"{name} = {text}: must be a number > 0 {unit}",
    )


def _add_actuators(
    plant: MultibodyPlant, instance: ModelInstanceIndex, urdf: Path
) -> None:
    """Adds actuators to joints for which the `urdf` has no <transmission>."""
    # All actuators: those of an instance are known only once it is finalized.
    driven = [actuator.joint().index() for actuator in actuators(plant)]
    require(
        len(set(driven)) == len(driven),
        "a joint must not have two <transmission>s",
    )
    efforts = {
        joint.get("name"): _number(limit.get("effort"))
        for joint in ElementTree.parse(urdf).getroot().findall("joint")
        for limit in joint.findall("limit")
    }
    for joint in map(plant.get_joint, plant.GetJointIndices(instance)):
        effort = efforts.get(joint.name(), 0.0)
        is_bare = joint.num_positions() > 0 and joint.index() not in driven
        if is_bare and effort > 0.0:
            plant.AddJointActuator(joint.name(), joint, effort)


def check_plant(plant: MultibodyPlant, params: RobotParams) -> None:
    """Checks the names in robot.yaml, and the drives.

    Args:
        plant: of the robot alone, finalized.
        params: of the robot.

    Raises:
        ValueError: the plant lacks parts that the parameters name; a joint has
            no drive with limits, or an angle is beyond the limits of a joint.
    """
    for field, name in (
        ("pelvis_body", params.pelvis_body),
        ("torso_body", params.torso_body),
        ("left_foot_body", params.left_foot_body),
        ("right_foot_body", params.right_foot_body),
    ):
        require(
            plant.HasBodyNamed(name),
            f"{field} = {name!r}: must be a link of the URDF",
        )
    floating = sorted(
        plant.get_body(i).name() for i in plant.GetFloatingBaseBodies()
    )
    require(
        floating == [params.pelvis_body],
        f"pelvis_body = {params.pelvis_body!r}: must be the one link that no "
        f"joint holds; these are: {', '.join(floating) or 'none'}",
    )
    context = plant.CreateDefaultContext()
    require(
        _position(plant, context, params.left_foot_body)[1]
        > _position(plant, context, params.right_foot_body)[1],
        f"left_foot_body = {params.left_foot_body!r}: must be left of "
        f"right_foot_body = {params.right_foot_body!r}",
    )
    # Joints of one degree of freedom by name, without the floating base.
    hinges = {j.name(): j for j in joints(plant) if j.num_positions() == 1}
    _check_drives(plant, params, hinges)
    _check_angles(params, hinges)


def _check_drives(
    plant: MultibodyPlant, params: RobotParams, hinges: dict[str, Joint]
) -> None:
    urdf = f"urdf = {params.urdf}"
    drives = {drive.joint().name(): drive for drive in actuators(plant)}
    for name, joint in hinges.items():
        require(
            min(joint.velocity_upper_limits()[0], params.max_joint_speed)
            < math.inf,
            f"{urdf}: joint {name}: must have a velocity limit, or robot.yaml "
            "a max_joint_speed",
        )
        drive = drives.get(name)
        if drive is None or not drive.effort_limit() < math.inf:
            raise ValueError(f"{urdf}: joint {name}: must have an effort limit")
        inertia = drive.default_reflected_inertia()
        require(
            inertia >= 0.0,
            f"{urdf}: rotor inertia x gear ratio^2 of {name} = {inertia}: must "
            "be >= 0 kg m^2",
        )
    motors = {} if params.drives is None else params.drives.motors
    driven: set[str] = set()
    for kind, motor in motors.items():
        for name in motor.joints:
            require(
                name in drives and name not in driven,
                f"drives.motors.{kind}.joints = {name}: must be an actuated "
                f"joint of {params.name}, and named once",
            )
            driven.add(name)


def _check_angles(params: RobotParams, hinges: dict[str, Joint]) -> None:
    fields = {
        "posture": params.posture,
        "whole_body.joint_lower_limits": params.whole_body.joint_lower_limits,
        "whole_body.joint_upper_limits": params.whole_body.joint_upper_limits,
    }
    for field, angles in fields.items():
        for name, angle in angles.items():
            require(
                name in hinges,
                f"{field}.{name} = {angle}: must be one of the joints "
                f"{', '.join(sorted(hinges))}",
            )
            lower = hinges[name].position_lower_limits()[0]
            upper = hinges[name].position_upper_limits()[0]
            require(
                lower <= angle <= upper,
                f"{field}.{name} = {angle}: must be in [{lower}, {upper}] rad",
            )


def remarks_on(plant: MultibodyPlant, feet: set[str]) -> list[str]:
    """Warnings about legal but suspicious settings.

    Args:
        plant: of the robot alone, with shapes.
        feet: names of its feet.

    Returns:
        The warnings, one line each.
    """
    remarks = []
    bodies = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
    shaped = filter(plant.GetCollisionGeometriesForBody, bodies)
    if {body.name() for body in shaped} == feet:
        remarks.append(
            "only the feet have collision shapes: a fall, or legs in each "
            "other, are not noticed"
        )
    bare = [
        drive.joint().name()
        for drive in actuators(plant)
        if not drive.default_reflected_inertia()
    ]
    if bare:
        remarks.append(f"no rotor inertia: {', '.join(bare)}")
    return remarks


def with_lengths(
    params: RobotParams,
    given: Mapping[str, Any],
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
) -> RobotParams:
    """Fills in the lengths that a robot.yaml lacks.

    Soles are the ground points of the feet's collision shapes; legs are
    measured between their pitch axes, and left alone unless each has three.

    Args:
        params: of the robot.
        given: tree of the robot.yaml.
        plant: of the robot alone, finalized.
        inspector: of the robot's shapes.

    Returns:
        The parameters with these lengths, in whole millimetres.

    Raises:
        ValueError: a foot has no collision shape.
    """
    feet = [params.left_foot_body, params.right_foot_body]
    sole = _filled(
        params.sole, _sole(plant, inspector, feet), given.get("sole")
    )
    straight = plant.CreateDefaultContext()
    standing: Any = plant.CreateDefaultContext()
    for joint, angle in params.posture.items():
        cast(RevoluteJoint, plant.GetJointByName(joint)).set_angle(
            standing, angle
        )
    com = plant.CalcCenterOfMassPositionInWorld(standing)
    left, right = (_position(plant, straight, foot) for foot in feet)
    legs = {"hip_width": left[1] - right[1]}
    axes = [_pitch_axes(plant, straight, foot) for foot in feet]
    if all(axes):
        bones = np.diff(axes[0], axis=0)[:, [0, 2]]  # in the sagittal plane
        legs["length"] = np.linalg.norm(bones, axis=1).sum()
        legs["ankle_height"] = axes[0][2][2] - left[2] - sole.z
        hip = np.mean(
            [_pitch_axes(plant, standing, foot)[0] for foot in feet], axis=0
        )
        legs["com_above_hip"] = com[2] - hip[2]
        ankle = axes[0][2][0] - left[0] - 0.5 * (sole.x_min + sole.x_max)
        legs["hip_ahead"] = hip[0] - com[0] - ankle
    ground = [_position(plant, standing, foot, sole.z)[2] for foot in feet]
    return replace(
        _filled(params, {"com_height": com[2] - 0.5 * sum(ground)}, given),
        sole=sole,
        legs=_filled(params.legs, legs, given.get("legs")),
    )


def _filled(
    params: T, measured: Mapping[str, float], given: Mapping[str, Any] | None
) -> T:
    """Returns the dataclass with `measured` values that are not `given`."""
    return replace(
        params,  # type: ignore[type-var]
        **{
            name: round(float(value), _DIGITS)
            for name, value in measured.items()
            if name not in (given or {})
        },
    )


def _position(
    plant: MultibodyPlant, context: Context, body: str, z: float = 0.0
) -> Array:
    """Position (3,) [m] in W of the point [0, 0, z] of a body."""
    return np.asarray(
        plant.GetBodyByName(body).EvalPoseInWorld(context)
        @ np.array([0.0, 0.0, z])
    )


def _pitch_axes(
    plant: MultibodyPlant, context: Context, foot: str
) -> list[Array]:
    """Positions (3,) [m] in W of the joints about y: hip, knee, ankle.

    Empty if the leg has not three of them, as with oblique hip axes.
    """
    axes: list[Any] = [
        joint.frame_on_child().CalcPoseInWorld(context).translation()
        for joint in joints_above(plant, foot)[::-1]
        if is_pitch(joint, context)
    ]
    return axes if len(axes) == 3 else []


def _sole(
    plant: MultibodyPlant, inspector: SceneGraphInspector, feet: Iterable[str]
) -> dict[str, float]:
    """The largest rectangle, symmetric about y = 0, in the ground points."""
    ends = []
    for foot in feet:
        shapes = plant.GetCollisionGeometriesForBody(plant.GetBodyByName(foot))
        points = np.vstack(
            [np.empty((0, 3)), *(_low_points(inspector, s) for s in shapes)]
        )
        require(len(points) > 0, f"foot {foot}: must have a collision shape")
        lowest = points[:, 2].min()
        on_ground = points[points[:, 2] < lowest + _LEVEL]
        low, high = on_ground.min(axis=0), on_ground.max(axis=0)
        ends.append((low[0], -high[0], -min(-low[1], high[1]), lowest))
    x_min, x_max, half_width, z = np.max(ends, axis=0)
    return {"x_min": x_min, "x_max": -x_max, "half_width": -half_width, "z": z}


def foot_width(
    plant: MultibodyPlant, inspector: SceneGraphInspector, feet: Iterable[str]
) -> float:
    """Twice the largest |y| of the feet's collision shapes, in their frame.

    Args:
        plant: of the robot.
        inspector: of its shapes.
        feet: names of its feet.

    Returns:
        Width [m], in whole millimetres.
    """
    sides = [0.0]
    for foot in feet:
        for shape in plant.GetCollisionGeometriesForBody(
            plant.GetBodyByName(foot)
        ):
            box = inspector.GetObbInGeometryFrame(shape)
            if box is not None:
                X_BO = inspector.GetPoseInFrame(shape) @ box.pose()
                half = np.abs(X_BO.rotation().matrix()[1]) @ box.half_width()
                sides.append(abs(X_BO.translation()[1]) + half)
    return 2.0 * round(float(max(sides)), _DIGITS)


def _low_points(inspector: SceneGraphInspector, shape: GeometryId) -> Array:
    """Points (n, 3) [m] of a shape, in the frame of its body.

    Lowest points of balls, corners of hulls, otherwise of the bounding box.
    """
    form = inspector.GetShape(shape)
    X_BG: Any = inspector.GetPoseInFrame(shape)
    if isinstance(form, Sphere | Capsule):
        length = form.length() if isinstance(form, Capsule) else 0.0
        half = np.array([0.0, 0.0, 0.5 * length])
        ends = X_BG @ np.array([-half, half]).T
        return np.asarray(ends.T - [0.0, 0.0, form.radius()])
    if isinstance(form, Convex | Mesh):
        return np.asarray((X_BG @ hull_points(inspector, shape).T).T)
    box: Any = inspector.GetObbInGeometryFrame(shape)
    if box is None:  # a half space
        return np.empty((0, 3))
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    return np.asarray((X_BG @ box.pose() @ (signs * box.half_width()).T).T)


def hull_points(inspector: SceneGraphInspector, shape: GeometryId) -> Array:
    """Corners of the convex hull of a shape.

    Args:
        inspector: of the shape.
        shape: its index.

    Returns:
        Points (n, 3) [m], in the frame of the shape.
    """
    hull = inspector.GetConvexHull(shape)
    return np.array([hull.vertex(i) for i in range(hull.num_vertices())])
