"""Both ends of a wire over LCM, by a message of Drake's own.

Channels ROBOT_STATE and ROBOT_COMMAND carry an lcmt_drake_signal each: `coord`
names each number of `val`, `timestamp` is the robot's time [us] in a state, and
the sender's number in a command.  The names are

    q.JOINT, dq.JOINT, tau.JOINT             of every joint, in both
    kp.JOINT, kd.JOINT, mode                 in a command
    quaternion.w ..., gyro.x ..., force.x ..., stick.forward ..., halt
"""

import functools
import os
import select
import socket
import time
from collections import deque
from collections.abc import Sequence
from itertools import product

import numpy as np
from drake import lcmt_drake_signal  # type: ignore[import-untyped]
from pydrake.lcm import DrakeLcm

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import check_number, require
from nadia_balance.wire.messages import (
    LOOPBACK,
    JointCommand,
    Mode,
    RefusedError,
    RobotState,
)

STATE, COMMAND = "ROBOT_STATE", "ROBOT_COMMAND"
GROUP, PORT = "239.255.76.67", 7667  # LCM's
BUFFER = 1 << 21  # of the socket: half a second of messages [bytes]
_SHORT = b"LC02"  # how a message of one datagram begins
_BODY = (
    *(f"quaternion.{axis}" for axis in "wxyz"),
    *(f"{part}.{axis}" for part, axis in product(("gyro", "force"), "xyz")),
    *(f"stick.{name}" for name in ("forward", "left", "turn")),
    "halt",
)


@functools.lru_cache(maxsize=64)
def is_here(address: str) -> bool:
    """Whether an address is one of this machine's.

    Args:
        address: of IPv4.

    Returns:
        True if a socket can be bound to it.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attempt:
        try:
            attempt.bind((address, 0))
        except OSError:
            return False
    return True


class _Group:
    """A multicast group: Drake sends to it, and a queue has what comes.

    A subscription of Drake's keeps but one message from one `receive` to the
    next, the oldest; two or three samples come while a controller computes.
    """

    def __init__(self, interface: str, domain: int) -> None:
        """Joins the group.

        Args:
            interface: "lo" neither leaves this machine nor hears another one;
                any other one lets the machine's routes decide.
            domain: that of both ends.

        Raises:
            ValueError: there is no such interface or domain, or no multicast.
        """
        check_number("domain", domain, least=0, most=232)
        names = [name for _, name in socket.if_nameindex()]
        require(
            interface in (LOOPBACK, *names),
            f"interface = {interface!r}: must be one of {', '.join(names)}",
        )
        self._is_open = interface != LOOPBACK
        port, ttl = PORT + domain, 0 if interface == LOOPBACK else 1
        self._queues: dict[bytes, deque[bytes]] = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            for option, value in (
                (socket.SO_REUSEADDR, 1),
                (socket.SO_REUSEPORT, 1),
                (socket.SO_RCVBUF, BUFFER),
            ):
                self._socket.setsockopt(socket.SOL_SOCKET, option, value)
            self._socket.bind((GROUP, port))
            member = socket.inet_aton(GROUP) + socket.inet_aton("0.0.0.0")
            self._socket.setsockopt(
                socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member
            )
            self._lcm = DrakeLcm(f"udpm://{GROUP}:{port}?ttl={ttl}")
        except (OSError, RuntimeError) as error:
            self.close()
            raise ValueError(f"interface = {interface!r}: {error}") from None

    def close(self) -> None:
        """Leaves the group."""
        self._socket.close()

    def send(self, channel: str, data: bytes) -> None:
        """Sends a message."""
        self._lcm.Publish(channel, data)

    def queue(self, channel: str) -> deque[bytes]:
        """The messages of a channel from now on, which receive() adds."""
        return self._queues.setdefault(channel.encode(), deque(maxlen=64))

    def receive(self, timeout: float = 0.0) -> None:
        """Queues what has come; waits for the first for a while [s]."""
        while select.select([self._socket], [], [], timeout)[0]:
            timeout = 0.0
            datagram, (address, _) = self._socket.recvfrom(1 << 16)
            if not (self._is_open or is_here(address)):
                continue
            channel, _, data = datagram[8:].partition(b"\0")
            if datagram.startswith(_SHORT) and channel in self._queues:
                self._queues[channel].append(data)


def _names(kinds: Sequence[str], joints: Sequence[str]) -> list[str]:
    return [f"{kind}.{joint}" for kind, joint in product(kinds, joints)]


class _Channel:
    """A channel of signals with fixed names."""

    def __init__(self, group: _Group, name: str, coord: list[str]) -> None:
        self._group, self._name, self._coord = group, name, coord
        self._messages: deque[bytes] = deque()

    def subscribe(self) -> None:
        """Begins to queue messages."""
        self._messages = self._group.queue(self._name)

    def send(self, stamp: int, values: Array) -> None:
        """Sends numbers, as many as there are names."""
        signal = lcmt_drake_signal()
        signal.dim, signal.coord = len(self._coord), self._coord
        signal.val, signal.timestamp = values.tolist(), stamp
        self._group.send(self._name, signal.encode())

    def take(self, timeout: float) -> tuple[int, Array] | None:
        """The next stamp and numbers, None if there are none in time.

        Raises RefusedError: the message is broken, or has other names.
        """
        deadline = time.monotonic() + timeout
        while not self._messages:  # messages of other channels wake it, too
            left = max(deadline - time.monotonic(), 0.0)
            self._group.receive(left)
            if left == 0.0 and not self._messages:
                return None
        try:
            signal = lcmt_drake_signal.decode(self._messages.popleft())
        except Exception as error:  # of struct, of text, or a ValueError
            raise RefusedError(
                f"{self._name} is no lcmt_drake_signal"
            ) from error
        if signal.coord != self._coord:
            raise RefusedError(
                f"{self._name} has {signal.dim} numbers: must be of the "
                f"{len(self._coord)} names of this robot"
            )
        return signal.timestamp, np.array(signal.val)

    def waiting(self) -> int:
        """The number of messages that have come and were not taken."""
        self._group.receive()
        return len(self._messages)

    def senders(self) -> set[int]:
        """The stamps of all messages that have come, which are taken."""
        self._group.receive()
        # The last field of the message: decoding all of it would take longer.
        stamps = {int.from_bytes(data[-8:]) for data in self._messages}
        self._messages.clear()
        return stamps


class _End:
    """What both ends have: the two channels of a robot."""

    def __init__(
        self, joints: Sequence[str], interface: str, domain: int
    ) -> None:
        """Connects.

        Args:
            joints: names of the robot's joints (n), by their actuators.
            interface: network interface, see _Group.
            domain: that of both ends.
        """
        self._n = len(joints)
        self._group = _Group(interface, domain)
        self._states = _Channel(
            self._group, STATE, [*_names(("q", "dq", "tau"), joints), *_BODY]
        )
        kinds = "q", "dq", "tau", "kp", "kd"
        self._commands = _Channel(
            self._group, COMMAND, [*_names(kinds, joints), "mode"]
        )

    def close(self) -> None:
        """Leaves the group: nothing is read or written after it."""
        self._group.close()


class LcmWire(_End):
    """The controller's end."""

    def __init__(
        self, joints: Sequence[str], interface: str = LOOPBACK, domain: int = 1
    ) -> None:
        """Connects, see _End.

        Args:
            joints: names of the robot's joints (n), by their actuators.
            interface: network interface, see _Group.
            domain: that of both ends.

        Raises:
            ValueError: as _Group.
        """
        super().__init__(joints, interface, domain)
        self._states.subscribe()
        self._commands.subscribe()  # also what others send
        # Not the process' number alone: it may be in another container.
        self._sender = int.from_bytes(os.urandom(6))

    def read(self, timeout: float) -> RobotState | None:
        """The next state, see messages.Wire.

        Args:
            timeout: for which it waits at most [s].

        Returns:
            The state, None if there was none.

        Raises:
            RefusedError: the message was not of this robot, or broken.
        """
        message = self._states.take(timeout)
        if message is None:
            return None
        stamp, values = message
        joints, body = values[: 3 * self._n], values[3 * self._n :]
        q, dq, tau = joints.reshape(3, self._n)
        return RobotState(
            time=1e-6 * stamp,
            q=q,
            dq=dq,
            tau=tau,
            quaternion=body[:4],
            gyro=body[4:7],
            force=body[7:10],
            sticks=body[10:13],
            halt=bool(body[13]),
        )

    def waiting(self) -> int:
        """The number of states that have come and were not read.

        Returns:
            0 if the controller keeps up.
        """
        return self._states.waiting()

    def write(self, command: JointCommand) -> None:
        """Sends a command.

        Args:
            command: for all joints.
        """
        self._commands.send(self._sender, _numbers_of(command))

    def has_rivals(self) -> bool:
        """Whether someone else has sent a command since the last call.

        Returns:
            True if somebody was heard.
        """
        return bool(self._commands.senders() - {self._sender})


