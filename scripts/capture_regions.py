"""Draws what the papers' algorithms are made of; simulates nothing.

Figures of the Nadia paper, each made by the functions that the controller uses:
3 the ICP feedback, 4 the capture regions, 6 how they grow, 8 where a foot can
be put, 9 the rules that choose among it; and of the Atlas paper: atlas_4 how
far the plan is advanced, atlas_5 which errors this is good for.

Examples:
    python scripts/capture_regions.py
    python scripts/capture_regions.py --figure 4 atlas_5 --out figures
"""

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

from nadia_balance.results.folder import prepare_folder
from nadia_balance.results.plots import capture_regions, speed_up
from nadia_balance.results.plots.style import RC
from nadia_balance.scripts.command_line import CommandLine

FIGURES = {
    "3": capture_regions.draw_feedback,
    "4": capture_regions.draw_by_reachability,
    "6": capture_regions.draw_growth,
    "8": capture_regions.draw_reach,
    "9": capture_regions.draw_rules,
    "atlas_4": speed_up.draw_projection,
    "atlas_5": speed_up.draw_speed_up,
}


def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; returns 0, bad input ends the program."""
    parser = CommandLine(
        prog="capture_regions.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Exit code: 0 drawn, 2 bad input.",
    )
    parser.add_argument(
        "--figure",
        nargs="+",
        choices=FIGURES,
        default=list(FIGURES),
        help="number in the Nadia paper, or in the Atlas paper; all by default",
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="folder for the pictures "
        "(default: runs/<date>_<time>_capture_regions)",
    )
    args = parser.parse_args(argv)
    with parser.refusing(), mpl.rc_context(RC):
        folder = prepare_folder(args.out, "capture_regions")
        for number in args.figure:
            path = folder / f"figure_{number}.png"
            FIGURES[number]().savefig(path)
            print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
