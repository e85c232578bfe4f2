"""Footholds and the paths of CoP, eCMP, ICP and CoM, seen from above.

As Figs. 12 and 13 of the Nadia paper: planned footholds dashed, achieved ones
solid and filled, where the feet were at first with a finer dash.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diagrams.plots.footholds import (
    NEAR,
    draw_footholds,
    draw_reach,
    key_to_footholds,
)
from diagrams.plots.style import title
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
from nadia_balance.core.walking import Array, Side
from nadia_balance.systems import palette

_LONGEST, _SHORTEST = 10.0, (8.0, 2.4)  # sides of the figure [in]
_MARGIN = 0.12  # around everything [m]
_ARROW, _BESIDE = 0.12, 0.03  # the push: length, distance from the ICP [m]


def draw(log: Log, summary: dict) -> Figure:
    """Draws the recovery from the last push, or the whole run without one."""
    pushed = pushes(log)
    first, last = window(log, pushed)
    shown = [s for s in steps(log) if first <= s.swing.last < last]
    rows = slice(first, last + 1)
    low, high = _limits(log, first, rows, shown)
    fig = Figure(figsize=_size(high - low), layout="constrained")
    ax = fig.subplots()
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    ax.set(xlabel="x, forward [m]", ylabel="y, left [m]")
    draw_footholds(ax, log, first, shown)
    _draw_paths(ax, log, rows)
    for push in pushed[-1:]:
        _draw_push(ax, log, push, rows)
        _mark_touchdowns(ax, log, shown)
        draw_reach(ax, log, shown)
    key_to_footholds(ax, shown)
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    times = f"{log['t'][first]:.2f} to {log['t'][last]:.2f} s"
    ax.set_title(title(summary, f"Footsteps, {times}"))
    return fig


def window(log: Log, pushed: list[PushSpan]) -> tuple[int, int]:
    """First and last row to draw: from the push until both feet are back.

    That is, the touchdown of the second step after the recovery.
    """
    last_row = len(log["t"]) - 1
    if not pushed:
        return 0, last_row
    push, taken = pushed[-1], steps(log)
    spans = phase_spans(log)
    begin = next(s for s in spans if s.first <= push.first <= s.last)
    moved = [s for s in taken if np.linalg.norm(s.adjustment) > NEAR]
    end = max([recovered_at(log, push), *(s.swing.end for s in moved)])
    after = [s.swing.last + 1 for s in taken if s.swing.end > end]
    return begin.first, min([*after[1:2], last_row])


def _limits(
    log: Log, first: int, rows: slice, shown: list[Step]
) -> tuple[Array, Array]:
    """Least and largest x and y (2,) [m] of all that must be seen."""
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
    return points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN


def _size(extent: Array) -> Array:
    """Width and height [in] of a figure, with room for the legend."""
    scale = _LONGEST / max(extent[0], 1.4 * extent[1])
    return np.maximum(scale * extent + [3.2, 1.0], _SHORTEST)


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


def _mark_touchdowns(ax: Axes, log: Log, shown: list[Step]) -> None:
    """Dots with the numbers of the steps: where the ICP was when they landed.

    They link the path with the footholds.
    """
    label = "ICP when that step landed"
    for step in shown:
        point = log["icp"][step.swing.last + 1]
        style = {"ms": 11, "mfc": "white", "mec": palette.ICP, "mew": 1.3}
        ax.plot(*point, "o", zorder=4, label=label, **style)
        label = None
        ax.text(
            *point,
            str(step.number),
            ha="center",
            va="center_baseline",
            color=palette.ICP,
            fontsize=7.5,
            weight="bold",
            zorder=5,
            clip_on=True,
        )


def _draw_push(ax: Axes, log: Log, push: PushSpan, rows: slice) -> None:
    """An arrow beside the place where the ICP was when the push began.

    On the side where the paths leave more room for it.
    """
    direction = push.force[:2] / np.linalg.norm(push.force)
    across = _BESIDE * np.array([-direction[1], direction[0]])
    tips = log["icp"][push.first] + np.array([across, -across])
    names = "icp", "com_state", "ecmp_command"
    paths = np.concatenate([log[name][rows, :2] for name in names])
    gaps = [
        np.min(np.linalg.norm(paths - tip + 0.5 * _ARROW * direction, axis=1))
        for tip in tips
    ]
    tip = tips[np.argmax(gaps)]
    ax.annotate(
        "",
        xy=tip,
        xytext=tip - _ARROW * direction,
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
