"""What crosses the boundary to a robot: its state, a command for its joints.

All arrays are in the order of the n actuators of the robot's `control_plant`,
in SI units.  A wire translates them into the messages of a bus; whoever
balances the robot does not know which.
"""

import dataclasses
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol

import numpy as np

from nadia_balance.core.math.arrays import Array

LOOPBACK = "lo"  # the network interface that stays on this machine
UNIT = 0.1  # by which the norm of a quaternion may differ from 1 [-]
LARGEST = 1e6  # number of a joint, or of the body, in SI units


class Mode(IntEnum):
    """What the drives do: nothing, or the law of a JointCommand."""

    OFF = 0
    ON = 1


@dataclass(frozen=True, eq=False)
class RobotState:
    """What a robot tells of itself, a sample.

    Args:
        time: of the sample, by the robot's clock [s].
        q: joint angles (n,) [rad].
        dq: joint speeds (n,) [rad/s].
        tau: joint torques, as the drives estimate them (n,) [N m].
        quaternion: orientation of the IMU in a level world (4,), w x y z.  Its
            tilt is read until the robot balances; then tilt is estimated.  Its
            yaw, which drifts, is never read.
        gyro: angular velocity of the IMU in its frame (3,) [rad/s].
        force: specific force a - g of the IMU in its frame (3,) [m/s^2]; at
            rest and level (0, 0, 9.81).
        sticks: of a remote control: forward, left, turn to the left (3,), each
            in [-1, 1].
        halt: whether its stop button is pressed.
    """

    time: float
    q: Array
    dq: Array
    tau: Array
    quaternion: Array
    gyro: Array
    force: Array
    sticks: Array = field(default_factory=lambda: np.zeros(3))
    halt: bool = False


@dataclass(frozen=True, eq=False)
class JointCommand:
    """What the drives do until the next command, at a rate of their own.

    torque = tau + kp (q - q_now) + kd (dq - dq_now)

    Args:
        q: joint angles (n,) [rad].
        dq: joint speeds (n,) [rad/s].
        tau: joint torques (n,) [N m].
        kp: stiffness (n,) >= 0 [N m/rad].
        kd: damping (n,) >= 0 [N m s/rad].
        mode: OFF switches the drives off, and the rest is not used.
    """

    q: Array
    dq: Array
    tau: Array
    kp: Array
    kd: Array
    mode: Mode = Mode.ON


_SIZES = {"quaternion": 4, "gyro": 3, "force": 3, "sticks": 3}


def fault_of(message: RobotState | JointCommand, joints: int) -> str:
    """What makes a message unfit for use.

    Args:
        message: as a wire has read it.
        joints: number n of joints.

    Returns:
        Field, value and what is allowed; empty if the message is good.
    """
    for part in dataclasses.fields(message):
        value = np.asarray(getattr(message, part.name))
        if value.ndim == 1 and len(value) != _SIZES.get(part.name, joints):
            return (
                f"{part.name} has {len(value)} numbers: must be "
                f"{_SIZES.get(part.name, joints)}"
            )
        if not np.isfinite(value).all():
            return f"{part.name} = {value.tolist()}: must be finite"
        if value.ndim == 1 and np.abs(value).max() > LARGEST:
            return (
                f"{part.name} = {value.tolist()}: must be within "
                f"{LARGEST:g} of 0"
            )
    if isinstance(message, RobotState):
        norm = float(np.linalg.norm(message.quaternion))
        if abs(norm - 1.0) > UNIT:
            return f"quaternion has the norm {norm:.3g}: must be 1"
    elif min(message.kp.min(), message.kd.min()) < 0.0:
        return "kp, kd: must be >= 0"
    return ""


class RefusedError(ValueError):
    """A message that is not of this robot, or broken: one line says why."""


class Wire(Protocol):
    """The controller's end of a wire."""

    def read(self, timeout: float) -> RobotState | None:
        """The next state, in the order of arrival.

        Args:
            timeout: for which it waits at most [s].

        Returns:
            The state, None if there was none.

        Raises:
            RefusedError: the message was not of this robot, or broken.
        """
        ...

    def waiting(self) -> int:
        """The number of states that have come and were not read.

        Returns:
            0 if the controller keeps up.
        """
        ...

    def write(self, command: JointCommand) -> None:
        """Sends a command.

        Args:
            command: for all joints.
        """
        ...

    def has_rivals(self) -> bool:
        """Whether someone else has sent a command since the last call.

        Returns:
            True if somebody was heard.
        """
        ...

    def close(self) -> None:
        """Frees the wire; nothing is read or written after it."""
        ...


class RobotWire(Protocol):
    """The robot's end of a wire."""

    def read(self, timeout: float) -> tuple[int, JointCommand] | None:
        """The next command, in the order of arrival.

        Args:
            timeout: for which it waits at most [s].

        Returns:
            A number that only its sender has, and the command; None if there
            was none.

        Raises:
            RefusedError: the message was not for this robot, or broken.
        """
        ...

    def write(self, state: RobotState) -> None:
        """Sends a state.

        Args:
            state: of the robot.
        """
        ...

    def close(self) -> None:
        """Frees the wire; nothing is read or written after it."""
        ...
