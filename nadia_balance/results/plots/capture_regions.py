"""Figures of the Nadia paper, computed by the functions of the controller.

The plan views show a robot that stands on its left foot in a right swing.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nadia_balance import palette
from nadia_balance.capture_point_controller import ControllerParams
from nadia_balance.core.capture_region import (
    capture_region,
    later_steps,
    one_step_region,
)
from nadia_balance.core.foothold_adjustment import (
    Landing,
    adjust_foothold,
    unadjusted,
)
from nadia_balance.core.mechanisms import MECHANISMS
from nadia_balance.core.model import LegGeometry, PointMassModel
from nadia_balance.core.momentum_qp import (
    IcpFeedbackQp,
    MomentumQpParams,
    feedback_limits,
)
from nadia_balance.core.polygon import intersection
from nadia_balance.core.reachability import (
    BACKWARD,
    BASE,
    FORWARD,
    ReachabilityParams,
    base_region,
    circle,
    in_world,
    step_regions,
    total_region,
)
from nadia_balance.core.swing_detour import SwingDetourParams
from nadia_balance.core.swing_geometry import (
    CaptureRegionStepAdjusterParams,
    swing_geometry,
)
from nadia_balance.core.walking import (
    Array,
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
    rectangle,
)
from nadia_balance.results.plots.style import FAINT, TEXT, arrow, fill

SOLE = rectangle(0.25, 0.12)  # Nadia's [m]
REACH = ReachabilityParams()
MODEL = PointMassModel(  # Nadia's; the legs have no effect here
    mass=91.0,
    com_height=0.888,
    step_width=0.25,
    sole=SOLE,
    legs=LegGeometry(),
    reach=REACH,
    detour=SwingDetourParams(),
)
STANCE, SWING = FootPose(), Side.RIGHT
NOMINAL = FootPose(np.array([0.0, -0.25, 0.0]))  # nominal foothold

# Fig. 3: reference of both CoP and eCMP, and ICP error [m].
COP_R, ERROR = np.array([-0.06, -0.02]), np.array([0.05, 0.042])

# Figs. 4 and 6.
ICP = np.array([0.16, 0.0])  # [m]
REMAINING_TIME = 0.25  # until touchdown [s]
LATEST = 5.0  # latest touchdown; the region then exceeds the circle [s]
STEP_DURATION = 0.5  # transfer plus swing of each later step [s]
CONTRACTION = math.exp(-MODEL.omega * STEP_DURATION)  # in one step [-]
CIRCLE = circle(REACH.length_forward, 96)
NAMES = ("C₁", "C₂", "C₃")
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

_WIDTH = 12.5  # width of a figure [in]
_GUIDE = {"color": FAINT, "lw": 0.9, "ls": (0, (4, 3))}  # dimension line


def draw_feedback() -> Figure:
    """Fig. 3: the eCMP of ankle feedback only, without and with Q_perp."""
    fig, axes = _plans(
        "Without $Q_⊥$: as near as can be",
        "With $Q_⊥$: along the error",
        x=(-0.15, 0.17),
        y=(-0.08, 0.13),
    )
    weights = 0.0, MomentumQpParams().perpendicular_weight
    none, dots = np.zeros(2), {"ls": "none", "mec": "white", "ms": 9}
    for ax, weight in zip(axes, weights, strict=True):
        params = MomentumQpParams(
            perpendicular_weight=weight, max_kappa=0.0, rate_weight=0.0
        )
        limits = feedback_limits(SOLE, 0.0, params)
        qp = IcpFeedbackQp(params)
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
        _note(ax, "$k_p\\,ξ_e$", tuple(beside))
    _share_legend(fig, axes[0])
    return fig


def draw_by_reachability() -> Figure:
    """Fig. 4: C_1 to C_3, with the same reach of all later steps."""
    fig, axes = _plans(
        "Any step of up to 1 m",
        "Feet side by side: an ellipse",
        "Cross-over allowed",
    )
    reaches = CIRCLE, base_region(REACH), total_region(REACH, cross_over=True)
    for ax, reach in zip(axes, reaches, strict=True):
        for n in range(len(NAMES), 0, -1):
            region = capture_region(_one_step(), _offsets(reach, n))
            fill(ax, region, palette.CAPTURE_REGIONS[n - 1], NAMES[n - 1])
        _draw_feet(ax)
    _share_legend(fig, axes[0], _WHEN)
    return fig


def draw_growth() -> Figure:
    """Fig. 6: C_n is C_1 swept by the reversed offsets -D_n of later steps."""
    fig, axes = _plans("Any step of up to 1 m", "Feet side by side: an ellipse")
    for ax, reach in zip(axes, (CIRCLE, base_region(REACH)), strict=True):
        for n in range(2, len(NAMES) + 1):
            color, offsets = palette.CAPTURE_REGIONS[n - 1], _offsets(reach, n)
            for point in _around(_one_step(), 28):
                fill(ax, point - offsets, color, alpha=0.0, linewidth=0.6)
            region = capture_region(_one_step(), offsets)
            label = f"{NAMES[n - 1]}: {NAMES[0]} swept by -D{NAMES[n - 1][1]}"
            fill(ax, region, color, label, alpha=0.0, linewidth=2.0)
        fill(ax, _one_step(), palette.CAPTURE_REGIONS[0], NAMES[0])
        _draw_feet(ax)
    _share_legend(fig, axes[0], _WHEN)
    return fig


def _offsets(reach: Array, n: int) -> Array:
    """D_n (k, 2) [m] for a `reach` (n, 2) [m] in the stance foot's frame."""
    reaches = [_reach_of_step(reach, k) for k in range(2, n + 1)]
    return later_steps(reaches, [CONTRACTION] * (n - 1))[-1]


