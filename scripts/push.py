"""Pushes the walking robot, and shows whether and how it recovers.

Examples:
    python scripts/push.py
    python scripts/push.py --direction inward --delta-v 0.2 --open --hold
    python scripts/push.py --direction 210 --at "left swing 50 %"
    python scripts/push.py --plant lipm --terrain stepping_stones
"""

import argparse
import sys

from nadia_balance.core.bounds import check
from nadia_balance.core.push import Moment
from nadia_balance.core.walking import Side
from nadia_balance.diagrams.scenario import Scenario, scenario_names
from nadia_balance.scripts.command_line import (
    ONE_OF,
    CommandLine,
    finite,
    main_job,
    output_flags,
    scenario_flags,
    scenario_from,
)

STANDING = "standing"
# Relative to a left stance foot, that is, to a right swing.
WORDS = {"forward": 0.0, "inward": 90.0, "backward": 180.0, "outward": 270.0}


def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`.

    Returns 0 recovered, 1 did not recover, 2 bad input.
    """
    parser = CommandLine(
        prog="push.py",
        description=__doc__.partition("\n")[0],
        epilog="Exit code: 0 recovered, 1 did not recover (summary.json says "
        "why), 2 bad input.",
    )
    _push_flags(parser)
    scenario_flags(parser, name="push", mechanisms=ONE_OF)
    parser.set_defaults(scenario_name=None)  # the terrain's, or push
    output_flags(parser)
    return main_job(parser, argv, _pushed_scenario)


def _push_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "push", "Of the scenario's first push.  Default: as in the scenario."
    )
    group.add_argument(
        "--direction",
        help="degrees (0 forward, 90 left), or forward, backward, inward, "
        "outward, seen from the stance foot",
    )
    group.add_argument(
        "--delta-v",
        type=finite,
        help="change of the robot's velocity [m/s]",
    )
    group.add_argument(
        "--at",
        help='when it begins: in a phase, such as "right swing 25 %%" (the '
        'right foot swings) or "left transfer 50 %%" (the left one will), at a '
        'time, such as "2.5 s", or "standing", at 1 s, with no steps at all',
    )


def _pushed_scenario(args: argparse.Namespace) -> Scenario:
    """The scenario, its first push changed as the flags say.

    Raises:
        ValueError: a flag has no meaning, or the scenario has no push.
    """
    if args.scenario_name is None:
        has_own = args.terrain in scenario_names()
        args.scenario_name = args.terrain if has_own else "push"
    scenario = scenario_from(args)
    if not scenario.pushes:
        raise ValueError(
            f"scenario_name = {args.scenario_name!r}: must have a push"
        )
    push = scenario.pushes[0]
    if args.delta_v is not None:
        push.delta_v, push.force = args.delta_v, None
    if args.at == STANDING:
        push.at, gait = "1 s", scenario.gait
        gait.num_steps, gait.steps, gait.footholds = 0, [], []
    elif args.at is not None:
        push.at = str(Moment.parse(args.at))
    if args.direction is not None:
        push.direction_deg = _degrees(args.direction, push.moment)
    check(scenario)
    return scenario


def _degrees(direction: str, moment: Moment) -> float:
    if direction in WORDS:
        mirrored = moment.swing is Side.LEFT
        return WORDS[direction] * (-1.0 if mirrored else 1.0)
    try:
        return finite(direction)
    except (ValueError, argparse.ArgumentTypeError):
        raise ValueError(
            f"direction = {direction!r}: must be degrees, or one of "
            f"{', '.join(WORDS)}"
        ) from None


if __name__ == "__main__":
    sys.exit(main())
