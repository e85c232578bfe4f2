"""Simulates any scenario, and shows and writes what happened.

Examples:
    python scripts/simulate.py --scenario_name walk_forward --hold
    python scripts/simulate.py --scenario_name walk_in_place --plant lipm
"""

import sys

from diagrams.command_line import (
    CommandLine,
    main_job,
    output_flags,
    scenario_flags,
    scenario_from,
)
from diagrams.scenario import scenario_names


def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; 0 stands, 1 fell, 2 bad input."""
    names = ", ".join(scenario_names())
    parser = CommandLine(
        prog="simulate.py",
        description=__doc__.partition("\n")[0],
        epilog=f"scenarios: {names}. "
        "Exit code: 0 still up, 1 fell, 2 bad input.",
    )
    scenario_flags(parser, name=None)
    output_flags(parser)
    return main_job(parser, argv, scenario_from)


if __name__ == "__main__":
    sys.exit(main())
