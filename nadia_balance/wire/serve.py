"""Puts a SimulatedRobot at the end of a wire, with the faults of a bus."""

import heapq
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from nadia_balance.parameters.bounds import bounded, check, parameters
from nadia_balance.wire.messages import (
    JointCommand,
    RefusedError,
    RobotState,
    RobotWire,
    fault_of,
)
from nadia_balance.wire.process import SILENCE
from nadia_balance.wire.simulated_robot import SAMPLE, SimulatedRobot

DEBT = 0.01  # that is made up for, in a burst of samples [s]
FIRST = 0.1  # for which it waits at most while nobody commands it [s]


@parameters
class BusFaults:
    """What happens to samples on their way; by default nothing."""

    delay: float = bounded(
        0.0, least=0.0, most=0.1, unit="s", of="", doc="of all samples"
    )
    lost: float = bounded(
        0.0, least=0.0, most=1.0, doc="share that is lost, at random"
    )
    late: float = bounded(
        0.0, least=0.0, most=1.0, doc="share that is late, at random"
    )
    late_by: float = bounded(
        0.004, above=0.0, most=0.1, unit="s", of="", doc="by how much"
    )
    silence: float = bounded(
        0.0, least=0.0, most=10.0, unit="s", of="", doc="length of one silence"
    )
    silent_at: float = bounded(
        1.0,
        least=0.0,
        most=1e5,
        doc="when it begins, after it stands alone, in s",
    )


@dataclass
class Bus:
    """Samples on their way to the controller.

    Args:
        faults: what happens to them.
        seed: of their chance.
    """

    faults: BusFaults
    seed: int = 0
    lost: int = 0
    late: int = 0
    _silent_from: float = math.inf  # [s]
    _way: list[tuple[float, float, RobotState]] = field(default_factory=list)

    def __post_init__(self) -> None:
        check(self.faults)
        self._random = np.random.default_rng((self.seed, 5))

    def send(self, state: RobotState, alone: float) -> None:
        """Puts a sample on its way, or not.

        Args:
            state: the sample.
            alone: for how long the robot has stood alone [s].
        """
        faults = self.faults
        is_lost, is_late = self._random.random(2) < (faults.lost, faults.late)
        if alone >= faults.silent_at:
            self._silent_from = min(self._silent_from, state.time)
        silent = state.time - self._silent_from
        if is_lost or 0.0 <= silent < faults.silence - 1e-9:
            self.lost += 1
            return
        self.late += int(is_late)
        due = state.time + faults.delay + is_late * faults.late_by
        heapq.heappush(self._way, (due, state.time, state))

    def arrived(self, now: float) -> Iterator[RobotState]:
        """The samples that have arrived.

        Args:
            now: by the robot's clock [s].

        Yields:
            Each once, in the order of arrival.
        """
        while self._way and self._way[0][0] <= now + 1e-9:
            yield heapq.heappop(self._way)[2]


