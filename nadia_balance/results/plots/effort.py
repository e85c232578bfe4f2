"""Effort over time: torques, joint speeds, foot forces, status of the QPs."""

import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nadia_balance import palette
from nadia_balance.core.walking import Side
from nadia_balance.results.log import QP_STATUS, Log, signal
from nadia_balance.results.measurements import joint_speed, torque_ratio
from nadia_balance.results.plots.style import TEXT, time_axes

# Patterns of joint names per group, for robots of several manufacturers.
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
    """Draws the available signals; None if the log has none."""
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
    fig, axes = time_axes(log, summary, "Effort", [row[1] for row in rows])
    for ax, (draw_row, _) in zip(axes, rows, strict=True):
        draw_row(ax, log)
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
    """Draws the largest torque ratio of each group of joints."""
    ratio = 100.0 * torque_ratio(log)
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
    speed = np.max(joint_speed(log), axis=1)
    ax.plot(log["t"], speed, color=TEXT, linewidth=1.1)
    ax.set(ylabel="fastest joint\n[rad/s]", ylim=(0.0, None))


def _draw_forces(ax: Axes, log: Log) -> None:
    forces = signal(log, "foot_forces")
    for side in Side:
        look = {
            "color": palette.foot_color(side),
            "label": f"{side.value} foot",
        }
        ax.plot(log["t"], getattr(forces, side.value), linewidth=1.1, **look)
    ax.set(ylabel="normal force [N]", ylim=(0.0, None))
    _legend(ax, 2)


def _draw_qps(ax: Axes, log: Log) -> None:
    """Draws constraint violations, with marks for failures and fallbacks."""
    t = log["t"]
    floor = 1e-16  # makes exact solutions visible on the logarithmic axis
    for name in filter(log.__contains__, QP_STATUS):
        qp = signal(log, name)
        label = name.removesuffix("_qp_status").replace("_", "-") + " QP"
        violation, color = np.maximum(qp.violation, floor), _QP_COLORS[name]
        ax.semilogy(t, violation, color=color, linewidth=1.0, label=label)
        _mark(ax, t[qp.fallback > 0.5], palette.ECMP, "fallback")
        _mark(ax, t[qp.solved < 0.5], palette.PUSH, "failure")
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
