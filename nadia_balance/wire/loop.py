"""Runs a RobotProcess on a wire, until it is told to end."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from nadia_balance.wire.messages import JointCommand, RefusedError, Wire
from nadia_balance.wire.process import SILENCE, Phase, RobotProcess

LISTEN = 0.3  # for rivals, before the first command [s]
DRIFT = 5e-4  # by which the clocks of robot and controller may differ [-]


@dataclass
class Delays:
    """How late the answers were, by the fastest one, and how the loop ended.

    An answer is late if it leaves more than a control period after the fastest
    answer would have: what waited in a queue counts.  The fastest one is
    forgotten as fast as the clocks may drift apart.

    Args:
        period: of the control [s].
    """

    period: float
    answers: int = 0
    late: int = 0
    longest: float = 0.0  # [s]
    balanced: bool = False  # at the end of the loop
    _least: float = float("inf")
    _last: float = 0.0  # wall time of the last answer [s]

    def restart(self) -> None:
        """Forgets the fastest answer: the robot's clock may have changed."""
        self._least = float("inf")

    def add(self, wall: float, sample: float) -> float:
        """Counts an answer.

        Args:
            wall: time at which it left [s].
            sample: the robot's time of what is answered [s].

        Returns:
            The delay [s].
        """
        drifted = self._least + DRIFT * (wall - self._last)
        self._least, self._last = min(drifted, wall - sample), wall
        delay = wall - sample - self._least
        self.answers += 1
        self.late += delay > self.period
        self.longest = max(self.longest, delay)
        return delay


def refuse_rivals(wire: Wire) -> None:
    """Listens whether someone else commands the robot.

    Args:
        wire: the controller's end.

    Raises:
        ValueError: someone does.
    """
    end = time.monotonic() + LISTEN
    while time.monotonic() < end:
        time.sleep(0.02)
        if wire.rivals():
            raise ValueError(
                "another controller commands this robot: must be the only one"
            )


def run(
    wire: Wire,
    process: RobotProcess,
    each: Callable[[], bool],
    slower: float = 1.0,
) -> Delays:
    """Reads, answers and writes until `each` says that it ends, then damps.

    An error, or a second Ctrl-C, also leaves the robot damped.

    Args:
        wire: the controller's end.
        process: what answers.
        each: called after each answer and each silence: False ends.
        slower: how much slower than real time the robot's clock may go; 1: as
            on a machine, and a controller that is SILENCE behind lets go.

    Returns:
        How late it was while it balanced, and whether it did at the end.
    """
    delays, heard = Delays(process.period), time.monotonic()
    silence = slower * SILENCE
    try:
        while each():
            state = command = None
            try:
                state = wire.read(max(heard + silence - time.monotonic(), 0.0))
            except RefusedError as error:
                process.refuse(str(error))
            now = time.monotonic()
            if state is not None:
                command = process.hear(state)
            if command is not None:
                heard = now
            elif now >= heard + silence:
                heard, command = now, process.silent()
            _write(wire, command)
            if state and command and process.phase is Phase.BALANCE:
                behind = delays.add(time.monotonic(), state.time)
                _write(wire, process.finish())
                if behind > SILENCE and slower == 1.0:
                    late = f"{1e3 * behind:.0f} ms behind the robot"
                    _write(wire, process.stop(late))
            elif command:
                delays.restart()
            if wire.rivals() and process.phase is not Phase.DAMPING:
                _write(wire, process.stop("another controller commands it"))
    finally:
        delays.balanced = process.phase is Phase.BALANCE
        if process.counts.samples:
            wire.write(process.stop("stopped"))
    return delays


def _write(wire: Wire, command: JointCommand | None) -> None:
    if command is not None:
        wire.write(command)
