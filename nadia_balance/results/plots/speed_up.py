"""Figures of the Atlas paper's swing speed-up, by the controller's functions.

Atlas stands on its left foot, half-way through a right swing, seen from above.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nadia_balance import palette
from nadia_balance.core.icp_plan import IcpPlan, IcpPlanParams, plan_icp
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
LENGTH = 0.5  # of a step [m]
SLOW, FAST = (1.0, 1.0), (0.7, 0.25)  # swing and transfer [s]
FORWARD, ASIDE = np.array([0.08, 0.0]), np.array([0.0, -0.08])  # errors [m]
CASES = (
    ("slow steps, error forward", SLOW, FORWARD),
    ("fast steps, error forward", FAST, FORWARD),
    ("fast steps, error to the side", FAST, ASIDE),
)
_X, _Y = (-0.2, 0.75), (-0.24, 0.24)  # what is seen [m]


def draw_projection() -> Figure:
    """Fig. 4: the ICP projected on the way from its reference to its end."""
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
    """Fig. 5: what an error leaves to do once the plan is sped up."""
    fig, axes = _axes(*(name for name, _, _ in CASES))
    for ax, (_, durations, error) in zip(axes, CASES, strict=True):
        plan, time = swing_plan(*durations)
        icp = plan.at(time).icp + error
        ahead = _draw_speed_up(ax, plan, time, icp)
        rest = icp - plan.at(time + ahead).icp
        before, after = 100.0 * math.hypot(*error), 100.0 * math.hypot(*rest)
        _note(ax, f"Δt = {ahead:.2f} s\nerror {before:.0f} → {after:.1f} cm")
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return fig


def swing_plan(swing: float, transfer: float) -> tuple[IcpPlan, float]:
    """The plan of a right swing in a steady walk, and its middle [s]."""
    half = 0.5 * MODEL.step_width

    def foot(side: Side, steps: int) -> FootPose:
        return FootPose(np.array([steps * LENGTH, side.sign * half, 0.0]))

    sides = [Side.RIGHT, Side.LEFT] * 3
    nothing = np.zeros(2)
    schedule = ContactSchedule(
        phase=Phase.SWING,
        support_side=Side.LEFT,
        duration=swing,
        feet=FootPoses(foot(Side.LEFT, 0), foot(Side.RIGHT, -1)),
        footsteps=tuple(
            Footstep(side, foot(side, n), transfer, swing)
            for n, side in enumerate(sides, start=1)
        ),
        start=ReferencePoint(nothing, nothing, nothing),
    )
    params = IcpPlanParams(continuous=False)
    return plan_icp(schedule, params, MODEL), 0.5 * swing


def projected(plan: IcpPlan, time: float, icp: Array) -> Array:
    """The point xi_p (2,) [m] of Eq. 10."""
    start, end = plan.at(time).icp, plan.at(plan.duration).icp
    return start + fraction_done(icp, start, end) * (end - start)


def _draw_speed_up(ax: Axes, plan: IcpPlan, time: float, icp: Array) -> float:
    """Draws the plan, the ICP, and both references; returns Δt [s]."""
    start, goal = plan.at(time).icp, projected(plan, time, icp)
    done = fraction_done(icp, start, plan.at(plan.duration).icp)
    ahead = time_ahead(done, plan.duration - time, MODEL.omega)
    for side, steps, line in (
        (Side.LEFT, 0, "-"),
        (Side.RIGHT, 1, "--"),
    ):
        centre = [steps * LENGTH, side.sign * 0.5 * MODEL.step_width]
        sole, color = MODEL.sole + centre, palette.foot_color(side)
        alpha = 0.12 if line == "-" else 0.0
        fill(ax, sole, color, alpha=alpha, linestyle=line)
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


def _note(ax: Axes, text: str) -> None:
    place = {"xycoords": "axes fraction", "va": "bottom", "fontsize": 9}
    ax.annotate(text, (0.03, 0.05), color=TEXT, **place)


def _axes(*titles: str) -> tuple[Figure, list[Axes]]:
    wide = 4.4 if len(titles) > 1 else 9.0
    size = wide * len(titles), wide * 0.55 + 0.9
    fig = Figure(figsize=size, layout="constrained")
    axes = list(fig.subplots(1, len(titles), squeeze=False).flat)
    for ax, title in zip(axes, titles, strict=True):
        ax.set(xlim=_X, ylim=_Y, aspect="equal", title=title)
        ax.set(xlabel="x, forward [m]", ylabel="y, left [m]")
        ax.label_outer()
    return fig, axes
