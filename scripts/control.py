"""Balances a robot at the other end of a wire, and walks it by keys."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import contextlib
import sys
import time
from collections.abc import Callable

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.footstep_plan import within_limits
from nadia_balance.diagrams.scenario import SENSORS
from nadia_balance.diagrams.simulation import LONGEST, until_ctrl_c
from nadia_balance.parameters.bounds import check_number
from nadia_balance.results.live_watches import clipped_words
from nadia_balance.results.story import command_words
from nadia_balance.scripts import command_line
from nadia_balance.wire import keyboard, loop
from nadia_balance.wire.balance import process_of
from nadia_balance.wire.kinds import WIRES, controller_wire
from nadia_balance.wire.messages import LOOPBACK
from nadia_balance.wire.process import Phase, RobotProcess

STAND, LET_GO = "r", "b"  # keys
GONE = 5.0  # of no sample, after which a robot does not come back [s]
# Factors of a lock step: that of two processes on one machine, the largest.
LOCKSTEP, SLOWEST = 50.0, 1000.0


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs a command line.

    Args:
        argv: its words; None: those of the process.

    Returns:
        The exit code of --help.
    """
    parser = _parser()
    args = parser.parse_args(argv)
    with parser.refusing():
        check_wire_flags(args)
        robot, process = process_of(args.robot, args.sensors, command_line.say)
        wire = controller_wire(args.wire, robot, args.interface, args.domain)
        loop.refuse_rivals(wire)
    process.start()
    with (
        contextlib.closing(wire),
        keyboard.pressed_keys() as keys,
        until_ctrl_c() as interrupted,
    ):
        command_line.say(
            f"waits for the robot on {place_words(args)}",
            f"{keyboard.HELP}, B let go, R stand up, Ctrl-C end",
        )
        delays = loop.run(
            wire,
            process,
            each=_until(process, args, keys, interrupted),
            slower=args.lockstep,
        )
        command_line.say(*_report(process))
        if args.lockstep == 1.0:
            command_line.say(
                f"answers late {delays.late} of {delays.answers}, longest "
                f"{1e3 * delays.longest:.1f} ms"
            )
        if interrupted():
            return command_line.INTERRUPTED
    counts = process.counts
    is_up = delays.balanced and not counts.falls and not counts.silences
    return command_line.DONE if is_up else command_line.FAILED


def _parser() -> command_line.CommandLine:
    parser = command_line.CommandLine(
        __file__,
        __doc__,
        "0 it stood until --duration, 1 it fell, was silent, or was let go, "
        "2 bad input, 130 Ctrl-C or SIGTERM.",
    )
    wire_flags(parser)
    parser.add_argument(
        "--sensors",
        choices=SENSORS[1:],
        default="proprioceptive",
        help="how wrong its IMU and encoders are (%(default)s)",
    )
    parser.add_argument(
        "--command",
        type=command_line.velocity,
        metavar="V",
        help="walk at this velocity as soon as it stands: forward, left "
        '[m/s], turn [rad/s], such as "0.3 0 0.2"',
    )
    return parser


def wire_flags(parser: command_line.CommandLine) -> None:
    """Adds the flags of both ends of a wire.

    Args:
        parser: of the program.
    """
    parser.add_argument(
        "--robot", default="g1", help="a model's name, or a robot.yaml"
    )
    parser.add_argument(
        "--wire", choices=WIRES, default="lcm", help="(%(default)s)"
    )
    parser.add_argument(
        "--interface",
        default=LOOPBACK,
        help="of the network; by default nothing leaves this machine",
    )
    parser.add_argument(
        "--domain",
        type=int,
        default=1,
        help="of DDS, or LCM's port above 7667 (%(default)s; Unitree's robots "
        "have 0)",
    )
    parser.add_argument(
        "--lockstep",
        type=command_line.finite,
        metavar="FACTOR",
        help="let the robot wait for commands: up to so much slower than real "
        f"time, the same at both ends ({LOCKSTEP:g}; with --interface 1: "
        "never)",
    )
    parser.add_argument(
        "--duration",
        type=command_line.finite,
        help="from its first sample on, by the robot's clock, or until it is "
        "silent [s] (until Ctrl-C)",
    )


def check_wire_flags(args: argparse.Namespace) -> None:
    """Checks the flags of both ends of a wire, and completes --lockstep.

    Args:
        args: those of `wire_flags`.

    Raises:
        ValueError: one is out of range.
    """
    if args.lockstep is None:  # a machine's clock waits for nobody
        args.lockstep = LOCKSTEP if args.interface == LOOPBACK else 1.0
    check_number("lockstep", args.lockstep, least=1.0, most=SLOWEST)
    if args.duration is not None:
        check_number(
            "duration", args.duration, above=0.0, most=LONGEST, unit="s"
        )


def place_words(args: argparse.Namespace) -> str:
    """Says on which wire the other end has to be.

    Args:
        args: those of `wire_flags`.

    Returns:
        Such as `lcm, interface lo, domain 1`.
    """
    return f"{args.wire}, interface {args.interface}, domain {args.domain}"


def _until(
    process: RobotProcess,
    args: argparse.Namespace,
    keys: Callable[[], str],
    interrupted: Callable[[], bool],
) -> Callable[[], bool]:
    """What the loop asks after each sample: whether it goes on."""
    began: list[float] = []  # the robot's time of the first sample [s]
    # How many samples there were, and since when there were no more [s].
    samples, since = 0, time.monotonic()

    def tell(asked: Array) -> None:
        words = clipped_words(asked, process.velocity_limits)
        command_line.say(", ".join(filter(None, (command_words(asked), words))))

    def is_over(duration: float) -> bool:
        nonlocal samples, since
        counts = process.counts
        if counts.samples > samples:
            samples, since = counts.samples, time.monotonic()
        is_heard = counts.samples + counts.refused > 0
        if is_heard and time.monotonic() > since + GONE:
            return True
        return bool(began) and process.time - began[0] >= duration

    def each() -> bool:
        pressed = keys().lower()
        if LET_GO in pressed:
            process.stop("B")
        if STAND in pressed:
            process.start()
        if process.phase is Phase.BALANCE:
            limits = process.velocity_limits
            if args.command is not None:
                asked, args.command = np.array(args.command), None
                tell(asked)
                process.velocity = within_limits(asked, limits)
            asked = keyboard.commanded(process.velocity, pressed, limits)
            if (asked != process.velocity).any():
                tell(asked)
            process.velocity = asked
        if process.counts.samples and not began:
            began.append(process.time)
        if args.duration is not None and is_over(args.duration):
            return False
        return not interrupted()

    return each


def _report(process: RobotProcess) -> list[str]:
    counts = process.counts
    return [
        f"samples {counts.samples}: lost {counts.lost}, late {counts.late}, "
        f"refused {counts.refused}",
        f"ticks {counts.ticks}, passed over {counts.passed}; silences "
        f"{counts.silences}, falls {counts.falls}",
    ]


if __name__ == "__main__":
    sys.exit(main())