class LcmRobotWire(_End):
    """The robot's end."""

    def __init__(
        self, joints: Sequence[str], interface: str = LOOPBACK, domain: int = 1
    ) -> None:
        """Connects, see _End.

        Args:
            joints: names of the robot's joints (n), by their actuators.
            interface: network interface, see _Group.
            domain: that of both ends.

        Raises:
            ValueError: as _Group.
        """
        super().__init__(joints, interface, domain)
        self._commands.subscribe()

    def read(self, timeout: float) -> tuple[int, JointCommand] | None:
        """The next command, see messages.RobotWire.

        Args:
            timeout: for which it waits at most [s].

        Returns:
            The sender's number, and the command; None if there was none.

        Raises:
            RefusedError: the message was not for this robot, or broken.
        """
        message = self._commands.take(timeout)
        if message is None:
            return None
        sender, values = message
        q, dq, tau, kp, kd = values[:-1].reshape(5, self._n)
        if values[-1] not in iter(Mode):
            raise RefusedError(f"mode = {values[-1]:g}: must be 0 or 1")
        return sender, JointCommand(
            q=q, dq=dq, tau=tau, kp=kp, kd=kd, mode=Mode(int(values[-1]))
        )

    def write(self, state: RobotState) -> None:
        """Sends a state.

        Args:
            state: of the robot.
        """
        self._states.send(
            round(1e6 * state.time),
            np.concatenate(
                (
                    state.q,
                    state.dq,
                    state.tau,
                    state.quaternion,
                    state.gyro,
                    state.force,
                    state.sticks,
                    (state.halt,),
                )
            ),
        )


def _numbers_of(command: JointCommand) -> Array:
    """The numbers of a command (5 n + 1,)."""
    return np.concatenate(
        (
            command.q,
            command.dq,
            command.tau,
            command.kp,
            command.kd,
            (command.mode,),
        )
    )