class Listener:
    """Obeys one controller, and lets the robot go when that is silent.

    Args:
        joints: number of joints.
        damping: command that lets the robot go.
        tell: takes a line for each event.
    """

    def __init__(
        self,
        joints: int,
        damping: JointCommand,
        tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._joints, self._damping, self._tell = joints, damping, tell
        self.command = damping
        self.refused = 0
        self._sender: int | None = None
        self._heard = 0.0
        self._reasons: set[str] = set()

    @property
    def is_new(self) -> bool:
        """Whether nobody has commanded the robot yet."""
        return self._sender is None and self._heard == 0.0

    @property
    def is_left(self) -> bool:
        """Whether who commanded the robot has gone."""
        return self._sender is None and self._heard > 0.0

    def hear(self, sender: int, command: JointCommand, now: float) -> None:
        """Takes a command, if it is good and from the one who commands.

        Args:
            sender: a number of its own.
            command: what it sends.
            now: by the robot's clock [s].
        """
        fault = fault_of(command, self._joints)
        if self._sender not in (None, sender):
            fault = "a second controller: only the first one is obeyed"
        if fault:
            self.refuse(fault)
            return
        if self._sender is None:
            self._tell("it is commanded")
        self._sender, self._heard, self.command = sender, now, command

    def refuse(self, reason: str) -> None:
        """Counts a command that is not used, and tells so once per reason.

        Args:
            reason: field, value and what is allowed.
        """
        self.refused += 1
        kind = reason.partition(" = ")[0]
        if kind not in self._reasons:
            self._reasons.add(kind)
            self._tell(f"refused: {reason}")

    def release_if_silent(self, now: float) -> None:
        """Lets the robot go after a silence.

        Args:
            now: by the robot's clock [s].
        """
        if self._sender is not None and now > self._heard + SILENCE:
            self._tell("no commands: damping")
            self._sender, self.command = None, self._damping


@dataclass
class Pace:
    """When samples are due in real time: what is late is made up for.

    Args:
        due: time at which the first sample begins [s].
        debt: that is made up for at most; the clock loses the rest [s].
    """

    due: float
    debt: float
    lost: float = 0.0  # by the clock [s]

    def rest(self, now: float) -> float:
        """Ends a sample.

        Args:
            now: time [s].

        Returns:
            Time until the next one is due [s].
        """
        lost = max(now - self.debt - self.due - SAMPLE, 0.0)
        self.lost += lost
        self.due += SAMPLE + lost
        return max(self.due - now, 0.0)


@dataclass
class Serving:
    """A simulated robot on a wire.

    Args:
        robot: the robot.
        wire: its end.
        damping: command that lets it go.
        faults: of the bus.
        seed: of their chance.
        pushes: those to come: when, after it stands alone [s], how strong
            [m/s], and in which direction [deg].
        sticks: those of its remote control (3,).
        slower: how much slower than real time it may go to wait for commands;
            1: it never waits.
        tell: takes a line for each event.
    """

    robot: SimulatedRobot
    wire: RobotWire
    damping: JointCommand
    faults: BusFaults = field(default_factory=BusFaults)
    seed: int = 0
    pushes: list[tuple[float, float, float]] = field(default_factory=list)
    sticks: tuple[float, ...] = (0.0, 0.0, 0.0)
    slower: float = 1.0
    tell: Callable[[str], None] = lambda line: None

    def __post_init__(self) -> None:
        self.bus = Bus(self.faults, self.seed)
        self.listener = Listener(
            len(self.damping.q), self.damping, self._tell_now
        )
        self.alone = 0.0  # for how long it has stood alone [s]
        self.longest = 0.0  # for which it did [s]
        self.falls = 0
        self._newest = -1.0
        # What a robot waits for commands is lost.
        debt = DEBT if self.slower == 1.0 else SAMPLE
        self.pace = Pace(time.monotonic(), debt)
        self.pushes = sorted(self.pushes)

    def step(self) -> None:
        """A sample: sends, listens, and moves."""
        robot = self.robot
        state = replace(robot.state(), sticks=np.array(self.sticks))
        self.bus.send(state, self.alone)
        waits = False
        for sample in self.bus.arrived(robot.time):
            self.wire.write(sample)
            waits = waits or sample.time > self._newest
            self._newest = max(self._newest, sample.time)
        self._listen(waits)
        self.listener.release_if_silent(robot.time)
        self._push()
        robot.step(self.listener.command)
        self._look()
        time.sleep(self.pace.rest(time.monotonic()))

    def _listen(self, waits: bool) -> None:
        """Reads commands; in lock step waits for that of the last sample.

        And for the first controller, but not for one that has gone.
        """
        patience = (self.slower - 1.0) * SAMPLE
        if not waits or self.listener.is_left:
            patience = 0.0
        elif self.listener.is_new:
            patience = min(patience, FIRST)
        while True:
            try:
                message = self.wire.read(patience)
            except RefusedError as error:
                self.listener.refuse(str(error))
                continue
            if message is None:
                return
            self.listener.hear(*message, self.robot.time)
            patience = 0.0

    def _push(self) -> None:
        while self.pushes and self.alone >= self.pushes[0][0]:
            _, delta_v, direction = self.pushes.pop(0)
            self.robot.push(delta_v, direction)
            self._tell_now(f"pushed by {delta_v:g} m/s at {direction:g} deg")

    def _look(self) -> None:
        """Tells when it begins to stand alone, and when it falls."""
        if not self.robot.band.is_slack:
            self.alone = 0.0
        elif self.robot.is_down:
            if self.alone > 0.0:
                self.falls += 1
                self._tell_now("FELL")
            self.alone = 0.0
        else:
            if self.alone == 0.0:
                self._tell_now("it stands alone")
            self.alone += SAMPLE
            self.longest = max(self.longest, self.alone)

    def _tell_now(self, line: str) -> None:
        self.tell(f"t={self.robot.time:.2f} s  {line}")
