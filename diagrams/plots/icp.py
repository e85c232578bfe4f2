"""The ICP, its reference, and the error between them, over time."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diagrams.plots.style import (
    FAINT,
    mark_pushes,
    set_title,
    shade_phases,
    stacked_axes,
)
from diagrams.run_log import Log, icp_error, phase_spans
from diagrams.summary import ICP_BACK
from nadia_balance.systems import palette

SMALLEST_RANGE = 0.1  # of an axis [m]


def draw(log: Log, summary: dict) -> Figure:
    """Draws both coordinates with the CoP and CoM, and the error."""
    fig, axes = stacked_axes([2.4, 2.4, 1.5])
    spans = phase_spans(log)
    for ax in axes:
        shade_phases(ax, spans)
        mark_pushes(ax, log, label=ax is axes[0])
    for column, ax in enumerate(axes[:2]):
        _draw_coordinate(ax, log, column)
    axes[0].set_ylabel("x, forward [m]")
    axes[1].set_ylabel("y, left [m]")
    axes[1].legend(
        loc="upper left", bbox_to_anchor=(0.0, 1.14), ncols=4, borderpad=0
    )
    _draw_error(axes[2], log)
    axes[2].set_xlim(log["t"][0], log["t"][-1])
    set_title(fig, summary, "ICP")
    return fig


def _draw_coordinate(ax: Axes, log: Log, column: int) -> None:
    t = log["t"]
    ax.plot(
        t,
        log["ecmp_command"][:, column],
        color=palette.COP,
        linewidth=0.9,
        alpha=0.75,
        label="CoP",
    )
    ax.plot(
        t,
        log["com_state"][:, column],
        color=palette.COM,
        linewidth=1.1,
        label="CoM",
    )
    ax.plot(
        t,
        log["icp_reference"][:, column],
        color=palette.ICP_REFERENCE,
        linewidth=3.0,
        label="ICP reference",
    )
    ax.plot(t, log["icp"][:, column], color=palette.ICP, label="ICP")
    # Millimetres of noise must not look like motion.
    low, high = ax.get_ylim()
    missing = max(0.0, SMALLEST_RANGE - (high - low))
    ax.set_ylim(low - 0.5 * missing, high + 0.5 * missing)


def _draw_error(ax: Axes, log: Log) -> None:
    error = 1000.0 * icp_error(log)
    limit = 1000.0 * ICP_BACK
    ax.fill_between(log["t"], error, color=palette.ICP, alpha=0.2, linewidth=0)
    ax.plot(log["t"], error, color=palette.ICP)
    ax.set_ylabel("ICP error [mm]")
    ax.set_ylim(bottom=0.0)
    if max(error) > 0.5 * limit:
        ax.axhline(limit, color=FAINT, linewidth=1.0, linestyle="--")
        ax.annotate(
            f"{limit:.0f} mm: recovered below",
            (1.0, limit),
            xycoords=("axes fraction", "data"),
            xytext=(-4, 3),
            textcoords="offset points",
            ha="right",
            fontsize=8,
            color=FAINT,
        )
