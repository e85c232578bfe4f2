"""Commands to a robot, sample by sample: damp, posture, load, balance.

Neither a wire nor a clock is in here: time is that of the samples.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import bounded, check, parameters
from nadia_balance.parameters.yaml_reader import one_line
from nadia_balance.view.live_controls import stick_command
from nadia_balance.wire.messages import JointCommand, RobotState, fault_of

SILENCE = 0.05  # without a sample, after which the robot is damped [s]
REMOTE = "its remote control"  # why it is damped
DAMPING_TIME = 0.03  # damping of a joint over its largest torque [s/rad]


class Phase(Enum):
    """What the robot does."""

    DAMPING = "damping"  # it sinks, or hangs
    POSTURE = "posture"  # its joints go to those of standing
    LOAD = "load"  # it holds them until its feet bear its weight
    BALANCE = "balance"  # it stands, walks and is pushed


@parameters
class ProcessParams:
    """How the robot gets up, and when it is let go."""

    sample_period: float = bounded(
        0.002, above=0.0, most=0.02, unit="s", of="", doc="of the robot's bus"
    )
    posture_time: float = bounded(
        2.0, above=0.0, unit="s", of="", doc="to take the posture of standing"
    )
    posture_angle: float = bounded(
        0.25,
        above=0.0,
        doc="error of a joint that bears the robot at which its posture takes "
        "the largest torque, in rad",
    )
    arm_angle: float = bounded(
        1.0, above=0.0, doc="the same of all other joints, in rad"
    )
    posture_damping: float = bounded(
        0.02, above=0.0, doc="damping over stiffness of the posture, in s"
    )
    damping_time: float = bounded(
        DAMPING_TIME,
        above=0.0,
        doc="damping of a joint that is let go over its largest torque, in "
        "s/rad",
    )
    loaded: float = bounded(
        0.85, above=0.0, most=1.0, doc="share of the weight on both feet"
    )
    foot_loaded: float = bounded(
        0.3, above=0.0, most=0.5, doc="share of the weight on either foot"
    )
    load_time: float = bounded(
        0.1, above=0.0, unit="s", of="", doc="for which the feet bear that"
    )


class Balance(Protocol):
    """What balances the robot once it stands; its time is in ticks."""

    period: float  # between two ticks [s]

    def begin(self) -> None:
        """Forgets all: the robot is at rest, with feet that may hang.

        The first tick is of one that stands, with level soles.
        """
        ...

    def loads(self, imu: Array, state: RobotState) -> Array:
        """The loads on the feet of a robot that does not balance yet.

        Args:
            imu: as of systems.estimation.Imu, over the last period (9,).
            state: the latest.

        Returns:
            Shares of its weight on the left and the right foot (2,).
        """
        ...

    def lies(self, state: RobotState) -> bool:
        """Whether a robot that does not balance yet has fallen.

        Args:
            state: the latest.

        Returns:
            True if its pelvis is tilted too far.
        """
        ...

    def tick(
        self, imu: Array, state: RobotState, velocity: Array
    ) -> JointCommand:
        """The command of a tick.

        Args:
            imu: as of systems.estimation.Imu, over the last period (9,).
            state: the latest.
            velocity: commanded, forward, left [m/s], turn [rad/s] (3,).

        Returns:
            The command.

        Raises:
            RuntimeError: there is none.
        """
        ...

    def estimate(self, imu: Array, state: RobotState) -> None:
        """Takes note of a tick that has no command.

        Args:
            imu: as of systems.estimation.Imu, over the last period (9,).
            state: the latest.

        Raises:
            RuntimeError: a block has no value.
        """
        ...

    def finish(self) -> None:
        """Computes of the last tick what its command did not need.

        Raises:
            RuntimeError: a block has no value.
        """
        ...

    def fall_reason(self) -> str:
        """Why the robot has fallen by the last tick.

        Returns:
            A few words; empty if it has not.
        """
        ...


@dataclass
class Counts:
    """What has happened since the process began."""

    samples: int = 0
    ticks: int = 0
    passed: int = 0  # ticks that were late, and had no command
    lost: int = 0  # samples that were bridged and never came
    late: int = 0  # that came after a later one
    refused: int = 0
    silences: int = 0
    falls: int = 0


class RobotProcess:
    """Answers each sample of a robot by a command.

    DAMPING -> POSTURE -> LOAD -> BALANCE; back to DAMPING by `stop`, a fall, a
    silence, a clock that runs back, or a balance that has no command.  It stays
    there until `start`.

    A sample that is missing is replaced by one between its neighbours as soon
    as the later of these is there, and counted; one that comes after a later
    one is counted and not used.

    Args:
        balance: what balances the robot.
        standing: joint angles in which it stands (n,) [rad].
        limits: largest torques of its joints (n,) [N m].
        bears: whether a joint is between the feet and the torso (n,).
        velocity_limits: least and most of a velocity command (2, 3).
        params: how it gets up.
        tell: takes a line for each event.
    """

    def __init__(
        self,
        balance: Balance,
        standing: Array,
        limits: Array,
        bears: NDArray[np.bool_],
        velocity_limits: Array,
        params: ProcessParams | None = None,
        tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.params = params = params or ProcessParams()
        check(params)
        self._balance, self._standing = balance, standing
        self.period, self.limits = balance.period, limits
        self.velocity_limits, self._tell = velocity_limits, tell
        self.stiffness = limits / np.where(
            bears, params.posture_angle, params.arm_angle
        )
        self._damp = damping(standing, limits, params.damping_time)
        self._posture = replace(
            self._damp,
            kp=self.stiffness,
            kd=params.posture_damping * self.stiffness,
        )
        self.phase = Phase.DAMPING
        self.counts = Counts()
        self.velocity = np.zeros(3)
        self._command = self._damp
        self._starts = False
        self._is_silent = False
        self._is_late = self._passes = False
        self._last: RobotState | None = None
        self._time = 0.0
        self._missing: deque[float] = deque(maxlen=64)  # times of samples
        self._reasons: set[str] = set()

    @property
    def time(self) -> float:
        """The robot's time by its last sample, 0 before the first [s]."""
        return self._time

    def forget(self) -> None:
        """Forgets the last sample: the next one may have any time."""
        self._last = None

    def start(self) -> None:
        """Lets a damped robot stand up at its next sample."""
        self._starts = True

    def stop(self, reason: str) -> JointCommand:
        """Damps the robot, until `start`.

        Args:
            reason: a few words, which are told.

        Returns:
            The command that does so.
        """
        if self.phase is not Phase.DAMPING:
            self._tell_now(f"damping: {reason}")
        self.phase, self._command = Phase.DAMPING, self._damp
        self._starts = False
        self.velocity = np.zeros(3)
        return self._command

    def silent(self) -> JointCommand | None:
        """Damps a robot of which nothing has been heard for SILENCE.

        Returns:
            The command that does so; None before the first sample.
        """
        if self._last is None:
            return None
        if not self._is_silent:
            self._is_silent = True
            self.counts.silences += 1
            self._starts = False
            self._tell_now("the robot is silent")
        return self.stop("the robot is silent")

    def refuse(self, reason: str) -> None:
        """Counts a message that is not used, and tells so once per reason.

        Args:
            reason: field, value and what is allowed.
        """
        self.counts.refused += 1
        kind = reason.partition(" = ")[0]
        if kind not in self._reasons:
            self._reasons.add(kind)
            self._tell_now(f"refused: {reason}")

    def hear(
        self, state: RobotState, is_late: bool = False
    ) -> JointCommand | None:
        """Answers a sample.

        Args:
            state: as a wire has read it.
            is_late: whether it has waited for longer than a period.

        Returns:
            The command until the next one; None if the sample is not used,
            unless it halts the robot.
        """
        self._is_late = is_late
        fault = fault_of(state, len(self._standing))
        gap = state.time - self._last.time if self._last else 0.0
        is_old = self._last is not None and -SILENCE <= gap <= 0.0
        if fault:
            self.refuse(fault)
        elif is_old:
            self._hear_late(state.time)
        if fault or is_old:
            return self.stop(REMOTE) if state.halt else None
        self.counts.samples += 1
        self._time = state.time
        if gap < 0.0:
            self.stop(f"the robot's clock ran back by {-gap:.3f} s")
            self._last = None
        elif gap > SILENCE + 0.5 * self.params.sample_period:
            self.silent()
            self._last = None
        self._is_silent = False
        for sample in self._bridge(state):
            self._advance(sample)
        self._last = state
        return self._command

    def finish(self) -> JointCommand | None:
        """Computes what may wait until the command has left.

        Returns:
            The command that lets the robot go, if that fails.
        """
        if self.phase is not Phase.BALANCE:
            return None
        try:
            self._balance.finish()
        except (RuntimeError, ValueError) as error:
            return self.stop(one_line(error))
        return None

    def _hear_late(self, time: float) -> None:
        """Counts a sample that came after a later one."""
        self.counts.late += 1
        for missing in self._missing:
            if abs(missing - time) < 0.5 * self.params.sample_period:
                self.counts.lost -= 1
                self._missing.remove(missing)
                return

    def _bridge(self, state: RobotState) -> list[RobotState]:
        """The samples since the last one, with those that are missing."""
        last = self._last
        if last is None:
            return [state]
        gap = state.time - last.time
        steps = max(round(gap / self.params.sample_period), 1)
        samples = [between(last, state, i / steps) for i in range(1, steps)]
        self._missing.extend(sample.time for sample in samples)
        self.counts.lost += len(samples)
        return [*samples, state]

    def _advance(self, sample: RobotState) -> None:
        """Sets the command by the phase, and the phase by the sample."""
        if sample.halt:
            self.stop(REMOTE)
        if self.phase is Phase.BALANCE:
            self._keep_balance(sample)
        elif self.phase is Phase.LOAD:
            self._wait_for_load(sample)
        elif self.phase is Phase.POSTURE:
            self._take_posture(sample)
        elif self._starts:
            self._starts = False
            self._from, self._since = sample.q, sample.time
            self._enter(Phase.POSTURE)
            self._take_posture(sample)

    def _enter(self, phase: Phase) -> None:
        self.phase = phase
        self._tell_now(phase.value)

    def _tell_now(self, line: str) -> None:
        self._tell(f"t={self.time:.2f} s  {line}")

    def _take_posture(self, sample: RobotState) -> None:
        """Moves the joints, along a cubic from rest to rest."""
        time = self.params.posture_time
        s = min((sample.time - self._since) / time, 1.0)
        move = self._standing - self._from
        self._command = replace(
            self._posture,
            q=self._from + (3.0 - 2.0 * s) * s**2 * move,
            dq=6.0 * (1.0 - s) * s / time * move,
        )
        if s == 1.0:
            self._since = sample.time
            self._enter(Phase.LOAD)
            self._balance.begin()
            self._begin_ticks(sample)

    def _wait_for_load(self, sample: RobotState) -> None:
        """Begins to balance once the feet have borne the weight for a while."""
        self._command = self._posture
        if self._balance.lies(sample):
            self.counts.falls += 1
            self.stop("pelvis tilted")
            return
        imu = self._imu_of_tick(sample)
        if imu is None:
            return
        loads, params = self._balance.loads(imu, sample), self.params
        if loads.sum() < params.loaded or loads.min() < params.foot_loaded:
            self._since = sample.time
        elif sample.time - self._since >= params.load_time:
            self._enter(Phase.BALANCE)
            self._begin_ticks(sample)
            self._keep_balance(sample)

    def _begin_ticks(self, sample: RobotState) -> None:
        """Lets the first tick be at a sample, of which alone it knows."""
        self._due = sample.time
        self._imus: list[Array] = []

    def _imu_of_tick(self, sample: RobotState) -> Array | None:
        """The means over a period (9,) if it ends with this sample."""
        self._imus.append(np.concatenate((sample.gyro, sample.force)))
        if sample.time < self._due - 0.5 * self.params.sample_period:
            return None
        mean = np.mean(self._imus, axis=0)
        self._imus = []
        self._due += self._balance.period
        return np.concatenate((mean, sample.gyro))

    def _asked(self, sticks: Array) -> Array:
        """The velocity that the sticks command; our own while they rest."""
        forward, left, turn = sticks.tolist()
        asked = stick_command((-left, -forward, -turn), self.velocity_limits)
        return asked if asked.any() else self.velocity

    def _keep_balance(self, sample: RobotState) -> None:
        """Ticks whenever a period is over."""
        imu = self._imu_of_tick(sample)
        if imu is None:
            return
        fall = fault = ""
        self._passes = self._is_late and not self._passes
        try:
            if self._passes:
                self._balance.estimate(imu, sample)
            else:
                self._command = self._balance.tick(
                    imu, sample, self._asked(sample.sticks)
                )
            fall = self._balance.fall_reason()
            fault = fault_of(self._command, len(self._standing))
        except (RuntimeError, ValueError) as error:
            fault = one_line(error)
        self.counts.ticks += 1
        self.counts.passed += self._passes
        self.counts.falls += bool(fall)
        if fall or fault:
            self.stop(fall or fault)


