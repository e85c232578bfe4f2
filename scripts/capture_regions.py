"""Draws what the Nadia paper's algorithm is made of; needs no robot.

Figures of the paper, each made by the functions that the controller uses:
3 the ICP feedback, 4 the capture regions, 6 how they grow, 8 where a foot can
be put, 9 the rules that choose among it.

Examples:
    python scripts/capture_regions.py
    python scripts/capture_regions.py --figure 4 9 --out figures
"""

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

from diagrams.command_line import BAD_INPUT, CommandLine
from diagrams.plots import feedback, reach, regions
from diagrams.plots.style import RC
from diagrams.run_folder import prepare_folder

FIGURES = {
    3: feedback.draw_feedback,
    4: regions.draw_by_reachability,
    6: regions.draw_growth,
    8: reach.draw_regions,
    9: reach.draw_rules,
}


def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; 0 drawn, 2 bad input."""
    parser = CommandLine(
        prog="capture_regions.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Exit code: 0 drawn, 2 bad input.",
    )
    parser.add_argument(
        "--figure",
        type=int,
        nargs="+",
        choices=FIGURES,
        default=list(FIGURES),
        help="number in the paper; by default all of them",
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="folder for the pictures "
        "(default: runs/<date>_<time>_capture_regions)",
    )
    args = parser.parse_args(argv)
    try:
        folder = prepare_folder(args.out, "capture_regions")
        for number in args.figure:
            path = folder / f"figure_{number}.png"
            with mpl.rc_context(RC):
                FIGURES[number]().savefig(path)
            print(f"wrote {path}")
    except (ValueError, OSError) as error:
        message = " ".join(str(error).split())
        print(f"{parser.prog}: {message}", file=sys.stderr)
        return BAD_INPUT
    return 0


if __name__ == "__main__":
    sys.exit(main())
