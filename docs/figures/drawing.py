"""What the papers' figures share: the swing, views from above, the command."""

import argparse
import contextlib
import itertools
from collections.abc import Callable, Iterable

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
from nadia_balance.results.plots.style import FAINT, RC, TEXT, key, plan_view
from nadia_balance.scripts.command_line import DONE, CommandLine, place, say


def draw(
    paper: str,
    figures: dict[str, Callable[[], Figure]],
    description: str | None,
    argv: list[str] | None,
) -> int:
    """Draws those `figures` of a `paper` that the command line `argv` names.

    Returns 0; bad input exits.
    """
    codes = "0 drawn, 1 disk failed, 2 bad input, 130 Ctrl-C."
    whole = {"formatter_class": argparse.RawDescriptionHelpFormatter}
    parser = CommandLine(f"{paper}_paper.py", description, codes, **whole)
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
    names = [f"{paper}_figure_{number}.png" for number in args.figure]
    with contextlib.ExitStack() as held, mpl.rc_context(RC):
        with parser.refusing():
            folder = held.enter_context(new_folder(args.out, paper, names))
        with appearing(folder) as drafts:
            for number, name in zip(args.figure, names, strict=True):
                figures[number]().savefig(drafts / name)
    say(*(f"wrote {folder / name}" for name in names))
    return DONE


def right_swing(
    feet: FootPoses,
    footholds: Iterable[FootPose],
    swing: float,
    transfer: float,
) -> ContactSchedule:
    """The beginning of a right swing to the first of the `footholds`.

    All swings and transfers take `swing` and `transfer` [s].
    """
    nothing = np.zeros(2)
    return ContactSchedule(
        phase=Phase.SWING,
        support_side=Side.LEFT,
        duration=swing,
        feet=feet,
        footsteps=tuple(
            Footstep(side, foothold, transfer, swing)
            for side, foothold in zip(
                itertools.cycle([Side.RIGHT, Side.LEFT]), footholds
            )
        ),
        start=ReferencePoint(nothing, nothing, nothing),
    )


def plan_views(
    *titles: str,
    x: tuple[float, float],
    y: tuple[float, float],
    rows: int = 1,
    width: float = 12.5,
) -> tuple[Figure, list[Axes]]:
    """Axes with limits x and y [m] in a figure that is `width` wide [in]."""
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
    """One legend for the whole figure, below it; `title` above it."""
    handles, names = ax.get_legend_handles_labels()
    key(fig, [*dict(zip(names, handles, strict=True)).values()], columns)
    fig.suptitle(title, x=0.01, ha="left", fontsize=9.5, color=FAINT)


def note(ax: Axes, text: str, at: tuple[float, float], **options) -> None:
    """Writes a `text` at a point [m], or elsewhere by `options`."""
    options = {"color": TEXT, "fontsize": 8.5, "ha": "center", **options}
    ax.annotate(text, at, **options)
