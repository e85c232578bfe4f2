"""Pushes the walking robot, and shows whether and how it recovers."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import sys
from dataclasses import replace

from nadia_balance.core.walking.push import SHAPES, random_pushes
from nadia_balance.diagrams.scenario import Scenario, scenario_names
from nadia_balance.parameters.bounds import require
from nadia_balance.scripts import command_line

MOST_RANDOM = 100  # largest number of random pushes


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs a command line.

    Args:
        argv: its words; None: those of the process.

    Returns:
        The exit code of --help.
    """
    parser = command_line.CommandLine(
        __file__, __doc__, f"0 recovered, {command_line.EXIT_CODES}"
    )
    _push_flags(parser)
    command_line.scenario_flags(parser, name="push")
    return command_line.main_job(parser, argv, _pushed_scenario)


def _push_flags(parser: command_line.CommandLine) -> None:
    group = parser.add_argument_group(
        "push", "The scenario's first push, as it is there; or a new one."
    )
    parser.not_live += [
        group.add_argument(
            "--direction",
            help="degrees (0 forward, 90 left), or forward, backward, inward, "
            "outward, seen from the stance foot",
        ),
        group.add_argument(
            "--delta-v",
            type=command_line.finite,
            help="change of the robot's velocity [m/s]",
        ),
        group.add_argument(
            "--at",
            help='begin in a phase, such as "right swing 25 %%" (the right '
            'foot swings) or "left transfer 50 %%" (the left one will); or at '
            'a time, such as "2.5 s". "standing" is at 1 s, without steps',
        ),
        group.add_argument(
            "--shape", help=f"of the force over time: {', '.join(SHAPES)}"
        ),
        group.add_argument(
            "--random",
            type=int,
            metavar="N",
            help="N pushes instead, in directions at random, of up to "
            "--delta-v, 1 to 3 s after each other; --seed gives others",
        ),
    ]


def _pushed_scenario(args: argparse.Namespace) -> Scenario:
    """The scenario with its first push changed by the flags; not for --live."""
    if args.scenario_name is None:
        args.scenario_name = "push"
        if args.command is not None:
            args.scenario_name = "walk_by_command"
        elif args.terrain in scenario_names():
            args.scenario_name = args.terrain
    scenario = command_line.scenario_from(args)
    if args.live:
        return scenario
    scenario = scenario.with_push(
        direction=args.direction,
        delta_v=args.delta_v,
        at=args.at,
        shape=args.shape,
    )
    return scenario if args.random is None else _at_random(args, scenario)


def _at_random(args: argparse.Namespace, scenario: Scenario) -> Scenario:
    """The scenario with --random pushes, and long enough for them."""
    for name, value in (
        ("at", args.at),
        ("direction", args.direction),
        ("shape", args.shape),
    ):
        require(
            value is None, f"{name} = {value!r}: must not come with --random"
        )
    require(
        1 <= args.random <= MOST_RANDOM,
        f"random = {args.random}: must be in [1, {MOST_RANDOM}]",
    )
    largest = scenario.pushes[0].delta_v
    if largest is None:
        raise ValueError("delta_v: must be given with --random")
    pushes = random_pushes(args.random, scenario.seed, largest)
    for push in pushes:
        push.body = scenario.pushes[0].body
    duration, gait = scenario.duration, scenario.gait
    if args.duration is None:
        duration += pushes[-1].moment.time
    if gait.num_steps:
        step = gait.swing_duration + gait.transfer_duration
        gait = replace(
            gait, num_steps=max(gait.num_steps, int(duration / step) + 1)
        )
    return scenario.changed(pushes=pushes, duration=duration, gait=gait)


if __name__ == "__main__":
    sys.exit(main())
