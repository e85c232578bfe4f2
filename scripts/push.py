"""Pushes the walking robot, and shows whether and how it recovers."""

import argparse
import sys

from nadia_balance.core.walking.push import SHAPES
from nadia_balance.diagrams.scenario import Scenario, scenario_names, set_push
from nadia_balance.scripts import command_line


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; returns the exit code of --help."""
    parser = command_line.CommandLine(
        prog="push.py",
        description=__doc__.partition("\n")[0],
        epilog=f"Exit code: 0 recovered, {command_line.EXIT_CODES}",
    )
    about = "The scenario's first push.  Default: as in the scenario."
    add = parser.add_argument_group("push", about).add_argument
    about = "degrees (0 forward, 90 left), or forward, backward, inward, "
    add("--direction", help=f"{about}outward, seen from the stance foot")
    about = "change of the robot's velocity [m/s]"
    add("--delta-v", type=command_line.finite, help=about)
    add(
        "--at",
        help='when it begins: in a phase, such as "right swing 25 %%" (the '
        'right foot swings) or "left transfer 50 %%" (the left one will), at a '
        'time, such as "2.5 s", or "standing", at 1 s, with no steps at all',
    )
    add("--shape", help=f"of the force over time: {', '.join(SHAPES)}")
    command_line.scenario_flags(parser, name="push")
    return command_line.main_job(parser, argv, _pushed_scenario)


def _pushed_scenario(args: argparse.Namespace) -> Scenario:
    """The scenario with its first push changed by the flags; not for --live."""
    if args.scenario_name is None:
        has_own = args.terrain in scenario_names()
        args.scenario_name = args.terrain if has_own else "push"
    scenario = command_line.scenario_from(args)
    if args.live:
        return scenario
    if args.shape is not None and scenario.pushes:
        scenario.pushes[0].shape = args.shape
    set_push(scenario, args.direction, args.delta_v, args.at)
    return scenario


if __name__ == "__main__":
    sys.exit(main())
