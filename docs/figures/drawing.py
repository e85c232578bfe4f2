"""What the papers' figures share: the swing, views from above, the command."""

import argparse
import contextlib
import itertools
from collections.abc import Callable, Iterable
from typing import Any, Literal, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nadia_balance.core.walking.state import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
)
from nadia_balance.results.folder import appearing, new_folder
from nadia_balance.results.plots.style import (
    FAINT,
    RC,
    TEXT,
    key,
    plan_view,
    save,
)
from nadia_balance.scripts.command_line import DONE, CommandLine, place, say


def draw(
    paper: str,
    figures: dict[str, Callable[[], Figure]],
    description: str | None,
    argv: list[str] | None,
) -> int:
    """Draws the figures that a command line names; bad input exits.

    Args:
        paper: name in the files' names.
        figures: functions that draw, by number in the paper.
        description: of the program, for its help.
        argv: command line; by default the program's.

    Returns:
        The exit code 0.
    """
    parser = CommandLine(
        f"{paper}_paper.py",
        description or "",
        "0 drawn, 1 disk failed, 2 bad input, 130 Ctrl-C.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--figure",
        nargs="+",
        choices=figures,
        default=list(figures),
        help="number in the paper; all by default",
    )
    parser.add_argument(
        "--out",
        type=place,
        help=f"folder for the pictures (default: runs/<date>_<time>_{paper})",
    )
    args = parser.parse_args(argv)
    pictures = [f"{paper}_figure_{number}.png" for number in args.figure]
    drawings = [name.replace(".png", ".svg") for name in pictures]
    with contextlib.ExitStack() as held, mpl.rc_context(cast(Any, RC)):
        with parser.refusing():
            folder = held.enter_context(
                new_folder(args.out, paper, pictures + drawings)
            )
        with appearing(folder) as drafts:
            for number, name in zip(args.figure, pictures, strict=True):
                save(figures[number](), drafts / name)
    say(*(f"wrote {folder / name}" for name in sorted(pictures + drawings)))
    return DONE


def right_swing(
    feet: FootPoses,
    footholds: Iterable[FootPose],
    swing: float,
    transfer: float,
) -> ContactSchedule:
    """Makes the schedule at the beginning of a right swing.

    Args:
        feet: where they stand, or stood.
        footholds: of the steps; the first is that of the swing.
        swing: duration of all swings [s].
        transfer: duration of all transfers [s].

    Returns:
        The contacts from the beginning of the swing on.
    """
    return ContactSchedule(
        phase=Phase.SWING,
        support_side=Side.LEFT,
        duration=swing,
        feet=feet,
        footsteps=tuple(
            Footstep(
                side=side,
                pose=foothold,
                transfer_duration=transfer,
                swing_duration=swing,
            )
            for side, foothold in zip(
                itertools.cycle([Side.RIGHT, Side.LEFT]), footholds
            )
        ),
        start=ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2)),
    )


def plan_views(
    *titles: str,
    x: tuple[float, float],
    y: tuple[float, float],
    rows: int = 1,
    width: float = 12.5,
) -> tuple[Figure, list[Axes]]:
    """Makes a figure of axes in rows, each a view from above.

    Args:
        *titles: one of each axes.
        x: limits forward [m].
        y: limits to the left [m].
        rows: number of rows.
        width: of the figure [in].

    Returns:
        The figure, and its axes row by row.
    """
    columns = len(titles) // rows
    scale = (width - 0.8) / columns / (x[1] - x[0])
    height = rows * (scale * (y[1] - y[0]) + 0.4) + 0.9
    fig = Figure(figsize=(width, height), layout="constrained")
    axes = list(fig.subplots(rows, columns, squeeze=False).flat)
    for ax, title in zip(axes, titles, strict=True):
        plan_view(ax, x, y, title=title)
        ax.label_outer()
    return fig, axes


def share_legend(
    fig: Figure, ax: Axes, title: str = "", columns: int | None = None
) -> None:
    """Draws one legend for the whole figure, below it.

    Args:
        fig: gets the legend.
        ax: axes of which it shows the labels.
        title: of the figure.
        columns: of the legend; by default one row.
    """
    handles, names = ax.get_legend_handles_labels()
    key(fig, [*dict(zip(names, handles, strict=True)).values()], columns)
    fig.suptitle(title, x=0.01, ha="left", fontsize=9.5, color=FAINT)


def note(
    ax: Axes,
    text: str,
    point: tuple[float, float],
    *,
    ha: Literal["left", "center", "right"] = "center",
    va: Literal["bottom", "baseline", "center"] = "baseline",
    fontsize: float = 8.5,
    xycoords: str = "data",
) -> None:
    """Writes a text.

    Args:
        ax: axes to write in.
        text: in mathtext.
        point: where it is, by default [m].
        ha: horizontal alignment.
        va: vertical alignment.
        fontsize: [pt].
        xycoords: what `point` is in, as in `Axes.annotate`.
    """
    ax.annotate(
        text,
        point,
        color=TEXT,
        ha=ha,
        va=va,
        fontsize=fontsize,
        xycoords=xycoords,
    )