def _reach_of_step(reach: Array, n: int) -> Array:
    return in_world(reach, STANCE, SWING if n % 2 else SWING.other)


def _around(polygon: Array, count: int) -> Array:
    """Points (count, 2) [m] at equal distances along the boundary."""
    closed = np.vstack([polygon, polygon[:1]])
    lengths = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    way = np.cumsum([0.0, *lengths])
    at = np.linspace(0.0, way[-1], count, endpoint=False)
    return np.column_stack([np.interp(at, way, c) for c in closed.T])


def _one_step() -> Array:
    """C_1 (k, 2) [m], clipped to the circle only."""
    foot = in_world(_usable_foot(), STANCE, SWING)
    omega = MODEL.omega
    touchdown = REMAINING_TIME, LATEST
    return intersection(one_step_region(ICP, foot, omega, touchdown), CIRCLE)


def _usable_foot() -> Array:
    return CaptureRegionStepAdjusterParams().usable_foot(SOLE)


def _draw_feet(ax: Axes) -> None:
    """Draws the stance foot, its usable part, the planned foothold, the ICP."""
    _draw_sole(ax, STANCE, SWING.other)
    foot = in_world(_usable_foot(), STANCE, SWING)
    fill(ax, foot, palette.LEFT, "where the CoP may be", linewidth=0.0)
    _draw_sole(ax, NOMINAL, SWING, "planned foothold", "--")
    _draw_icp(ax, ICP)


def draw_reach() -> Figure:
    """Fig. 8: the union of the reachability regions, and each region."""
    fig, axes = _plans(
        "Reachable, with cross-over",
        "$R_b$: feet side by side",
        "$R_{fwd}$: crossing in front",
        "$R_{bwd}$: crossing behind",
        x=(-1.15, 1.15),
        y=(-0.9, 0.3),
        rows=2,
    )
    regions = _regions()
    alone = [(name,) for name in (BASE, FORWARD, BACKWARD)]
    for ax, names in zip(axes, (regions, *alone), strict=True):
        for name in names:
            fill(ax, regions[name], palette.REACH, "reachable", alpha=0.18)
        _draw_sole(ax, STANCE, SWING.other)
        _draw_sole(ax, NOMINAL, SWING, linestyle="--")
    _measure_base(axes[1])
    _measure_crossing(axes[2], FORWARD)
    _measure_crossing(axes[3], BACKWARD)
    _share_legend(fig, axes[0])
    return fig


def _regions() -> dict[str, np.ndarray]:
    """All regions by name, in W."""
    return {
        name: in_world(region, STANCE, SWING)
        for name, region in step_regions(REACH, cross_over=True).items()
    }


def _measure_base(ax: Axes) -> None:
    """Writes the widths and lengths of Fig. 5 beside the base region."""
    for width, label in (
        (REACH.width_min, "$w_{min}$"),
        (REACH.width_nominal, "$w_{nom}$"),
        (REACH.width_max, "$w_{max}$"),
    ):
        ax.plot([0.0, 0.3], [-width, -width], **_GUIDE)
        at = (0.32, -width)
        _note(ax, f"{label} = {width} m", at, ha="left", va="center")
    for x, label in (
        (REACH.length_forward, "$l_{max}$"),
        (-REACH.length_backward, "$l_{min}$"),
    ):
        ax.plot([x, x], [-REACH.width_nominal, 0.12], **_GUIDE)
        _note(ax, f"{label} = {abs(x)} m", (0.9 * x, 0.15))


