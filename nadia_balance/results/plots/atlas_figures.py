"""Figures of the Atlas paper's plan and swing speed-up, seen from above.

They use the controller's functions.  Atlas stands on its left foot, in a right
swing.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nadia_balance import palette
from nadia_balance.core.atlas_icp_plan import (
    AtlasIcpPlanParams,
    plan_atlas_icp,
)
from nadia_balance.core.icp_plan import IcpPlan
from nadia_balance.core.time_adjustment import fraction_done, time_ahead
from nadia_balance.core.walking import (
    Array,
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
)
from nadia_balance.results.plots.style import FAINT, TEXT, fill
from nadia_balance.robot import load_robot

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
_STEPS = 6  # steps of the walk; its end has no effect on the figures
_Y = (-0.24, 0.24)  # limits of the y axis [m]


def draw_plans() -> Figure:
    """Fig. 2: CMPs in heel and toe, with and without jumps between them."""
    fig, axes = _axes("(a) the CMP jumps", "(b) the CMP is shifted", steps=2)
    for ax, smooth in zip(axes, (False, True), strict=True):
        plan, _ = swing_plan(*FAST, smooth)
        times = _draw_walk(ax, plan, *FAST)
        if smooth:
            path = np.array([plan.at(t).ecmp for t in times])
            ax.plot(*path.T, color=palette.ECMP, lw=1.0, label="CMP")
        knots = plan.knots[plan.knots <= times[-1]]
        for points, mark, color, size, label in (
            (plan.cop_waypoints, "o", palette.ECMP, 6, "CMPs of heel and toe"),
            ([plan.at(t).icp for t in knots], ".", palette.PUSH, 9, "knots"),
        ):
            look = {"color": color, "ms": size, "label": label, "ls": "none"}
            ax.plot(*np.transpose(points), mark, **look)
    _legend(fig, axes[-1])
    return fig


def draw_speeds() -> Figure:
    """Fig. 3: ICP plans of slow and fast steps."""
    titles = [f"swing {a:g} s, transfer {b:g} s" for a, b in SPEEDS]
    fig, axes = _axes(*titles, steps=2)
    for ax, durations in zip(axes, SPEEDS, strict=True):
        plan, middle = swing_plan(*durations)
        _draw_walk(ax, plan, *durations)
        middles = middle, middle + sum(durations)
        icps = np.array([plan.at(t).icp for t in middles])
        look = {"color": palette.ICP, "ms": 9, "mew": 2.5, "ls": "none"}
        ax.plot(*icps.T, "x", **look, label="half-way through a swing")
    _legend(fig, axes[-1])
    return fig


def draw_projection() -> Figure:
    """Fig. 4: projection of the ICP on the line to the plan's end."""
    plan, time = swing_plan(*FAST)
    icp = plan.at(time).icp + [0.04, -0.11]
    fig, (ax,) = _axes("How far the plan is advanced (Eqs. 10 to 12)")
    ahead = _draw_speed_up(ax, plan, time, icp)
    end = plan.at(plan.duration).icp
    start = plan.at(time).icp
    ax.plot(*np.array([start, end]).T, color=FAINT, lw=1.0, ls="--")
    ax.plot(*np.array([icp, projected(plan, time, icp)]).T, color=FAINT, lw=1.0)
    ax.plot(*end, "D", color=palette.ICP_REFERENCE, label="its end, $ξ_t$")
    ax.plot(*plan.at(time).ecmp, "s", color=palette.ECMP, label="$r_{cmp,r}$")
    _note(ax, f"Δt = {ahead:.2f} s")
    fig.legend(loc="outside right center")
    return fig


def draw_speed_up() -> Figure:
    """Fig. 5: the ICP error that remains after the plan is sped up."""
    fig, axes = _axes(*(name for name, _, _ in CASES))
    for ax, (_, durations, error) in zip(axes, CASES, strict=True):
        plan, time = swing_plan(*durations)
        icp = plan.at(time).icp + error
        ahead = _draw_speed_up(ax, plan, time, icp)
        rest = icp - plan.at(time + ahead).icp
        before, after = 100.0 * math.hypot(*error), 100.0 * math.hypot(*rest)
        _note(ax, f"Δt = {ahead:.2f} s\nerror {before:.0f} → {after:.1f} cm")
    _legend(fig, axes[0])
    return fig


