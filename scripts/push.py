"""Pushes the walking robot, and shows whether and how it recovers."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import sys
from dataclasses import replace

from nadia_balance.core.walking.push import SHAPES, random_pushes
from nadia_balance.diagrams.scenario import Scenario, scenario_names
from nadia_balance.scripts import command_line

MOST_RANDOM = 100  # largest number of random pushes


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; returns the exit code of --help."""
    codes = f"0 recovered, {command_line.EXIT_CODES}"
    parser = command_line.CommandLine(__file__, __doc__, codes)
    about = "The scenario's first push, as it is there; or a new one."
    add = parser.add_argument_group("push", about).add_argument
    about = "degrees (0 forward, 90 left), or forward, backward, inward, "
    add("--direction", help=f"{about}outward, seen from the stance foot")
    about = "change of the robot's velocity [m/s]"
    add("--delta-v", type=command_line.finite, help=about)
    add(
        "--at",
        help='when it begins: in a phase, such as "right swing 25 %%" (the '
        'right foot swings) or "left transfer 50 %%" (the left one will), at a '
        'time, such as "2.5 s", or "standing", at 1 s, told to walk nowhere',
    )
    add("--shape", help=f"of the force over time: {', '.join(SHAPES)}")
    about = "N pushes instead, in directions at random, of up to --delta-v, 1 "
    about += "to 3 s after each other; --seed gives others"
    add("--random", type=int, metavar="N", help=about)
    command_line.scenario_flags(parser, name="push")
    return command_line.main_job(parser, argv, _pushed_scenario)


def _pushed_scenario(args: argparse.Namespace) -> Scenario:
    """The scenario with its first push changed by the flags; not for --live."""
    if args.scenario_name is None:
        has_own = args.terrain in scenario_names()
        args.scenario_name = args.terrain if has_own else "push"
        if args.command is not None:
            args.scenario_name = "walk_by_command"
    scenario = command_line.scenario_from(args)
    if args.live:
        return scenario
    scenario = scenario.with_push(
        args.direction, args.delta_v, args.at, args.shape
    )
    if args.random is not None:
        return _pushed_at_random(args, scenario)
    return scenario


def _pushed_at_random(args: argparse.Namespace, scenario: Scenario) -> Scenario:
    """With --random pushes instead, for which gait and run are long enough."""
    for name in ("at", "direction", "shape"):
        if (value := getattr(args, name)) is not None:
            raise ValueError(f"{name} = {value!r}: must not come with --random")
    if not 1 <= args.random <= MOST_RANDOM:
        why = f"must be in [1, {MOST_RANDOM}]"
        raise ValueError(f"random = {args.random}: {why}")
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
        num_steps = max(gait.num_steps, int(duration / step) + 1)
        gait = replace(gait, num_steps=num_steps)
    return scenario.changed(pushes=pushes, duration=duration, gait=gait)


if __name__ == "__main__":
    sys.exit(main())