def _measure_crossing(ax: Axes, name: str) -> None:
    """Writes the dimensions of Fig. 8 beside a cross-over region.

    The angle theta is a parameter of the ellipse, not an angle in the picture.
    """
    word = "fwd" if name == FORWARD else "bwd"
    region = _regions()[name]
    x, y = region[np.argmax(region[:, 1])]  # the farthest point across
    way = np.sign(x)
    ends = np.array([-0.2 * way, x])
    ax.plot(ends, [0.0, 0.0], **_GUIDE)
    ax.plot(ends, [y, y], **_GUIDE)
    ax.plot([x, x], [y, 0.2], **_GUIDE)
    side = {"ha": "right" if way > 0 else "left", "va": "center"}
    at = (-0.23 * way, y + 0.03 * np.sign(y))
    _note(ax, f"$w_{{{word}}}$ = {y:.2f} m", at, **side)
    length = "max" if way > 0 else "min"
    text = rf"$l_{{{length}}}\,\sin θ_{{{word}}}$ = {abs(x):.2f} m"
    _note(ax, text, (x, 0.22))


def draw_rules() -> Figure:
    """Fig. 9: the region that each rule chooses, and the adjusted foothold."""
    fig, axes = _plans(
        *(title for title, _ in RULES), x=(-1.1, 1.3), y=(-0.9, 0.9)
    )
    params = CaptureRegionStepAdjusterParams()
    on = MECHANISMS["all_with_cross_over"]
    schedule = _schedule()
    geometry = swing_geometry(schedule, params, MODEL, on)
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
    _share_legend(fig, axes[0])
    return fig


def _schedule() -> ContactSchedule:
    """The schedule of steps in place, two per second."""
    feet = FootPoses(STANCE, NOMINAL)
    sides = [SWING, SWING.other] * 2
    return ContactSchedule(
        phase=Phase.SWING,
        support_side=SWING.other,
        duration=0.4,
        feet=feet,
        footsteps=tuple(Footstep(s, feet[s], 0.1, 0.4) for s in sides),
        start=ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2)),
    )


def _plans(
    *titles: str,
    x: tuple[float, float] = (-0.3, 1.35),
    y: tuple[float, float] = (-0.8, 0.8),
    rows: int = 1,
) -> tuple[Figure, list[Axes]]:
    """Axes for plan views, with limits x and y [m]."""
    columns = len(titles) // rows
    scale = (_WIDTH - 0.8) / columns / (x[1] - x[0])
    height = rows * (scale * (y[1] - y[0]) + 0.4) + 0.9
    fig = Figure(figsize=(_WIDTH, height), layout="constrained")
    axes = list(fig.subplots(rows, columns, sharex=True, sharey=True).flat)
    for ax, title in zip(axes, titles, strict=True):
        ax.set(xlim=x, ylim=y, aspect="equal", title=title)
        ax.set(xlabel="x, forward [m]", ylabel="y, left [m]")
        ax.label_outer()
    return fig, axes


def _share_legend(fig: Figure, ax: Axes, title: str = "") -> None:
    """One legend for the whole figure, below it; `title` above it."""
    handles, names = ax.get_legend_handles_labels()
    entries = dict(zip(names, handles, strict=True))
    where = {"loc": "outside lower center", "ncols": len(entries)}
    fig.legend(entries.values(), entries.keys(), **where)
    fig.suptitle(title, x=0.01, ha="left", fontsize=9.5, color=FAINT)


def _draw_sole(
    ax: Axes, pose: FootPose, side: Side, label: str = "", linestyle: str = "-"
) -> None:
    """Draws a sole: filled with a solid line, outlined with another one."""
    alpha = 0.12 if linestyle == "-" else 0.0
    color, label = palette.foot_color(side), label or f"{side.value} foot"
    fill(ax, pose.to_world(SOLE), color, label, alpha, linestyle=linestyle)


def _draw_icp(ax: Axes, icp: Array) -> None:
    ax.plot(*icp, "o", color=palette.ICP, ms=7, mec="white", label="ICP")


def _note(ax: Axes, text: str, at: tuple[float, float], **options) -> None:
    options = {"color": TEXT, "fontsize": 8.5, "ha": "center", **options}
    ax.annotate(text, at, **options)
