"""What all pictures of the ground have in common, seen from above."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from diagrams.plots.style import FAINT, TEXT
from nadia_balance.core.walking import Array, FootPose, Side, rectangle
from nadia_balance.systems import palette

SOLE = rectangle(0.25, 0.12)  # Nadia's [m]
GUIDE = {"color": FAINT, "lw": 0.9, "ls": (0, (4, 3))}  # a line to measure by
_WIDTH = 12.5  # of a figure [in]


def plans(
    *titles: str,
    x: tuple[float, float] = (-0.3, 1.35),
    y: tuple[float, float] = (-0.8, 0.8),
    rows: int = 1,
) -> tuple[Figure, list[Axes]]:
    """Axes for what is seen from above, within the limits x and y [m]."""
    columns = len(titles) // rows
    scale = (_WIDTH - 0.8) / columns / (x[1] - x[0])
    height = rows * (scale * (y[1] - y[0]) + 0.4) + 0.9
    fig = Figure(figsize=(_WIDTH, height), layout="constrained")
    axes = list(fig.subplots(rows, columns, sharex=True, sharey=True).flat)
    for ax, title in zip(axes, titles, strict=True):
        ax.set(xlim=x, ylim=y, aspect="equal", title=title)
        ax.set(xlabel="x, forward [m]", ylabel="y, left [m]")
        ax.label_outer()
    return fig, axes


def share_legend(fig: Figure, ax: Axes, title: str = "") -> None:
    """One legend for the whole figure, below it; `title` above it."""
    handles, names = ax.get_legend_handles_labels()
    entries = dict(zip(names, handles, strict=True))
    fig.legend(
        entries.values(),
        entries.keys(),
        loc="outside lower center",
        ncols=len(entries),
    )
    fig.suptitle(title, x=0.01, ha="left", fontsize=9.5, color=FAINT)


def fill(
    ax: Axes,
    polygon: Array,
    color: str,
    label: str | None = None,
    alpha: float = 0.22,
    linewidth: float = 1.4,
    linestyle: str = "-",
) -> None:
    """Draws a polygon (n, 2) [m]: its inside transparent, its edge not."""
    rgb = palette.rgb(color)
    patch = Polygon(
        polygon,
        facecolor=(*rgb, alpha),
        edgecolor=color,
        linewidth=linewidth,
        linestyle=linestyle,
        label=label,
    )
    ax.add_patch(patch)


def draw_sole(
    ax: Axes,
    pose: FootPose,
    side: Side,
    label: str | None = None,
    linestyle: str = "-",
) -> None:
    """Draws a sole: solid ones stand, others are only meant."""
    fill(
        ax,
        pose.to_world(SOLE),
        palette.foot_color(side),
        label or f"{side.value} foot",
        alpha=0.12 if linestyle == "-" else 0.0,
        linestyle=linestyle,
    )


def draw_icp(ax: Axes, icp: Array) -> None:
    """Draws the capture point."""
    ax.plot(*icp, "o", color=palette.ICP, ms=7, mec="white", label="ICP")


def note(ax: Axes, text: str, at: tuple[float, float], **options) -> None:
    """Writes `text` in the picture."""
    options = {"color": TEXT, "fontsize": 8.5, "ha": "center", **options}
    ax.annotate(text, at, **options)
