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
# Least length [m] of icp_r -> icp_end in Eq. 10: it goes to 0 in a transfer.
_SHORTEST = 0.01
_STEPS = 6  # steps of the walk; its end has no effect on the figures
# Limits of the axes [m]: along one step, along two, and across.
_ONE_STEP = (-0.2, 0.75)
_TWO_STEPS = (-0.2, 1.25)
_ACROSS = (-0.24, 0.24)


def draw_plans() -> Figure:
    """Draws Fig. 2: CMPs in heel and toe, with and without jumps between them.

    Returns:
        The figure.
    """
    fig, axes = plan_views(
        "(a) the CMP jumps",
        "(b) the CMP is shifted",
        x=_TWO_STEPS,
        y=_ACROSS,
        rows=2,
        width=9.0,
    )
    for ax, smooth in zip(axes, (False, True), strict=True):
        plan, _ = swing_plan(*FAST, smooth)
        times = _draw_walk(ax, plan, *FAST)
        if smooth:
            ax.plot(
                *np.transpose([plan.at(t).ecmp for t in times]),
                color=palette.ECMP,
                lw=1.0,
                label="CMP",
            )
        ax.plot(
            *np.transpose(plan.cop_waypoints),
            "o",
            color=palette.ECMP,
            ms=6,
            label="CMPs of heel and toe",
            ls="none",
        )
        ax.plot(
            *_icps(plan, plan.knots[plan.knots <= times[-1]]).T,
            ".",
            color=palette.PUSH,
            ms=9,
            label="knots",
            ls="none",
        )
    share_legend(fig, axes[-1])
    return fig


def draw_speeds() -> Figure:
    """Draws Fig. 3: ICP plans of slow and fast steps.

    Returns:
        The figure.
    """
    fig, axes = plan_views(
        *(f"swing {a:g} s, transfer {b:g} s" for a, b in SPEEDS),
        x=_TWO_STEPS,
        y=_ACROSS,
        rows=len(SPEEDS),
        width=9.0,
    )
    for ax, durations in zip(axes, SPEEDS, strict=True):
        plan, middle = swing_plan(*durations)
        _draw_walk(ax, plan, *durations)
        ax.plot(
            *_icps(plan, (middle, middle + sum(durations))).T,
            "x",
            color=palette.ICP,
            ms=9,
            mew=2.5,
            ls="none",
            label="half-way through a swing",
        )
    share_legend(fig, axes[-1])
    return fig


def draw_projection() -> Figure:
    """Draws Fig. 4: projection of the ICP on the line to the plan's end.

    Returns:
        The figure.
    """
    plan, time = swing_plan(*FAST)
    icp = plan.at(time).icp + [0.04, -0.11]
    fig, (ax,) = plan_views(
        "How far the plan is advanced (Eqs. 10 to 12)",
        x=_ONE_STEP,
        y=_ACROSS,
        width=9.0,
    )
    ahead = _draw_speed_up(ax, plan, time, icp=icp)
    end = plan.at(plan.duration).icp
    ax.plot(*np.array([plan.at(time).icp, end]).T, color=FAINT, lw=1.0, ls="--")
    ax.plot(*np.array([icp, projected(plan, time, icp)]).T, color=FAINT, lw=1.0)
    ax.plot(*end, "D", color=palette.ICP_REFERENCE, label="its end, $ξ_t$")
    ax.plot(*plan.at(time).ecmp, "s", color=palette.ECMP, label="$r_{cmp,r}$")
    _note(ax, f"Δt = {ahead:.2f} s")
    share_legend(fig, ax, columns=4)
    return fig


def draw_speed_up() -> Figure:
    """Draws Fig. 5: the ICP error that remains after the plan is sped up.

    Returns:
        The figure.
    """
    fig, axes = plan_views(
        *(name for name, _, _ in CASES), x=_ONE_STEP, y=_ACROSS
    )
    for ax, (_, durations, error) in zip(axes, CASES, strict=True):
        plan, time = swing_plan(*durations)
        icp = plan.at(time).icp + error
        ahead = _draw_speed_up(ax, plan, time, icp=icp)
        rest = icp - plan.at(time + ahead).icp
        _note(
            ax,
            f"Δt = {ahead:.2f} s\nerror {100.0 * math.hypot(*error):.0f} → "
            f"{100.0 * math.hypot(*rest):.1f} cm",
        )
    share_legend(fig, axes[0])
    return fig


def swing_plan(
    swing: float, transfer: float, smooth: bool = True
) -> tuple[IcpPlan, float]:
    """Plans a steady walk from the beginning of a right swing on.

    Args:
        swing: duration of swings [s].
        transfer: duration of transfers [s].
        smooth: without jumps of the CMP.

    Returns:
        The plan, and the middle of the swing [s].
    """
    plan = plan_atlas_icp(
        right_swing(
            FootPoses(_foothold(0), _foothold(-1)),
            map(_foothold, range(1, _STEPS + 1)),
            swing=swing,
            transfer=transfer,
        ),
        AtlasIcpPlanParams(smooth=smooth, num_previewed_steps=_STEPS),
        MODEL,
    )
    return plan, 0.5 * swing


