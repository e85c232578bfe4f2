"""The ICP, its reference, and the error between them, over time."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nadia_balance import palette
from nadia_balance.results.log import Log, icp_error, signal
from nadia_balance.results.plots.style import FAINT, time_axes
from nadia_balance.results.recovery import ICP_BACK

SMALLEST_RANGE = 0.1  # smallest range of an axis [m]


def draw(log: Log, summary: dict) -> Figure:
    """Draws both coordinates with the CoP and CoM, and the error."""
    fig, axes = time_axes(log, summary, "ICP", [2.4, 2.4, 1.5], label=True)
    for axis, name in enumerate(("x, forward [m]", "y, left [m]")):
        _draw_coordinate(axes[axis], log, axis)
        axes[axis].set_ylabel(name)
    axes[1].legend(
        loc="upper left", bbox_to_anchor=(0.0, 1.14), ncols=4, borderpad=0
    )
    _draw_error(axes[2], log)
    return fig


def _draw_coordinate(ax: Axes, log: Log, axis: int) -> None:
    """Draws x (`axis` 0) or y (1)."""
    cop = signal(log, "ecmp_command").cop
    com = signal(log, "com_state").position
    reference = signal(log, "icp_reference").icp
    for point, color, label, style in (
        (cop, palette.COP, "CoP", {"lw": 0.9, "alpha": 0.75}),
        (com, palette.COM, "CoM", {"lw": 1.1}),
        (reference, palette.ICP_REFERENCE, "ICP reference", {"lw": 3.0}),
        (log["icp"].T, palette.ICP, "ICP", {}),
    ):
        ax.plot(log["t"], point[axis], color=color, label=label, **style)
    # A smallest range, so that noise of millimetres does not fill the axis.
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
