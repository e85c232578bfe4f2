"""Checks of a robot's URDF and robot.yaml, and of contacts."""

import itertools
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pydrake.geometry import SceneGraphInspector
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    JacobianWrtVariable,
    ModelInstanceIndex,
    world_index,
)
from pydrake.systems.framework import Context

from nadia_balance.core.walking import Side
from nadia_balance.robot_params import RobotParams

_JOINTS = ("revolute", "continuous", "fixed")
_PITCH = 0.75  # least |y| of a pitch axis; also of slanted hips [-]


def check_urdf(urdf: Path) -> None:
    """Checks values that Drake accepts unchecked, or for which it aborts.

    Raises:
        ValueError: a value is out of range.
        SyntaxError: `urdf` is no XML.
    """
    root = ElementTree.parse(urdf).getroot()
    for link in root.iter("link"):
        for mass in link.iter("mass"):
            _positive(f"mass of {link.get('name')}", mass.get("value"), "kg")
    for joint in root.findall("joint"):
        name, kind = joint.get("name"), joint.get("type", "")
        _require(
            kind in _JOINTS and joint.find("mimic") is None,
            f"joint {name}: must be one of {', '.join(_JOINTS)}, and no mimic "
            f"(nadia-new-robot welds others); it is {kind}",
        )
        for limit in joint.iter("limit"):
            velocity = limit.get("velocity", "1")
            _positive(f"velocity limit of {name}", velocity, "rad/s")
            low, high = limit.get("lower", "0"), limit.get("upper", "0")
            _require(
                not _number(low) > _number(high),
                f"lower limit of {name} = {low}: must be <= its upper limit = "
                f"{high}",
            )


def effort_limits(urdf: Path) -> dict[str, float]:
    """The effort limit of each joint of a checked `urdf` that has one."""
    limits = {
        joint.get("name", ""): _number(limit.get("effort"))
        for joint in ElementTree.parse(urdf).getroot().findall("joint")
        for limit in joint.findall("limit")
    }
    return {name: effort for name, effort in limits.items() if effort > 0.0}


def _require(fulfilled: bool, message: str) -> None:
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
    _require(positive, f"{what} = {text}: must be a number > 0 {unit}")


def check_plant(plant: MultibodyPlant, params: RobotParams) -> None:
    """Raises ValueError if `plant` lacks parts that `params` name."""
    for part in ("pelvis", "torso", "left_foot", "right_foot"):
        name = getattr(params, f"{part}_body")
        _require(
            plant.HasBodyNamed(name),
            f"{part}_body = {name!r}: must be a link of the URDF",
        )
    bodies = map(plant.get_body, plant.GetFloatingBaseBodies())
    floating = sorted(body.name() for body in bodies)
    _require(
        floating == [params.pelvis_body],
        f"pelvis_body = {params.pelvis_body!r}: must be the one link that no "
        f"joint holds; these are: {', '.join(floating) or 'none'}",
    )
    context = plant.CreateDefaultContext()
    left, right = (
        plant.GetBodyByName(foot).EvalPoseInWorld(context).translation()[1]
        for foot in (params.left_foot_body, params.right_foot_body)
    )
    _require(
        left > right,
        f"left_foot_body = {params.left_foot_body!r}: must be left of "
        f"right_foot_body = {params.right_foot_body!r}",
    )
    # Joints of one degree of freedom by name, without the floating base.
    joints = map(plant.get_joint, plant.GetJointIndices())
    joints = {j.name(): j for j in joints if j.num_positions() == 1}
    _check_drives(plant, params, joints)
    for field, angles in (
        ("posture", params.posture),
        ("whole_body.joint_lower_limits", params.whole_body.joint_lower_limits),
        ("whole_body.joint_upper_limits", params.whole_body.joint_upper_limits),
    ):
        for name, angle in angles.items():
            what = f"{field}.{name} = {angle}: must be"
            known = ", ".join(sorted(joints))
            _require(name in joints, f"{what} one of the joints {known}")
            low = joints[name].position_lower_limits()[0]
            high = joints[name].position_upper_limits()[0]
            _require(low <= angle <= high, f"{what} in [{low}, {high}] rad")


