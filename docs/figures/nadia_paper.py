"""Draws figures of the Nadia paper by the functions of the controller.

3 ICP feedback, 4 capture regions, 6 their growth, 8 reachable footholds, 9
rules that choose a region.  The robot stands on its left foot, in a right
swing; nothing is simulated.

Examples:
    python docs/figures/nadia_paper.py
    python docs/figures/nadia_paper.py --figure 4 9 --out figures
"""

import math
import sys

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drawing import draw, note, plan_views, right_swing, share_legend
from nadia_balance import palette
from nadia_balance.balance_controller import ControllerParams
from nadia_balance.core.body import reachability
from nadia_balance.core.body.reachability import BACKWARD, BASE, FORWARD
from nadia_balance.core.feedback import momentum_qp
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import intersection
from nadia_balance.core.steps import capture_region as regions
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
)
from nadia_balance.core.steps.foothold_adjustment import (
    Landing,
    adjust_foothold,
    unadjusted,
)
from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.core.walking.state import FootPose, FootPoses, Side
from nadia_balance.results.plots.style import FAINT, arrow, draw_sole, fill
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts.command_line import program

MODEL = load_robot("nadia").point_mass
SOLE, REACH = MODEL.sole, MODEL.reach
STANCE, SWING = FootPose(), Side.RIGHT
NOMINAL = FootPose([0.0, -MODEL.step_width, 0.0])  # nominal foothold
USABLE = CaptureRegionStepAdjusterParams().usable_foot(SOLE)

# Fig. 3: reference of both CoP and eCMP, and ICP error [m].
COP_R, ERROR = np.array([-0.06, -0.02]), np.array([0.05, 0.042])

# Figs. 4 and 6.
ICP = np.array([0.16, 0.0])  # [m]
REMAINING_TIME = 0.25  # until touchdown [s]
LATEST = 5.0  # latest touchdown; the region then exceeds the circle [s]
STEP_DURATION = 0.5  # transfer plus swing of each later step [s]
CONTRACTION = math.exp(-MODEL.omega * STEP_DURATION)  # in one step [-]
CIRCLE = reachability.circle(REACH.length_forward, 96)
REACHES = {  # of later steps
    "Any step of up to 1 m": CIRCLE,
    "Feet side by side: an ellipse": reachability.base_region(REACH),
    "Cross-over allowed": reachability.total_region(REACH, cross_over=True),
}
NAMES = ("C₁", "C₂", "C₃")
_WHEN = (
    f"Where to step so as to recover: touchdown in {REMAINING_TIME} s, "
    f"all later steps take {STEP_DURATION} s each"
)

# Fig. 8: all reachability regions by name, in W.
REGIONS = {
    name: reachability.in_world(region, STANCE, SWING)
    for name, region in reachability.step_regions(REACH, True).items()
}

# Fig. 9: earliest and latest touchdown from now [s]; title and ICP [m] of each
# rule.
TOUCHDOWN = (0.2, 0.5)
RULES = (
    ("Rule 1: base, if it meets the capture region", (0.2, -0.03)),
    ("Rule 2: the cross-over region that shares most", (0.07, 0.08)),
    ("Rule 3: the closest, if none meets it", (-0.02, 0.21)),
)

_SEEN = {"x": (-0.3, 1.35), "y": (-0.8, 0.8)}  # in Figs. 4 and 6 [m]
_GUIDE = {"color": FAINT, "lw": 0.9, "ls": (0, (4, 3))}  # dimension line


def draw_feedback() -> Figure:
    """Fig. 3: the eCMP of ankle feedback only, without and with Q_perp."""
    fig, axes = plan_views(
        "Without $Q_⊥$: as near as can be",
        "With $Q_⊥$: along the error",
        x=(-0.15, 0.17),
        y=(-0.08, 0.13),
    )
    weights = 0.0, 1e5  # the default is between the two
    none, dots = np.zeros(2), {"ls": "none", "mec": "white", "ms": 9}
    for ax, weight in zip(axes, weights, strict=True):
        params = momentum_qp.MomentumQpParams(
            perpendicular_weight=weight, max_kappa=0.0, rate_weight=0.0
        )
        limits = momentum_qp.feedback_limits(SOLE, 0.0, params)
        qp = momentum_qp.IcpFeedbackQp(params)
        ecmp = qp.solve(ERROR, COP_R, none, np.zeros(4), limits).ecmp
        asked = COP_R + params.feedback_gain * ERROR
        edge = {"alpha": 0.0, "linewidth": 0.8}
        _draw_sole(ax, STANCE, SWING.other, "support polygon")
        fill(ax, limits.polygon, palette.SUPPORT, "limit of the CoP", **edge)
        arrow(ax, COP_R, asked, FAINT)
        arrow(ax, COP_R, ecmp, palette.ECMP)
        ax.plot(*asked, "D", color=FAINT, label="eCMP asked for", **dots)
        ax.plot(*COP_R, "o", color=palette.COP, label="reference", **dots)
        ax.plot(*ecmp, "s", color=palette.ECMP, label="eCMP", **dots)
        beside = COP_R + 0.85 * (asked - COP_R) + [-0.014, 0.002]
        note(ax, "$k_p\\,ξ_e$", tuple(beside))
    share_legend(fig, axes[0])
    return fig


