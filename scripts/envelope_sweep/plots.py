"""Polar plot of the largest recovered push by direction, seen from above.

It follows Fig. 10 of the Nadia paper and Fig. 6 of the Atlas paper: the radius
is the change of velocity by the push; forward is up, left is left.  The unit is
that of the paper.
"""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from matplotlib.patheffects import withStroke

from nadia_balance import palette
from nadia_balance.core.mechanisms import ATLAS_MECHANISMS, MECHANISMS
from nadia_balance.core.walking import Array, Side
from nadia_balance.results.plots.style import FAINT, TEXT
from nadia_balance.scripts.envelope_sweep.protocols import PROTOCOLS, Curve
from nadia_balance.scripts.envelope_sweep.search import Situation
from nadia_balance.scripts.envelope_sweep.sweep import moment_of
from nadia_balance.scripts.envelope_sweep.table import LimitTable, Record, mark

# Names of directions [deg], relative to the heading of the stance foot.
WORDS = {0.0: "forward", 90.0: "left", 180.0: "backward", 270.0: "right"}
# One hue, darker for more mechanisms: readable without colours, too.
_TINTS = ("#b5cdf5", "#82a8ee", "#4f80e4", palette.ICP, "#102a78")
COLORS = dict(zip(MECHANISMS, _TINTS, strict=True)) | dict(
    zip(ATLAS_MECHANISMS, [*_TINTS[:3], _TINTS[-1]], strict=True)
)
NAMES = {
    "icp_only": "ankles and hips only",
    "step": "+ where to step",
    "step_swing": "+ when to land",
    "step_swing_transfer": "+ when to lift off",
    "all_with_cross_over": "+ crossing the legs",
    "feedback": "feedback only",
    "feedback_step": "step adjustment",
    "feedback_timing": "swing speed-up",
    "feedback_step_timing": "both of them",
}
PLANTS = {"humanoid": "whole body", "lipm": "point mass"}
PAPER_LINE = {"color": "#3d4552", "ls": (0, (4, 2)), "lw": 1.5}
SEARCHED_LABEL = "still being searched"
LIMIT = "#8a93a3"
LIMIT_LABEL = "beyond the limit of any\ncontroller on a point\nmass, computed"
HIPS_LABEL = "and with the momentum\nof the upper body"
BEYOND = "#eceef2"
HIPS_LINE = {"color": LIMIT, "ls": ":", "lw": 1.4}


def key_name(limits: LimitTable, mechanisms: str) -> str:
    """The mechanism added to the previous set; a name if a set is missing."""
    names = list(MECHANISMS)
    before = names[: names.index(mechanisms)] if mechanisms in names else []
    stacked = set(before) <= set(limits.mechanisms)
    return NAMES[mechanisms] if stacked else mechanisms


def tint(color: str) -> list[float]:
    """Red, green and blue of a pale, opaque version of a colour."""
    return [1.0 - 0.2 * (1.0 - part) for part in palette.rgb(color)]


def _unit(limits: LimitTable) -> tuple[str, float]:
    """The unit of the paper's figure, and its change of velocity [m/s]."""
    protocol = limits.protocol
    return (protocol.unit, protocol.unit_speed) if protocol else ("m/s", 1.0)


def inward(at: str) -> float:
    """The direction [deg] that points from the swing foot to the other."""
    return 90.0 if moment_of(at).swing is Side.RIGHT else 270.0


def direction_name(direction: float, at: str) -> str:
    """Words for the four main directions; degrees for the others."""
    side = {inward(at): "inward", 360.0 - inward(at): "outward"}
    if direction not in WORDS:
        return f"{direction:g}°"
    word = WORDS[direction]
    return f"{word} ({side[direction]})" if direction in side else word


def _draw_key(fig: Figure, limits: LimitTable) -> None:
    """One legend for the whole figure, to its right."""
    line = {"lw": 2, "marker": "o", "ms": 5}
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=COLORS[m], label=key_name(limits, m), **line)
        for m in limits.mechanisms
    ]
    if not all(record.complete for record in limits.records):
        dot = {"ls": "none", "marker": "o", "ms": 5, "mfc": "white"}
        dot |= {"mec": FAINT, "mew": 1.4, "label": SEARCHED_LABEL}
        handles.append(Line2D([], [], **dot))
    known = [s for s in limits.situations if limits.references[s].paper]
    if protocol := limits.protocol:
        handles.append(Line2D([], [], label=protocol.paper, **PAPER_LINE))
    if limits.assumptions:
        patch = Patch(facecolor=BEYOND, edgecolor=LIMIT, label=LIMIT_LABEL)
        handles += [patch, Line2D([], [], label=HIPS_LABEL, **HIPS_LINE)]
    if scale := limits.scale:
        unit, speed = _unit(limits)
        text = f"1 {unit} is {speed * scale.mass:.3g} N s,\n"
        text += f"{speed / scale.speed:.3f} $\\sqrt{{gz}}$"
        handles.append(Line2D([], [], ls="none", label=text))
    if len(known) < len(limits.situations):
        text = "\n".join(["the paper's: only for", *PROTOCOLS])
        handles.append(Line2D([], [], ls="none", label=text))
    fig.legend(
        handles=handles,
        loc="outside right center",
        fontsize=9.5,
        labelspacing=0.8,
        handlelength=2.2,
    )


