"""The wires by their names."""

from collections.abc import Callable

from nadia_balance.parameters.bounds import require
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import actuators
from nadia_balance.wire.lcm import LcmRobotWire, LcmWire
from nadia_balance.wire.messages import LOOPBACK, RobotWire, Wire

WIRES = "lcm", "unitree"


def joint_names(robot: RobotModel) -> list[str]:
    """The joints of a robot in the order of its messages.

    Args:
        robot: the robot.

    Returns:
        Their names, by their actuators.
    """
    return [one.joint().name() for one in actuators(robot.control_plant())]


def controller_wire(
    kind: str, robot: RobotModel, interface: str = LOOPBACK, domain: int = 1
) -> Wire:
    """The controller's end of a wire.

    Args:
        kind: one of WIRES.
        robot: that is controlled.
        interface: network interface; LOOPBACK stays on this machine.
        domain: that of both ends; Unitree's robots have 0.

    Returns:
        The end, connected.

    Raises:
        ValueError: there is no such wire, robot, interface or domain, or its
            package is missing.
    """
    controller, _ = _ends(kind)
    return controller(joint_names(robot), interface, domain)


def robot_wire(
    kind: str, robot: RobotModel, interface: str = LOOPBACK, domain: int = 1
) -> RobotWire:
    """The robot's end of a wire, as controller_wire.

    Args:
        kind: one of WIRES.
        robot: that is controlled.
        interface: network interface; LOOPBACK stays on this machine.
        domain: that of both ends.

    Returns:
        The end, connected.

    Raises:
        ValueError: as controller_wire.
    """
    _, end = _ends(kind)
    return end(joint_names(robot), interface, domain)


def _ends(kind: str) -> tuple[Callable[..., Wire], Callable[..., RobotWire]]:
    """The classes of both ends; ValueError: no such wire, or no package."""
    require(
        kind in WIRES, f"wire = {kind!r}: must be one of {', '.join(WIRES)}"
    )
    if kind == "lcm":
        return LcmWire, LcmRobotWire
    try:
        from nadia_balance.wire import unitree
    except ModuleNotFoundError as error:
        if error.name not in ("cyclonedds", "unitree_sdk2py"):
            raise
        raise ValueError(
            "wire = 'unitree': must have its packages: "
            "pip install cyclonedds unitree-sdk2py-dimos"
        ) from None
    return unitree.UnitreeWire, unitree.UnitreeRobotWire