def draw_by_reachability() -> Figure:
    """Fig. 4: C_1 to C_3, with the same reach of all later steps."""
    fig, axes = plan_views(*REACHES, **_SEEN)
    reaches = (
        CIRCLE,
        reachability.base_region(REACH),
        reachability.total_region(REACH, cross_over=True),
    )
    for ax, reach in zip(axes, reaches, strict=True):
        for n in range(len(NAMES), 0, -1):
            region = regions.capture_region(_one_step(), _offsets(reach, n))
            fill(ax, region, palette.CAPTURE_REGIONS[n - 1], NAMES[n - 1])
        _draw_feet(ax)
    share_legend(fig, axes[0], _WHEN)
    return fig


def draw_growth() -> Figure:
    """Fig. 6: C_n is C_1 swept by the reversed offsets -D_n of later steps."""
    titles, reaches = zip(*list(REACHES.items())[:2], strict=True)
    fig, axes = plan_views(*titles, **_SEEN)
    for ax, reach in zip(
        axes, (CIRCLE, reachability.base_region(REACH)), strict=True
    ):
        for n in range(2, len(NAMES) + 1):
            color, offsets = palette.CAPTURE_REGIONS[n - 1], _offsets(reach, n)
            for point in _around(_one_step(), 28):
                fill(ax, point - offsets, color, alpha=0.0, linewidth=0.6)
            region = regions.capture_region(_one_step(), offsets)
            label = f"{NAMES[n - 1]}: {NAMES[0]} swept by -D{NAMES[n - 1][1]}"
            fill(ax, region, color, label, alpha=0.0, linewidth=2.0)
        fill(ax, _one_step(), palette.CAPTURE_REGIONS[0], NAMES[0])
        _draw_feet(ax)
    share_legend(fig, axes[0], _WHEN)
    return fig


def _offsets(reach: Array, n: int) -> Array:
    """D_n (k, 2) [m] for a `reach` (n, 2) [m] in the stance foot's frame."""
    reaches = [
        reachability.in_world(reach, STANCE, SWING if k % 2 else SWING.other)
        for k in range(2, n + 1)
    ]
    return regions.later_steps(reaches, [CONTRACTION] * (n - 1))[-1]


def _around(polygon: Array, count: int) -> Array:
    """Points (count, 2) [m] at equal distances along the boundary."""
    closed = np.vstack([polygon, polygon[:1]])
    lengths = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    way = np.cumsum([0.0, *lengths])
    at = np.linspace(0.0, way[-1], count, endpoint=False)
    return np.column_stack([np.interp(at, way, c) for c in closed.T])


def _one_step() -> Array:
    """C_1 (k, 2) [m], clipped to the circle only."""
    foot = reachability.in_world(USABLE, STANCE, SWING)
    touchdown = REMAINING_TIME, LATEST
    region = regions.one_step_region(ICP, foot, MODEL.omega, touchdown)
    return intersection(region, CIRCLE)


def _draw_feet(ax: Axes) -> None:
    """Draws the stance foot, its usable part, the planned foothold, the ICP."""
    _draw_sole(ax, STANCE, SWING.other)
    foot = reachability.in_world(USABLE, STANCE, SWING)
    fill(ax, foot, palette.LEFT, "where the CoP may be", linewidth=0.0)
    _draw_sole(ax, NOMINAL, SWING, "planned foothold", "--")
    _draw_icp(ax, ICP)


def draw_reach() -> Figure:
    """Fig. 8: the union of the reachability regions, and each region."""
    fig, axes = plan_views(
        "Reachable, with cross-over",
        "$R_b$: feet side by side",
        "$R_{fwd}$: crossing in front",
        "$R_{bwd}$: crossing behind",
        x=(-1.15, 1.15),
        y=(-0.9, 0.3),
        rows=2,
    )
    alone = [[name] for name in (BASE, FORWARD, BACKWARD)]
    for ax, names in zip(axes, (REGIONS, *alone), strict=True):
        for name in names:
            fill(ax, REGIONS[name], palette.REACH, "reachable", alpha=0.18)
        _draw_sole(ax, STANCE, SWING.other)
        _draw_sole(ax, NOMINAL, SWING, line="--")
    _measure_base(axes[1])
    _measure_crossing(axes[2], FORWARD)
    _measure_crossing(axes[3], BACKWARD)
    share_legend(fig, axes[0])
    return fig