_FARTHEST = 100.0  # directions farther apart are not joined [deg]
_RINGS = (0.05, 0.1, 0.2, 0.5, 1.0)  # distances of rings [unit]
_MOST_RINGS = 5
_RING_LABELS = 15.0  # direction of their labels, backward of inward [deg]


def points(values: Curve) -> Array:
    """The corners (n, 2) [m/s] of a closed line, right and up in the picture.

    NaNs break the line between directions that are too far apart.
    """
    corners = []
    angles = sorted(values)
    for here, after in zip(angles, [*angles[1:], angles[0] + 360], strict=True):
        corners.append(point(here, values[here]))
        if after - here > _FARTHEST:
            corners.append(np.full(2, np.nan))
    return np.array([*corners, corners[0]])


def point(direction: float, size: float) -> Array:
    """The point (2,) of the picture for a push in a direction [deg]."""
    angle = math.radians(direction)
    return size * np.array([-math.sin(angle), math.cos(angle)])


def _draw_rings(ax: Axes, limits: LimitTable, at: str) -> None:
    """Draws rings at round values; the outer ones have labels."""
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set_visible(False)
    (left, right), (_, top) = ax.get_xlim(), ax.get_ylim()
    unit, speed = _unit(limits)
    rings = top / speed
    gap = next((g for g in _RINGS if rings / g <= _MOST_RINGS), _RINGS[-1])
    angle = 90.0 + _RING_LABELS
    if inward(at) > 180.0:
        angle = -angle
    for ring in np.arange(gap, 1.5 * rings, gap):
        circle = Circle(
            (0, 0), ring * speed, fill=False, ec=FAINT, lw=0.6, alpha=0.5
        )
        ax.add_patch(circle).set_zorder(1.0)
        place = point(angle, ring * speed)
        if ring > 0.35 * rings and 0.88 * left < place[0] < 0.88 * right:
            text = ax.text(*place, f"{ring:g} {unit}", ha="center", va="center")
            text.set(color=FAINT, fontsize=8.5, zorder=1.2)


def spoke_angle(directions: Sequence[float]) -> float:
    """Angle between spokes [deg] that fits all directions, or else 30."""
    for angle in (45.0, 30.0, 15.0):
        if all(d % angle == 0.0 for d in directions):
            return angle
    return 30.0


def _draw_directions(ax: Axes, at: str, directions: Sequence[float]) -> None:
    """Draws spokes with words for the main directions, degrees for others."""
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    for angle in np.arange(0.0, 360.0, spoke_angle(directions)):
        way = point(angle, 1.0)
        sides = np.where(way > 0, [right, high], [left, low])
        with np.errstate(divide="ignore"):
            end = way * np.min(np.abs(sides / np.where(way == 0, 1e-9, way)))
        ax.plot(*np.array([np.zeros(2), end]).T, color=FAINT, lw=0.5, alpha=0.5)
        if angle % 30.0 and angle % 45.0:
            continue
        main = angle % 90.0 == 0.0
        ax.annotate(
            direction_name(angle, at).replace(" ", "\n"),
            end,
            xytext=-6.0 * np.sign(np.round(way, 6)),
            textcoords="offset points",
            ha=_anchor(way[0], "left", "center", "right"),
            va=_anchor(way[1], "bottom", "center", "top"),
            color=TEXT if main else FAINT,
            fontsize=10 if main else 8.5,
            linespacing=1.0,
        )


def _anchor(way: float, negative: str, zero: str, positive: str) -> str:
    if abs(way) < 1e-6:
        return zero
    return positive if way > 0.0 else negative


_HEIGHTS = 6.6, 5.0  # height of one panel, and of each of several [in]
_KEY = 2.5  # width of the legend [in]
_COLUMNS = 2  # columns of panels
_MOST_NUMBERS = 16  # with more directions, limits are not written [-]


