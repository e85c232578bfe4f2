"""Runs a RobotProcess on a wire, until it is told to end."""

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass

from nadia_balance.wire.messages import JointCommand, RefusedError, Wire
from nadia_balance.wire.process import SILENCE, Phase, RobotProcess

LISTEN = 0.3  # for rivals, before the first command [s]


@dataclass
class Delays:
    """How late the answers were, and how the loop ended.

    An answer is late by the time of the samples that have come meanwhile, if
    that is a control period or more.

    Args:
        period: of the control [s].
    """

    period: float
    answers: int = 0
    late: int = 0
    longest: float = 0.0  # [s]
    balanced: bool = False  # at the end of the loop

    def add(self, delay: float) -> None:
        """Counts an answer.

        Args:
            delay: by which it is late [s].
        """
        self.answers += 1
        self.late += delay > self.period - 1e-9
        self.longest = max(self.longest, delay)


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
        if wire.has_rivals():
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

    An error, or a second Ctrl-C, also leaves the robot damped.  A process that
    is late passes over ticks, and one that is SILENCE behind lets go.

    Args:
        wire: the controller's end.
        process: what answers.
        each: called after each answer and each silence: False ends.
        slower: how much slower than real time the robot's clock may go.

    Returns:
        How late it was while it balanced, and whether it did at the end.
    """
    gc.freeze()  # its look through all that there is would take 50 ms
    delays, heard = Delays(process.period), time.monotonic()
    silence, sample = slower * SILENCE, process.params.sample_period
    try:
        while each():
            state = command = None
            try:
                state = wire.read(max(heard + silence - time.monotonic(), 0.0))
            except RefusedError as error:
                process.refuse(str(error))
            now = time.monotonic()
            if state is not None:
                is_late = wire.waiting() * sample >= process.period
                command = process.hear(state, is_late)
            if command is not None:
                heard = now
            elif now >= heard + silence:
                heard, command = now, process.silent()
            _write(wire, command)
            if state and command and process.phase is Phase.BALANCE:
                behind = wire.waiting() * sample
                delays.add(behind)
                _write(wire, process.finish())
                if behind > SILENCE:
                    late = f"{1e3 * behind:.0f} ms behind the robot"
                    _write(wire, process.stop(late))
            if wire.has_rivals() and process.phase is not Phase.DAMPING:
                _write(wire, process.stop("another controller commands it"))
    finally:
        gc.unfreeze()
        delays.balanced = process.phase is Phase.BALANCE
        if process.counts.samples:
            wire.write(process.stop("stopped"))
    return delays


def _write(wire: Wire, command: JointCommand | None) -> None:
    if command is not None:
        wire.write(command)
