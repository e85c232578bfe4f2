"""Footholds and the paths of CoP, eCMP, ICP and CoM, seen from above.

As Figs. 12 and 13 of the Nadia paper: desired footholds dashed, achieved ones
solid and filled, where the feet were at first with a finer dash.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from diagrams.plots.style import TEXT, title
from diagrams.run_log import (
    Log,
    PushSpan,
    Step,
    phase_spans,
    pushes,
    sole_pose,
    steps,
)
from diagrams.story import recovered_at
from nadia_balance.core.walking import FootPose, Side
from nadia_balance.systems import palette

_LONGEST, _SHORTEST = 10.0, (8.0, 2.4)  # sides of the figure [in]
_MARGIN = 0.12  # around everything [m]
_APART = 0.05  # numbers of footholds nearer than this would overlap [m]


def draw(log: Log, summary: dict) -> Figure:
    """Draws the recovery from the last push, or the whole run without one."""
    pushed = pushes(log)
    first, last = window(log, pushed)
    shown = [s for s in steps(log) if first <= s.swing.last <= last]
    rows = slice(first, last + 1)
    points = np.concatenate(
        [
            log["icp"][rows],
            log["ecmp_command"][rows, :2],
            *(s.achieved.to_world(log["sole"]) for s in shown),
            *(s.commanded.to_world(log["sole"]) for s in shown),
            *(sole_pose(log, first, s).to_world(log["sole"]) for s in Side),
        ]
    )
    points = points[np.all(np.isfinite(points), axis=1)]
    low, high = points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
    fig = Figure(figsize=_size(high - low), layout="constrained")
    ax = fig.subplots()
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    ax.set(xlabel="x, forward [m]", ylabel="y, left [m]")
    _draw_footholds(ax, log, first, shown)
    _draw_paths(ax, log, rows)
    for push in pushed[-1:]:
        _draw_push(ax, log, push)
    ax.plot([], [], color=TEXT, ls=":", lw=1.2, label="at first")
    ax.plot([], [], color=TEXT, ls="--", lw=1.2, label="commanded")
    ax.plot([], [], color=TEXT, lw=1.2, label="achieved")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    times = f"{log['t'][first]:.2f} to {log['t'][last]:.2f} s"
    ax.set_title(title(summary, f"Footsteps, {times}"))
    return fig


def window(log: Log, pushed: list[PushSpan]) -> tuple[int, int]:
    """First and last row to draw: from the push to two phases after it."""
    last_row = len(log["t"]) - 1
    if not pushed:
        return 0, last_row
    spans = phase_spans(log)
    push = pushed[-1]
    begin = next(s for s in spans if s.first <= push.first <= s.last)
    end = max(
        [recovered_at(log, push)]
        + [s.swing.end for s in steps(log) if np.any(s.adjustment != 0.0)]
    )
    after = [s.last for s in spans if s.start > end]
    return begin.first, min([*after[1:2], last_row])


def _size(extent: np.ndarray) -> np.ndarray:
    """Width and height [in] of a figure, with room for the legend."""
    scale = _LONGEST / max(extent[0], 1.4 * extent[1])
    return np.maximum(scale * extent + [2.4, 1.0], _SHORTEST)


def _draw_footholds(ax: Axes, log: Log, first: int, shown: list[Step]) -> None:
    sole = log["sole"]
    for side in Side:
        _draw_sole(ax, sole_pose(log, first, side), sole, side, ":", 0.06)
    drawn: dict[Side, list[np.ndarray]] = {side: [] for side in Side}
    for step in shown:
        xy = step.achieved.p_WF[:2]
        near = [np.linalg.norm(xy - p) < _APART for p in drawn[step.side]]
        _draw_sole(ax, step.commanded, sole, step.side, "--", 0.0)
        # Fills and numbers on top of each other would hide what is below.
        fill = 0.0 if any(near) else 0.16
        _draw_sole(ax, step.achieved, sole, step.side, "-", fill)
        if not any(near):
            drawn[step.side].append(xy)
            _number(ax, step, sole)


def _number(ax: Axes, step: Step, sole: np.ndarray) -> None:
    """Writes the number of a step beside its outer edge."""
    edge = step.side.sign * np.max(np.abs(sole[:, 1]))
    ax.annotate(
        str(step.number),
        step.achieved.to_world(np.array([[0.0, edge]]))[0],
        xytext=(0, 7 * step.side.sign),
        textcoords="offset points",
        ha="center",
        va="center",
        color=palette.foot_color(step.side),
        fontsize=8.5,
        weight="bold",
    )


def _draw_sole(
    ax: Axes,
    pose: FootPose,
    sole: np.ndarray,
    side: Side,
    line: str,
    fill: float,
) -> None:
    color = palette.foot_color(side)
    corners = pose.to_world(sole)
    if fill > 0.0:
        ax.add_patch(Polygon(corners, facecolor=color, alpha=fill))
    ax.add_patch(
        Polygon(corners, fill=False, edgecolor=color, linestyle=line, lw=1.4)
    )


def _draw_paths(ax: Axes, log: Log, rows: slice) -> None:
    for name, columns, color, label, style in (
        ("ecmp_command", slice(2, 4), palette.ECMP, "eCMP", {"lw": 1.0}),
        ("ecmp_command", slice(0, 2), palette.COP, "CoP", {"lw": 1.4}),
        ("com_state", slice(0, 2), palette.COM, "CoM", {"lw": 1.3}),
        (
            "icp_reference",
            slice(0, 2),
            palette.ICP_REFERENCE,
            "ICP reference",
            {"lw": 1.6, "ls": (0, (3, 1.5))},
        ),
        ("icp", slice(0, 2), palette.ICP, "ICP", {"lw": 1.8}),
    ):
        x, y = log[name][rows, columns].T
        ax.plot(x, y, color=color, label=label, **style)


def _draw_push(ax: Axes, log: Log, push: PushSpan) -> None:
    """An arrow beside the place where the ICP was when the push began."""
    direction = push.force[:2] / np.linalg.norm(push.force)
    beside = 0.04 * np.array([direction[1], -direction[0]])
    tip = log["icp"][push.first] + beside
    ax.annotate(
        "",
        xy=tip,
        xytext=tip - 0.1 * direction,
        arrowprops={
            "arrowstyle": "-|>,head_width=0.35,head_length=0.7",
            "color": palette.PUSH,
            "linewidth": 2.5,
            "shrinkA": 0,
            "shrinkB": 0,
        },
        zorder=5,
    )
    ax.plot([], [], color=palette.PUSH, lw=2.5, label="push")
