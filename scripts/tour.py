"""Walks the tour of teleop-walking-benchmark, with our controller.

Stages: `held`, waypoints with the arms held; `walked`, the arms move at random;
`punched`, and every 5 s a punch.  Run n is the benchmark's own run n.  Finished
runs are kept: the same flags go on after Ctrl-C.

Example:
    python scripts/tour.py --stages held,walked --seeds 4
"""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import sys
from pathlib import Path

from nadia_balance.diagrams.scenario import SENSORS, load_scenario
from nadia_balance.diagrams.tour import STAGES
from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.yaml_reader import load_tree
from nadia_balance.scripts import command_line, envelope
from nadia_balance.sweep.tour import (
    TABLE,
    TOURS,
    Tour,
    TourRows,
    run_tours,
    write_table,
)

OUT = "envelopes/tour"
SEEDS = 64
OWN = {"robot", "duration", "seed", "gait", "place"}  # fields of a Scenario


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
        "0 done, 1 workers or a block failed, 2 bad input, 4 cannot write, "
        "130 Ctrl-C.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _tour_flags(parser)
    envelope.running_flags(
        parser.add_argument_group("running"), OUT, rows=TOURS
    )
    parser.set_defaults(out=Path(OUT))
    args = parser.parse_args(argv)
    with parser.refusing():
        given = OWN & load_tree(args.scenario_text or "{}").keys()
        require(
            not given,
            f"scenario_text has {', '.join(sorted(given))}: must not, as the "
            "tour has its own",
        )
        tours = Tour(
            scenario=load_scenario(
                "stand",
                text=args.scenario_text,
                robot="g1",
                engine=args.engine,
                sensors=args.sensors,
            ),
            stages=envelope.words("stages", vars(args)),
            seeds=args.seeds,
        )
        tours.validate()

    def report(rows: TourRows) -> int:
        command_line.say(
            *write_table(rows), f"wrote {rows.folder}/{{{TOURS}, {TABLE}}}"
        )
        return command_line.DONE

    return envelope.carry_out(
        parser=parser,
        args=args,
        argv=argv,
        sweep=tours,
        report=report,
        run=run_tours,
    )


def _tour_flags(parser: command_line.CommandLine) -> None:
    group = parser.add_argument_group("tour")
    group.add_argument(
        "--stages", default=",".join(STAGES), help="with commas (%(default)s)"
    )
    group.add_argument(
        "--seeds",
        type=int,
        default=SEEDS,
        help="number of runs in each stage, from 0 on (%(default)s)",
    )
    group.add_argument(
        "--engine", choices=("drake", "mujoco"), help="of the physics (drake)"
    )
    group.add_argument(
        "--sensors", choices=SENSORS, help="what measures the state (perfect)"
    )
    group.add_argument(
        "--scenario_text", help="YAML of single fields of a Scenario"
    )


if __name__ == "__main__":
    sys.exit(main())
