"""What all plots have in common."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diagrams.run_log import Log, PhaseSpan, pushes
from nadia_balance.core.walking import Phase
from nadia_balance.systems import palette

TEXT = "#2f3440"
FAINT = "#8a93a3"
RC = {
    "font.size": 9.0,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": TEXT,
    "axes.titlelocation": "left",
    "axes.titlesize": 10.5,
    "axes.titlecolor": TEXT,
    "axes.titlepad": 5.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e7eaef",
    "grid.linewidth": 0.8,
    "text.color": TEXT,
    "xtick.color": TEXT,
    "ytick.color": TEXT,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.5,
    "savefig.bbox": "tight",
    "savefig.dpi": 130,
    "savefig.pad_inches": 0.12,
}


def stacked_axes(
    heights: list[float], width: float = 10.0
) -> tuple[Figure, list[Axes]]:
    """A figure of axes above each other, of `heights` [in], one time axis."""
    fig = Figure(figsize=(width, sum(heights) + 0.6), layout="constrained")
    grid = {"height_ratios": heights}
    axes = fig.subplots(len(heights), 1, sharex=True, gridspec_kw=grid)
    axes = list(np.atleast_1d(axes))
    axes[-1].set_xlabel("time [s]")
    return fig, axes


def title(summary: dict, what: str) -> str:
    """Says what is seen, of which run."""
    run = [summary["robot"], summary["mechanisms"]]
    if summary["delta_v"] is not None:
        run.append(f"push {summary['delta_v']:.2f} m/s")
    if summary["direction_deg"] is not None:
        run[-1] += f" at {summary['direction_deg']:.0f}°"
    if summary["fell_at"] is not None:
        run.append(f"fell at {summary['fell_at']:.2f} s")
    elif summary["delta_v"] is not None:
        run.append("recovered" if summary["recovered"] else "not recovered")
    return f"{what}   ·   {', '.join(run)}"


def set_title(fig: Figure, summary: dict, what: str) -> None:
    """Writes the title over a figure of several axes."""
    fig.suptitle(
        title(summary, what), x=0.01, ha="left", fontsize=10.5, color=TEXT
    )


def shade_phases(ax: Axes, spans: list[PhaseSpan]) -> None:
    """Shades each swing in the colour of the foot in the air."""
    for span in spans:
        if span.phase is Phase.SWING:
            ax.axvspan(
                span.start,
                span.end,
                color=palette.foot_color(span.swing_side),
                alpha=0.08,
                linewidth=0,
            )


def mark_pushes(ax: Axes, log: Log, label: bool = False) -> None:
    """Marks when the robot was pushed; the `label` is above the axes."""
    for push in pushes(log):
        ax.axvspan(
            push.start,
            push.end,
            color=palette.PUSH,
            alpha=0.3,
            linewidth=0,
            zorder=0,
        )
        if label:
            ax.annotate(
                f"push {np.linalg.norm(push.force):.0f} N",
                (0.5 * (push.start + push.end), 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(0, 3),
                textcoords="offset points",
                annotation_clip=True,  # only where the axes show that time
                ha="center",
                color=palette.PUSH,
                fontsize=8.5,
            )
