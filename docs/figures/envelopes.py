"""Draws what Nadia and the G1 recover from, in one picture.

Beside Nadia's limits are the paper's, beside the G1's those of a learned
policy, for both of which any landing counts; all of them from the tables in
docs/results.

Example:
    python docs/figures/envelopes.py --out envelopes.png
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple, cast

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from nadia_balance import palette
from nadia_balance.core.walking.mechanisms import COLORS, MOST
from nadia_balance.diagrams.scenario import AT
from nadia_balance.parameters.bounds import require
from nadia_balance.results.folder import appearing
from nadia_balance.results.plots.style import FAINT, RC, TEXT, save
from nadia_balance.scripts import command_line
from nadia_balance.sweep.envelope_plot import (
    closed,
    draw_directions,
    share_scale,
)
from nadia_balance.sweep.limits import PROTOCOLS, known_limits

ROOT = Path(__file__).resolve().parents[2]
OURS, PAPER, POLICY = COLORS[MOST], palette.RIGHT, palette.COP


class Curve(NamedTuple):
    """Limits [m/s] by direction [deg], and how they are drawn."""

    label: str
    color: str
    line: str
    limits: Mapping[float, float]


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Draws the picture; bad input exits.

    Args:
        argv: command line; by default the program's.

    Returns:
        The exit code 0.
    """
    parser = command_line.CommandLine(
        __file__,
        __doc__ or "",
        "0 drawn, 1 disk failed, 2 bad input, 130 Ctrl-C.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--results",
        type=command_line.place,
        default=ROOT / "docs" / "results",
        help="folder with the tables (default: docs/results)",
    )
    parser.add_argument(
        "--out",
        type=command_line.place,
        default=Path("envelopes.png"),
        help="the picture; an .svg is written beside it (default: %(default)s)",
    )
    args = parser.parse_args(argv)
    with parser.refusing():
        require(
            args.out.suffix == ".png",
            f"out = {str(args.out)!r}: must end in .png",
        )
        figure = draw(args.results)
    with (
        mpl.rc_context(cast(Any, RC)),
        appearing(args.out.absolute().parent) as drafts,
    ):
        save(figure, drafts / args.out.name)
    command_line.say(
        f"wrote {args.out}", f"wrote {args.out.with_suffix('.svg')}"
    )
    return command_line.DONE


def draw(results: Path) -> Figure:
    """Draws a panel for each robot, on one radial scale.

    Args:
        results: folder with the folders of the sweeps.

    Returns:
        The picture.

    Raises:
        ValueError: a sweep has no limits.
        OSError: a sweep cannot be read.
    """
    paper = PROTOCOLS["nadia_fig10"].curves("push")[MOST]
    ours = "this package"
    robots = {
        "Nadia, 91 kg, soft landings": (
            Curve(ours, OURS, "-", _limits(results / "fig10")),
            Curve("the Nadia paper's, Fig. 10", PAPER, "--", paper),
        ),
        "Unitree G1, 33 kg, any landing": (
            Curve(ours, OURS, "-", _limits(results / "g1")),
            Curve(
                "a learned policy (FastSAC)",
                POLICY,
                "--",
                _limits(results / "g1_policy_moments"),
            ),
        ),
    }
    with mpl.rc_context(cast(Any, RC)):
        fig = Figure(figsize=(10.0, 5.9), layout="constrained")
        panels = []
        for number, (robot, curves) in enumerate(robots.items(), start=1):
            ax = cast(
                PolarAxes, fig.add_subplot(1, 2, number, projection="polar")
            )
            _draw_robot(ax, robot, curves)
            panels.append(ax)
        share_scale(panels)
        fig.suptitle(
            "Largest push from which the robot recovers, by direction, "
            "25 % into a right swing",
            x=0.01,
            ha="left",
            fontsize=12,
            color=TEXT,
        )
    return fig


def _limits(folder: Path) -> dict[float, float]:
    """The limits [m/s] at AT by direction [deg], with all mechanisms."""
    return {
        cell.direction_deg: limit
        for cell, limit in known_limits(folder).items()
        if (cell.at, cell.mechanisms) == (AT, MOST)
    }


def _draw_robot(ax: PolarAxes, robot: str, curves: tuple[Curve, ...]) -> None:
    draw_directions(ax)
    ax.set_title(robot, fontsize=11.5, loc="center")
    for curve in curves:
        line = closed(dict(curve.limits))
        ax.plot(
            *line,
            color=curve.color,
            linestyle=curve.line,
            linewidth=2.2,
            label=f"{curve.label}: {fmean(curve.limits.values()):.2f} m/s "
            "in the mean",
        )
        ax.fill(*line, color=curve.color, alpha=0.13, linewidth=0.0)
    ax.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.06),
        fontsize=10.0,
        labelcolor=TEXT,
        edgecolor=FAINT,
    )


if __name__ == "__main__":
    sys.exit(main())
