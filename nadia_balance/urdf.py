"""Reader of a robot's URDF into a MultibodyPlant, with strict checks."""

import contextlib
import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

_JOINTS = ("revolute", "continuous", "fixed")


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

    Raises:
        ValueError: the URDF is malformed; Drake's warnings count as errors,
            because Drake then substitutes values of its own.
    """
    parser = Parser(plant)
    parser.SetStrictParsing()
    with naming(f"urdf = {urdf}"):
        instance = parser.AddModels(str(urdf))[0]
        _add_actuators(plant, instance, _effort_limits(urdf))
    return instance


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


def _effort_limits(urdf: Path) -> dict[str, float]:
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


def _add_actuators(
    plant: MultibodyPlant,
    instance: ModelInstanceIndex,
    effort_limits: dict[str, float],
) -> None:
    """Adds actuators to joints for which the URDF has no <transmission>."""
    # All actuators: those of an instance are known only once it is finalized.
    actuators = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    driven = [actuator.joint().index() for actuator in actuators]
    if len(set(driven)) < len(driven):
        raise ValueError("a joint must not have two <transmission>s")
    for joint in map(plant.get_joint, plant.GetJointIndices(instance)):
        limit = effort_limits.get(joint.name())
        if limit and joint.num_positions() and joint.index() not in driven:
            plant.AddJointActuator(joint.name(), joint, limit)