def fraction_done(icp: Array, icp_r: Array, icp_end: Array) -> float:
    """Returns the share of icp_r -> icp_end that the ICP has passed.

    It is (icp - icp_r)^T (icp_end - icp_r) / |icp_end - icp_r|^2, and goes to 0
    as icp_end approaches icp_r.
    Erratum: Atlas paper, Eq. 10 must divide by the squared norm.

    Args:
        icp: ICP (2,) in W [m].
        icp_r: its reference (2,) in W [m].
        icp_end: reference (2,) at the end of the phase, in W [m].

    Returns:
        The share in [0, 1].
    """
    span = icp_end - icp_r
    length2 = max(float(span @ span), _SHORTEST**2)
    return min(max(float((icp - icp_r) @ span) / length2, 0.0), 1.0)


def time_ahead(fraction: float, remaining: float, omega: float) -> float:
    """Returns the time by which the ICP leads (Eq. 16).

    Erratum: the logarithm of the Nadia paper's Eq. 16 is of the scalar ratio
    of two collinear vectors.  With the constant eCMP that leads from icp_r to
    icp_end in the remaining time, that ratio is 1 + fraction (e^(w T) - 1).

    Args:
        fraction: result of `fraction_done`, in [0, 1].
        remaining: T, time until the end of the phase [s].
        omega: w of the pendulum [rad/s].

    Returns:
        The time in [0, remaining] [s].
    """
    return math.log1p(fraction * math.expm1(omega * remaining)) / omega


def projected(plan: IcpPlan, time: float, icp: Array) -> Array:
    """Returns the point xi_p of Eq. 10.

    Args:
        plan: of the phase.
        time: since its beginning [s].
        icp: ICP (2,) in W [m].

    Returns:
        The point (2,) in W [m].
    """
    start = plan.at(time).icp
    end = plan.at(plan.duration).icp
    return start + fraction_done(icp, start, end) * (end - start)


def _icps(plan: IcpPlan, times: Iterable[float]) -> Array:
    """The plan's ICPs (n, 2) [m] at n `times` [s]."""
    return np.array([plan.at(t).icp for t in times])


def _draw_speed_up(
    ax: Axes, plan: IcpPlan, time: float, *, icp: Array
) -> float:
    """Draws the plan, the ICP, and both references; returns Δt [s]."""
    start = plan.at(time).icp
    ahead = time_ahead(
        fraction_done(icp, start, plan.at(plan.duration).icp),
        remaining=plan.duration - time,
        omega=MODEL.omega,
    )
    sped_up = plan.at(time + ahead).icp
    _draw_soles(ax, 2)
    ax.plot(
        *_icps(plan, np.linspace(0.0, plan.duration, 60)).T,
        color=palette.ICP_REFERENCE,
        lw=3.0,
        label="ICP plan",
    )
    ax.plot(
        *np.array([sped_up, icp]).T,
        color=palette.PUSH,
        lw=2.0,
        label="error that is left",
    )
    for point, mark, color, label in (
        (start, "o", palette.ICP_REFERENCE, "reference, $ξ_r$"),
        (projected(plan, time, icp), "x", TEXT, "projected ICP, $ξ_p$"),
        (sped_up, "*", palette.COM, "sped-up reference"),
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
            ax.plot(
                *_icps(plan, np.linspace(first + begin, first + end, 60)).T,
                color=color,
                lw=3.0,
                label=f"ICP plan, {name}" if first == 0.0 else None,
            )
    return np.linspace(0.0, 2.0 * step, 400)


def _draw_soles(ax: Axes, count: int) -> None:
    """Draws the stance foot and the next footholds."""
    for n in range(count):
        draw_sole(
            ax,
            _foothold(n).to_world(MODEL.sole),
            _side(n),
            alpha=0.0 if n else 0.12,
            linestyle="--" if n else "-",
        )


def _foothold(step: int) -> FootPose:
    y = _side(step).sign * 0.5 * MODEL.step_width
    return FootPose(np.array([step * LENGTH, y, 0.0]))


def _side(step: int) -> Side:
    return Side.RIGHT if step % 2 else Side.LEFT


def _note(ax: Axes, text: str) -> None:
    """Writes a text in the corner of the axes."""
    note(
        ax,
        text,
        (0.03, 0.05),
        ha="left",
        va="bottom",
        fontsize=9,
        xycoords="axes fraction",
    )


FIGURES = {
    "2": draw_plans,
    "3": draw_speeds,
    "4": draw_projection,
    "5": draw_speed_up,
}


@program
def main(argv: list[str] | None = None) -> int:
    """Draws the figures; bad input exits.

    Args:
        argv: command line; by default the program's.

    Returns:
        The exit code 0.
    """
    return draw("atlas", FIGURES, description=__doc__, argv=argv)


if __name__ == "__main__":
    sys.exit(main())
