"""Plots over time: contacts, ICP, effort, estimate."""

import math
import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Mode, Phase, Side
from nadia_balance.results.log import (
    Log,
    PhaseSpan,
    PushSpan,
    contacts,
    foot_part,
    icp_error,
    mode_spans,
    phase_spans,
    pushes,
    signal_view,
    velocity_commands,
)
from nadia_balance.results.measurements import (
    ICP_BACK,
    joint_speed_ratio,
    torque_ratio,
    walked_velocity,
)
from nadia_balance.results.plots.style import FAINT, TEXT, key, title

# Groups of joints: a pattern of their names, for robots of several
# manufacturers, and a colour.  A joint is in the first one that fits.
GROUPS = {
    "hips": (r"hip|leg_hp", "#2456b4"),
    "knees": (r"knee|leg_kn", "#d9731a"),
    "ankles": (r"ankle|leg_ak", "#52b58a"),
    "waist": (r"spine|back|waist|torso", "#3d1152"),
    "arms": (r"", "#9aa3b2"),
}
SMALLEST_RANGE = 0.1  # smallest range of an axis of the ICP [m]
_AXES = {"to x, forward": "#2456b4", "to y, left": "#d9731a"}
CHANGED = 0.03  # larger changes of a duration show the planned one, too [s]
_SHORT = 20.0  # longest run whose durations are written [s]
MOST_LABELS = 12  # of pushes
_SWING, _PUSH = 0.08, 0.25  # opacities of the shades of swings and pushes
_BAR = 0.965  # where the bars above them begin [height of the axes]
_FOOT_Y = {Side.LEFT: 2.0, Side.RIGHT: 0.0}
_MODE_Y = -0.95  # of the strip of modes
_MODE_COLORS = {
    Mode.STANDING: "#cfd4dc",
    Mode.WALKING: "#7d8fb3",
    Mode.RECOVERING: "#d88a93",
}
# Parts of a velocity, and their colours.
_VELOCITY = {
    "forward [m/s]": "#2456b4",
    "left [m/s]": "#d9731a",
    "turn [rad/s]": "#52b58a",
}


def time_axes(
    log: Log,
    summary: dict[str, Any],
    name: str,
    heights: Sequence[float],
    label: bool = False,
) -> tuple[Figure, list[Axes]]:
    """Makes a figure with stacked axes over one time axis.

    Swings are shaded, below a bar in the colour of the foot in the air, and so
    are pushes.

    Args:
        log: log of a run.
        summary: summary of the run.
        name: name of the plot, the first part of its title.
        heights: heights of the axes, from above [in].
        label: whether the pushes are labelled with their force.

    Returns:
        The figure and its axes, from above.
    """
    fig = Figure(figsize=(10.0, sum(heights) + 0.9), layout="constrained")
    axes = fig.subplots(
        len(heights), sharex=True, squeeze=False, height_ratios=heights
    )[:, 0]
    swings = [span for span in phase_spans(log) if span.phase is Phase.SWING]
    for ax in axes:
        _shade(ax, log, swings)
    axes[-1].set(xlabel="time [s]", xlim=(log["t"][0], log["t"][-1]))
    key(fig, _key_to_shades(log, swings))
    if label:
        _label_pushes(axes[0], log)
    fig.suptitle(
        title(summary, name), x=0.01, ha="left", fontsize=10.5, color=TEXT
    )
    return fig, list(axes)


def _shade(ax: Axes, log: Log, swings: list[PhaseSpan]) -> None:
    """Shades swings and pushes, with a bar of their colour at the top."""
    spans: list[tuple[PhaseSpan | PushSpan, str, float]] = [
        *(
            (swing, palette.foot_color(swing.swing_side), _SWING)
            for swing in swings
        ),
        *((push, palette.PUSH, _PUSH) for push in pushes(log)),
    ]
    for span, color, alpha in spans:
        ax.axvspan(
            span.start, span.end, zorder=0, lw=0, color=color, alpha=alpha
        )
        ax.axvspan(span.start, span.end, ymin=_BAR, lw=0, color=color)


def _key_to_shades(log: Log, swings: list[PhaseSpan]) -> list[Patch]:
    return [
        *(
            Patch(
                label=f"{side.value} foot swings",
                color=palette.foot_color(side),
            )
            for side in Side
            if any(span.swing_side is side for span in swings)
        ),
        *([Patch(label="push", color=palette.PUSH)] if pushes(log) else []),
    ]


