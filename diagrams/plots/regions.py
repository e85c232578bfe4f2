"""Capture regions of one example, as in Figs. 4 and 6 of the Nadia paper.

She stands on her left foot and swings the right one; seen from above.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diagrams.plots.plan_view import (
    SOLE,
    draw_icp,
    draw_sole,
    fill,
    plans,
    share_legend,
)
from nadia_balance.core.capture_region import (
    capture_region,
    later_steps,
    one_step_region_in_disc,
)
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.lipm import natural_frequency
from nadia_balance.core.reachability import (
    ReachabilityParams,
    base_region,
    circle,
    in_world,
    total_region,
)
from nadia_balance.core.walking import Array, FootPose, Side
from nadia_balance.systems import palette

OMEGA = natural_frequency(com_height=0.888)  # Nadia's
STANCE, SWING = FootPose(), Side.RIGHT
NOMINAL = FootPose(np.array([0.0, -0.25, 0.0]))  # where she would step
ICP = np.array([0.16, 0.0])  # [m]
REMAINING_TIME = 0.25  # until touchdown [s]
STEP_DURATION = 0.5  # of the steps to come, transfer and swing [s]
NUM_STEPS = 3
REACH = ReachabilityParams()
CROSSING = ReachabilityParams(cross_over=True)
CIRCLE = circle(REACH.length_forward, 96)
NAMES = ("C₁", "C₂", "C₃")
_WHEN = (
    f"Where to step so as to recover: touchdown in {REMAINING_TIME} s, "
    f"all later steps take {STEP_DURATION} s each"
)


def draw_by_reachability() -> Figure:
    """Fig. 4: C_1 to C_3, if all later steps are bound by one shape."""
    fig, axes = plans(
        "Any step of up to 1 m",
        "Feet side by side: an ellipse",
        "Cross-over allowed",
    )
    reaches = CIRCLE, base_region(REACH), total_region(CROSSING)
    for ax, reach in zip(axes, reaches, strict=True):
        for n in range(NUM_STEPS, 0, -1):
            region = capture_region(_one_step(), offsets(reach, n))
            fill(ax, region, palette.CAPTURE_REGIONS[n - 1], NAMES[n - 1])
        _draw_feet(ax)
    share_legend(fig, axes[0], _WHEN)
    return fig


def draw_growth() -> Figure:
    """Fig. 6: C_n is C_n-1 swept by the reversed reach of step n, scaled."""
    fig, axes = plans("Any step of up to 1 m", "Feet side by side: an ellipse")
    for ax, reach in zip(axes, (CIRCLE, base_region(REACH)), strict=True):
        last = _one_step()
        for n in range(2, NUM_STEPS + 1):
            color = palette.CAPTURE_REGIONS[n - 1]
            for point in _around(last, 28):
                swept = point - _increment(reach, n)
                fill(ax, swept, color, alpha=0.0, linewidth=0.6)
            last = capture_region(last, _increment(reach, n))
            label = f"{NAMES[n - 1]}: {NAMES[n - 2]} swept by step {n}"
            fill(ax, last, color, label, alpha=0.0, linewidth=2.0)
        fill(ax, _one_step(), palette.CAPTURE_REGIONS[0], NAMES[0])
        _draw_feet(ax)
    share_legend(fig, axes[0], _WHEN)
    return fig


def offsets(reach: Array, n: int) -> Array:
    """D_n, if the feet reach as far as `reach`, given for a left stance."""
    reaches = [in_world(reach, STANCE, _swing(k)) for k in range(2, n + 1)]
    contraction = math.exp(-OMEGA * STEP_DURATION)
    return later_steps(reaches, [contraction] * (n - 1))[-1]


def _increment(reach: Array, n: int) -> Array:
    """D_n without D_n-1: the reach of step n, scaled, about its stance foot."""
    contraction = math.exp(-OMEGA * STEP_DURATION * (n - 1))
    return later_steps([in_world(reach, STANCE, _swing(n))], [contraction])[-1]


def _around(polygon: Array, count: int) -> Array:
    """`count` points (count, 2) [m] along the boundary, evenly spread."""
    closed = np.vstack([polygon, polygon[:1]])
    lengths = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.linspace(0.0, way[-1], count, endpoint=False)
    return np.column_stack([np.interp(at, way, c) for c in closed.T])


def _swing(n: int) -> Side:
    """The foot that takes step n."""
    return SWING if n % 2 else SWING.other


def _one_step() -> Array:
    foot = in_world(_usable_foot(), STANCE, SWING)
    return one_step_region_in_disc(ICP, foot, OMEGA, REMAINING_TIME, CIRCLE)


def _usable_foot() -> Array:
    return CaptureRegionStepAdjusterParams().usable_foot(SOLE)


def _draw_feet(ax: Axes) -> None:
    """The stance foot, the part of it that counts, the foothold as planned."""
    draw_sole(ax, STANCE, SWING.other)
    foot = in_world(_usable_foot(), STANCE, SWING)
    fill(ax, foot, palette.LEFT, "where the CoP may be", linewidth=0.0)
    draw_sole(ax, NOMINAL, SWING, "planned foothold", "--")
    draw_icp(ax, ICP)
