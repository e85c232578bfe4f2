"""Both ends of a wire of Unitree's G1: unitree_hg messages over DDS.

LowState_ on rt/lowstate and LowCmd_ on rt/lowcmd are Unitree's own types, the
checksum is of its own function, and Cyclone DDS is its transport.  Parsers made
from the types take 1.3 ms of Python for a state, of which one comes every 2 ms:
here a message is one record of fixed layout.

Joints are mapped by name to the first 29 of 35 motors.  In the states and the
commands of a G1 with 29 joints mode_machine is one of MACHINES; ankles and
waist are commanded by pitch and roll (mode_pr 0).
"""

import ctypes
import functools
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from cyclonedds.core import (
    DDSException,
    InstanceState,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from unitree_sdk2py.idl.unitree_hg.msg.dds_ import LowCmd_, LowState_  # type: ignore[import-untyped]
from unitree_sdk2py.utils.crc import CRC  # type: ignore[import-untyped]

from nadia_balance.parameters.bounds import check_number
from nadia_balance.wire.g1_motors import motors_of
from nadia_balance.wire.messages import (
    LOOPBACK,
    JointCommand,
    Mode,
    RefusedError,
    RobotState,
)

MACHINES = (2, 5)  # the first and the present G1 with 29 joints
MOTORS = 35
DEPTH = 64  # of a queue: an eighth of a second of messages
_STOP_BUTTON = 1 << 9  # B
_REMOTE = np.dtype(
    {
        "names": ["keys", "lx", "rx", "ly"],
        "formats": ["<u2", "<f4", "<f4", "<f4"],
        "offsets": [2, 4, 8, 20],
        "itemsize": 40,
    }
)
# As structs of C, of which Unitree computes the checksum.
_STATE = np.dtype(
    [
        ("version", "<u4", 2),
        ("mode_pr", "u1"),
        ("mode_machine", "u1"),
        ("", "V2"),
        ("tick", "<u4"),
        ("quaternion", "<f4", 4),
        ("gyroscope", "<f4", 3),
        ("accelerometer", "<f4", 3),
        ("rpy", "<f4", 3),
        ("temperature", "<i2"),
        ("_", "V2"),
        (
            "motor",
            [
                ("mode", "u1"),
                ("", "V3"),
                ("q", "<f4"),
                ("dq", "<f4"),
                ("ddq", "<f4"),
                ("tau_est", "<f4"),
                ("more", "<u4", 9),  # temperatures, voltage, sensors, ...
            ],
            MOTORS,
        ),
        ("wireless_remote", _REMOTE),
        ("reserve", "<u4", 4),
        ("crc", "<u4"),
    ]
)
_COMMAND = np.dtype(
    [
        ("mode_pr", "u1"),
        ("mode_machine", "u1"),
        ("", "V2"),
        (
            "motor",
            [
                ("mode", "u1"),
                ("", "V3"),
                ("q", "<f4"),
                ("dq", "<f4"),
                ("tau", "<f4"),
                ("kp", "<f4"),
                ("kd", "<f4"),
                ("reserve", "<u4"),
            ],
            MOTORS,
        ),
        ("reserve", "<u4", 4),
        ("crc", "<u4"),
    ]
)
_HEADER = bytes((0, 1, 0, 0))  # CDR, little-endian


class _Sample:
    """A message as DDS delivers it: its bytes, and who has sent it."""

    sample_info: Any

    def __init__(self, data: bytes) -> None:
        self.data = data

    @classmethod
    def deserialize(cls, data: bytes) -> "_Sample":
        """What the reader calls.

        Args:
            data: of the message, with its header.

        Returns:
            The sample.
        """
        return cls(data)

    deserialize_key = deserialize


class _Record:
    """The layout of a message, as a struct of C and on the wire.

    In CDR the motors follow what is before them without padding: the first
    one's mode comes at `cut`, and four bytes are missing.
    """

    def __init__(self, layout: np.dtype[Any], cut: int) -> None:
        self._layout, self._cut = layout, cut
        self._crc = CRC().crc_lib.crc32_core

    def empty(self) -> Any:
        """A record of zeros (1,)."""
        return np.zeros(1, self._layout)

    def checksum(self, record: Any) -> int:
        """Unitree's checksum, of all words but the last."""
        words = record.tobytes()
        return int(
            self._crc(
                (ctypes.c_uint32 * (len(words) // 4)).from_buffer_copy(words),
                len(words) // 4 - 1,
            )
        )

    def encoded(self, record: Any) -> bytes:
        """The message of a record, with its checksum."""
        record["crc"] = self.checksum(record)
        c: bytes = record.tobytes()
        cut = self._cut
        return _HEADER + c[:cut] + c[cut + 2 : cut + 4] + c[cut + 6 :]

    def decoded(self, data: bytes) -> Any:
        """The record () of a message; RefusedError: it is none."""
        body, cut = data[len(_HEADER) :], self._cut
        if len(body) + 4 != self._layout.itemsize:
            raise RefusedError(
                f"a message of {len(body)} bytes: must be of "
                f"{self._layout.itemsize - 4}, of {MOTORS} motors"
            )
        gap = bytes(2)
        c = body[:cut] + gap + body[cut : cut + 2] + gap + body[cut + 2 :]
        record = np.frombuffer(c, self._layout)
        # Simulators leave it 0.
        if record["crc"][0] not in (0, self.checksum(record)):
            raise RefusedError(
                f"crc = {record['crc'][0]}: must be the checksum"
            )
        if record["mode_pr"][0] != 0:
            raise RefusedError(
                f"mode_pr = {record['mode_pr'][0]}: must be 0, pitch and roll"
            )
        if record["mode_machine"][0] not in MACHINES:
            raise RefusedError(
                f"mode_machine = {record['mode_machine'][0]}: must be one of "
                f"{', '.join(map(str, MACHINES))}, a G1 with 29 joints"
            )
        return record[0]


_STATES, _COMMANDS = _Record(_STATE, cut=70), _Record(_COMMAND, cut=2)


class _LastingDomain(Domain):
    """A domain that ends with the process.

    Its deletion may wait for its threads for ever (Cyclone DDS 11.0.1; 4 of 16
    ends of a controller, on a busy machine).
    """

    def __del__(self) -> None:
        pass


@functools.cache  # DDS allows one per process
def _domain(interface: str, domain: int) -> Domain:
    config = f"""<CycloneDDS><Domain Id="any"><General><Interfaces>
        <NetworkInterface name="{interface}" priority="default"
        multicast="default"/></Interfaces></General></Domain></CycloneDDS>"""
    return _LastingDomain(domain, config)


class _Reader:
    """A queue of the messages of a topic that others send."""

    def __init__(self, participant: Any, topic: str, kind: Any) -> None:
        queue = Qos(
            Policy.History.KeepLast(DEPTH), Policy.IgnoreLocal.Participant
        )
        self._topic = Topic(participant, topic, kind)
        self._reader = DataReader(participant, self._topic, qos=queue)
        self._topic.data_type = _Sample  # the parser
        self._condition = ReadCondition(
            self._reader,
            ViewState.Any | InstanceState.Any | SampleState.NotRead,
        )
        self._wait = WaitSet(participant)
        self._wait.attach(self._condition)
        self._samples: deque[_Sample] = deque(maxlen=DEPTH)

    def waiting(self) -> int:
        """The number of messages that have come and were not taken."""
        self._samples.extend(
            sample
            for sample in self._reader.take(DEPTH)
            if sample.sample_info.valid_data
        )
        return len(self._samples)

    def forget(self) -> None:
        """Takes all that waits."""
        self._samples.clear()

    def take(self, timeout: float) -> _Sample | None:
        """The next message, None if there is none in time."""
        end = time.monotonic() + timeout
        while not self._samples and not self.waiting():
            left = end - time.monotonic()
            if left <= 0.0:
                return None
            self._wait.wait(duration(seconds=left))
        return self._samples.popleft()


class _Writer:
    """Sends the messages of a topic."""

    def __init__(self, participant: Any, topic: str, kind: Any) -> None:
        self._writer = DataWriter(participant, Topic(participant, topic, kind))
        self._message = kind.__new__(kind)

    def send(self, data: bytes) -> None:
        """Sends a message that is encoded already."""
        self._message.serialize = lambda **_: data
        self._writer.write(self._message)


class _End:
    """What both ends have: the motors of a G1's joints, and DDS."""

    def __init__(
        self, joints: Sequence[str], interface: str, domain: int
    ) -> None:
        self._motors = motors_of(joints, "wire = 'unitree'")
        check_number("domain", domain, least=0, most=230)
        try:
            _domain(interface, domain)
            self._participant = DomainParticipant(domain)
        except DDSException as error:
            raise ValueError(
                f"interface = {interface!r}, domain = {domain}: must be of "
                f"this machine ({error.msg})"
            ) from None

    def close(self) -> None:
        """Lets go of DDS' readers and writers."""
        self.__dict__.clear()


class UnitreeWire(_End):
    """The controller's end."""

    def __init__(
        self, joints: Sequence[str], interface: str = LOOPBACK, domain: int = 1
    ) -> None:
        """Connects.

        Args:
            joints: names of the robot's joints (n), by their actuators.
            interface: network interface; LOOPBACK stays on this machine.
            domain: of DDS; Unitree's robots have 0.

        Raises:
            ValueError: it is no G1, or there is no such interface or domain.
        """
        super().__init__(joints, interface, domain)
        self._states = _Reader(self._participant, "rt/lowstate", LowState_)
        self._others = _Reader(self._participant, "rt/lowcmd", LowCmd_)
        self._commands = _Writer(self._participant, "rt/lowcmd", LowCmd_)
        self._machine = 0

    def read(self, timeout: float) -> RobotState | None:
        """The next state, see messages.Wire.

        Args:
            timeout: for which it waits at most [s].

        Returns:
            The state, None if there was none.

        Raises:
            RefusedError: the message was not of this robot, or broken.
        """
        sample = self._states.take(timeout)
        if sample is None:
            return None
        record = _STATES.decoded(sample.data)
        self._machine = record["mode_machine"]
        motors, remote = record["motor"], record["wireless_remote"]
        q, dq, tau = (
            motors[name].astype(float)[self._motors]
            for name in ("q", "dq", "tau_est")
        )
        return RobotState(
            time=1e-3 * float(record["tick"]),
            q=q,
            dq=dq,
            tau=tau,
            quaternion=record["quaternion"].astype(float),
            gyro=record["gyroscope"].astype(float),
            force=record["accelerometer"].astype(float),
            sticks=np.array(
                (remote["ly"], -remote["lx"], -remote["rx"]), dtype=float
            ),
            halt=bool(remote["keys"] & _STOP_BUTTON),
        )

    def waiting(self) -> int:
        """The number of states that have come and were not read.

        Returns:
            0 if the controller keeps up.
        """
        return self._states.waiting()

    def write(self, command: JointCommand) -> None:
        """Sends a command, for the machine that was heard last.

        Args:
            command: for all joints.
        """
        record = _COMMANDS.empty()
        record["mode_machine"] = self._machine
        motors = record["motor"][0]
        motors["mode"][self._motors] = command.mode
        for name in ("q", "dq", "tau", "kp", "kd"):
            motors[name][self._motors] = getattr(command, name)
        self._commands.send(_COMMANDS.encoded(record))

    def has_rivals(self) -> bool:
        """Whether someone else has sent a command since the last call.

        Returns:
            True if somebody was heard.
        """
        is_heard = self._others.waiting() > 0
        self._others.forget()
        return is_heard


class UnitreeRobotWire(_End):
    """The robot's end: it is the present G1 with 29 joints."""

    def __init__(
        self, joints: Sequence[str], interface: str = LOOPBACK, domain: int = 1
    ) -> None:
        """Connects.

        Args:
            joints: names of the robot's joints (n), by their actuators.
            interface: network interface; LOOPBACK stays on this machine.
            domain: of DDS.

        Raises:
            ValueError: it is no G1, or there is no such interface or domain.
        """
        super().__init__(joints, interface, domain)
        self._commands = _Reader(self._participant, "rt/lowcmd", LowCmd_)
        self._states = _Writer(self._participant, "rt/lowstate", LowState_)

    def read(self, timeout: float) -> tuple[int, JointCommand] | None:
        """The next command, see messages.RobotWire.

        Args:
            timeout: for which it waits at most [s].

        Returns:
            The writer's handle, and the command; None if there was none.

        Raises:
            RefusedError: the message was not for this robot, or broken.
        """
        sample = self._commands.take(timeout)
        if sample is None:
            return None
        motors = _COMMANDS.decoded(sample.data)["motor"]
        modes = {*motors["mode"][self._motors].tolist()}
        if len(modes) > 1 or not modes <= {*Mode}:
            raise RefusedError(
                f"mode = {sorted(modes)}: must be 0 or 1 of all motors"
            )
        q, dq, tau, kp, kd = (
            motors[name].astype(float)[self._motors]
            for name in ("q", "dq", "tau", "kp", "kd")
        )
        return sample.sample_info.publication_handle, JointCommand(
            q=q, dq=dq, tau=tau, kp=kp, kd=kd, mode=Mode(modes.pop())
        )

    def write(self, state: RobotState) -> None:
        """Sends a state.

        Args:
            state: of the robot.
        """
        record = _STATES.empty()
        record["mode_machine"] = MACHINES[-1]
        record["tick"] = round(1e3 * state.time)
        record["quaternion"] = state.quaternion
        record["gyroscope"] = state.gyro
        record["accelerometer"] = state.force
        motors, remote = record["motor"][0], record["wireless_remote"][0]
        motors["mode"][self._motors] = Mode.ON
        for name, values in (
            ("q", state.q),
            ("dq", state.dq),
            ("tau_est", state.tau),
        ):
            motors[name][self._motors] = values
        remote["keys"] = _STOP_BUTTON if state.halt else 0
        remote["ly"], remote["lx"], remote["rx"] = state.sticks * (1, -1, -1)
        self._states.send(_STATES.encoded(record))
