"""Reachability regions, and which of them a step respects (Figs. 8 and 9)."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diagrams.plots.plan_view import (
    GUIDE,
    SOLE,
    draw_icp,
    draw_sole,
    fill,
    note,
    plans,
    share_legend,
)
from diagrams.plots.regions import CROSSING, NOMINAL, OMEGA, STANCE, SWING
from nadia_balance.capture_point_controller import ControllerParams
from nadia_balance.core.foothold_adjustment import adjust_foothold, unadjusted
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.polygon import intersection
from nadia_balance.core.reachability import (
    BACKWARD,
    BASE,
    FORWARD,
    in_world,
    step_regions,
)
from nadia_balance.core.swing_geometry import swing_geometry
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
)
from nadia_balance.systems import palette

TOUCHDOWN = (0.2, 0.5)  # between these times from now [s]
# Title, ICP [m]: one for each rule.
RULES = (
    ("Rule 1: base, if it meets the capture region", (0.2, -0.03)),
    ("Rule 2: the cross-over region that shares most", (0.07, 0.08)),
    ("Rule 3: the closest, if none meets it", (-0.02, 0.21)),
)


def draw_regions() -> Figure:
    """Fig. 8: the union of the regions, and each of them by itself."""
    fig, axes = plans(
        "Reachable, with cross-over",
        "$R_b$: feet side by side",
        "$R_{fwd}$: crossing in front",
        "$R_{bwd}$: crossing behind",
        x=(-1.15, 1.15),
        y=(-0.9, 0.3),
        rows=2,
    )
    regions = _regions()
    for ax, names in zip(
        axes, (tuple(regions), (BASE,), (FORWARD,), (BACKWARD,)), strict=True
    ):
        for name in names:
            _fill_region(ax, name)
        draw_sole(ax, STANCE, SWING.other)
        draw_sole(ax, NOMINAL, SWING, linestyle="--")
    _measure_base(axes[1])
    _measure_crossing(axes[2], FORWARD)
    _measure_crossing(axes[3], BACKWARD)
    share_legend(fig, axes[0])
    return fig


def draw_rules() -> Figure:
    """Fig. 9: which region the controller chooses, and where she steps."""
    fig, axes = plans(
        *(title for title, _ in RULES), x=(-1.1, 1.3), y=(-0.9, 0.9)
    )
    params = CaptureRegionStepAdjusterParams(reachability=CROSSING)
    geometry = swing_geometry(_schedule(), SOLE, params, OMEGA)
    for ax, (_, icp) in zip(axes, RULES, strict=True):
        one_step = geometry.one_step_region(np.array(icp), OMEGA, TOUCHDOWN)
        captures = geometry.capture_region(one_step)
        found = adjust_foothold(
            unadjusted(_schedule()),
            captures,
            geometry,
            params,
            ControllerParams().control_period,
        )
        for name, region in geometry.regions.items():
            if name != found.region:
                fill(ax, region, palette.REACH, alpha=0.0, linewidth=0.8)
        _fill_region(ax, found.region)
        fill(ax, captures, palette.CAPTURE_REGIONS[-1], "capture region C₃")
        shared = intersection(geometry.regions[found.region], captures)
        fill(ax, shared, palette.CAPTURE_REGIONS[0], "what they share", 0.45)
        draw_sole(ax, STANCE, SWING.other)
        draw_sole(ax, NOMINAL, SWING, "planned foothold", "--")
        draw_sole(ax, found.pose, SWING, "adjusted foothold")
        draw_icp(ax, np.array(icp))
    share_legend(fig, axes[0])
    return fig


def _regions() -> dict[str, np.ndarray]:
    """All regions by name, in W."""
    return {
        name: in_world(region, STANCE, SWING)
        for name, region in step_regions(CROSSING).items()
    }


def _fill_region(ax: Axes, name: str) -> None:
    fill(ax, _regions()[name], palette.REACH, "reachable", alpha=0.18)


def _measure_base(ax: Axes) -> None:
    """Writes the widths and lengths of Fig. 5 beside the base region."""
    for width, label in (
        (CROSSING.width_min, "$w_{min}$"),
        (CROSSING.width_nominal, "$w_{nom}$"),
        (CROSSING.width_max, "$w_{max}$"),
    ):
        ax.plot([0.0, 0.3], [-width, -width], **GUIDE)
        note(ax, f"{label} = {width} m", (0.32, -width), ha="left", va="center")
    for x, label in (
        (CROSSING.length_forward, "$l_{max}$"),
        (-CROSSING.length_backward, "$l_{min}$"),
    ):
        ax.plot([x, x], [-CROSSING.width_nominal, 0.12], **GUIDE)
        note(ax, f"{label} = {abs(x)} m", (0.9 * x, 0.15))


def _measure_crossing(ax: Axes, name: str) -> None:
    """Writes the figures of Fig. 8 beside a cross-over region.

    Its angle theta is that of the ellipse, not one that can be seen.
    """
    word = "fwd" if name == FORWARD else "bwd"
    region = _regions()[name]
    x, y = region[np.argmax(region[:, 1])]  # as far across as she may go
    way = np.sign(x)
    ends = np.array([-0.2 * way, x])
    ax.plot(ends, [0.0, 0.0], **GUIDE)
    ax.plot(ends, [y, y], **GUIDE)
    ax.plot([x, x], [y, 0.2], **GUIDE)
    side = {"ha": "right" if way > 0 else "left", "va": "center"}
    at = (-0.23 * way, y + 0.03 * np.sign(y))
    note(ax, f"$w_{{{word}}}$ = {y:.2f} m", at, **side)
    length = "max" if way > 0 else "min"
    text = rf"$l_{{{length}}}\,\sin θ_{{{word}}}$ = {abs(x):.2f} m"
    note(ax, text, (x, 0.22))


def _schedule() -> ContactSchedule:
    """She steps in place, twice a second and ever on."""
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
