"""Footholds as planned and as achieved, and where a foot could have gone."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from diagrams.plots.style import FAINT, TEXT
from diagrams.run_log import Log, Step, sole_pose
from nadia_balance.core.polygon import contains
from nadia_balance.core.reachability import (
    BACKWARD,
    BASE,
    FORWARD,
    in_world,
)
from nadia_balance.core.walking import Array, FootPose, Side
from nadia_balance.systems import palette

NEAR = 0.05  # footholds nearer than this are one to the eye [m]
_MOST_LISTED = 8  # steps, in the legend [-]
_ON_EDGE = 1e-3  # a foothold so far out of a region is on its edge [m]
_MEANING = {
    BASE: "feet side by side",
    FORWARD: "crossing in front",
    BACKWARD: "crossing behind",
}


def draw_footholds(ax: Axes, log: Log, first: int, shown: list[Step]) -> None:
    """Draws where the feet were at row `first`, and the steps from there."""
    sole = log["sole"]
    for side in Side:
        _draw_sole(ax, sole_pose(log, first, side), sole, side, ":", 0.06)
    drawn: dict[Side, list[Array]] = {side: [] for side in Side}
    for step in shown:
        xy = step.achieved.p_WF[:2]
        near = [np.linalg.norm(xy - p) < NEAR for p in drawn[step.side]]
        _draw_sole(ax, step.commanded, sole, step.side, "--", 0.0)
        # Fills and numbers on top of each other would hide what is below.
        fill = 0.0 if any(near) else 0.16
        _draw_sole(ax, step.achieved, sole, step.side, "-", fill)
        if not any(near):
            drawn[step.side].append(xy)
            _number(ax, step, sole)
        if _is_moved(step):
            _draw_move(ax, step)


def draw_reach(ax: Axes, log: Log, shown: list[Step]) -> None:
    """Draws the region that the step respected whose foothold moved most."""
    moved = [s for s in shown if _is_moved(s)]
    if not moved:
        return
    step = max(moved, key=lambda s: float(np.linalg.norm(s.adjustment)))
    name = region_of(log, step)
    if not name:
        return
    rgb = palette.rgb(palette.REACH)
    patch = Polygon(
        reach_of(log, step, name),
        facecolor=(*rgb, 0.07),
        edgecolor=(*rgb, 0.7),
        lw=1.2,
        zorder=0.5,
        label=f"reach of step {step.number} (sole centre),\n{_MEANING[name]}",
    )
    ax.add_patch(patch)


def region_of(log: Log, step: Step) -> str:
    """The name of the region that the step respected; empty if none."""
    xy = step.adjusted.p_WF[:2]
    for name in _MEANING:
        if f"region_{name}" in log and contains(
            xy, reach_of(log, step, name), _ON_EDGE
        ):
            return name
    return ""


def reach_of(log: Log, step: Step, name: str) -> Array:
    """The region (n, 2) [m] of this name about the step's stance foot, in W."""
    stance = sole_pose(log, step.swing.last, step.side.other)
    return in_world(log[f"region_{name}"], stance, step.side)


def key_to_footholds(ax: Axes, shown: list[Step]) -> None:
    """Adds to the legend what the lines mean, and how long each step took."""
    for style, label in (
        (":", "foot at first"),
        ("--", "foothold as planned"),
        ("-", "foothold as achieved"),
    ):
        ax.plot([], [], color=TEXT, ls=style, lw=1.2, label=label)
    if any(_is_moved(step) for step in shown):
        arrow = {"marker": ">", "ms": 4, "markevery": [1]}
        ax.plot([], [], color=FAINT, lw=1.2, label="foothold moved", **arrow)
    if len(shown) > _MOST_LISTED:
        for side in Side:
            _key_to_sole(ax, side, f"{side.value} foot")
        return
    for step in shown:
        transfer = step.transfer.duration if step.transfer else 0.0
        text = f"{step.number} {step.side.value}: {transfer:.2f} s transfer"
        _key_to_sole(
            ax, step.side, f"{text}, {step.swing.duration:.2f} s swing"
        )


def _is_moved(step: Step) -> bool:
    return bool(np.linalg.norm(step.adjustment) > NEAR)


def _key_to_sole(ax: Axes, side: Side, label: str) -> None:
    color = palette.foot_color(side)
    face = (*palette.rgb(color), 0.16)
    nowhere = np.full((1, 2), np.nan)
    patch = Polygon(nowhere, facecolor=face, edgecolor=color, lw=1.4)
    patch.set_label(label)
    ax.add_patch(patch)


def _number(ax: Axes, step: Step, sole: Array) -> None:
    """Writes the number of a step beside its outer edge."""
    edge = step.side.sign * np.max(np.abs(sole[:, 1]))
    ax.annotate(
        str(step.number),
        step.achieved.to_world(np.array([[0.0, edge]]))[0],
        xytext=(0, 8 * step.side.sign),
        textcoords="offset points",
        ha="center",
        va="center",
        color=palette.foot_color(step.side),
        fontsize=11,
        weight="bold",
        path_effects=[withStroke(linewidth=3, foreground="white")],
    )


def _draw_move(ax: Axes, step: Step) -> None:
    """A thin arrow from where the foot was to land to where it did."""
    ax.annotate(
        "",
        xy=step.achieved.p_WF[:2],
        xytext=step.commanded.p_WF[:2],
        arrowprops={
            "arrowstyle": "->,head_width=0.25,head_length=0.5",
            "color": FAINT,
            "linewidth": 1.2,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )


def _draw_sole(
    ax: Axes, pose: FootPose, sole: Array, side: Side, line: str, fill: float
) -> None:
    color = palette.foot_color(side)
    corners = pose.to_world(sole)
    if fill > 0.0:
        ax.add_patch(Polygon(corners, facecolor=color, alpha=fill))
    ax.add_patch(
        Polygon(corners, fill=False, edgecolor=color, linestyle=line, lw=1.4)
    )
