"""Over time: the pelvis's velocity and tilt, as estimated and as they were."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nadia_balance.core.math.arrays import Array
from nadia_balance.results.log import Log
from nadia_balance.results.plots.style import FAINT, time_axes

_AXES = {"to x, forward": "#3b6fb6", "to y, left": "#c2571a"}
_BAND = 0.2  # opacity of 3 standard deviations


def draw(log: Log, summary: dict) -> Figure | None:
    """Draws the estimate, and its error if the truth is in the log.

    Bands are 3 standard deviations.  None if nothing was estimated.
    """
    if "estimate_covariance" not in log:
        return None
    known, told = "state" in log, log["estimated_state"]
    heights = [1.8, 1.3] if known else [1.8]
    fig, axes = time_axes(log, summary, "Estimate", 2 * heights, label=True)
    variances = log["estimate_covariance"][:, ::10]  # the diagonal of (9, 9)
    for kind, unit, value, columns in (
        ("velocity", "mm/s", _velocity, (3, 4)),
        ("tilt", "deg", _tilt, (1, 0)),
    ):
        scale = 1e3 if kind == "velocity" else np.degrees(1.0)
        band = 3.0 * scale * np.sqrt(variances[:, columns])
        rows, axes = axes[: len(heights)], axes[len(heights) :]
        estimated = value(told)
        if known:
            truth = value(log["state"])
            look = {"color": FAINT, "lw": 3.0, "alpha": 0.6}
            rows[0].plot(log["t"], truth, label=["truth", None], **look)
            _draw(rows[1], log, estimated - truth, 0.0 * truth, band)
            rows[1].set_ylabel(f"error and\n3 sigma [{unit}]")
        _draw(rows[0], log, estimated, estimated, band)
        rows[0].set_ylabel(f"{kind} [{unit}]")
        rows[0].legend(ncols=3, loc="upper right")
    return fig


def _draw(ax: Axes, log: Log, line: Array, middle: Array, band: Array) -> None:
    """Draws both parts of `line` (n, 2), and `band` about `middle`."""
    for axis, (label, color) in enumerate(_AXES.items()):
        low, high = middle[:, axis] - band[:, axis], (middle + band)[:, axis]
        ax.fill_between(log["t"], low, high, color=color, alpha=_BAND, lw=0)
        ax.plot(log["t"], line[:, axis], color=color, lw=1.1, label=label)


def _velocity(state: Array) -> Array:
    """Horizontal velocity (n, 2) [mm/s] of the pelvis, of `state` (n, nx)."""
    nq = (state.shape[1] + 1) // 2
    return 1e3 * state[:, nq + 3 : nq + 5]


def _tilt(state: Array) -> Array:
    """Lean (n, 2) [deg] of the pelvis's z axis towards x and y of W."""
    w, x, y, z = state[:, :4].T
    lean = 2.0 * np.column_stack((w * y + x * z, y * z - w * x))
    return np.degrees(np.arcsin(np.clip(lean, -1.0, 1.0)))
