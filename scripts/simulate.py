"""Simulates any scenario, and shows and writes what happened.

Examples:
    python scripts/simulate.py --scenario_name walk_forward --hold
    python scripts/simulate.py --scenario_name walk_in_place --plant lipm
"""

import nadia_balance.scripts  # noqa: F401  (first, for Ctrl-C)

# isort: split
import sys

from nadia_balance.diagrams.scenario import scenario_names
from nadia_balance.scripts.command_line import (
    EXIT_CODES,
    ONE_OF,
    CommandLine,
    main_job,
    output_flags,
    program,
    scenario_flags,
    scenario_from,
)


@program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`.

    Returns 0 stood, walked or recovered, 1 did not, 2 bad input, 3 undecided,
    130 Ctrl-C.
    """
    names = ", ".join(scenario_names())
    parser = CommandLine(
        prog="simulate.py",
        description=__doc__.partition("\n")[0],
        epilog=f"scenarios: {names}. "
        f"Exit code: 0 stood, walked or recovered, {EXIT_CODES}",
    )
    scenario_flags(parser, name=None, mechanisms=ONE_OF)
    output_flags(parser)
    return main_job(parser, argv, scenario_from)


if __name__ == "__main__":
    sys.exit(main())