def swing_plan(
    swing: float, transfer: float, smooth: bool = True
) -> tuple[IcpPlan, float]:
    """The plan of a right swing in a steady walk, and its mid-time [s]."""
    half = 0.5 * MODEL.step_width

    def foot(side: Side, steps: int) -> FootPose:
        return FootPose(np.array([steps * LENGTH, side.sign * half, 0.0]))

    nothing = np.zeros(2)
    schedule = ContactSchedule(
        phase=Phase.SWING,
        support_side=Side.LEFT,
        duration=swing,
        feet=FootPoses(foot(Side.LEFT, 0), foot(Side.RIGHT, -1)),
        footsteps=tuple(
            Footstep(side, foot(side, n), transfer, swing)
            for n in range(1, _STEPS + 1)
            for side in [_side(n)]
        ),
        start=ReferencePoint(nothing, nothing, nothing),
    )
    params = AtlasIcpPlanParams(smooth=smooth, num_previewed_steps=_STEPS)
    return plan_atlas_icp(schedule, params, MODEL), 0.5 * swing


def projected(plan: IcpPlan, time: float, icp: Array) -> Array:
    """The point xi_p (2,) [m] of Eq. 10."""
    start, end = plan.at(time).icp, plan.at(plan.duration).icp
    return start + fraction_done(icp, start, end) * (end - start)


def _draw_speed_up(ax: Axes, plan: IcpPlan, time: float, icp: Array) -> float:
    """Draws the plan, the ICP, and both references; returns Δt [s]."""
    start, goal = plan.at(time).icp, projected(plan, time, icp)
    done = fraction_done(icp, start, plan.at(plan.duration).icp)
    ahead = time_ahead(done, plan.duration - time, MODEL.omega)
    _draw_soles(ax, 2)
    times = np.linspace(0.0, plan.duration, 60)
    path = np.array([plan.at(t).icp for t in times])
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
            path = np.array([plan.at(t).icp for t in times])
            label = f"ICP plan, {name}" if first == 0.0 else None
            ax.plot(*path.T, color=color, lw=3.0, label=label)
    return np.linspace(0.0, 2.0 * step, 400)


def _draw_soles(ax: Axes, count: int) -> None:
    """Draws the stance foot and the next footholds."""
    for n in range(count):
        side = _side(n)
        centre = [n * LENGTH, side.sign * 0.5 * MODEL.step_width]
        sole, color = MODEL.sole + centre, palette.foot_color(side)
        alpha, line = (0.0, "--") if n else (0.12, "-")
        fill(ax, sole, color, alpha=alpha, linestyle=line)


def _side(step: int) -> Side:
    return Side.RIGHT if step % 2 else Side.LEFT


def _legend(fig: Figure, ax: Axes) -> None:
    handles, labels = ax.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=len(labels))


def _note(ax: Axes, text: str) -> None:
    place = {"xycoords": "axes fraction", "va": "bottom", "fontsize": 9}
    ax.annotate(text, (0.03, 0.05), color=TEXT, **place)


def _axes(*titles: str, steps: int = 1) -> tuple[Figure, list[Axes]]:
    """Axes in a row for one step, in a column for several."""
    rows, columns = (1, len(titles)) if steps == 1 else (len(titles), 1)
    wide = 4.4 if columns > 1 else 9.0
    high = wide * (0.55 if steps == 1 else 0.4)
    fig = Figure((wide * columns, high * rows + 0.9), layout="constrained")
    axes = list(fig.subplots(rows, columns, squeeze=False).flat)
    seen = (-0.2, 0.25 + LENGTH * steps)
    for ax, title in zip(axes, titles, strict=True):
        ax.set(xlim=seen, ylim=_Y, aspect="equal", title=title)
        ax.set(xlabel="x, forward [m]", ylabel="y, left [m]")
        ax.label_outer()
    return fig, axes
