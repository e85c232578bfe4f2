"""Draws figures of the Atlas paper by the functions of the controller.

2 the plan with CMPs in heel and toe, 3 the plans of faster steps, 4 projection
of the ICP on the plan, 5 errors that a swing speed-up reduces.  Atlas stands on
its left foot, in a right swing; nothing is simulated.

Examples:
    python docs/figures/atlas_paper.py
    python docs/figures/atlas_paper.py --figure 5 --out figures
"""

import math
import sys
from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drawing import draw, note, plan_views, right_swing, share_legend
from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.atlas_icp_plan import (
    AtlasIcpPlanParams,
    plan_atlas_icp,
)
from nadia_balance.core.plan.icp_plan import IcpPlan
from nadia_balance.core.walking.state import FootPose, FootPoses, Side
from nadia_balance.results.plots.style import FAINT, TEXT, draw_sole
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts.command_line import program

MODEL = load_robot("atlas").point_mass
LENGTH = 0.5  # step length [m]
SLOW, FAST = (1.0, 1.0), (0.7, 0.25)  # swing and transfer [s]
SPEEDS = (SLOW, (0.85, 0.5), FAST)
FORWARD, ASIDE = np.array([0.08, 0.0]), np.array([0.0, -0.08])  # errors [m]
CASES = (
    ("slow steps, error forward", SLOW, FORWARD),
    ("fast steps, error forward", FAST, FORWARD),
    ("fast steps, error to the side", FAST, ASIDE),
)
# Least length [m] of the way in Eq. 10: it vanishes as a transfer ends.
_SHORT_WAY = 0.01
_STEPS = 6  # steps of the walk; its end has no effect on the figures
# Limits of the axes for one step in a row, and for two in a column [m].
_STEP = {"x": (-0.2, 0.75), "y": (-0.24, 0.24)}
_TWO_STEPS = {"x": (-0.2, 1.25), "y": (-0.24, 0.24), "width": 9.0}


def draw_plans() -> Figure:
    """Fig. 2: CMPs in heel and toe, with and without jumps between them."""
    titles = "(a) the CMP jumps", "(b) the CMP is shifted"
    fig, axes = plan_views(*titles, rows=len(titles), **_TWO_STEPS)
    for ax, smooth in zip(axes, (False, True), strict=True):
        plan, _ = swing_plan(*FAST, smooth)
        times = _draw_walk(ax, plan, *FAST)
        if smooth:
            path = np.array([plan.at(t).ecmp for t in times])
            ax.plot(*path.T, color=palette.ECMP, lw=1.0, label="CMP")
        knots = plan.knots[plan.knots <= times[-1]]
        for points, mark, color, size, label in (
            (plan.cop_waypoints, "o", palette.ECMP, 6, "CMPs of heel and toe"),
            (_icps(plan, knots), ".", palette.PUSH, 9, "knots"),
        ):
            look = {"color": color, "ms": size, "label": label, "ls": "none"}
            ax.plot(*np.transpose(points), mark, **look)
    share_legend(fig, axes[-1])
    return fig


def draw_speeds() -> Figure:
    """Fig. 3: ICP plans of slow and fast steps."""
    titles = [f"swing {a:g} s, transfer {b:g} s" for a, b in SPEEDS]
    fig, axes = plan_views(*titles, rows=len(titles), **_TWO_STEPS)
    for ax, durations in zip(axes, SPEEDS, strict=True):
        plan, middle = swing_plan(*durations)
        _draw_walk(ax, plan, *durations)
        middles = middle, middle + sum(durations)
        icps = _icps(plan, middles)
        look = {"color": palette.ICP, "ms": 9, "mew": 2.5, "ls": "none"}
        ax.plot(*icps.T, "x", **look, label="half-way through a swing")
    share_legend(fig, axes[-1])
    return fig


def draw_projection() -> Figure:
    """Fig. 4: projection of the ICP on the line to the plan's end."""
    plan, time = swing_plan(*FAST)
    icp = plan.at(time).icp + [0.04, -0.11]
    title = "How far the plan is advanced (Eqs. 10 to 12)"
    fig, (ax,) = plan_views(title, **_STEP, width=9.0)
    ahead = _draw_speed_up(ax, plan, time, icp)
    end = plan.at(plan.duration).icp
    start = plan.at(time).icp
    ax.plot(*np.array([start, end]).T, color=FAINT, lw=1.0, ls="--")
    ax.plot(*np.array([icp, projected(plan, time, icp)]).T, color=FAINT, lw=1.0)
    ax.plot(*end, "D", color=palette.ICP_REFERENCE, label="its end, $ξ_t$")
    ax.plot(*plan.at(time).ecmp, "s", color=palette.ECMP, label="$r_{cmp,r}$")
    _note(ax, f"Δt = {ahead:.2f} s")
    share_legend(fig, ax, columns=4)
    return fig


def draw_speed_up() -> Figure:
    """Fig. 5: the ICP error that remains after the plan is sped up."""
    fig, axes = plan_views(*(name for name, _, _ in CASES), **_STEP)
    for ax, (_, durations, error) in zip(axes, CASES, strict=True):
        plan, time = swing_plan(*durations)
        icp = plan.at(time).icp + error
        ahead = _draw_speed_up(ax, plan, time, icp)
        rest = icp - plan.at(time + ahead).icp
        before, after = 100.0 * math.hypot(*error), 100.0 * math.hypot(*rest)
        _note(ax, f"Δt = {ahead:.2f} s\nerror {before:.0f} → {after:.1f} cm")
    share_legend(fig, axes[0])
    return fig


