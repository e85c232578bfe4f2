"""Plots over time: contacts, torques, speeds, forces, QPs; ICP; estimate."""

import math
import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.vocabulary import Phase, Side
from nadia_balance.results import log as logs
from nadia_balance.results import measurements as measured
from nadia_balance.results.log import QP_STATUS, Log, icp_error, signal
from nadia_balance.results.plots import style
from nadia_balance.results.plots.style import FAINT, RC, TEXT, time_axes

# Patterns of joint names per group, for robots of several manufacturers.
GROUPS = {
    "hips": r"hip|leg_hp",
    "knees": r"knee|leg_kn",
    "ankles": r"ankle|leg_ak",
    "spine": r"spine|back",
    "arms": r"",
}
_GROUP_COLORS = ("#3b6fb6", "#c2571a", "#2b8a5f", "#7a5ba6", "#9aa3b2")
_QP_COLORS = dict(zip(QP_STATUS, ("#7a5ba6", "#2b8a5f"), strict=True))
SMALLEST_RANGE = 0.1  # smallest range of an axis of the ICP [m]
_AXES = {"to x, forward": "#3b6fb6", "to y, left": "#c2571a"}
_BAND = 0.2  # opacity of 3 standard deviations
CHANGED = 0.03  # larger changes of a duration show the planned one, too [s]
_WIDTH, _MAX_ROWS, _ROW_SECONDS = 12.0, 6, 10.0
_FOOT_Y = {Side.LEFT: 2.0, Side.RIGHT: 0.0}
_PLAN, _MEASURED = (0.02, 0.42), (-0.42, -0.02)  # lanes of a foot
_LABEL_Y, _LINE = (1.36, 0.82), 0.27  # lanes of the durations, their lines
_NUMBER = {"ls": "none", "ms": 22}  # in the legend
_PALE = 0.3  # opacity of planned contacts
_LETTER = RC["font.size"] / 72.0 * 0.6  # width of a letter [in]


def draw_effort(log: Log, summary: dict) -> Figure | None:
    """Draws the available signals; None if the log has none."""
    rows = {
        _draw_torques: 2.2 * (measured.torque_ratio(log).size > 0),
        _draw_speed: 1.3 * (measured.joint_speed(log).size > 0),
        _draw_forces: 1.8 * ("foot_forces" in log),
        _draw_qps: 1.5 * any(name in log for name in QP_STATUS),
    }
    rows = {draw_row: height for draw_row, height in rows.items() if height}
    if not rows:
        return None
    fig, axes = time_axes(log, summary, "Effort", list(rows.values()))
    for ax, draw_row in zip(axes, rows, strict=True):
        draw_row(ax, log)
    return fig


def joint_groups(names: np.ndarray) -> dict[str, np.ndarray]:
    """Returns group -> indices of its joints; each joint is in one group."""
    groups: dict[str, list[int]] = {group: [] for group in GROUPS}
    for i, name in enumerate(names):
        found = (g for g in GROUPS if re.search(GROUPS[g], name, re.I))
        groups[next(found)].append(i)
    return {g: np.array(members) for g, members in groups.items() if members}


def _draw_torques(ax: Axes, log: Log) -> None:
    """Draws the largest torque ratio of each group of joints."""
    ratio = 100.0 * measured.torque_ratio(log)
    groups = joint_groups(log["actuator_names"])
    looks = zip(groups.items(), _GROUP_COLORS, strict=False)
    for (group, members), color in looks:
        largest = np.max(ratio[:, members], axis=1)
        ax.plot(log["t"], largest, color=color, linewidth=1.1, label=group)
    if np.max(ratio) > 60.0:
        look = {"color": palette.PUSH, "linewidth": 1.0, "linestyle": "--"}
        ax.axhline(100.0, label="limit", **look)
    ax.set(ylabel="torque [% of limit]", ylim=(0.0, None))
    _legend(ax, len(groups) + 1)


def _draw_speed(ax: Axes, log: Log) -> None:
    speed = np.max(measured.joint_speed(log), axis=1)
    ax.plot(log["t"], speed, color=TEXT, linewidth=1.1)
    ax.set(ylabel="fastest joint\n[rad/s]", ylim=(0.0, None))


def _draw_forces(ax: Axes, log: Log) -> None:
    forces = signal(log, "foot_forces")
    for side in Side:
        look = {"color": palette.foot_color(side), "linewidth": 1.1}
        look["label"] = f"{side.value} foot"
        ax.plot(log["t"], getattr(forces, side.value), **look)
    ax.set(ylabel="normal force [N]", ylim=(0.0, None))
    _legend(ax, 2)


