"""The common style of all plots: colours, axes, titles, polygons, arrows."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Side

TEXT = "#2f3440"
FAINT = "#8a93a3"
FEW = 3  # pushes that a title tells one by one
# By the keys of matplotlib.
RC: dict[Any, Any] = {
    "font.size": 9.0,
    "text.color": TEXT,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": TEXT,
    "axes.titlecolor": TEXT,
    "axes.titlelocation": "left",
    "axes.titlesize": 10.5,
    "axes.titlepad": 5.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e7eaef",
    "xtick.color": TEXT,
    "ytick.color": TEXT,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "savefig.bbox": "tight",
    "savefig.dpi": 130,
    "savefig.pad_inches": 0.12,
}

_HEAD = "-|>,head_width=0.3,head_length=0.6"  # of arrows


def plan_view(
    ax: Axes, x: tuple[float, float], y: tuple[float, float], **more: Any
) -> None:
    """Makes axes a view from above.

    Args:
        ax: axes to change.
        x: limits along x [m].
        y: limits along y [m].
        **more: other properties of the axes, such as the title.
    """
    ax.set(
        xlim=x,
        ylim=y,
        aspect="equal",
        xlabel="x, forward [m]",
        ylabel="y, left [m]",
        **more,
    )


def key(
    fig: Figure, handles: Sequence[Artist], columns: int | None = None
) -> None:
    """Adds one legend for all axes below them.

    Args:
        fig: figure with a constrained layout.
        handles: artists with a label.
        columns: columns of the legend, by default all in one row.
    """
    fig.legend(
        handles=handles,
        loc="outside lower center",
        ncols=columns or max(len(handles), 1),
    )


def title(summary: dict[str, Any], name: str) -> str:
    """Returns a title: name, robot, mechanisms, pushes and outcome of the run.

    More than FEW pushes are counted.

    Args:
        summary: summary of the run.
        name: name of the plot.

    Returns:
        One line.
    """
    pushes = [
        f"push {push['delta_v']:.2f} m/s at {push['direction_deg']:.0f}°"
        for push in summary["pushes"]
    ]
    if len(pushes) > FEW:
        largest = max(push["delta_v"] for push in summary["pushes"])
        pushes = [f"{len(pushes)} pushes of up to {largest:.2f} m/s"]
    run = [summary["robot"], summary["mechanisms"], *pushes]
    if summary["fell_at"] is not None:
        run.append(f"fell at {summary['fell_at']:.2f} s")
    elif summary["pushes"]:
        run.append(summary["outcome"].replace("failed", "not recovered"))
    return f"{name}   ·   {', '.join(run)}"


def save(fig: Figure, path: Path) -> None:
    """Writes a picture twice; the same one has the same bytes.

    Args:
        fig: figure to write.
        path: of the .png file; an .svg file is written beside it.
    """
    fig.savefig(path)
    # Words stay words; identifiers follow from the drawing.
    svg: Any = {"svg.fonttype": "none", "svg.hashsalt": "nadia_balance"}
    with mpl.rc_context(svg):
        fig.savefig(path.with_suffix(".svg"), metadata={"Date": None})


def fill(
    ax: Axes,
    polygon: Array,
    color: str,
    label: str | None = None,
    alpha: float = 0.22,
    edgecolor: Any = None,
    linewidth: float = 1.4,
    **style: Any,
) -> None:
    """Draws a polygon with a transparent fill and an opaque edge.

    Args:
        ax: axes to draw in.
        polygon: corners (n, 2) [m].
        color: colour, written #rrggbb.
        label: label in the legend, if any.
        alpha: opacity of the fill.
        edgecolor: colour of the edge; None: that of the fill.
        linewidth: width of the edge [pt].
        **style: other properties, such as linestyle or zorder.
    """
    ax.add_patch(
        Polygon(
            polygon,
            facecolor=(*palette.rgb(color), alpha),
            edgecolor=color if edgecolor is None else edgecolor,
            linewidth=linewidth,
            label=label,
            **style,
        )
    )


def draw_sole(
    ax: Axes, corners: Array, side: Side, alpha: float = 0.0, **style: Any
) -> None:
    """Draws a sole in the colour of its foot.

    Args:
        ax: axes to draw in.
        corners: corners (n, 2) [m].
        side: side of the foot.
        alpha: opacity of the fill.
        **style: other properties (see fill).
    """
    fill(ax, corners, palette.foot_color(side), alpha=alpha, **style)


def arrow(
    ax: Axes,
    start: Array,
    end: Array,
    color: str,
    width: float = 2.0,
    style: str = _HEAD,
) -> None:
    """Draws an arrow.

    Args:
        ax: axes to draw in.
        start: where it begins, (2,) [m].
        end: where its tip is, (2,) [m].
        color: colour, written #rrggbb.
        width: width of its line, in points.
        style: arrow style of matplotlib.
    """
    ax.annotate(
        "",
        xy=(end[0], end[1]),
        xytext=(start[0], start[1]),
        arrowprops={
            "arrowstyle": style,
            "color": color,
            "linewidth": width,
            "shrinkA": 0,
            "shrinkB": 0,
        },
        zorder=5,
    )