def swing_plan(
    swing: float, transfer: float, smooth: bool = True
) -> tuple[IcpPlan, float]:
    """The plan of a right swing in a steady walk, and its mid-time [s]."""
    feet = FootPoses(_foothold(0), _foothold(-1))
    footholds = map(_foothold, range(1, _STEPS + 1))
    schedule = right_swing(feet, footholds, swing, transfer)
    params = AtlasIcpPlanParams(smooth=smooth, num_previewed_steps=_STEPS)
    return plan_atlas_icp(schedule, params, MODEL), 0.5 * swing


def fraction_done(icp: Array, icp_r: Array, icp_end: Array) -> float:
    """Returns the share in [0, 1] of icp_r -> icp_end that the ICP has passed.

    Points (2,) [m] in W.  The share goes to 0 as icp_end approaches icp_r.
    Erratum: Atlas paper, Eq. 10 must divide by the squared norm.
    """
    way = icp_end - icp_r
    length2 = max(float(way @ way), _SHORT_WAY**2)
    return min(max(float((icp - icp_r) @ way) / length2, 0.0), 1.0)


def time_ahead(fraction: float, remaining: float, omega: float) -> float:
    """Returns the time [s] by which the ICP leads, in [0, remaining] (Eq. 16).

    `fraction` in [0, 1] is the result of `fraction_done` for the plan's ICP at
    the end of the phase, which is `remaining` [s] away; omega [rad/s].
    Erratum: the logarithm of the Nadia paper's Eq. 16 is of the scalar ratio
    of two collinear vectors.  With the constant eCMP that leads from icp_r to
    icp_end in the remaining time, that ratio is 1 + fraction (e^(w T) - 1).
    """
    return math.log1p(fraction * math.expm1(omega * remaining)) / omega


def projected(plan: IcpPlan, time: float, icp: Array) -> Array:
    """The point xi_p (2,) [m] of Eq. 10."""
    start, end = plan.at(time).icp, plan.at(plan.duration).icp
    return start + fraction_done(icp, start, end) * (end - start)


def _icps(plan: IcpPlan, times: Iterable[float]) -> Array:
    """The plan's ICPs (n, 2) [m] at n `times` [s]."""
    return np.array([plan.at(t).icp for t in times])


def _draw_speed_up(ax: Axes, plan: IcpPlan, time: float, icp: Array) -> float:
    """Draws the plan, the ICP, and both references; returns Δt [s]."""
    start, goal = plan.at(time).icp, projected(plan, time, icp)
    done = fraction_done(icp, start, plan.at(plan.duration).icp)
    ahead = time_ahead(done, plan.duration - time, MODEL.omega)
    _draw_soles(ax, 2)
    times = np.linspace(0.0, plan.duration, 60)
    path = _icps(plan, times)
    ax.plot(*path.T, color=palette.ICP_REFERENCE, lw=3.0, label="ICP plan")
    rest = np.array([plan.at(time + ahead).icp, icp])
    ax.plot(*rest.T, color=palette.PUSH, lw=2.0, label="error that is left")
    for point, mark, color, label in (
        (start, "o", palette.ICP_REFERENCE, "reference, $ξ_r$"),
        (goal, "x", TEXT, "projected ICP, $ξ_p$"),
        (plan.at(time + ahead).icp, "*", palette.COM, "sped-up reference"),
        (icp, "o", palette.ICP, "ICP, $ξ$"),
    ):
        ax.plot(*point, mark, color=color, ms=8, label=label, ls="none")
    return ahead


def _draw_walk(ax: Axes, plan: IcpPlan, swing: float, transfer: float) -> Array:
    """Draws the plan of two steps; returns times (n,) [s] until its end."""
    _draw_soles(ax, 3)
    step = swing + transfer
    for begin, end, color, name in (
        (0.0, swing, palette.ICP_REFERENCE, "swing"),
        (swing, step, palette.RIGHT, "transfer"),
    ):
        for first in 0.0, step:
            times = np.linspace(first + begin, first + end, 60)
            path = _icps(plan, times)
            label = f"ICP plan, {name}" if first == 0.0 else None
            ax.plot(*path.T, color=color, lw=3.0, label=label)
    return np.linspace(0.0, 2.0 * step, 400)


def _draw_soles(ax: Axes, count: int) -> None:
    """Draws the stance foot and the next footholds."""
    for n in range(count):
        alpha, line = (0.0, "--") if n else (0.12, "-")
        corners = _foothold(n).to_world(MODEL.sole)
        draw_sole(ax, corners, _side(n), alpha=alpha, linestyle=line)


def _foothold(step: int) -> FootPose:
    y = _side(step).sign * 0.5 * MODEL.step_width
    return FootPose([step * LENGTH, y, 0.0])


def _side(step: int) -> Side:
    return Side.RIGHT if step % 2 else Side.LEFT


def _note(ax: Axes, text: str) -> None:
    place = {"xycoords": "axes fraction", "ha": "left", "va": "bottom"}
    note(ax, text, (0.03, 0.05), fontsize=9, **place)


FIGURES = {
    "2": draw_plans,
    "3": draw_speeds,
    "4": draw_projection,
    "5": draw_speed_up,
}


@program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv` and returns 0; bad input exits."""
    return draw("atlas", FIGURES, __doc__, argv)


if __name__ == "__main__":
    sys.exit(main())
