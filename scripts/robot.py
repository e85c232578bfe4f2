"""Simulates a robot at the other end of a wire, with drives and a bus."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import gc
import sys
from functools import partial

import numpy as np

from nadia_balance.diagrams.scenario import SENSORS
from nadia_balance.diagrams.simulation import LONGEST, until_ctrl_c
from nadia_balance.parameters.bounds import check, check_number, require
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.params import load_sensors
from nadia_balance.scripts import command_line
from nadia_balance.scripts.control import (
    check_wire_flags,
    place_words,
    wire_flags,
)
from nadia_balance.wire.kinds import joint_names, robot_wire
from nadia_balance.wire.process import damping
from nadia_balance.wire.serve import BusFaults, Serving
from nadia_balance.wire.simulated_robot import ENGINES, SimulatedRobot

PUSH = (
    "when, after it stands alone [s], how strong [m/s], and where to [deg, "
    "90 left]"
)
STICKS = "forward", "left", "turn"


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
        serving = _serving(args)
    robot = serving.robot
    command_line.say(f"waits for a controller on {place_words(args)}")
    gc.freeze()  # its look through all that there is would take 50 ms
    with until_ctrl_c() as interrupted:
        while not interrupted() and (
            args.duration is None or robot.time < args.duration
        ):
            serving.step()
        serving.wire.close()
        command_line.say(*_report(serving))
        if interrupted():
            return command_line.INTERRUPTED
    is_up = serving.longest > 0.0 and not serving.falls
    is_done = is_up and not serving.pushes
    return command_line.DONE if is_done else command_line.FAILED


def _parser() -> command_line.CommandLine:
    parser = command_line.CommandLine(
        __file__,
        __doc__,
        "0 it stood alone, never fell, and was pushed as told, 1 it was not, "
        "2 bad input, 130 Ctrl-C or SIGTERM.",
    )
    wire_flags(parser)
    parser.add_argument(
        "--engine",
        default=ENGINES[0],
        help=f"{', '.join(ENGINES)}: what moves it (%(default)s)",
    )
    parser.add_argument(
        "--model",
        type=command_line.place,
        metavar="MJCF",
        help="that moves in the place of the robot's own URDF, in mujoco",
    )
    parser.add_argument(
        "--sensors",
        choices=SENSORS[1:],
        default="proprioceptive",
        help="how wrong its IMU and encoders are (%(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, help="of noise and bus")
    parser.add_argument(
        "--no-band",
        action="store_true",
        help="the band that sets it down does not lift it again",
    )
    parser.add_argument(
        "--push",
        type=partial(command_line.three, names=PUSH),
        action="append",
        metavar="P",
        help=f'{PUSH}, such as "2.0 0.5 90"; more than once',
    )
    parser.add_argument(
        "--sticks",
        type=partial(command_line.three, names=", ".join(STICKS)),
        default=(0.0, 0.0, 0.0),
        metavar="S",
        help=f"of its remote control: {', '.join(STICKS)}, each in [-1, 1]",
    )
    _bus_flags(parser)
    return parser


def _bus_flags(parser: command_line.CommandLine) -> None:
    group = parser.add_argument_group("bus")
    for name, unit in (
        ("delay", "of each sample [s]"),
        ("lost", "share of the samples, at random"),
        ("late", "share of the samples, at random"),
        ("late_by", "how late these are [s] (0.004)"),
        ("silence", "length of one [s]"),
        ("silent_at", "when, after it stands alone [s] (1)"),
    ):
        group.add_argument(f"--{name}", type=command_line.finite, help=unit)


def _serving(args: argparse.Namespace) -> Serving:
    check_wire_flags(args)
    check_number("seed", args.seed, least=0, most=2**63)
    for name, number in zip(STICKS, args.sticks, strict=True):
        check_number(f"sticks, {name}", number, least=-1.0, most=1.0)
    for time, delta_v, angle in args.push or []:
        check_number("push, when", time, above=0.0, most=LONGEST, unit="s")
        check_number(
            "push, where to", angle, least=-3600.0, most=3600.0, unit="deg"
        )
        check_number(
            "push, how strong", delta_v, least=0.0, most=10.0, unit="m/s"
        )
    names = "delay", "lost", "late", "late_by", "silence", "silent_at"
    faults = BusFaults()
    for name, other in ("late_by", "late"), ("silent_at", "silence"):
        require(
            getattr(args, name) is None or bool(getattr(args, other)),
            f"{name} = {getattr(args, name)}: must come with {other}",
        )
    for name in names:
        if getattr(args, name) is not None:
            setattr(faults, name, getattr(args, name))
    check(faults)  # before anything is opened
    robot = load_robot(args.robot)
    limits = np.array(robot.control_plant().GetEffortUpperLimits())
    simulated = SimulatedRobot(
        robot,
        load_sensors(args.sensors),
        engine=args.engine,
        model=args.model,
        catches=not args.no_band,
        seed=args.seed,
    )
    return Serving(
        simulated,
        robot_wire(args.wire, robot, args.interface, args.domain),
        damping=damping(np.zeros(len(joint_names(robot))), limits),
        faults=faults,
        seed=args.seed,
        pushes=args.push or [],
        sticks=args.sticks,
        slower=args.lockstep,
        tell=command_line.say,
    )


def _report(serving: Serving) -> list[str]:
    pose = serving.robot.pose
    lines = [
        f"stood alone for {serving.longest:.2f} s, falls {serving.falls}; "
        f"pelvis at {pose[4]:.2f} {pose[5]:.2f} {pose[6]:.2f} m",
        f"samples {serving.robot.samples}: lost {serving.bus.lost}, late "
        f"{serving.bus.late}; commands refused {serving.listener.refused}",
    ]
    if serving.pushes:
        lines.append(f"pushes that did not come: {len(serving.pushes)}")
    if serving.slower == 1.0 and serving.pace.lost > 0.0:
        lines.append(
            f"its clock lost {serving.pace.lost:.2f} s: this machine is too "
            "slow to move it in real time"
        )
    return lines


if __name__ == "__main__":
    sys.exit(main())
