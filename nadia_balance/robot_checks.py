"""What a URDF must hold for a robot to walk, and what must not touch."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    JacobianWrtVariable,
    ModelInstanceIndex,
    world_index,
)

from nadia_balance.core.walking import Side
from nadia_balance.robot_params import RobotParams

_JOINTS = ("revolute", "continuous", "fixed")


def check_urdf(urdf: Path) -> None:
    """Checks the figures that Drake takes as they are, or ends Python for.

    Raises:
        ValueError: one is out of range.
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
    """NaN for what is no number: Drake says what it misses, and where."""
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan


def _positive(what: str, text: str | None, unit: str) -> None:
    positive = 0.0 < _number(text) < math.inf
    _require(positive, f"{what} = {text}: must be a number > 0 {unit}")


def check_plant(plant: MultibodyPlant, params: RobotParams) -> None:
    """Raises ValueError if `plant` lacks what `params` and control need."""
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
    # The joints that move, by name; the floating base is none of them.
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
    """What of a plant, which has shapes, may not be meant so; one line each.

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

    In `plant` at `q` (nq,), either sole carrying half the weight at its centre.
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


def improper_contacts(
    plant: MultibodyPlant,
    results: ContactResults,
    robot: ModelInstanceIndex,
    feet: set[str],
) -> set[str]:
    """Returns the pairs of bodies in contact that are not foot and ground.

    By name, such as "LEFT_SHIN_LINK - RIGHT_SHIN_LINK" or "PELVIS_LINK -
    ground".  A foot may touch all that is not the `robot` itself.
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