def _draw_qps(ax: Axes, log: Log) -> None:
    """Draws constraint violations; marks what Clarabel, or no one, solved."""
    t = log["t"]
    floor = 1e-16  # makes exact solutions visible on the logarithmic axis
    for name in filter(log.__contains__, QP_STATUS):
        qp = signal(log, name)
        label = name.removesuffix("_qp_status").replace("_", "-") + " QP"
        violation, color = np.maximum(qp.violation, floor), _QP_COLORS[name]
        ax.semilogy(t, violation, color=color, linewidth=1.0, label=label)
        _mark(ax, t[qp.fallback > 0.5], palette.ECMP, "by Clarabel")
        _mark(ax, t[qp.solved < 0.5], palette.PUSH, "torques held")
    ax.set(ylabel="QP violation")
    _legend(ax, 4)


def _mark(ax: Axes, times: np.ndarray, color: str, label: str) -> None:
    if len(times):
        look = {"color": color, "ms": 9, "label": f"{label} ({len(times)})"}
        look["transform"] = ax.get_xaxis_transform()
        ax.plot(times, np.full(len(times), 0.93), "|", **look)


def _legend(ax: Axes, columns: int) -> None:
    look = {"borderpad": 0, "borderaxespad": 0.2, "ncols": columns}
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), **look)


def draw_icp(log: Log, summary: dict) -> Figure | None:
    """Draws both coordinates with the CoP and CoM, and the error, if any."""
    if "icp" not in log:
        return None
    fig, axes = time_axes(log, summary, "ICP", [2.4, 2.4, 1.5], label=True)
    for axis, name in enumerate(("x, forward [m]", "y, left [m]")):
        _draw_icp(axes[axis], log, axis)
        axes[axis].set_ylabel(name)
    where = {"loc": "upper left", "bbox_to_anchor": (0.0, 1.14)}
    axes[1].legend(ncols=4, borderpad=0, **where)
    _draw_icp_error(axes[2], log)
    return fig


def _draw_icp(ax: Axes, log: Log, axis: int) -> None:
    """Draws x (`axis` 0) or y (1)."""
    cop = signal(log, "ecmp_command").cop
    com = signal(log, "com_state").position
    reference = signal(log, "icp_reference").icp
    for point, color, label, look in (
        (cop, palette.COP, "CoP", {"lw": 0.9, "alpha": 0.75}),
        (com, palette.COM, "CoM", {"lw": 1.1}),
        (reference, palette.ICP_REFERENCE, "ICP reference", {"lw": 3.0}),
        (log["icp"].T, palette.ICP, "ICP", {}),
    ):
        ax.plot(log["t"], point[axis], color=color, label=label, **look)
    # A smallest range, so that noise of millimetres does not fill the axis.
    low, high = ax.get_ylim()
    missing = max(0.0, SMALLEST_RANGE - (high - low))
    ax.set_ylim(low - 0.5 * missing, high + 0.5 * missing)


def _draw_icp_error(ax: Axes, log: Log) -> None:
    error = 1000.0 * icp_error(log)
    limit = 1000.0 * measured.ICP_BACK
    ax.fill_between(log["t"], error, color=palette.ICP, alpha=0.2, linewidth=0)
    ax.plot(log["t"], error, color=palette.ICP)
    ax.set(ylabel="ICP error [mm]", ylim=(0.0, None))
    if max(error) > 0.5 * limit:
        ax.axhline(limit, color=FAINT, linewidth=1.0, linestyle="--")
        where = {"xytext": (-4, 3), "textcoords": "offset points"}
        where |= {"xycoords": ("axes fraction", "data"), "ha": "right"}
        look = {"fontsize": 8, "color": FAINT}
        text = f"{limit:.0f} mm: recovered below"
        ax.annotate(text, (1.0, limit), **where, **look)


def draw_estimate(log: Log, summary: dict) -> Figure | None:
    """Draws the estimate, 3 standard deviations and, if known, the error."""
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
            _draw_estimate(rows[1], log, estimated - truth, 0.0 * truth, band)
            rows[1].set_ylabel(f"error and\n3 sigma [{unit}]")
        _draw_estimate(rows[0], log, estimated, estimated, band)
        rows[0].set_ylabel(f"{kind} [{unit}]")
        rows[0].legend(ncols=3, loc="upper right")
    return fig


def _draw_estimate(
    ax: Axes, log: Log, line: Array, middle: Array, band: Array
) -> None:
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


def draw_contacts(log: Log, summary: dict) -> Figure:
    """Draws planned and measured contacts of both feet, with durations."""
    t = log["t"]
    total = max(t[-1] - t[0], 1e-3)
    rows = min(max(round(total / _ROW_SECONDS), 1), _MAX_ROWS)
    fig = Figure(figsize=(_WIDTH, 1.0 + 1.75 * rows), layout="constrained")
    axes = np.atleast_1d(fig.subplots(rows, 1, squeeze=True))
    seconds = total / rows
    spans = logs.phase_spans(log)
    for i, ax in enumerate(axes):
        begin = t[0] + i * seconds
        _draw_row(ax, log, spans, begin, begin + seconds)
        style.mark_pushes(ax, log, label=True)
    axes[-1].set_xlabel("time [s]")
    _add_key(fig, log)
    style.set_title(fig, summary, "Contacts")
    return fig


def _add_key(fig: Figure, log: Log) -> None:
    """Adds the legend of bars and numbers below the axes."""
    planned = "walking_signal" in log
    bars = [Patch(color=FAINT, alpha=_PALE, label="contact as planned")]
    bars = bars if planned else []
    if "foot_forces" in log:
        label = "as measured" if planned else "contact as measured"
        bars.append(Patch(color=FAINT, label=label))
    numbers = [
        Line2D([], [], color=color, marker=f"${text}$", label=label, **_NUMBER)
        for text, color, label in (
            ("0.54", palette.RIGHT, "swing [s], in the colour of its foot"),
            ("0.54", TEXT, "transfer [s]"),
            ("(0.70)", FAINT, "as planned, if changed"),
        )
        if planned
    ]
    style.key(fig, [*bars, *numbers, *style.push_key(log)])


def _draw_row(
    ax: Axes, log: Log, spans: list[logs.PhaseSpan], begin: float, end: float
) -> None:
    ax.set_xlim(begin, end)
    ax.set_ylim(-0.6, 2.6)
    ax.set_yticks([_FOOT_Y[s] for s in Side], [s.value for s in Side])
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    ax.grid(axis="y", visible=False)
    for side in Side:
        plan = [(s.start, s.duration) for s in spans if s.carries(side)]
        _bars(ax, plan, _FOOT_Y[side], _PLAN, side, _PALE)
        if "foot_forces" in log:
            _bars(
                ax,
                logs.contacts(log, side),
                _FOOT_Y[side],
                _MEASURED,
                side,
                1.0,
            )
    inches = _WIDTH * 0.9 / (end - begin)
    free = [-math.inf] * len(_LABEL_Y)  # end of each lane's last label [s]
    for span in spans:
        if begin <= 0.5 * (span.start + span.end) < end:
            _write_duration(ax, span, inches, free)


def _bars(ax: Axes, bars, y: float, lane, side: Side, alpha: float) -> None:
    look = {"facecolor": palette.foot_color(side), "alpha": alpha, "lw": 0}
    ax.broken_barh(bars, (y + lane[0], lane[1] - lane[0]), **look)


def _write_duration(
    ax: Axes, span: logs.PhaseSpan, inches: float, free: list[float]
) -> None:
    """Writes the duration of a phase between the feet, if there is room.

    `inches` is the width of a second on paper.  Labels that would overlap
    alternate between the lanes; `free` is updated.
    """
    if span.phase is Phase.STANDING or not span.complete:
        return
    changed = abs(span.duration - span.planned) > CHANGED
    lines = [f"{span.duration:.2f}"]
    if changed and math.isfinite(span.planned):
        lines.append(f"({span.planned:.2f})")
    width = max(map(len, lines)) * _LETTER / inches
    if not changed and span.duration < width:
        return
    middle = 0.5 * (span.start + span.end)
    begins = middle - 0.5 * width
    lane = next((i for i, t in enumerate(free) if t <= begins), None)
    if lane is None:
        lane = free.index(min(free))
    free[lane] = middle + 0.5 * width
    swing = span.phase is Phase.SWING
    color = palette.foot_color(span.swing_side) if swing else TEXT
    looks = (
        {"color": color, "weight": "bold" if changed else "normal"},
        {"color": FAINT, "fontsize": 7.5},
    )
    for row, (text, look) in enumerate(zip(lines, looks, strict=False)):
        y = _LABEL_Y[lane] - row * _LINE
        ax.text(middle, y, text, ha="center", va="center", **look)
