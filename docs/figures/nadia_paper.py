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
from nadia_balance.core.body.reachability import (
    BACKWARD,
    BASE,
    FORWARD,
    base_region,
    circle,
    in_world,
    step_regions,
    total_region,
)
from nadia_balance.core.feedback.momentum_qp import (
    IcpFeedbackQp,
    MomentumQpParams,
    feedback_limits,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import intersection
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
    capture_region,
    later_steps,
    one_step_region,
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
SOLE = MODEL.sole
REACH = MODEL.reach
STANCE = FootPose()
SWING = Side.RIGHT
NOMINAL = FootPose(np.array([0.0, -MODEL.step_width, 0.0]))  # foothold
USABLE = CaptureRegionStepAdjusterParams().usable_foot(SOLE)

# Fig. 3: reference of both CoP and eCMP, and ICP error [m].
COP_R = np.array([-0.06, -0.02])
ERROR = np.array([0.05, 0.042])

# All reachability regions of this step by name, in W: Figs. 4 and 8.
REGIONS = {
    name: in_world(region, STANCE, SWING)
    for name, region in step_regions(REACH, True).items()
}

# Figs. 4 and 6.  The ICP is where only crossed legs recover.
ICP = np.array([0.12, 0.08])  # [m]
REMAINING_TIME = 0.25  # until touchdown [s]
LATEST = 5.0  # latest touchdown; the region then exceeds the circle [s]
STEP_DURATION = 0.5  # transfer plus swing of each later step [s]
CONTRACTION = math.exp(-MODEL.omega * STEP_DURATION)  # in one step [-]
CIRCLE = circle(REACH.length_forward, 96)
REACHES = {  # of later steps
    "Any step of up to 1 m": CIRCLE,
    "Feet side by side: an ellipse": base_region(REACH),
    "Cross-over allowed": total_region(REACH, cross_over=True),
}
THIS_STEP = dict(
    zip(REACHES, ([CIRCLE], [REGIONS[BASE]], REGIONS.values()), strict=True)
)
NAMES = ("C₁", "C₂", "C₃")
_IN_REACH, _RECOVERS = "in reach of the right foot", "in reach, and recovers"
_WHEN = (
    f"Where to step so as to recover: touchdown in {REMAINING_TIME} s, "
    f"all later steps take {STEP_DURATION} s each"
)

# Fig. 9: earliest and latest touchdown from now [s]; title and ICP [m] of each
# rule.
TOUCHDOWN = (0.2, 0.5)
RULES = (
    ("Rule 1: base, if it meets the capture region", (0.2, -0.03)),
    ("Rule 2: the cross-over region that shares most", (0.07, 0.08)),
    ("Rule 3: the closest, if none meets it", (-0.02, 0.21)),
)

# Limits of the axes in Figs. 4 and 6 [m].
_FORWARD = (-0.3, 1.35)
_ACROSS = (-0.85, 0.85)


def draw_feedback() -> Figure:
    """Draws Fig. 3: the eCMP of ankle feedback only, without and with Q_perp.

    Returns:
        The figure.
    """
    fig, axes = plan_views(
        "Without $Q_⊥$: as near as can be",
        "With $Q_⊥$: along the error",
        x=(-0.15, 0.17),
        y=(-0.08, 0.13),
    )
    # The default of the weight is between the two.
    for ax, weight in zip(axes, (0.0, 1e5), strict=True):
        params = MomentumQpParams(
            perpendicular_weight=weight, max_kappa=0.0, rate_weight=0.0
        )
        limits = feedback_limits(SOLE, 0.0, params)
        solution = IcpFeedbackQp(params).solve(
            ERROR,
            COP_R,
            kappa_r=np.zeros(2),
            previous=np.zeros(4),
            limits=limits,
        )
        asked = COP_R + params.feedback_gain * ERROR
        _draw_sole(ax, STANCE, SWING.other, label="support polygon")
        fill(
            ax,
            limits.polygon,
            palette.SUPPORT,
            label="limit of the CoP",
            alpha=0.0,
            linewidth=0.8,
        )
        arrow(ax, COP_R, asked, FAINT)
        arrow(ax, COP_R, solution.ecmp, palette.ECMP)
        for point, mark, color, label in (
            (asked, "D", FAINT, "eCMP asked for"),
            (COP_R, "o", palette.COP, "reference"),
            (solution.ecmp, "s", palette.ECMP, "eCMP"),
        ):
            _draw_point(ax, point, mark, color=color, label=label, size=9)
        x, y = COP_R + 0.85 * (asked - COP_R) + [-0.014, 0.002]
        note(ax, "$k_p\\,ξ_e$", (x, y))
    share_legend(fig, axes[0])
    return fig


def draw_by_reachability() -> Figure:
    """Draws Fig. 4: C_1 to C_3, with the same reach of all steps.

    Returns:
        The figure.
    """
    fig, axes = plan_views(*REACHES, x=_FORWARD, y=_ACROSS)
    for ax, (title, reach) in zip(axes, REACHES.items(), strict=True):
        for n in range(len(NAMES), 0, -1):
            fill(
                ax,
                capture_region(_one_step(), _offsets(reach, n)),
                palette.CAPTURE_REGIONS[n - 1],
                label=NAMES[n - 1],
            )
        captures = capture_region(_one_step(), _offsets(reach, len(NAMES)))
        for region in THIS_STEP[title]:
            shared = intersection(region, captures)
            fill(ax, shared, palette.RIGHT, label=_RECOVERS, alpha=0.4)
            fill(ax, region, palette.REACH, label=_IN_REACH, alpha=0.0)
        _draw_feet(ax)
    share_legend(fig, axes[0], _WHEN)
    return fig


def draw_growth() -> Figure:
    """Draws Fig. 6: C_n is C_1 swept by the reversed offsets -D_n.

    Returns:
        The figure.
    """
    titles = list(REACHES)[:2]
    fig, axes = plan_views(*titles, x=_FORWARD, y=_ACROSS)
    for ax, title in zip(axes, titles, strict=True):
        for n in range(2, len(NAMES) + 1):
            color = palette.CAPTURE_REGIONS[n - 1]
            offsets = _offsets(REACHES[title], n)
            for point in _around(_one_step(), 28):
                fill(ax, point - offsets, color, alpha=0.0, linewidth=0.6)
            fill(
                ax,
                capture_region(_one_step(), offsets),
                color,
                label=f"{NAMES[n - 1]}: {NAMES[0]} swept by "
                f"-D{NAMES[n - 1][1]}",
                alpha=0.0,
                linewidth=2.0,
            )
        fill(ax, _one_step(), palette.CAPTURE_REGIONS[0], label=NAMES[0])
        _draw_feet(ax)
    share_legend(fig, axes[0], _WHEN)
    return fig


def _offsets(reach: Array, n: int) -> Array:
    """D_n (k, 2) [m] for a `reach` (n, 2) [m] in the stance foot's frame."""
    return later_steps(
        [
            in_world(reach, STANCE, SWING if k % 2 else SWING.other)
            for k in range(2, n + 1)
        ],
        [CONTRACTION] * (n - 1),
    )[-1]


def _around(polygon: Array, count: int) -> Array:
    """Points (count, 2) [m] at equal distances along the boundary."""
    closed = np.vstack([polygon, polygon[:1]])
    lengths = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    knots = np.cumsum([0.0, *lengths])
    samples = np.linspace(0.0, knots[-1], count, endpoint=False)
    return np.column_stack([np.interp(samples, knots, c) for c in closed.T])


def _one_step() -> Array:
    """C_1 (k, 2) [m], clipped to the circle only."""
    return intersection(
        one_step_region(
            icp=ICP,
            foot=in_world(USABLE, STANCE, SWING),
            omega=MODEL.omega,
            touchdown=(REMAINING_TIME, LATEST),
        ),
        CIRCLE,
    )


def _draw_feet(ax: Axes) -> None:
    """Draws the stance foot, its usable part, the planned foothold, the ICP."""
    _draw_sole(ax, STANCE, SWING.other)
    fill(
        ax,
        in_world(USABLE, STANCE, SWING),
        palette.LEFT,
        label="where the CoP may be",
        linewidth=0.0,
    )
    _draw_sole(ax, NOMINAL, SWING, label="planned foothold", line="--")
    _draw_point(ax, ICP, "o", color=palette.ICP, label="ICP")


def draw_reach() -> Figure:
    """Draws Fig. 8: the union of the reachability regions, and each region.

    Returns:
        The figure.
    """
    fig, axes = plan_views(
        "Reachable, with cross-over",
        "$R_b$: feet side by side",
        "$R_{fwd}$: crossing in front",
        "$R_{bwd}$: crossing behind",
        x=(-1.15, 1.15),
        y=(-0.9, 0.3),
        rows=2,
    )
    for ax, names in zip(
        axes, (list(REGIONS), [BASE], [FORWARD], [BACKWARD]), strict=True
    ):
        for name in names:
            fill(
                ax, REGIONS[name], palette.REACH, label="reachable", alpha=0.18
            )
        _draw_sole(ax, STANCE, SWING.other)
        _draw_sole(ax, NOMINAL, SWING, line="--")
    _measure_base(axes[1])
    _measure_crossing(axes[2], FORWARD, "fwd")
    _measure_crossing(axes[3], BACKWARD, "bwd")
    share_legend(fig, axes[0])
    return fig


def _measure_base(ax: Axes) -> None:
    """Writes the widths and lengths of Fig. 5 beside the base region."""
    for width, label in (
        (REACH.width_min, "$w_{min}$"),
        (REACH.width_nominal, "$w_{nom}$"),
        (REACH.width_max, "$w_{max}$"),
    ):
        _draw_guide(ax, (0.0, 0.3), (-width, -width))
        note(ax, f"{label} = {width} m", (0.32, -width), ha="left", va="center")
    for x, label in (
        (REACH.length_forward, "$l_{max}$"),
        (-REACH.length_backward, "$l_{min}$"),
    ):
        _draw_guide(ax, (x, x), (-REACH.width_nominal, 0.12))
        note(ax, f"{label} = {abs(x)} m", (0.9 * x, 0.15))


def _measure_crossing(ax: Axes, name: str, subscript: str) -> None:
    """Writes the dimensions of Fig. 8 beside a cross-over region.

    The angle theta is a parameter of the ellipse, not an angle in the picture.
    """
    region = REGIONS[name]
    x, y = region[np.argmax(region[:, 1])]  # the farthest point across
    sign = np.sign(x)
    _draw_guide(ax, (-0.2 * sign, x), (0.0, 0.0))
    _draw_guide(ax, (-0.2 * sign, x), (y, y))
    _draw_guide(ax, (x, x), (y, 0.2))
    note(
        ax,
        f"$w_{{{subscript}}}$ = {y:.2f} m",
        (-0.23 * sign, y + 0.03 * np.sign(y)),
        ha="right" if sign > 0 else "left",
        va="center",
    )
    note(
        ax,
        rf"$l_{{{'max' if sign > 0 else 'min'}}}\,\sin θ_{{{subscript}}}$ = "
        f"{abs(x):.2f} m",
        (x, 0.22),
    )


def draw_rules() -> Figure:
    """Draws Fig. 9: the region that each rule chooses, and its foothold.

    Returns:
        The figure.
    """
    fig, axes = plan_views(
        *(title for title, _ in RULES), x=(-1.1, 1.3), y=(-0.9, 0.9)
    )
    params = CaptureRegionStepAdjusterParams()
    schedule = right_swing(
        FootPoses(STANCE, NOMINAL),
        [NOMINAL, STANCE] * 2,
        swing=0.4,
        transfer=0.1,
    )
    geometry = SwingGeometry(
        schedule, params, MODEL, MECHANISMS["all_with_cross_over"]
    )
    for ax, (_, icp) in zip(axes, RULES, strict=True):
        landing = Landing(geometry, np.array(icp), TOUCHDOWN)
        adjusted = adjust_foothold(
            unadjusted(schedule),
            landing,
            params,
            period=ControllerParams().control_period,
        )
        for name, region in geometry.regions.items():
            if name != adjusted.region:
                fill(ax, region, palette.REACH, alpha=0.0, linewidth=0.8)
        reach = geometry.regions[adjusted.region]
        captures = landing.capture_region
        fill(ax, reach, palette.REACH, label="reachable", alpha=0.18)
        fill(
            ax, captures, palette.CAPTURE_REGIONS[-1], label="capture region C₃"
        )
        fill(
            ax,
            intersection(reach, captures),
            palette.CAPTURE_REGIONS[0],
            label="what they share",
            alpha=0.45,
        )
        _draw_sole(ax, STANCE, SWING.other)
        _draw_sole(ax, NOMINAL, SWING, label="planned foothold", line="--")
        _draw_sole(ax, adjusted.pose, SWING, label="adjusted foothold")
        _draw_point(ax, np.array(icp), "o", color=palette.ICP, label="ICP")
    share_legend(fig, axes[0])
    return fig


def _draw_sole(
    ax: Axes, pose: FootPose, side: Side, label: str = "", line: str = "-"
) -> None:
    """Draws a sole: filled with a solid line, outlined with another one."""
    draw_sole(
        ax,
        pose.to_world(SOLE),
        side,
        alpha=0.12 if line == "-" else 0.0,
        label=label or f"{side.value} foot",
        linestyle=line,
    )


def _draw_point(
    ax: Axes, point: Array, mark: str, *, color: str, label: str, size: int = 7
) -> None:
    ax.plot(
        *point, mark, color=color, ls="none", mec="white", ms=size, label=label
    )


def _draw_guide(
    ax: Axes, x: tuple[float, float], y: tuple[float, float]
) -> None:
    """Draws a line at which a dimension is written."""
    ax.plot(x, y, color=FAINT, lw=0.9, ls=(0, (4, 3)))


FIGURES = {
    "3": draw_feedback,
    "4": draw_by_reachability,
    "6": draw_growth,
    "8": draw_reach,
    "9": draw_rules,
}


@program
def main(argv: list[str] | None = None) -> int:
    """Draws the figures; bad input exits.

    Args:
        argv: command line; by default the program's.

    Returns:
        The exit code 0.
    """
    return draw("nadia", FIGURES, description=__doc__, argv=argv)


if __name__ == "__main__":
    sys.exit(main())
