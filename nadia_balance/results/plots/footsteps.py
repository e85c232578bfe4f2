"""Footholds and the paths of CoP, eCMP, ICP and CoM, seen from above.

The style is that of Figs. 12 and 13 of the Nadia paper: planned footholds are
dashed, achieved ones solid and filled, initial ones dotted.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

import nadia_balance.results.log as logs
from nadia_balance import palette
from nadia_balance.core.body import reachability
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import contains
from nadia_balance.core.walking.state import FootPose, Side
from nadia_balance.results.log import Log, PushSpan, Step, signal, sole_pose
from nadia_balance.results.measurements import recovered_at
from nadia_balance.results.plots.time_series import (
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


def draw(log: Log, summary: dict) -> Figure | None:
    """Draws the recovery from the last push, or the run; None: without ICP."""
    if "icp" not in log:
        return None
    pushed = logs.pushes(log)
    first, last = window(log, pushed)
    shown = [s for s in logs.steps(log) if first <= s.swing.last < last]
    rows = slice(first, last + 1)
    low, high = _limits(log, first, rows, shown)
    extent = high - low
    scale = _LONGEST / max(extent[0], 1.4 * extent[1])
    # With room for the legend.
    size = np.maximum(scale * extent + [3.2, 1.0], _SHORTEST)
    fig = Figure(figsize=size, layout="constrained")
    ax = fig.subplots()
    plan_view(ax, *zip(low, high, strict=True))
    _draw_ground(ax, log, shown)
    _draw_footholds(ax, log, first, shown)
    _draw_paths(ax, log, rows)
    for push in pushed[-1:]:  # its arrow ends in the ICP, as the push begins
        tip = log["icp"][push.first]
        way = _ARROW * push.force[:2] / np.linalg.norm(push.force)
        arrow(ax, tip - way, tip, palette.PUSH, width=2.5)
        ax.plot([], [], color=palette.PUSH, lw=2.5, label="push")
        _draw_reach(ax, log, shown)
    _key_to_footholds(ax, shown)
    where = {"loc": "center left", "bbox_to_anchor": (1.01, 0.5)}
    ax.legend(title="numbers: which step", alignment="left", **where)
    times = f"{log['t'][first]:.2f} to {log['t'][last]:.2f} s"
    ax.set_title(title(summary, f"Footsteps, {times}"))
    return fig


def window(log: Log, pushed: list[PushSpan]) -> tuple[int, int]:
    """First and last row to draw, from the push to after the recovery.

    The last is the second touchdown after it and after all adjusted steps.
    """
    last_row = len(log["t"]) - 1
    if not pushed:
        return 0, last_row
    push, taken = pushed[-1], logs.steps(log)
    moved = filter(_is_moved, taken)
    end = max([recovered_at(log, push), *(s.swing.end for s in moved)])
    after = [s.swing.last + 1 for s in taken if s.swing.end > end]
    starts = (s.first for s in logs.phase_spans(log) if s.first <= push.first)
    return max(starts), min([*after[1:2], last_row])


def _limits(log: Log, first: int, rows: slice, shown: list[Step]) -> tuple:
    """Least and largest x and y (2,) [m] of paths and footholds."""
    poses = [pose for s in shown for pose in (s.achieved, s.commanded)]
    poses += [sole_pose(log, first, side) for side in Side]
    soles = [pose.to_world(log["sole"]) for pose in poses]
    cop = signal(log, "ecmp_command", rows).cop.T
    points = np.concatenate([log["icp"][rows], cop, *soles])
    points = points[np.all(np.isfinite(points), axis=1)]
    return points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN


def _draw_paths(ax: Axes, log: Log, rows: slice) -> None:
    command = signal(log, "ecmp_command", rows)
    com = signal(log, "com_state", rows).position[:2]
    reference = signal(log, "icp_reference", rows).icp
    dashed = {"lw": 1.6, "ls": (0, (3, 1.5))}
    for path, color, label, look in (
        (command.ecmp, palette.ECMP, "eCMP", {"lw": 1.0}),
        (command.cop, palette.COP, "CoP", {"lw": 1.4}),
        (com, palette.COM, "CoM", {"lw": 1.3}),
        (reference, palette.ICP_REFERENCE, "ICP reference", dashed),
        (log["icp"][rows].T, palette.ICP, "ICP", {"lw": 1.8}),
    ):
        ax.plot(*path, color=color, label=label, **look)


def _draw_ground(ax: Axes, log: Log, shown: list[Step]) -> None:
    """Draws the regions of the ground; regions with a step are darker."""
    labels = {True: "region stepped on", False: "other region"}
    for region in logs.ground_regions(log):
        used = any(contains(s.achieved.p_WF[:2], region) for s in shown)
        look = {"alpha": 0.32 if used else 0.1, "linewidth": 0.8}
        look |= {"label": labels.pop(used, None), "zorder": 0.3}
        fill(ax, region, palette.GROUND, **look)


def _draw_footholds(ax: Axes, log: Log, first: int, shown: list[Step]) -> None:
    """Draws the soles at row `first` and the steps after it."""

    def show(pose: FootPose, side: Side, line: str, alpha: float) -> None:
        corners = pose.to_world(log["sole"])
        draw_sole(ax, corners, side, alpha, linestyle=line)

    for side in Side:
        show(sole_pose(log, first, side), side, ":", 0.06)
    drawn: dict[Side, list[Array]] = {side: [] for side in Side}
    for step in shown:
        start, end = step.commanded.p_WF[:2], step.achieved.p_WF[:2]
        near = [np.linalg.norm(end - p) < NEAR for p in drawn[step.side]]
        show(step.commanded, step.side, "--", 0.0)
        # Only one fill and number for several near footholds.
        show(step.achieved, step.side, "-", 0.0 if any(near) else _FILL)
        if not any(near):
            drawn[step.side].append(end)
            _number(ax, step, log["sole"])
        if _is_moved(step):
            head = "->,head_width=0.25,head_length=0.5"
            arrow(ax, start, end, FAINT, width=1.2, style=head)


def _is_moved(step: Step) -> bool:
    return bool(np.linalg.norm(step.adjustment) > NEAR)


def _number(ax: Axes, step: Step, sole: Array) -> None:
    """Writes the number of a step beside its outer edge."""
    edge = step.side.sign * np.max(np.abs(sole[:, 1]))
    place = step.achieved.to_world(np.array([[0.0, edge]]))[0]
    where = {"xytext": (0, 8 * step.side.sign), "ha": "center", "va": "center"}
    look = {"color": palette.foot_color(step.side), "fontsize": 11}
    look["path_effects"] = [withStroke(linewidth=3, foreground="white")]
    look |= {"weight": "bold", "textcoords": "offset points"}
    ax.annotate(str(step.number), place, **where, **look)


def _draw_reach(ax: Axes, log: Log, shown: list[Step]) -> None:
    """Draws the reachability region of the step that was adjusted most."""
    moved = list(filter(_is_moved, shown))
    if not moved:
        return
    step = max(moved, key=lambda s: float(np.linalg.norm(s.adjustment)))
    stance = sole_pose(log, step.swing.last, step.side.other)
    for name, meaning in _MEANING.items():
        region = reachability.in_world(log[f"region_{name}"], stance, step.side)
        if contains(step.adjusted.p_WF[:2], region, _ON_EDGE):
            label = f"reach of step {step.number} (sole centre),\n{meaning}"
            edge = {"edgecolor": (*palette.rgb(palette.REACH), 0.7)}
            edge |= {"linewidth": 1.2, "zorder": 0.5}
            fill(ax, region, palette.REACH, label, alpha=0.07, **edge)
            return


def _key_to_footholds(ax: Axes, shown: list[Step]) -> None:
    """Adds line styles and colours of the steps to the legend."""
    for line, label in (
        (":", "foot at first"),
        ("--", "foothold as planned"),
        ("-", "foothold as adjusted,\nwhere the foot landed"),
    ):
        ax.plot([], [], color=TEXT, ls=line, lw=1.2, label=label)
    if any(map(_is_moved, shown)):
        head = {"marker": ">", "ms": 4, "markevery": [1]}
        ax.plot([], [], color=FAINT, lw=1.2, label="adjustment", **head)
    for side in Side:
        nowhere, label = np.full((1, 2), np.nan), f"{side.value} foot"
        fill(ax, nowhere, palette.foot_color(side), label, alpha=_FILL)
