"""Plots over time, and the common style of all plots: colours, axes, titles."""

import math
import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon

import nadia_balance.results.log as logs
from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Mode, Phase, Side
from nadia_balance.results import measurements as measured
from nadia_balance.results.log import Log, icp_error, pushes, signal

TEXT = "#2f3440"
FAINT = "#8a93a3"
_PUSH = {"color": palette.PUSH, "alpha": 0.3, "lw": 0}
RC = {
    "font.size": 9.0,
    "axes.edgecolor": FAINT,
    "axes.titlelocation": "left",
    "axes.titlesize": 10.5,
    "axes.titlepad": 5.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e7eaef",
    **dict.fromkeys(("axes.labelcolor", "axes.titlecolor", "text.color"), TEXT),
    **dict.fromkeys(("xtick.color", "ytick.color"), TEXT),
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "savefig.bbox": "tight",
    "savefig.dpi": 130,
    "savefig.pad_inches": 0.12,
}

# Groups of joints: a pattern of their names, for robots of several
# manufacturers, and a colour.  A joint is in the first one that fits.
GROUPS = {
    "hips": (r"hip|leg_hp", "#3b6fb6"),
    "knees": (r"knee|leg_kn", "#c2571a"),
    "ankles": (r"ankle|leg_ak", "#2b8a5f"),
    "spine": (r"spine|back", "#7a5ba6"),
    "arms": (r"", "#9aa3b2"),
}
SMALLEST_RANGE = 0.1  # smallest range of an axis of the ICP [m]
_AXES = {"to x, forward": "#3b6fb6", "to y, left": "#c2571a"}
CHANGED = 0.03  # larger changes of a duration show the planned one, too [s]
_SHORT = 20.0  # longest run whose durations are written [s]
_HEAD = "-|>,head_width=0.3,head_length=0.6"  # of arrows
_FOOT_Y = {Side.LEFT: 2.0, Side.RIGHT: 0.0}
_MODE_Y = -0.95  # of the strip of modes
_MODE_COLORS = {
    Mode.STANDING: "#cfd4dc",
    Mode.WALKING: "#7d8fb3",
    Mode.RECOVERING: "#d88a93",
}
# Parts of a velocity, and their colours.
_VELOCITY = {
    "forward [m/s]": "#3b6fb6",
    "left [m/s]": "#c2571a",
    "turn [rad/s]": "#2b8a5f",
}


def plan_view(ax: Axes, x: tuple, y: tuple, **more) -> None:
    """Makes `ax` a view from above, with the limits x and y [m]."""
    ax.set(xlim=x, ylim=y, aspect="equal", **more)
    ax.set(xlabel="x, forward [m]", ylabel="y, left [m]")


def time_axes(
    log: Log, summary: dict, what: str, heights: list[float], label=False
) -> tuple[Figure, list[Axes]]:
    """A figure with stacked axes of `heights` [in] over one time axis.

    Swings are shaded in the colour of the foot in the air, pushes are marked
    and, with `label`, labelled.  `what` is the first part of the title.
    """
    fig = Figure(figsize=(10.0, sum(heights) + 0.9), layout="constrained")
    shape = {"sharex": True, "squeeze": False, "height_ratios": heights}
    axes = fig.subplots(len(heights), **shape)[:, 0]
    swings = [s for s in logs.phase_spans(log) if s.phase is Phase.SWING]
    look = {s: {"color": palette.foot_color(s), "alpha": 0.12} for s in Side}
    for ax in axes:
        for span in swings:
            ax.axvspan(span.start, span.end, lw=0, **look[span.swing_side])
        for push in pushes(log):
            ax.axvspan(push.start, push.end, zorder=0, **_PUSH)
    axes[-1].set(xlabel="time [s]", xlim=(log["t"][0], log["t"][-1]))
    swung = [s for s in Side if s in {span.swing_side for span in swings}]
    named = [{"label": f"{s.value} foot swings", **look[s]} for s in swung]
    if pushes(log):
        named.append({"label": "push", **_PUSH})
    key(fig, [Patch(**one) for one in named])
    for push in pushes(log) if label else ():
        text = f"push {np.linalg.norm(push.force):.0f} N"
        place = (0.5 * (push.start + push.end), 1.0), (0, 3)
        units = ("data", "axes fraction"), "offset points"
        look = {"color": palette.PUSH, "fontsize": 8.5, "ha": "center"}
        # Clipped: only where the axes show that time.
        axes[0].annotate(text, *place, *units, annotation_clip=True, **look)
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