def _check_drives(
    plant: MultibodyPlant, params: RobotParams, joints: dict
) -> None:
    where = f"urdf = {params.urdf}"
    actuators = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    actuators = {actuator.joint().name(): actuator for actuator in actuators}
    for name, joint in joints.items():
        speed = min(joint.velocity_upper_limits()[0], params.max_joint_speed)
        _require(
            speed < math.inf,
            f"{where}: joint {name}: must have a velocity limit, or robot.yaml "
            "a max_joint_speed",
        )
        actuator = actuators.get(name)
        _require(
            actuator is not None and actuator.effort_limit() < math.inf,
            f"{where}: joint {name}: must have an effort limit",
        )
        inertia = actuator.default_reflected_inertia()
        _require(
            inertia >= 0.0,
            f"{where}: rotor inertia x gear ratio^2 of {name} = {inertia}: "
            "must be >= 0 kg m^2",
        )


def remarks_on(plant: MultibodyPlant, feet: set[str]) -> list[str]:
    """Warnings about legal but suspicious settings of a plant with shapes.

    Raises:
        ValueError: a foot has no collision shape.
    """
    shaped = {
        body.name()
        for body in map(
            plant.get_body, map(BodyIndex, range(plant.num_bodies()))
        )
        if plant.GetCollisionGeometriesForBody(body)
    }
    for foot in sorted(feet):
        _require(foot in shaped, f"foot {foot}: must have a collision shape")
    remarks = []
    if shaped == feet:
        remarks.append(
            "only the feet have collision shapes: a fall, or legs in each "
            "other, are not noticed"
        )
    actuators = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    light = [
        actuator.joint().name()
        for actuator in actuators
        if not actuator.default_reflected_inertia()
    ]
    if light:
        remarks.append(f"no rotor inertia: {', '.join(light)}")
    return remarks


def check_standing(
    plant: MultibodyPlant,
    q: np.ndarray,
    feet: Mapping[Side, str],
    X_FootSole: Mapping[Side, RigidTransform],
) -> None:
    """Raises ValueError if a joint is too weak for the robot to stand.

    The robot of `plant` stands at `q` (nq,), with half of its weight at the
    centre of either sole.
    """
    context, world = plant.CreateDefaultContext(), plant.world_frame()
    plant.SetPositions(context, q)
    gravity = plant.gravity_field().gravity_vector()
    half_weight = -0.5 * plant.CalcTotalMass(context) * gravity
    torques = -plant.CalcGravityGeneralizedForces(context)
    for side, foot in feet.items():
        torques -= half_weight @ plant.CalcJacobianTranslationalVelocity(
            context,
            JacobianWrtVariable.kV,
            plant.GetFrameByName(foot),
            X_FootSole[side].translation(),
            world,
            world,
        )
    for i in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(i)
        joint, limit = actuator.joint(), actuator.effort_limit()
        needed = abs(torques[joint.velocity_start()])
        _require(
            needed <= limit,
            f"effort limit of {joint.name()} = {limit:g}: must be >= "
            f"{needed:.0f} N m, for the robot to stand",
        )


# Tolerances between robot.yaml and URDF: soles [m]; legs and CoM [leg length].
_SOLE_OFF, _LEG_OFF, _COM_OFF = 0.01, 0.03, 0.05


def check_sizes(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    params: RobotParams,
) -> None:
    """Raises ValueError if sizes in `params` differ from the URDF.

    Soles are compared with the collision shapes of either foot, legs with
    their pitch axes if they have three.  `plant` contains only the robot, with
    the shapes in `inspector`.
    """
    context = plant.CreateDefaultContext()
    legs = {
        foot: _leg(plant, context, foot)
        for foot in (params.left_foot_body, params.right_foot_body)
    }
    unit = params.size.leg
    for foot, leg in legs.items():
        _check_sole(plant, inspector, params, foot)
        if len(leg) == 3:
            hip, knee, ankle = leg
            unit = _apart(hip, knee) + _apart(knee, ankle)
            _require_near(
                "legs.length", params.legs.length, unit, _LEG_OFF * unit
            )
            p_WF = plant.GetBodyByName(foot).EvalPoseInWorld(context)
            height = ankle[2] - p_WF.translation()[2] - params.sole.z
            _require_near(
                "legs.ankle_height",
                params.legs.ankle_height,
                height,
                _LEG_OFF * unit,
            )
    left, right = (
        plant.GetBodyByName(foot).EvalPoseInWorld(context).translation()
        for foot in legs
    )
    _require_near(
        "legs.hip_width",
        params.legs.hip_width,
        left[1] - right[1],
        2.0 * _LEG_OFF * unit,
    )
    for joint, angle in params.posture.items():
        plant.GetJointByName(joint).set_angle(context, angle)
    posed = [_leg(plant, context, foot) for foot in legs]
    hips = [leg[0] for leg in posed if len(leg) == 3]
    if not hips:  # oblique hip axes, as some robots have
        return
    com = plant.CalcCenterOfMassPositionInWorld(context)[2]
    _require_near(
        "legs.com_above_hip",
        params.legs.com_above_hip,
        com - float(np.mean([hip[2] for hip in hips])),
        _COM_OFF * unit,
    )


