"""Draws what the papers' algorithms are made of; simulates nothing.

Figures of the Nadia paper, computed by the functions of the controller: 3 ICP
feedback, 4 capture regions, 6 their growth, 8 reachable footholds, 9 rules that
choose a region; and of the Atlas paper: atlas_2 the plan with CMPs in heel and
toe, atlas_3 the plan of faster steps, atlas_4 projection of the ICP on the
plan, atlas_5 errors that a swing speed-up reduces.

Examples:
    python scripts/capture_regions.py
    python scripts/capture_regions.py --figure 4 atlas_5 --out figures
"""

import nadia_balance.scripts  # noqa: F401  (first, for Ctrl-C)

# isort: split
import argparse
import sys

import matplotlib as mpl

from nadia_balance.results.folder import appearing, new_folder
from nadia_balance.results.plots import atlas_figures, capture_regions
from nadia_balance.results.plots.style import RC
from nadia_balance.scripts.command_line import (
    DONE,
    CommandLine,
    place,
    program,
    say,
)

FIGURES = {
    "3": capture_regions.draw_feedback,
    "4": capture_regions.draw_by_reachability,
    "6": capture_regions.draw_growth,
    "8": capture_regions.draw_reach,
    "9": capture_regions.draw_rules,
    "atlas_2": atlas_figures.draw_plans,
    "atlas_3": atlas_figures.draw_speeds,
    "atlas_4": atlas_figures.draw_projection,
    "atlas_5": atlas_figures.draw_speed_up,
}


@program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv` and returns 0; bad input exits."""
    parser = CommandLine(
        prog="capture_regions.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Exit code: 0 drawn, 1 disk failed, 2 bad input, 130 Ctrl-C.",
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
        type=place,
        help="folder for the pictures "
        "(default: runs/<date>_<time>_capture_regions)",
    )
    args = parser.parse_args(argv)
    names = [f"figure_{number}.png" for number in args.figure]
    with parser.refusing():
        folder = new_folder(args.out, "capture_regions", names)
    with mpl.rc_context(RC), appearing(folder) as drafts:
        for number, name in zip(args.figure, names, strict=True):
            FIGURES[number]().savefig(drafts / name)
    say(*(f"wrote {folder / name}" for name in names))
    return DONE


if __name__ == "__main__":
    sys.exit(main())
