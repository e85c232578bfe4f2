"""Footholds and the paths of CoP, eCMP, ICP and CoM, seen from above.

The style is that of Figs. 12 and 13 of the Nadia paper: planned footholds are
dashed, achieved ones solid and filled, initial ones dotted.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from nadia_balance import palette
from nadia_balance.core.body import reachability
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import contains
from nadia_balance.core.walking.state import Side
from nadia_balance.results.log import (
    Log,
    PushSpan,
    Step,
    ground_regions,
    phase_spans,
    pushes,
    signal_view,
    sole_pose,
    steps,
)
from nadia_balance.results.measurements import recovered_at
from nadia_balance.results.plots.style import (
    FAINT,
    TEXT,
    arrow,
    draw_sole,
    fill,
    plan_view,
    title,
)

NEAR = 0.05  # nearer footholds are treated as one [m]
_ON_EDGE = 1e-3  # tolerance for footholds on the edge of a region [m]
_LONGEST, _SHORTEST = 10.0, (8.0, 2.4)  # sides of the figure [in]
_MARGIN = 0.12  # margin of the axes [m]
_ARROW = 0.12  # length of the push's arrow [m]
_FILL = 0.16  # opacity of a foothold
_MEANING = {
    reachability.BASE: "feet side by side",
    reachability.FORWARD: "crossing in front",
    reachability.BACKWARD: "crossing behind",
}


def draw(log: Log, summary: dict[str, Any]) -> Figure | None:
    """Draws the recovery from the last push; without a push, the run.

    Args:
        log: log of a run.
        summary: summary of the run.

    Returns:
        The figure; None if no ICP is logged.
    """
    if "icp" not in log:
        return None
    pushed = pushes(log)
    first, last = window(log, pushed)
    shown = [s for s in steps(log) if first <= s.swing.last < last]
    low, high = _limits(log, first, last, shown)
    fig = _figure(high - low)
    ax = fig.subplots()
    plan_view(ax, (low[0], high[0]), (low[1], high[1]))
    _draw_ground(ax, log, shown)
    _draw_footholds(ax, log, first, shown)
    _draw_paths(ax, log, slice(first, last + 1))
    if pushed:
        _draw_push(ax, log, pushed[-1])
        _draw_reach(ax, log, shown)
    _key_to_footholds(ax, shown)
    ax.legend(
        title="numbers: which step",
        alignment="left",
        loc="center left",
        bbox_to_anchor=(1.01, 0.5),
    )
    start, end = log["t"][[first, last]]
    ax.set_title(title(summary, f"Footsteps, {start:.2f} to {end:.2f} s"))
    return fig


def _figure(extent: Array) -> Figure:
    """A figure for axes of this extent (2,) [m], and the legend beside them."""
    scale = _LONGEST / max(extent[0], 1.4 * extent[1])
    width, height = np.maximum(scale * extent + [3.2, 1.0], _SHORTEST)
    return Figure(figsize=(width, height), layout="constrained")


def window(log: Log, pushed: list[PushSpan]) -> tuple[int, int]:
    """Returns what is drawn, from the last push to after the recovery.

    It ends with the second touchdown after it and after all adjusted steps.

    Args:
        log: log of a run.
        pushed: pushes of the run.

    Returns:
        First and last row in the log.
    """
    last_row = len(log["t"]) - 1
    if not pushed:
        return 0, last_row
    push, taken = pushed[-1], steps(log)
    end = max(
        [
            recovered_at(log, push),
            *(step.swing.end for step in taken if _is_moved(step)),
        ]
    )
    after = [step.swing.last + 1 for step in taken if step.swing.end > end]
    first = max(s.first for s in phase_spans(log) if s.first <= push.first)
    return first, min([*after[1:2], last_row])


def _limits(
    log: Log, first: int, last: int, shown: list[Step]
) -> tuple[Array, Array]:
    """Least and largest x and y (2,) [m] of paths and footholds."""
    poses = [
        *(sole_pose(log, first, side) for side in Side),
        *(step.achieved for step in shown),
        *(step.commanded for step in shown),
    ]
    rows = slice(first, last + 1)
    points = np.concatenate(
        [
            log["icp"][rows],
            signal_view(log, "ecmp_command", rows).cop.T,
            *(pose.to_world(log["sole"]) for pose in poses),
        ]
    )
    points = points[np.all(np.isfinite(points), axis=1)]
    return points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN


def _draw_paths(ax: Axes, log: Log, rows: slice) -> None:
    command = signal_view(log, "ecmp_command", rows)
    ax.plot(*command.ecmp, color=palette.ECMP, label="eCMP", lw=1.0)
    ax.plot(*command.cop, color=palette.COP, label="CoP", lw=1.4)
    ax.plot(
        *signal_view(log, "com_state", rows).position[:2],
        color=palette.COM,
        label="CoM",
        lw=1.3,
    )
    ax.plot(
        *signal_view(log, "icp_reference", rows).icp,
        color=palette.ICP_REFERENCE,
        label="ICP reference",
        lw=1.6,
        ls=(0, (3, 1.5)),
    )
    ax.plot(*log["icp"][rows].T, color=palette.ICP, label="ICP", lw=1.8)


def _draw_push(ax: Axes, log: Log, push: PushSpan) -> None:
    """Draws an arrow that ends in the ICP as the push begins."""
    tip = log["icp"][push.first]
    shaft = _ARROW * push.force[:2] / np.linalg.norm(push.force)
    arrow(ax, tip - shaft, tip, palette.PUSH, width=2.5)
    ax.plot([], [], color=palette.PUSH, lw=2.5, label="push")


def _draw_ground(ax: Axes, log: Log, shown: list[Step]) -> None:
    """Draws the regions of the ground; regions with a step are darker."""
    labels: dict[bool, str] = {True: "region stepped on", False: "other region"}
    for region in ground_regions(log):
        used = any(contains(s.achieved.p_WF[:2], region) for s in shown)
        fill(
            ax,
            region,
            palette.GROUND,
            label=labels.pop(used, None),
            alpha=0.32 if used else 0.1,
            linewidth=0.8,
            zorder=0.3,
        )


def _draw_footholds(ax: Axes, log: Log, first: int, shown: list[Step]) -> None:
    """Draws the soles at row `first` and the steps after it."""
    sole = log["sole"]
    for side in Side:
        draw_sole(
            ax,
            sole_pose(log, first, side).to_world(sole),
            side,
            alpha=0.06,
            linestyle=":",
        )
    drawn: dict[Side, list[Array]] = {side: [] for side in Side}
    for step in shown:
        start, end = step.commanded.p_WF[:2], step.achieved.p_WF[:2]
        near = any(np.linalg.norm(end - p) < NEAR for p in drawn[step.side])
        draw_sole(ax, step.commanded.to_world(sole), step.side, linestyle="--")
        # Only one fill and number for several near footholds.
        draw_sole(
            ax,
            step.achieved.to_world(sole),
            step.side,
            alpha=0.0 if near else _FILL,
        )
        if not near:
            drawn[step.side].append(end)
            _number(ax, step, sole)
        if _is_moved(step):
            arrow(
                ax,
                start,
                end,
                FAINT,
                width=1.2,
                style="->,head_width=0.25,head_length=0.5",
            )


def _is_moved(step: Step) -> bool:
    return bool(np.linalg.norm(step.adjustment) > NEAR)


def _number(ax: Axes, step: Step, sole: Array) -> None:
    """Writes the number of a step beside its outer edge."""
    half_width = np.max(np.abs(sole[:, 1]))
    x, y = step.achieved.to_world(np.array([0.0, step.side.sign * half_width]))
    ax.annotate(
        str(step.number),
        xy=(x, y),
        xytext=(0, 8 * step.side.sign),
        textcoords="offset points",
        ha="center",
        va="center",
        color=palette.foot_color(step.side),
        fontsize=11,
        weight="bold",
        path_effects=[withStroke(linewidth=3, foreground="white")],
    )


def _draw_reach(ax: Axes, log: Log, shown: list[Step]) -> None:
    """Draws where the step could land that was adjusted most.

    These are its reachability region, and its last capture regions.
    """
    moved = list(filter(_is_moved, shown))
    if not moved:
        return
    step = max(moved, key=lambda s: float(np.linalg.norm(s.adjustment)))
    stance = sole_pose(log, step.swing.last, step.side.other)
    for name, meaning in _MEANING.items():
        region = reachability.in_world(log[f"region_{name}"], stance, step.side)
        if contains(step.adjusted.p_WF[:2], region, _ON_EDGE):
            fill(
                ax,
                region,
                palette.REACH,
                label=f"reach of step {step.number} (sole centre),\n{meaning}",
                alpha=0.05,
                linewidth=1.2,
                zorder=0.5,
            )
            break
    for n, region in _capture_regions(log, step).items():
        fill(
            ax,
            region,
            palette.CAPTURE_REGIONS[min(n, len(palette.CAPTURE_REGIONS)) - 1],
            label=f"C$_{n}$ of step {step.number}, just before\nit landed",
            alpha=0.15,
            linewidth=1.2,
            zorder=0.6,
        )


def _capture_regions(log: Log, step: Step) -> dict[int, Array]:
    """Corners (k, 2) [m] of C_n by n, the larger first, as the step landed."""
    rows = log.get("capture_regions", np.zeros((0, 4)))
    swing = (rows[:, 0] >= step.swing.start) & (rows[:, 0] <= step.swing.end)
    last = rows[swing & (rows[:, 0] == rows[swing, 0].max(initial=-np.inf))]
    numbers = np.unique(last[:, 1])[::-1]
    return {int(n): last[last[:, 1] == n, 2:] for n in numbers}


def _key_to_footholds(ax: Axes, shown: list[Step]) -> None:
    """Adds line styles and colours of the steps to the legend."""
    for line, label in (
        (":", "foot at first"),
        ("--", "foothold as planned"),
        ("-", "foothold as adjusted,\nwhere the foot landed"),
    ):
        ax.plot([], [], color=TEXT, ls=line, lw=1.2, label=label)
    if any(map(_is_moved, shown)):
        ax.plot(
            [],
            [],
            color=FAINT,
            lw=1.2,
            label="adjustment",
            marker=">",
            ms=4,
            markevery=[1],
        )
    for side in Side:
        fill(
            ax,
            np.full((1, 2), np.nan),
            palette.foot_color(side),
            label=f"{side.value} foot",
            alpha=_FILL,
        )