def _require_near(field: str, value: float, urdf: float, off: float) -> None:
    _require(
        abs(value - urdf) <= off,
        f"{field} = {value}: must be {urdf:.3f} m as in the URDF, to within "
        f"{off:.3f} m",
    )


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    """Distance [m] of two pitch axes in the sagittal plane."""
    return math.hypot(a[0] - b[0], a[2] - b[2])


def _leg(
    plant: MultibodyPlant, context: Context, foot: str
) -> list[np.ndarray]:
    """Positions (3,) [m] in W of the joints about y, from hip to `foot`."""
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
    return found[::-1]


def _check_sole(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    params: RobotParams,
    foot: str,
) -> None:
    corners, off = [], _SOLE_OFF
    for shape in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(foot)):
        box = inspector.GetObbInGeometryFrame(shape)
        if box is None:  # a half space
            continue
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
        X_FB = inspector.GetPoseInFrame(shape) @ box.pose()
        corners.append(X_FB @ (signs * box.half_width()).T)
    _require(
        bool(corners),
        f"urdf = {params.urdf}: {foot} must have collision shapes",
    )
    points = np.hstack(corners)
    low, high = points.min(axis=1), points.max(axis=1)
    sole, of = params.sole, f"m, where the shapes of {foot} end"
    _require(
        sole.x_min >= low[0] - off,
        f"sole.x_min = {sole.x_min}: must be >= {low[0]:.3f} {of}",
    )
    _require(
        sole.x_max <= high[0] + off,
        f"sole.x_max = {sole.x_max}: must be <= {high[0]:.3f} {of}",
    )
    half_width = min(-low[1], high[1])
    _require(
        sole.half_width <= half_width + off,
        f"sole.half_width = {sole.half_width}: must be <= {half_width:.3f} "
        f"{of}",
    )
    _require(
        abs(sole.z - low[2]) <= off,
        f"sole.z = {sole.z}: must be {low[2]:.3f} m, the lowest of "
        f"the shapes of {foot}, to within {off:.3f} m",
    )


def improper_contacts(
    plant: MultibodyPlant,
    results: ContactResults,
    robot: ModelInstanceIndex,
    feet: set[str],
) -> set[str]:
    """Returns the pairs of bodies in contact that are not foot and ground.

    Pairs are named, such as "LEFT_SHIN_LINK - RIGHT_SHIN_LINK" or "PELVIS_LINK
    - ground".  A foot may touch all bodies that are not of the `robot`.
    """
    improper = set()
    for pair in set(_touching(plant, results)):
        bodies = [plant.get_body(BodyIndex(i)) for i in pair]
        own = {b.name() for b in bodies if b.model_instance() == robot}
        # Two robots may have bodies of the same name.
        others = {
            "ground" if b.index() == world_index() else str(b.scoped_name())
            for b in bodies
            if b.model_instance() != robot
        }
        if own and not (others and own <= feet):
            improper.add(" - ".join([*sorted(own), *others]))
    return improper


def _touching(
    plant: MultibodyPlant, results: ContactResults
) -> Iterator[tuple[int, int]]:
    """The indices of the two bodies of every contact."""
    for i in range(results.num_point_pair_contacts()):
        contact = results.point_pair_contact_info(i)
        yield int(contact.bodyA_index()), int(contact.bodyB_index())
    if not results.num_hydroelastic_contacts():
        return
    bodies = map(plant.get_body, map(BodyIndex, range(plant.num_bodies())))
    body_of = {
        shape: int(body.index())
        for body in bodies
        for shape in plant.GetCollisionGeometriesForBody(body)
    }
    for i in range(results.num_hydroelastic_contacts()):
        surface = results.hydroelastic_contact_info(i).contact_surface()
        yield body_of[surface.id_M()], body_of[surface.id_N()]
