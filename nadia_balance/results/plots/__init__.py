"""Plots of a run; here their common style: colours, axes, titles, shapes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon

from nadia_balance import palette
from nadia_balance.core.walking.vocabulary import Phase, Side
from nadia_balance.results.log import Log, phase_spans, pushes

TEXT = "#2f3440"
FAINT = "#8a93a3"
_PUSH = {"color": palette.PUSH, "alpha": 0.3, "lw": 0}
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


def plan_view(
    ax: Axes, x: tuple[float, float], y: tuple[float, float], **more
) -> None:
    """Makes `ax` a view from above, with the limits x and y [m]."""
    ax.set(xlim=x, ylim=y, aspect="equal", **more)
    ax.set(xlabel="x, forward [m]", ylabel="y, left [m]")


def time_axes(
    log: Log,
    summary: dict,
    what: str,
    heights: list[float],
    label: bool = False,
) -> tuple[Figure, list[Axes]]:
    """A figure with stacked axes of `heights` [in] over one time axis.

    Swings are shaded in the colour of the foot in the air, pushes are marked;
    with `label`, they are labelled.  `what` is the first part of the title.
    """
    fig = Figure(figsize=(10.0, sum(heights) + 0.9), layout="constrained")
    shape = {"sharex": True, "squeeze": False, "height_ratios": heights}
    axes = fig.subplots(len(heights), **shape)[:, 0]
    swings = [s for s in phase_spans(log) if s.phase is Phase.SWING]
    look = {
        side: {"color": palette.foot_color(side), "alpha": 0.12}
        for side in Side
    }
    for ax in axes:
        for span in swings:
            ax.axvspan(span.start, span.end, lw=0, **look[span.swing_side])
        _mark_pushes(ax, log, label and ax is axes[0])
    axes[-1].set(xlabel="time [s]", xlim=(log["t"][0], log["t"][-1]))
    swung = {span.swing_side for span in swings}
    bands = [
        Patch(label=f"{side.value} foot swings", **look[side])
        for side in filter(swung.__contains__, Side)
    ]
    if pushes(log):
        bands.append(Patch(label="push", **_PUSH))
    key(fig, bands)
    look = {"ha": "left", "fontsize": 10.5, "color": TEXT}
    fig.suptitle(title(summary, what), x=0.01, **look)
    return fig, list(axes)


def key(fig: Figure, handles: list, columns: int | None = None) -> None:
    """Adds one legend for all axes below them, by default in one row."""
    columns = columns or max(len(handles), 1)
    fig.legend(handles=handles, loc="outside lower center", ncols=columns)


def title(summary: dict, what: str) -> str:
    """A title: `what`, robot, mechanisms, pushes and outcome of the run."""
    run = [summary["robot"], summary["mechanisms"]]
    for push in summary["pushes"]:
        where = f"at {push['direction_deg']:.0f}°"
        run.append(f"push {push['delta_v']:.2f} m/s {where}")
    if summary["fell_at"] is not None:
        run.append(f"fell at {summary['fell_at']:.2f} s")
    elif summary["pushes"]:
        run.append(summary["outcome"].replace("failed", "not recovered"))
    return f"{what}   ·   {', '.join(run)}"


def _mark_pushes(ax: Axes, log: Log, label: bool) -> None:
    """Marks the times of pushes; the `label` is above the axes."""
    for push in pushes(log):
        ax.axvspan(push.start, push.end, zorder=0, **_PUSH)
        if label:
            where = {"xycoords": ("data", "axes fraction"), "xytext": (0, 3)}
            where |= {"textcoords": "offset points", "ha": "center"}
            ax.annotate(
                f"push {np.linalg.norm(push.force):.0f} N",
                (0.5 * (push.start + push.end), 1.0),
                annotation_clip=True,  # only where the axes show that time
                color=palette.PUSH,
                fontsize=8.5,
                **where,
            )


def fill(
    ax: Axes,
    polygon: np.ndarray,
    color: str,
    label: str | None = None,
    alpha: float = 0.22,
    **style,
) -> None:
    """Draws a polygon (n, 2) [m] with a transparent fill and an opaque edge."""
    style = {"edgecolor": color, "linewidth": 1.4, **style}
    face = (*palette.rgb(color), alpha)
    ax.add_patch(Polygon(polygon, facecolor=face, label=label, **style))


def draw_sole(
    ax: Axes, corners: np.ndarray, side: Side, alpha: float = 0.0, **style
) -> None:
    """Draws the `corners` (n, 2) [m] of a sole in the colour of its foot."""
    fill(ax, corners, palette.foot_color(side), alpha=alpha, **style)


def arrow(
    ax: Axes,
    start: np.ndarray,
    end: np.ndarray,
    color: str,
    width: float = 2.0,
    style: str = "-|>,head_width=0.3,head_length=0.6",
) -> None:
    """Draws an arrow from `start` to `end` (2,) [m]."""
    look = {"arrowstyle": style, "color": color, "linewidth": width}
    look |= {"shrinkA": 0, "shrinkB": 0}
    ax.annotate("", xy=end, xytext=start, arrowprops=look, zorder=5)
