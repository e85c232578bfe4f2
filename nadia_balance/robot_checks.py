"""What a URDF must hold for a robot to walk, and what must not touch."""

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex

from nadia_balance.core.robot_params import RobotParams

BODIES = ("pelvis_body", "torso_body", "left_foot_body", "right_foot_body")


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
        name = joint.get("name")
        for limit in joint.iter("limit"):
            velocity = limit.get("velocity", "1")
            _positive(f"velocity limit of {name}", velocity, "rad/s")
            low, high = limit.get("lower", "0"), limit.get("upper", "0")
            if _number(low) > _number(high):
                raise ValueError(
                    f"lower limit of {name} = {low}: must be <= its upper "
                    f"limit = {high}"
                )


def _number(text: str | None) -> float:
    """NaN for what is no number: Drake says what it misses, and where."""
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")


def _positive(what: str, text: str | None, unit: str) -> None:
    if not 0.0 < _number(text) < float("inf"):
        raise ValueError(f"{what} = {text}: must be a number > 0 {unit}")


def check_plant(plant: MultibodyPlant, params: RobotParams) -> None:
    """Raises ValueError if `plant` lacks what `params` and control need."""
    for field in BODIES:
        body = getattr(params, field)
        if not plant.HasBodyNamed(body):
            raise ValueError(f"{field} = {body!r}: must be a link of the URDF")
    floating = sorted(
        plant.get_body(i).name() for i in plant.GetFloatingBaseBodies()
    )
    if floating != [params.pelvis_body]:
        raise ValueError(
            f"pelvis_body = {params.pelvis_body!r}: must be the one link that "
            f"no joint holds; these are: {', '.join(floating) or 'none'}"
        )
    context = plant.CreateDefaultContext()
    left, right = (
        plant.GetBodyByName(foot).EvalPoseInWorld(context).translation()[1]
        for foot in (params.left_foot_body, params.right_foot_body)
    )
    if not left > right:
        raise ValueError(
            f"left_foot_body = {params.left_foot_body!r}: must be left of "
            f"right_foot_body = {params.right_foot_body!r}"
        )
    _check_actuators(plant, params)
    limits = params.whole_body.joint_lower_limits
    _check_angles(plant, "posture", params.posture)
    _check_angles(plant, "whole_body.joint_lower_limits", limits)


def _joints(plant: MultibodyPlant) -> dict:
    """The joints that move, by name; the floating base is none of them."""
    joints = map(plant.get_joint, plant.GetJointIndices())
    return {j.name(): j for j in joints if j.num_positions() == 1}


def _check_actuators(plant: MultibodyPlant, params: RobotParams) -> None:
    where = f"urdf = {params.urdf}"
    indices = plant.GetJointActuatorIndices()
    actuators = {
        actuator.joint().name(): actuator
        for actuator in map(plant.get_joint_actuator, indices)
    }
    if len(actuators) < len(indices):
        raise ValueError(f"{where}: a joint must not have two <transmission>s")
    for name in _joints(plant):
        if name not in actuators or not (
            actuators[name].effort_limit() < float("inf")
        ):
            raise ValueError(
                f"{where}: joint {name}: must have a <transmission> and an "
                "effort limit"
            )
        inertia = actuators[name].default_reflected_inertia()
        if inertia < 0.0:
            raise ValueError(
                f"{where}: rotor inertia x gear ratio^2 of {name} = "
                f"{inertia}: must be >= 0 kg m^2"
            )


def _check_angles(
    plant: MultibodyPlant, field: str, angles: dict[str, float]
) -> None:
    joints = _joints(plant)
    for name, angle in angles.items():
        if name not in joints:
            raise ValueError(
                f"{field}.{name} = {angle}: must be one of the joints "
                f"{', '.join(sorted(joints))}"
            )
        low = joints[name].position_lower_limits()[0]
        high = joints[name].position_upper_limits()[0]
        if not low <= angle <= high:
            raise ValueError(
                f"{field}.{name} = {angle}: must be in [{low}, {high}] rad"
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
        others = {
            "ground"
            if body.index() == plant.world_body().index()
            # Two robots may have bodies of the same name.
            else str(body.scoped_name())
            for body in bodies
            if body.model_instance() != robot
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
    body_of = {
        geometry: i
        for i in range(plant.num_bodies())
        for geometry in plant.GetCollisionGeometriesForBody(
            plant.get_body(BodyIndex(i))
        )
    }
    for i in range(results.num_hydroelastic_contacts()):
        surface = results.hydroelastic_contact_info(i).contact_surface()
        yield body_of[surface.id_M()], body_of[surface.id_N()]
