"""Simulates any scenario, and shows and writes what happened."""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import sys

from nadia_balance.diagrams.scenario import Scenario, scenario_names
from nadia_balance.parameters.bounds import require
from nadia_balance.scripts import command_line


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs a command line.

    Args:
        argv: its words; None: those of the process.

    Returns:
        The exit code of --help.
    """
    parser = command_line.CommandLine(
        __file__,
        __doc__,
        f"0 stood, walked or recovered, {command_line.EXIT_CODES} Scenarios: "
        f"{', '.join(scenario_names())}.",
    )
    command_line.scenario_flags(parser, name="walk_by_command, with --command")
    return command_line.main_job(parser, argv, _scenario)


def _scenario(args: argparse.Namespace) -> Scenario:
    """The scenario of the flags."""
    if args.scenario_name is None:
        require(
            args.command is not None or args.live,
            "scenario_name: must be given, or --command",
        )
        args.scenario_name = "walk_by_command"
    return command_line.scenario_from(args)


if __name__ == "__main__":
    sys.exit(main())