def _measure_base(ax: Axes) -> None:
    """Writes the widths and lengths of Fig. 5 beside the base region."""
    for width, label in (
        (REACH.width_min, "$w_{min}$"),
        (REACH.width_nominal, "$w_{nom}$"),
        (REACH.width_max, "$w_{max}$"),
    ):
        ax.plot([0.0, 0.3], [-width, -width], **_GUIDE)
        at = (0.32, -width)
        note(ax, f"{label} = {width} m", at, ha="left", va="center")
    for x, label in (
        (REACH.length_forward, "$l_{max}$"),
        (-REACH.length_backward, "$l_{min}$"),
    ):
        ax.plot([x, x], [-REACH.width_nominal, 0.12], **_GUIDE)
        note(ax, f"{label} = {abs(x)} m", (0.9 * x, 0.15))


def _measure_crossing(ax: Axes, name: str) -> None:
    """Writes the dimensions of Fig. 8 beside a cross-over region.

    The angle theta is a parameter of the ellipse, not an angle in the picture.
    """
    word = "fwd" if name == FORWARD else "bwd"
    region = REGIONS[name]
    x, y = region[np.argmax(region[:, 1])]  # the farthest point across
    way = np.sign(x)
    ends = np.array([-0.2 * way, x])
    ax.plot(ends, [0.0, 0.0], **_GUIDE)
    ax.plot(ends, [y, y], **_GUIDE)
    ax.plot([x, x], [y, 0.2], **_GUIDE)
    side = {"ha": "right" if way > 0 else "left", "va": "center"}
    at = (-0.23 * way, y + 0.03 * np.sign(y))
    note(ax, f"$w_{{{word}}}$ = {y:.2f} m", at, **side)
    length = "max" if way > 0 else "min"
    text = rf"$l_{{{length}}}\,\sin θ_{{{word}}}$ = {abs(x):.2f} m"
    note(ax, text, (x, 0.22))


def draw_rules() -> Figure:
    """Fig. 9: the region that each rule chooses, and the adjusted foothold."""
    fig, axes = plan_views(
        *(title for title, _ in RULES), x=(-1.1, 1.3), y=(-0.9, 0.9)
    )
    params = CaptureRegionStepAdjusterParams()
    on = MECHANISMS["all_with_cross_over"]
    in_place = [NOMINAL, STANCE] * 2
    schedule = right_swing(FootPoses(STANCE, NOMINAL), in_place, 0.4, 0.1)
    geometry = SwingGeometry(schedule, params, MODEL, on)
    for ax, (_, icp) in zip(axes, RULES, strict=True):
        landing = Landing(geometry, np.array(icp), TOUCHDOWN)
        captures = landing.capture_region
        period = ControllerParams().control_period
        planned = unadjusted(schedule)
        found = adjust_foothold(planned, landing, params, period)
        for name, region in geometry.regions.items():
            if name != found.region:
                fill(ax, region, palette.REACH, alpha=0.0, linewidth=0.8)
        chosen = geometry.regions[found.region]
        fill(ax, chosen, palette.REACH, "reachable", alpha=0.18)
        fill(ax, captures, palette.CAPTURE_REGIONS[-1], "capture region C₃")
        shared = intersection(chosen, captures)
        fill(ax, shared, palette.CAPTURE_REGIONS[0], "what they share", 0.45)
        _draw_sole(ax, STANCE, SWING.other)
        _draw_sole(ax, NOMINAL, SWING, "planned foothold", "--")
        _draw_sole(ax, found.pose, SWING, "adjusted foothold")
        _draw_icp(ax, np.array(icp))
    share_legend(fig, axes[0])
    return fig


def _draw_sole(
    ax: Axes, pose: FootPose, side: Side, label: str = "", line: str = "-"
) -> None:
    """Draws a sole: filled with a solid line, outlined with another one."""
    label, alpha = label or f"{side.value} foot", 0.12 if line == "-" else 0.0
    look = {"label": label, "linestyle": line}
    draw_sole(ax, pose.to_world(SOLE), side, alpha, **look)


def _draw_icp(ax: Axes, icp: Array) -> None:
    ax.plot(*icp, "o", color=palette.ICP, ms=7, mec="white", label="ICP")


FIGURES = {
    "3": draw_feedback,
    "4": draw_by_reachability,
    "6": draw_growth,
    "8": draw_reach,
    "9": draw_rules,
}


@program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv` and returns 0; bad input exits."""
    return draw("nadia", FIGURES, __doc__, argv)


if __name__ == "__main__":
    sys.exit(main())