def damping(
    q: Array, limits: Array, time: float = DAMPING_TIME
) -> JointCommand:
    """The command that lets a robot sink.

    Args:
        q: any angles (n,) [rad]; they have no stiffness.
        limits: largest torques of the joints (n,) [N m].
        time: damping over these [s/rad].

    Returns:
        The command.
    """
    zero = np.zeros(len(q))
    return JointCommand(q=q, dq=zero, tau=zero, kp=zero, kd=time * limits)


def between(first: RobotState, second: RobotState, s: float) -> RobotState:
    """A state between two.

    Args:
        first: the earlier one.
        second: the later one.
        s: share of the time from the first to the second, in [0, 1].

    Returns:
        All numbers interpolated; the remote control is that of the first.
    """

    def at(a: Array, b: Array) -> Array:
        return a + s * (b - a)

    sign = math.copysign(1.0, float(first.quaternion @ second.quaternion))
    quaternion = at(first.quaternion, sign * second.quaternion)
    return replace(
        first,
        time=first.time + s * (second.time - first.time),
        q=at(first.q, second.q),
        dq=at(first.dq, second.dq),
        tau=at(first.tau, second.tau),
        quaternion=quaternion / np.linalg.norm(quaternion),
        gyro=at(first.gyro, second.gyro),
        force=at(first.force, second.force),
    )