def _label_pushes(ax: Axes, log: Log) -> None:
    labelled = pushes(log)
    if len(labelled) > MOST_LABELS:
        return  # one would hide the other
    for push in labelled:
        ax.annotate(
            f"push {np.linalg.norm(push.force):.0f} N",
            xy=(0.5 * (push.start + push.end), 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            annotation_clip=True,  # only where the axes show that time
            color=palette.PUSH,
            fontsize=8.5,
            ha="center",
        )


def _legend(
    ax: Axes, columns: int, handles: list[Artist] | None = None
) -> None:
    """Adds a legend above the right end of the axes."""
    ax.legend(
        handles=handles,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderpad=0,
        borderaxespad=0.2,
        ncols=columns,
    )


def draw_effort(log: Log, summary: dict[str, Any]) -> Figure | None:
    """Draws torques and speeds of joints, and forces on the feet, if logged.

    Args:
        log: log of a run.
        summary: summary of the run.

    Returns:
        The figure; None if the log has none of them.
    """
    torques, speeds = torque_ratio(log), joint_speed_ratio(log)
    panels = [
        (height, draw)
        for is_logged, height, draw in (
            (torques.size, 2.2, partial(_draw_shares, "torque", torques)),
            (speeds.size, 2.0, partial(_draw_shares, "speed", speeds)),
            ("foot_forces" in log, 1.8, _draw_forces),
        )
        if is_logged
    ]
    if not panels:
        return None
    fig, axes = time_axes(
        log, summary, "Effort", [height for height, _ in panels]
    )
    for ax, (_, draw) in zip(axes, panels, strict=True):
        draw(ax, log)
        ax.set_ylim(0.0, None)
        if len(ax.lines) > 1:
            _legend(ax, len(ax.lines))
    return fig


def _draw_shares(quantity: str, ratio: Array, ax: Axes, log: Log) -> None:
    """Draws the largest one of each group, of a ratio (n, nu) to its limit."""
    t, percent = log["t"], 100.0 * ratio
    groups = np.array([_group_of(name) for name in log["actuator_names"]])
    for group, (_, color) in GROUPS.items():
        if np.any(groups == group):
            ax.plot(
                t,
                np.max(percent[:, groups == group], axis=1),
                linewidth=1.1,
                color=color,
                label=group,
            )
    ax.plot(
        t,
        0.0 * t + 100.0,
        linewidth=1.1,
        color=palette.PUSH,
        linestyle="--",
        label="limit",
    )
    ax.set_ylabel(f"{quantity} [% of limit]")


def _group_of(joint: str) -> str:
    """The group of GROUPS that a joint is in, by its name."""
    return next(
        group
        for group, (pattern, _) in GROUPS.items()
        if re.search(pattern, joint, re.IGNORECASE)
    )


def _draw_forces(ax: Axes, log: Log) -> None:
    for side in Side:
        ax.plot(
            log["t"],
            foot_part(signal_view(log, "foot_forces"), side),
            linewidth=1.1,
            color=palette.foot_color(side),
            label=f"{side.value} foot",
        )
    ax.set_ylabel("normal force [N]")


def draw_icp(log: Log, summary: dict[str, Any]) -> Figure | None:
    """Draws the ICP, its reference, CoP and CoM, and the ICP error.

    Args:
        log: log of a run.
        summary: summary of the run.

    Returns:
        The figure; None if no ICP is logged.
    """
    if "icp" not in log:
        return None
    fig, (x, y, error) = time_axes(
        log, summary, "ICP", heights=[2.4, 2.4, 1.5], label=True
    )
    _draw_coordinate(x, log, 0, "x, forward [m]")
    _draw_coordinate(y, log, 1, "y, left [m]")
    y.legend(ncols=4, borderpad=0, loc="upper left", bbox_to_anchor=(0.0, 1.14))
    _draw_icp_error(error, log)
    return fig


def _draw_coordinate(ax: Axes, log: Log, axis: int, label: str) -> None:
    """Draws the points' coordinate of this number."""
    t = log["t"]
    ax.plot(
        t,
        signal_view(log, "ecmp_command").cop[axis],
        color=palette.COP,
        label="CoP",
        lw=0.9,
        alpha=0.75,
    )
    ax.plot(
        t,
        signal_view(log, "com_state").position[axis],
        color=palette.COM,
        label="CoM",
        lw=1.1,
    )
    ax.plot(
        t,
        signal_view(log, "icp_reference").icp[axis],
        color=palette.ICP_REFERENCE,
        label="ICP reference",
        lw=3.0,
    )
    ax.plot(t, log["icp"][:, axis], color=palette.ICP, label="ICP")
    # A smallest range, so that noise of millimetres does not fill the axis.
    low, high = ax.get_ylim()
    more = 0.5 * max(0.0, SMALLEST_RANGE - (high - low))
    ax.set(ylabel=label, ylim=(low - more, high + more))


def _draw_icp_error(ax: Axes, log: Log) -> None:
    error, limit = 1000.0 * icp_error(log), 1000.0 * ICP_BACK
    ax.fill_between(log["t"], error, color=palette.ICP, alpha=0.2, lw=0)
    ax.plot(log["t"], error, color=palette.ICP)
    ax.set(ylabel="ICP error [mm]", ylim=(0.0, None))
    if max(error) > 0.5 * limit:
        ax.axhline(limit, color=FAINT, linewidth=1.0, linestyle="--")
        ax.annotate(
            f"{limit:.0f} mm: recovered below",
            xy=(1.0, limit),
            xycoords=("axes fraction", "data"),
            xytext=(-4, 3),
            textcoords="offset points",
            fontsize=8,
            color=FAINT,
            ha="right",
        )


def draw_estimate(log: Log, summary: dict[str, Any]) -> Figure | None:
    """Draws the estimate, 3 standard deviations and, if logged, the error.

    Args:
        log: log of a run.
        summary: summary of the run.

    Returns:
        The figure; None if no estimate is logged.
    """
    if "estimate_covariance" not in log:
        return None
    heights = [1.8, 1.3] if "state" in log else [1.8]
    fig, axes = time_axes(log, summary, "Estimate", 2 * heights, label=True)
    sigma = np.sqrt(log["estimate_covariance"][:, ::10])  # diagonal of (9, 9)
    _draw_part(
        axes[: len(heights)],
        log,
        part=_velocity,
        band=3.0 * 1e3 * sigma[:, (3, 4)],
        name="velocity",
        unit="mm/s",
    )
    _draw_part(
        axes[len(heights) :],
        log,
        part=_tilt,
        band=3.0 * np.degrees(1.0) * sigma[:, (1, 0)],
        name="tilt",
        unit="deg",
    )
    return fig


def _draw_part(
    panels: Sequence[Axes],
    log: Log,
    part: Callable[[Array], Array],
    band: Array,
    name: str,
    unit: str,
) -> None:
    """Draws a part (n, 2) of the state, and below it its error, if logged."""
    t, estimated = log["t"], part(log["estimated_state"])
    if "state" in log:
        truth = part(log["state"])
        panels[0].plot(
            t, truth, label=["truth", None], color=FAINT, lw=3.0, alpha=0.6
        )
        _draw_band(panels[1], t, estimated - truth, 0.0 * truth, band)
        panels[1].set_ylabel(f"error and\n3 sigma [{unit}]")
    _draw_band(panels[0], t, estimated, estimated, band)
    panels[0].set_ylabel(f"{name} [{unit}]")
    panels[0].legend(ncols=3, loc="upper right")


def _draw_band(
    ax: Axes, t: Array, line: Array, middle: Array, band: Array
) -> None:
    """Draws both parts of `line` (n, 2), and `band` about `middle`."""
    for axis, (label, color) in enumerate(_AXES.items()):
        low, high = (middle - band)[:, axis], (middle + band)[:, axis]
        ax.fill_between(t, low, high, color=color, alpha=0.2, lw=0)
        ax.plot(t, line[:, axis], color=color, lw=1.1, label=label)


def _velocity(state: Array) -> Array:
    """Velocity (n, 2) [mm/s] of the pelvis along x and y of W."""
    column = (state.shape[1] + 1) // 2 + 3
    return np.asarray(1e3 * state[:, column : column + 2])


def _tilt(state: Array) -> Array:
    """Lean (n, 2) [deg] of the pelvis's z axis towards x and y of W."""
    w, x, y, z = state[:, :4].T
    lean = 2.0 * np.column_stack((w * y + x * z, y * z - w * x))
    return np.asarray(np.degrees(np.arcsin(np.clip(lean, -1.0, 1.0))))


def draw_contacts(log: Log, summary: dict[str, Any]) -> Figure:
    """Draws planned (pale) and measured contacts, with durations [s].

    Those of a swing are where its foot is in the air, and below them in
    brackets as planned, if that was changed.  Below the feet is the mode, and
    below that the velocity commanded, if one is, and walked.

    Args:
        log: log of a run.
        summary: summary of the run.

    Returns:
        The figure.
    """
    modes, commands = mode_spans(log), velocity_commands(log)
    fig, (ax, *others) = time_axes(
        log,
        summary,
        "Contacts",
        heights=[2.4 + 0.3 * bool(modes), *([1.5] if commands else [])],
        label=True,
    )
    spans = phase_spans(log)
    _draw_feet(ax, log, spans)
    rows = {side.value: y for side, y in _FOOT_Y.items()}
    if modes:
        rows["mode"] = _MODE_Y
    for span in modes:
        ax.broken_barh(
            [(span.start, span.end - span.start)],
            (_MODE_Y - 0.12, 0.24),
            color=_MODE_COLORS[span.mode],
            lw=0,
            zorder=3,
        )
    ax.set(ylim=(min(rows.values()) - (0.25 if modes else 0.6), 2.6))
    ax.set_yticks([*rows.values()], [*rows])
    ax.grid(axis="y", visible=False)
    bars = _key_to_bars(bool(spans), {span.mode for span in modes})
    _legend(ax, len(bars), bars)
    if others:
        _draw_velocity(others[0], log)
    if np.ptp(log["t"]) < _SHORT:
        _write_durations(ax, spans)
    return fig


def _draw_feet(ax: Axes, log: Log, spans: list[PhaseSpan]) -> None:
    """Draws the planned and the measured contacts of both feet."""
    for side, y in _FOOT_Y.items():
        color = palette.foot_color(side)
        ax.broken_barh(
            [(s.start, s.duration) for s in spans if s.carries(side)],
            (y + 0.02, 0.4),
            alpha=0.3,
            facecolor=color,
            lw=0,
        )
        if "foot_forces" in log:
            ax.broken_barh(
                contacts(log, side), (y - 0.42, 0.4), facecolor=color, lw=0
            )


def _key_to_bars(are_planned: bool, modes: set[Mode]) -> list[Artist]:
    """The entries of the legend: contacts, and the modes that there are."""
    return [
        *(
            [Patch(color=FAINT, alpha=0.3, label="as planned")]
            if are_planned
            else []
        ),
        Patch(color=FAINT, label="as measured"),
        *(
            Patch(color=_MODE_COLORS[mode], label=mode.value)
            for mode in Mode
            if mode in modes
        ),
    ]


def _write_durations(ax: Axes, spans: list[PhaseSpan]) -> None:
    for span in spans:
        if not span.complete or span.phase is Phase.STANDING:
            continue
        text = f"{span.duration:.2f}"
        if abs(span.duration - span.planned) > CHANGED:
            text += f"\n({span.planned:.2f})" * math.isfinite(span.planned)
        y, color = _FOOT_Y[span.swing_side], palette.foot_color(span.swing_side)
        if span.phase is Phase.TRANSFER:
            # Transfers to the left and to the right foot have a line each: the
            # times before and after a short step would overlap.
            y, color = 1.0 + 0.3 * span.swing_side.sign, TEXT
        ax.text(
            0.5 * (span.start + span.end),
            y,
            text,
            ha="center",
            va="center",
            color=color,
            fontsize=7.5,
            # Wider than its gap, it would vanish on bars of its colour.
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
        )


def _draw_velocity(ax: Axes, log: Log) -> None:
    """Draws the velocity commanded, and walked, if it is known."""
    t, commanded = log["t"], log["velocity_command"]
    walked = walked_velocity(log)
    for i, (name, color) in enumerate(_VELOCITY.items()):
        ax.plot(
            t,
            commanded[:, i],
            lw=3.0,
            alpha=0.35,
            color=color,
            drawstyle="steps-post",
            label=name if walked is None else None,
        )
        if walked is not None:
            ax.plot(t, walked[0][:, i], color=color, lw=1.2, label=name)
    ax.set(ylabel="velocity\ncommanded" + "\nand walked" * bool(walked))
    _legend(ax, len(_VELOCITY))
    if walked is not None:
        ax.annotate(
            f"pale: commanded; walked: mean of the last {walked[1]:.1f} s",
            xy=(0.0, 1.0),
            xycoords="axes fraction",
            xytext=(2, 3),
            textcoords="offset points",
            fontsize=8,
            color=FAINT,
        )