def fill(ax: Axes, polygon: Array, color: str, label=None, alpha=0.22, **style):
    """Draws a polygon (n, 2) [m] with a transparent fill and an opaque edge."""
    style = {"edgecolor": color, "linewidth": 1.4, **style}
    face = (*palette.rgb(color), alpha)
    ax.add_patch(Polygon(polygon, facecolor=face, label=label, **style))


def draw_sole(ax: Axes, corners, side: Side, alpha=0.0, **style) -> None:
    """Draws the `corners` (n, 2) [m] of a sole in the colour of its foot."""
    fill(ax, corners, palette.foot_color(side), alpha=alpha, **style)


def arrow(ax: Axes, start, end, color: str, width=2.0, style=_HEAD) -> None:
    """Draws an arrow from `start` to `end` (2,) [m]."""
    look = {"arrowstyle": style, "color": color, "linewidth": width}
    look |= {"shrinkA": 0, "shrinkB": 0}
    ax.annotate("", xy=end, xytext=start, arrowprops=look, zorder=5)


def draw_effort(log: Log, summary: dict) -> Figure | None:
    """Draws the available signals; None if the log has none."""
    rows = []  # height [in], label, and lines: values (n,), their look
    ratio, speed = 100.0 * measured.torque_ratio(log), measured.joint_speed(log)
    if ratio.size:
        lines = _largest_torques(ratio, log["actuator_names"])
        if np.max(ratio) > 60.0:
            look = {"color": palette.PUSH, "linestyle": "--"}
            lines.append((0.0 * log["t"] + 100.0, {"label": "limit", **look}))
        rows.append((2.2, "torque [% of limit]", lines))
    if speed.size:
        lines = [(np.max(speed, axis=1), {"color": TEXT})]
        rows.append((1.3, "fastest joint\n[rad/s]", lines))
    if "foot_forces" in log:
        forces, lines = signal(log, "foot_forces"), []
        for side in Side:
            look = {"color": palette.foot_color(side)}
            look["label"] = f"{side.value} foot"
            lines.append((getattr(forces, side.value), look))
        rows.append((1.8, "normal force [N]", lines))
    if not rows:
        return None
    heights = [height for height, *_ in rows]
    fig, axes = time_axes(log, summary, "Effort", heights)
    for ax, (_, label, lines) in zip(axes, rows, strict=True):
        for values, look in lines:
            ax.plot(log["t"], values, linewidth=1.1, **look)
        ax.set(ylabel=label, ylim=(0.0, None))
        if len(lines) > 1:
            _legend(ax, len(lines))
    return fig


def _largest_torques(ratio: Array, names: Array) -> list[tuple[Array, dict]]:
    """The largest ratio (n,) of each group of the joints, and its look."""
    groups = [
        next(g for g in GROUPS if re.search(GROUPS[g][0], name, re.I))
        for name in names
    ]
    return [
        (np.max(ratio[:, own], axis=1), {"color": color, "label": group})
        for group, (_, color) in GROUPS.items()
        if any(own := np.array(groups) == group)
    ]


def _legend(ax: Axes, columns: int, **what) -> None:
    look = {"borderpad": 0, "borderaxespad": 0.2, "ncols": columns, **what}
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), **look)


def draw_icp(log: Log, summary: dict) -> Figure | None:
    """Draws both coordinates with the CoP and CoM, and the error, if any."""
    if "icp" not in log:
        return None
    heights = [2.4, 2.4, 1.5]
    fig, (*axes, last) = time_axes(log, summary, "ICP", heights, label=True)
    cop, com = signal(log, "ecmp_command").cop, signal(log, "com_state")
    reference = signal(log, "icp_reference").icp
    for points, color, label, look in (
        (cop, palette.COP, "CoP", {"lw": 0.9, "alpha": 0.75}),
        (com.position[:2], palette.COM, "CoM", {"lw": 1.1}),
        (reference, palette.ICP_REFERENCE, "ICP reference", {"lw": 3.0}),
        (log["icp"].T, palette.ICP, "ICP", {}),
    ):
        for ax, part in zip(axes, points, strict=True):
            ax.plot(log["t"], part, color=color, label=label, **look)
    for ax, name in zip(axes, ("x, forward [m]", "y, left [m]"), strict=True):
        # A smallest range, so that noise of millimetres does not fill the axis.
        low, high = ax.get_ylim()
        more = 0.5 * max(0.0, SMALLEST_RANGE - (high - low))
        ax.set(ylabel=name, ylim=(low - more, high + more))
    where = {"loc": "upper left", "bbox_to_anchor": (0.0, 1.14)}
    axes[1].legend(ncols=4, borderpad=0, **where)
    error, limit = 1000.0 * icp_error(log), 1000.0 * measured.ICP_BACK
    last.fill_between(log["t"], error, color=palette.ICP, alpha=0.2, lw=0)
    last.plot(log["t"], error, color=palette.ICP)
    last.set(ylabel="ICP error [mm]", ylim=(0.0, None))
    if max(error) > 0.5 * limit:
        last.axhline(limit, color=FAINT, linewidth=1.0, linestyle="--")
        text = f"{limit:.0f} mm: recovered below"
        units = ("axes fraction", "data"), "offset points"
        look = {"fontsize": 8, "color": FAINT, "ha": "right"}
        last.annotate(text, (1.0, limit), (-4, 3), *units, **look)
    return fig


def draw_estimate(log: Log, summary: dict) -> Figure | None:
    """Draws the estimate, 3 standard deviations and, if known, the error."""
    if "estimate_covariance" not in log:
        return None
    t, told, known = log["t"], log["estimated_state"], "state" in log
    heights = [1.8, 1.3] if known else [1.8]
    fig, axes = time_axes(log, summary, "Estimate", 2 * heights, label=True)
    variances = log["estimate_covariance"][:, ::10]  # the diagonal of (9, 9)
    v = (told.shape[1] + 1) // 2 + 3  # the pelvis' velocity along x, then y
    for kind, unit, scale, value, columns in (
        ("velocity", "mm/s", 1e3, lambda x: 1e3 * x[:, v : v + 2], (3, 4)),
        ("tilt", "deg", np.degrees(1.0), _tilt, (1, 0)),
    ):
        band = 3.0 * scale * np.sqrt(variances[:, columns])
        rows, axes = axes[: len(heights)], axes[len(heights) :]
        estimated = value(told)
        if known:
            truth = value(log["state"])
            look = {"color": FAINT, "lw": 3.0, "alpha": 0.6}
            rows[0].plot(t, truth, label=["truth", None], **look)
            _draw_estimate(rows[1], t, estimated - truth, 0.0 * truth, band)
            rows[1].set_ylabel(f"error and\n3 sigma [{unit}]")
        _draw_estimate(rows[0], t, estimated, estimated, band)
        rows[0].set_ylabel(f"{kind} [{unit}]")
        rows[0].legend(ncols=3, loc="upper right")
    return fig


def _draw_estimate(ax: Axes, t: Array, line: Array, middle, band) -> None:
    """Draws both parts of `line` (n, 2), and `band` about `middle`."""
    for axis, (label, color) in enumerate(_AXES.items()):
        low, high = (middle - band)[:, axis], (middle + band)[:, axis]
        ax.fill_between(t, low, high, color=color, alpha=0.2, lw=0)
        ax.plot(t, line[:, axis], color=color, lw=1.1, label=label)


def _tilt(state: Array) -> Array:
    """Lean (n, 2) [deg] of the pelvis's z axis towards x and y of W."""
    w, x, y, z = state[:, :4].T
    lean = 2.0 * np.column_stack((w * y + x * z, y * z - w * x))
    return np.degrees(np.arcsin(np.clip(lean, -1.0, 1.0)))


def draw_contacts(log: Log, summary: dict) -> Figure:
    """Draws planned (pale) and measured contacts, with durations [s].

    Those of a swing are where its foot is in the air, and below them in
    brackets as planned, if that was changed.  Below the feet is the mode, and
    below that the velocity commanded, if one is, and walked.
    """
    modes, commanded = logs.mode_spans(log), logs.velocity_commands(log)
    heights = [2.4 + 0.3 * bool(modes), *([1.5] if commanded else [])]
    fig, axes = time_axes(log, summary, "Contacts", heights, label=True)
    ax = axes[0]
    spans = logs.phase_spans(log)
    for side, y in _FOOT_Y.items():
        look = {"facecolor": palette.foot_color(side), "lw": 0}
        plan = [(s.start, s.duration) for s in spans if s.carries(side)]
        ax.broken_barh(plan, (y + 0.02, 0.4), alpha=0.3, **look)
        if "foot_forces" in log:
            ax.broken_barh(logs.contacts(log, side), (y - 0.42, 0.4), **look)
    places = {side.value: y for side, y in _FOOT_Y.items()}
    if modes:
        places["mode"] = _MODE_Y
        for span in modes:
            bar = [(span.start, span.end - span.start)]
            look = {"color": _MODE_COLORS[span.mode], "lw": 0, "zorder": 3}
            ax.broken_barh(bar, (_MODE_Y - 0.12, 0.24), **look)
    ax.set(ylim=(min(places.values()) - (0.25 if modes else 0.6), 2.6))
    ax.set_yticks([*places.values()], [*places])
    ax.grid(axis="y", visible=False)
    bars = [Patch(color=FAINT, alpha=0.3, label="as planned")] if spans else []
    bars.append(Patch(color=FAINT, label="as measured"))
    seen = {span.mode for span in modes}
    for mode in filter(seen.__contains__, Mode):
        bars.append(Patch(color=_MODE_COLORS[mode], label=mode.value))
    _legend(ax, len(bars), handles=bars)
    for panel in axes[1:]:
        _draw_velocity(panel, log)
    for span in spans if np.ptp(log["t"]) < _SHORT else ():
        if not span.complete or span.phase is Phase.STANDING:
            continue
        text, y = f"{span.duration:.2f}", _FOOT_Y[span.swing_side]
        if abs(span.duration - span.planned) > CHANGED:
            text += f"\n({span.planned:.2f})" * math.isfinite(span.planned)
        look = {"color": palette.foot_color(span.swing_side), "fontsize": 7.5}
        if span.phase is Phase.TRANSFER:
            # Transfers to the left and to the right foot have a line each: the
            # times before and after a short step would overlap.
            y, look["color"] = 1.0 + 0.3 * span.swing_side.sign, TEXT
        where = 0.5 * (span.start + span.end), y
        ax.text(*where, text, ha="center", va="center", **look)
    return fig


def _draw_velocity(ax: Axes, log: Log) -> None:
    """Draws the velocity commanded, and walked, if it is known."""
    walked = measured.walked_velocity(log)
    told = log["velocity_command"]
    for i, (name, color) in enumerate(_VELOCITY.items()):
        look = {"color": color, "drawstyle": "steps-post"}
        ax.plot(log["t"], told[:, i], lw=3.0, alpha=0.35, **look)
        if walked is None:
            ax.lines[-1].set_label(name)
        else:
            ax.plot(log["t"], walked[0][:, i], color=color, lw=1.2, label=name)
    ax.set(ylabel="velocity\ncommanded" + "\nand walked" * bool(walked))
    _legend(ax, len(_VELOCITY))
    if walked is not None:
        text = f"pale: commanded; walked: mean of the last {walked[1]:.1f} s"
        units = "axes fraction", "offset points"
        look = {"fontsize": 8, "color": FAINT}
        ax.annotate(text, (0.0, 1.0), (2, 3), *units, **look)
