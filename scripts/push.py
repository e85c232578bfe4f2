"""Shoves the walking robot, and shows whether and how she recovers.

Examples:
    python scripts/push.py
    python scripts/push.py --direction inward --delta-v 0.2 --open --hold
    python scripts/push.py --direction 210 --at "left swing 50 %"
"""

import argparse
import sys

from diagrams.command_line import (
    ONE_OF,
    CommandLine,
    finite,
    main_job,
    output_flags,
    scenario_flags,
    scenario_from,
)
from diagrams.envelope.moment import Moment
from diagrams.scenario import Scenario
from nadia_balance.core.gait import Gait
from nadia_balance.core.push import Push

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
        "--phase",
        choices=("swing", "transfer", "standing"),
        help="when the push begins",
    )
    group.add_argument(
        "--side",
        choices=("left", "right"),
        help="the foot that swings, or will after the transfer",
    )
    group.add_argument(
        "--fraction", type=finite, help="of the phase that has passed, 0 to 1"
    )
    group.add_argument("--at", help='in short, such as "right swing 25 %%"')


def _pushed_scenario(args: argparse.Namespace) -> Scenario:
    """The scenario, its first push changed as the flags say.

    Raises:
        ValueError: a flag has no meaning, or the scenario has no push.
    """
    scenario = scenario_from(args)
    if not scenario.pushes:
        raise ValueError(
            f"scenario_name = {args.scenario_name!r}: must have a push"
        )
    push = scenario.pushes[0]
    if args.at is not None:
        _read_at(args)
    if args.delta_v is not None:
        push.delta_v, push.force = args.delta_v, None
    _set_moment(args, push, scenario.gait)
    if args.direction is not None:
        push.direction_deg = _degrees(args.direction, push)
    scenario.validate()
    return scenario


def _set_moment(args: argparse.Namespace, push: Push, gait: Gait) -> None:
    """Sets when `push` begins; who stands then takes no steps at all."""
    if args.phase == "standing":
        push.phase, push.time = None, 1.0
        gait.num_steps, gait.steps, gait.footholds = 0, [], []
    elif args.phase is not None:
        push.phase, push.time = args.phase, None
    for name in ("side", "fraction"):
        if (value := getattr(args, name)) is None:
            continue
        if push.phase is None:
            raise ValueError(
                f"{name} = {value}: must come with --phase swing or transfer"
            )
        setattr(push, name, value)


def _read_at(args: argparse.Namespace) -> None:
    """Splits --at into --side, --phase and --fraction."""
    for name in ("side", "phase", "fraction"):
        if (value := getattr(args, name)) is not None:
            raise ValueError(f"{name} = {value}: must not come with --at")
    moment = Moment.parse(args.at)
    args.side, args.phase = moment.side, moment.phase
    args.fraction = moment.fraction


def _degrees(direction: str, push: Push) -> float:
    if direction in WORDS:
        mirrored = push.side == "left"
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