def draw_envelope(limits: LimitTable) -> Figure:
    """Draws a panel for each situation, with its references."""
    situations = limits.situations
    columns = min(len(situations), _COLUMNS)
    rows = math.ceil(len(situations) / columns)
    (left, right), (low, high) = _window(limits)
    height = _HEIGHTS[0] if len(situations) == 1 else _HEIGHTS[1]
    width = height * (right - left) / (high - low)
    size = columns * width + _KEY, rows * (height + 0.25) + 0.4
    fig = Figure(figsize=size, layout="constrained")
    grid = list(fig.subplots(rows, columns, squeeze=False).flat)
    for ax, situation in zip(grid, situations, strict=False):
        ax.set(xlim=(left, right), ylim=(low, high), aspect="equal")
        ax.set_title(str(situation), fontsize=10.5)
        _draw_panel(ax, limits, situation)
    for ax in grid[len(situations) :]:
        ax.remove()
    _draw_key(fig, limits)
    plant = PLANTS.get(limits.identity["plant"], "")
    what = f"Largest recovered push [{_unit(limits)[0]}], by direction   ·   "
    what += f"{limits.identity['robot']}, {plant}"
    fig.suptitle(what, x=0.01, ha="left", fontsize=12, color=TEXT)
    return fig


def _window(limits: LimitTable) -> Array:
    """The limits (2, 2) of the x and y axes that contain all curves."""
    most, curves = limits.mechanisms[-1], []
    for each in limits.situations:
        known = limits.references[each]
        curves += [curves.get(most, {}) for curves in known]
        curves += [
            _recovered(limits.curve(name, each)) for name in limits.mechanisms
        ]
    seen = np.vstack([np.zeros(2), *(points(c) for c in curves if c)])
    low, high = np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)
    half = max(0.5 * np.max(high - low), 2.0 * limits.identity["resolution"])
    left, right = np.maximum([-low[0], high[0]], 0.6 * half) + 0.45 * half
    top = max(-low[1], high[1], 0.6 * half) + 0.3 * half
    return np.array([[-left, right], [-top, top]])


def _recovered(records: dict[float, Record]) -> Curve:
    return {angle: record.recovered for angle, record in records.items()}


def _draw_panel(ax: Axes, limits: LimitTable, situation: Situation) -> None:
    known = limits.references[situation]
    most = limits.mechanisms[-1]
    if most in known.with_hips:
        ax.plot(*points(known.with_hips[most]).T, zorder=0.6, **HIPS_LINE)
    if most in known.limit:
        ax.set_facecolor(BEYOND)
        ax.fill(*points(known.limit[most]).T, fc="white", ec=LIMIT, zorder=0.5)
    _draw_rings(ax, limits, situation.at)
    _draw_directions(ax, situation.at, limits.directions)
    for mechanisms in reversed(limits.mechanisms):
        if records := limits.curve(mechanisms, situation):
            _draw_limits(ax, records, mechanisms)
    if most in known.paper:
        ax.plot(*points(known.paper[most]).T, zorder=3.0, **PAPER_LINE)
    _write_limits(ax, limits, situation)


def _draw_limits(
    ax: Axes, records: dict[float, Record], mechanisms: str
) -> None:
    """Draws a line through the limits; dots of incomplete ones are hollow."""
    color = COLORS[mechanisms]
    curve = _recovered(records)
    corners = points(curve)
    if not np.any(np.isnan(corners)):
        ax.fill(*corners.T, color=tint(color), lw=0, zorder=2.0)
    line = {"color": color, "lw": 1.8, "label": mechanisms}
    ax.plot(*corners.T, zorder=2.5, **line)
    for complete, face in ((True, color), (False, "white")):
        dots = [
            point(angle, curve[angle])
            for angle, record in records.items()
            if record.complete is complete
        ]
        if dots:
            dot = {"ls": "none", "marker": "o", "ms": 5.0, "mew": 1.4}
            ax.plot(*np.array(dots).T, mfc=face, mec=color, zorder=3.1, **dot)


def _write_limits(ax: Axes, limits: LimitTable, situation: Situation) -> None:
    """Writes the limits with the most mechanisms beside their dots, outward."""
    most = limits.mechanisms[-1]
    records, speed = limits.curve(most, situation), _unit(limits)[1]
    if len(records) > _MOST_NUMBERS:
        return
    for angle, record in records.items():
        ax.annotate(
            mark([record]) + limits.words(record.recovered / speed),
            point(angle, record.recovered),
            xytext=point(angle, 13.0) * [1.25, 1.0],
            textcoords="offset points",
            ha="center",
            va="center",
            color=COLORS[most],
            fontsize=9,
            zorder=4.0,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )
