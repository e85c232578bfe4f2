"""A robot's URDF: its strict reader, its checks, and lengths measured in it."""

import contextlib
import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pydrake import geometry
from pydrake.geometry import GeometryId, SceneGraphInspector
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import Array
from nadia_balance.robot.params import RobotParams
from nadia_balance.robot.plants import actuators, is_pitch, joints, joints_above

_MESHES = (".obj", ".gltf", ".vtk", ".stl", ".dae")
_JOINTS = ("revolute", "continuous", "fixed")
_LEVEL = 1e-3  # points of a foot so near to its lowest one are of the sole [m]
_DIGITS = 3  # lengths are rounded to millimetres


@contextlib.contextmanager
def naming(what: str) -> Iterator[None]:
    """Turns errors of its block into a ValueError that begins with `what`."""
    try:
        yield
    # SystemExit is how pydrake reports a condition of Drake's own code.
    except (RuntimeError, ValueError, SyntaxError, SystemExit) as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{what}: {reason}") from error


def add_urdf(plant: MultibodyPlant, urdf: Path) -> ModelInstanceIndex:
    """Adds the robot in `urdf` to a `plant` that is not finalized yet.

    Raises ValueError: the URDF is malformed; Drake's warnings count as errors,
    because Drake then substitutes values of its own.
    """
    parser = Parser(plant)
    parser.SetStrictParsing()
    with naming(f"urdf = {urdf}"):
        instance = parser.AddModels(str(urdf))[0]
        _add_actuators(plant, instance, urdf)
    return instance


def check_urdf(urdf: Path) -> None:
    """Checks values that Drake accepts unchecked, or for which it aborts.

    Raises ValueError: a value is out of range; SyntaxError: `urdf` is no XML.
    """
    root = ElementTree.parse(urdf).getroot()
    endings, kinds = ", ".join(_MESHES), ", ".join(_JOINTS)
    for link in root.iter("link"):
        name = link.get("name")
        for mass in link.iter("mass"):
            _positive(f"mass of {name}", mass.get("value"), "kg")
        for mesh in link.iter("mesh"):
            file = mesh.get("filename", "")
            must = f"mesh of {name} = {file!r}: must end in {endings}"
            require(file.lower().endswith(_MESHES), must)
    for joint in root.findall("joint"):
        name, kind = joint.get("name"), joint.get("type", "")
        must = f"must be one of {kinds}, and no mimic"
        why = f"(nadia-new-robot welds others); it is {kind}"
        known = kind in _JOINTS and joint.find("mimic") is None
        require(known, f"joint {name}: {must} {why}")
        for limit in joint.iter("limit"):
            velocity = limit.get("velocity", "1")
            _positive(f"velocity limit of {name}", velocity, "rad/s")
            low, high = limit.get("lower", "0"), limit.get("upper", "0")
            must = f"{low}: must be <= its upper limit = {high}"
            fits = not _number(low) > _number(high)
            require(fits, f"lower limit of {name} = {must}")


def require(fulfilled: bool, message: str) -> None:
    """Raises ValueError(message) unless it is fulfilled."""
    if not fulfilled:
        raise ValueError(message)


def _number(text: str | None) -> float:
    """The number in `text`; NaN if it is none, which Drake reports itself."""
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan


def _positive(what: str, text: str | None, unit: str) -> None:
    positive = 0.0 < _number(text) < math.inf
    require(positive, f"{what} = {text}: must be a number > 0 {unit}")


def _add_actuators(plant: MultibodyPlant, instance, urdf: Path) -> None:
    """Adds actuators to joints for which the `urdf` has no <transmission>."""
    # All actuators: those of an instance are known only once it is finalized.
    driven = [actuator.joint().index() for actuator in actuators(plant)]
    if len(set(driven)) < len(driven):
        raise ValueError("a joint must not have two <transmission>s")
    efforts = {
        joint.get("name"): _number(limit.get("effort"))
        for joint in ElementTree.parse(urdf).getroot().findall("joint")
        for limit in joint.findall("limit")
    }
    for joint in map(plant.get_joint, plant.GetJointIndices(instance)):
        limit = efforts.get(joint.name(), 0.0)
        is_bare = joint.num_positions() and joint.index() not in driven
        if limit > 0.0 and is_bare:
            plant.AddJointActuator(joint.name(), joint, limit)


def check_plant(plant: MultibodyPlant, params: RobotParams) -> None:
    """Raises ValueError if `plant` lacks parts that `params` name."""
    for part in ("pelvis", "torso", "left_foot", "right_foot"):
        name = getattr(params, f"{part}_body")
        must = f"{part}_body = {name!r}: must be a link of the URDF"
        require(plant.HasBodyNamed(name), must)
    bodies = map(plant.get_body, plant.GetFloatingBaseBodies())
    floating = sorted(body.name() for body in bodies)
    these = f"these are: {', '.join(floating) or 'none'}"
    must = f"must be the one link that no joint holds; {these}"
    is_base = floating == [params.pelvis_body]
    require(is_base, f"pelvis_body = {params.pelvis_body!r}: {must}")
    context = plant.CreateDefaultContext()
    left, right = (
        plant.GetBodyByName(foot).EvalPoseInWorld(context).translation()[1]
        for foot in (params.left_foot_body, params.right_foot_body)
    )
    must = f"must be left of right_foot_body = {params.right_foot_body!r}"
    require(left > right, f"left_foot_body = {params.left_foot_body!r}: {must}")
    # Joints of one degree of freedom by name, without the floating base.
    by_name = {j.name(): j for j in joints(plant) if j.num_positions() == 1}
    _check_drives(plant, params, by_name)
    given, known = {"posture": params.posture}, ", ".join(sorted(by_name))
    for field in ("joint_lower_limits", "joint_upper_limits"):
        given[f"whole_body.{field}"] = getattr(params.whole_body, field)
    for field, angles in given.items():
        for name, angle in angles.items():
            what = f"{field}.{name} = {angle}: must be"
            require(name in by_name, f"{what} one of the joints {known}")
            low = by_name[name].position_lower_limits()[0]
            high = by_name[name].position_upper_limits()[0]
            require(low <= angle <= high, f"{what} in [{low}, {high}] rad")


def _check_drives(plant: MultibodyPlant, params: RobotParams, by_name) -> None:
    where, must = f"urdf = {params.urdf}", "must have a velocity limit, or"
    drives = {drive.joint().name(): drive for drive in actuators(plant)}
    for name, joint in by_name.items():
        speed = min(joint.velocity_upper_limits()[0], params.max_joint_speed)
        what = f"{where}: joint {name}"
        require(
            speed < math.inf, f"{what}: {must} robot.yaml a max_joint_speed"
        )
        drive = drives.get(name)
        limited = drive is not None and drive.effort_limit() < math.inf
        require(limited, f"{what}: must have an effort limit")
        inertia = drive.default_reflected_inertia()
        what = f"{where}: rotor inertia x gear ratio^2 of {name} = {inertia}"
        require(inertia >= 0.0, f"{what}: must be >= 0 kg m^2")


def remarks_on(plant: MultibodyPlant, feet: set[str]) -> list[str]:
    """Warnings about legal but suspicious settings of a plant with shapes."""
    bodies = map(plant.get_body, map(BodyIndex, range(plant.num_bodies())))
    shaped = filter(plant.GetCollisionGeometriesForBody, bodies)
    only = "only the feet have collision shapes: a fall, or legs in each other"
    is_only = {body.name() for body in shaped} == feet
    remarks = [f"{only}, are not noticed"] if is_only else []
    bare = [a for a in actuators(plant) if not a.default_reflected_inertia()]
    names = ", ".join(drive.joint().name() for drive in bare)
    return remarks + ([f"no rotor inertia: {names}"] if bare else [])


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

    Raises ValueError: a foot has no collision shape.
    """
    feet = params.left_foot_body, params.right_foot_body
    sole = _filled(params.sole, _sole(plant, inspector, feet), given, "sole")
    context = plant.CreateDefaultContext()
    left, right = (_position(plant, context, foot) for foot in feet)
    legs = {"hip_width": left[1] - right[1]}
    axes = [_pitch_axes(plant, context, foot) for foot in feet]
    if all(axes):
        bones = np.diff(axes[0], axis=0)[:, [0, 2]]  # in the sagittal plane
        legs["length"] = np.linalg.norm(bones, axis=1).sum()
        legs["ankle_height"] = axes[0][2][2] - left[2] - sole.z
    for joint, angle in params.posture.items():
        plant.GetJointByName(joint).set_angle(context, angle)
    com = plant.CalcCenterOfMassPositionInWorld(context)[2]
    if all(axes):
        hips = [_pitch_axes(plant, context, foot)[0][2] for foot in feet]
        legs["com_above_hip"] = com - 0.5 * sum(hips)
    ground = [_position(plant, context, foot, sole.z)[2] for foot in feet]
    legs = _filled(params.legs, legs, given, "legs")
    params = replace(params, sole=sole, legs=legs)
    return _filled(params, {"com_height": com - 0.5 * sum(ground)}, given)


def _filled(params, measured: dict, given: dict, part: str = ""):
    """Returns the dataclass with `measured` values not in `part` of `given`."""
    tree = given.get(part) or {} if part else given
    lacking = {n: value for n, value in measured.items() if n not in tree}
    lengths = {n: round(float(value), _DIGITS) for n, value in lacking.items()}
    return replace(params, **lengths)


def _position(plant, context: Context, body: str, z: float = 0.0) -> Array:
    """Position (3,) [m] in W of the point [0, 0, z] of a body."""
    X_WB = plant.GetBodyByName(body).EvalPoseInWorld(context)
    return X_WB @ np.array([0.0, 0.0, z])


def _pitch_axes(plant, context: Context, foot: str) -> list[Array]:
    """Positions (3,) [m] in W of the joints about y: hip, knee, ankle.

    Empty if the leg has not three of them, as with oblique hip axes.
    """
    found = [
        joint.frame_on_child().CalcPoseInWorld(context).translation()
        for joint in joints_above(plant, foot)[::-1]
        if is_pitch(joint, context)
    ]
    return found if len(found) == 3 else []


def _sole(plant, inspector, feet: tuple[str, str]) -> dict[str, float]:
    """The largest rectangle, symmetric about y = 0, in the ground points."""
    ends = []
    for foot in feet:
        shapes = plant.GetCollisionGeometriesForBody(plant.GetBodyByName(foot))
        found = [_low_points(inspector, shape) for shape in shapes]
        points = np.vstack([np.empty((0, 3)), *found])
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
    """Twice the largest |y| [m] of a foot's collision shapes, in its frame."""
    sides = [0.0]
    for foot in feet:
        body = plant.GetBodyByName(foot)
        for shape in plant.GetCollisionGeometriesForBody(body):
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
    form, X_BG = inspector.GetShape(shape), inspector.GetPoseInFrame(shape)
    if isinstance(form, geometry.Sphere | geometry.Capsule):
        is_ball = isinstance(form, geometry.Sphere)
        half = np.array([0.0, 0.0, 0.0 if is_ball else 0.5 * form.length()])
        return (X_BG @ np.array([-half, half]).T).T - [0.0, 0.0, form.radius()]
    if isinstance(form, geometry.Convex | geometry.Mesh):
        return (X_BG @ hull_points(inspector, shape).T).T
    box = inspector.GetObbInGeometryFrame(shape)
    if box is None:  # a half space
        return np.empty((0, 3))
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    return (X_BG @ box.pose() @ (signs * box.half_width()).T).T


def hull_points(inspector: SceneGraphInspector, shape: GeometryId) -> Array:
    """Corners (n, 3) [m] of the convex hull of a shape, in its frame."""
    hull = inspector.GetConvexHull(shape)
    return np.array([hull.vertex(i) for i in range(hull.num_vertices())])
