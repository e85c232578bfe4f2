"""What the recovery costs: torques, speeds, forces, and the QPs' health."""

import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diagrams.plots.style import (
    TEXT,
    mark_pushes,
    set_title,
    shade_phases,
    stacked_axes,
)
from diagrams.run_log import (
    FALLBACK,
    QP_STATUS,
    SOLVED,
    VIOLATION,
    Log,
    phase_spans,
)
from diagrams.summary import joint_speed, torque_ratio
from nadia_balance.core.walking import Side
from nadia_balance.systems import palette

# What joints of a group are called, in the robots' several tongues.
GROUPS = {
    "hips": r"hip|leg_hp",
    "knees": r"knee|leg_kn",
    "ankles": r"ankle|leg_ak",
    "spine": r"spine|back",
    "arms": r"",
}
_GROUP_COLORS = ("#3b6fb6", "#c2571a", "#2b8a5f", "#7a5ba6", "#9aa3b2")
_QP_COLORS = {
    "momentum_qp_status": "#7a5ba6",
    "whole_body_qp_status": "#2b8a5f",
}


def draw(log: Log, summary: dict) -> Figure | None:
    """Draws what the log has of it; None if it has nothing."""
    rows = [
        (draws, height)
        for has, draws, height in (
            (torque_ratio(log).size > 0, _draw_torques, 2.2),
            (joint_speed(log).size > 0, _draw_speed, 1.3),
            ("foot_forces" in log, _draw_forces, 1.8),
            (any(name in log for name in QP_STATUS), _draw_qps, 1.5),
        )
        if has
    ]
    if not rows:
        return None
    fig, axes = stacked_axes([height for _, height in rows])
    spans = phase_spans(log)
    for ax, (draw_row, _) in zip(axes, rows, strict=True):
        shade_phases(ax, spans)
        mark_pushes(ax, log)
        draw_row(ax, log)
    axes[-1].set_xlim(log["t"][0], log["t"][-1])
    set_title(fig, summary, "Effort")
    return fig


def joint_groups(names: np.ndarray) -> dict[str, np.ndarray]:
    """Returns group -> indices of its joints; each joint is in one group."""
    groups: dict[str, list[int]] = {group: [] for group in GROUPS}
    for i, name in enumerate(names):
        found = (
            g for g, words in GROUPS.items() if re.search(words, name, re.I)
        )
        groups[next(found)].append(i)
    return {g: np.array(members) for g, members in groups.items() if members}


def _draw_torques(ax: Axes, log: Log) -> None:
    """The joint of each group that is nearest to its limit."""
    ratio = 100.0 * torque_ratio(log)
    groups = joint_groups(log["actuator_names"])
    for (group, members), color in zip(
        groups.items(), _GROUP_COLORS, strict=False
    ):
        ax.plot(
            log["t"],
            np.max(ratio[:, members], axis=1),
            color=color,
            linewidth=1.1,
            label=group,
        )
    if np.max(ratio) > 60.0:
        ax.axhline(100.0, color=palette.PUSH, linewidth=1.0, linestyle="--")
    ax.set_ylabel("torque [% of limit]")
    ax.set_ylim(bottom=0.0)
    _legend(ax, len(groups))


def _draw_speed(ax: Axes, log: Log) -> None:
    speed = np.max(joint_speed(log), axis=1)
    ax.plot(log["t"], speed, color=TEXT, linewidth=1.1)
    ax.set_ylabel("fastest joint\n[rad/s]")
    ax.set_ylim(bottom=0.0)


def _draw_forces(ax: Axes, log: Log) -> None:
    for column, side in enumerate(Side):
        ax.plot(
            log["t"],
            log["foot_forces"][:, column],
            color=palette.foot_color(side),
            linewidth=1.1,
            label=f"{side.value} foot",
        )
    ax.set_ylabel("normal force [N]")
    ax.set_ylim(bottom=0.0)
    _legend(ax, 2)


def _draw_qps(ax: Axes, log: Log) -> None:
    """Constraint violations; failures and fallbacks as ticks above them."""
    t = log["t"]
    floor = 1e-16  # exact solutions must show up on the logarithmic axis
    for name in QP_STATUS:
        if name not in log:
            continue
        status, color = log[name], _QP_COLORS[name]
        label = name.removesuffix("_status").replace("_qp", " QP")
        ax.semilogy(
            t,
            np.maximum(status[:, VIOLATION], floor),
            color=color,
            linewidth=1.0,
            label=label.replace("_", "-"),
        )
        _mark(ax, t[status[:, FALLBACK] > 0.5], palette.ECMP, "fallback")
        _mark(ax, t[status[:, SOLVED] < 0.5], palette.PUSH, "failure")
    ax.set_ylabel("QP violation")
    _legend(ax, 4)


def _mark(ax: Axes, times: np.ndarray, color: str, label: str) -> None:
    if len(times):
        ax.plot(
            times,
            np.full(len(times), 0.93),
            "|",
            transform=ax.get_xaxis_transform(),
            color=color,
            markersize=9,
            label=f"{label} ({len(times)})",
        )


def _legend(ax: Axes, columns: int) -> None:
    ax.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 0.98),
        ncols=columns,
        borderpad=0,
        borderaxespad=0.2,
    )
