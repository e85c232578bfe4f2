"""Polar plot of the largest recovered push by direction, seen from above.

It follows Fig. 10 of the Nadia paper and Fig. 6 of the Atlas paper: the radius
is the change of velocity by the push; forward is up, left is left.  The unit is
that of the paper.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.projections.polar import PolarAxes

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.mechanisms import ATLAS_MECHANISMS, MECHANISMS
from nadia_balance.core.walking.push import Moment
from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.results.plots.style import FAINT, TEXT
from nadia_balance.scripts.envelope_sweep.protocols import PROTOCOLS, Curve
from nadia_balance.scripts.envelope_sweep.search import Situation
from nadia_balance.scripts.envelope_sweep.table import LimitTable, mark

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
DOT = {"ls": "none", "marker": "o", "ms": 5.0, "mew": 1.4}
_FARTHEST = 100.0  # directions farther apart are not joined [deg]
_MOST_NUMBERS = 16  # with more directions, limits are not written [-]
_PANEL, _KEY, _COLUMNS = 6.0, 2.5, 2  # sizes [in]; columns of panels


def draw_envelope(limits: LimitTable) -> Figure:
    """Draws a panel for each situation, with its references."""
    count = len(limits.situations)
    columns = min(count, _COLUMNS)
    size = columns * _PANEL + _KEY, math.ceil(count / columns) * _PANEL + 0.4
    fig = Figure(figsize=size, layout="constrained")
    for number, situation in enumerate(limits.situations, start=1):
        shape = math.ceil(count / columns), columns, number
        ax = fig.add_subplot(*shape, projection="polar")
        _draw_directions(ax, limits, situation)
        _draw_curves(ax, limits, situation)
    _draw_key(fig, limits)
    unit, _ = _unit(limits)
    plant = PLANTS.get(limits.identity["plant"], "")
    what = f"Largest recovered push [{unit}], by direction   ·   "
    what += f"{limits.identity['robot']}, {plant}"
    fig.suptitle(what, x=0.01, ha="left", fontsize=12, color=TEXT)
    return fig


def _unit(limits: LimitTable) -> tuple[str, float]:
    """The unit of the paper's figure, and its change of velocity [m/s]."""
    protocol = limits.protocol
    return (protocol.unit, protocol.unit_speed) if protocol else ("m/s", 1.0)


def direction_name(direction: float, at: str) -> str:
    """Words for the four main directions; degrees for the others.

    Inward is from the swing foot to the other.
    """
    inward = 90.0 if Moment.parse(at).swing is Side.RIGHT else 270.0
    side = {inward: "inward", 360.0 - inward: "outward"}
    if direction not in WORDS:
        return f"{direction:g}°"
    word = WORDS[direction]
    return f"{word}\n({side[direction]})" if direction in side else word


def _draw_directions(
    ax: PolarAxes, limits: LimitTable, situation: Situation
) -> None:
    """Draws spokes and rings, in the unit of the paper."""
    unit, _ = _unit(limits)
    eighths = all(r.direction_deg % 45.0 == 0.0 for r in limits.records)
    angles = np.arange(0.0, 360.0, 45.0 if eighths else 30.0)
    ax.set_theta_zero_location("N")
    words = [direction_name(angle, situation.at) for angle in angles]
    ax.set_thetagrids(angles, words, color=TEXT)
    ax.set_title(str(situation), fontsize=10.5)
    ax.yaxis.set_major_formatter(lambda ring, _: f"{ring:g} {unit}")
    ax.tick_params(axis="y", labelcolor=FAINT, labelsize=8.5)
    ax.set_rlabel_position(105.0)
    ax.grid(color=FAINT, lw=0.5, alpha=0.5)
    ax.spines[:].set_visible(False)


def _draw_curves(
    ax: PolarAxes, limits: LimitTable, situation: Situation
) -> None:
    """Draws the limits over those of the paper and of any controller."""
    known, (_, speed) = limits.references[situation], _unit(limits)
    most = limits.mechanisms[-1]
    if most in known.with_hips:
        line = points(known.with_hips[most], speed)
        ax.plot(*line, zorder=0.6, **HIPS_LINE)
    if most in known.limit:
        ax.set_facecolor(BEYOND)
        area = points(known.limit[most], speed)
        ax.fill(*area, fc="white", ec=LIMIT, zorder=0.5)
    for mechanisms in reversed(limits.mechanisms):
        records = limits.of(mechanisms, situation)
        records = [r for r in records if r.recovered is not None]
        curve = {r.direction_deg: r.recovered for r in records}
        _draw_limits(ax, points(curve, speed), mechanisms)
        for record in records:
            face = COLORS[mechanisms] if record.complete else "white"
            dot = {"mfc": face, "mec": COLORS[mechanisms], "zorder": 3.1}
            angle = math.radians(record.direction_deg)
            place = angle, record.recovered / speed
            ax.plot(*place, **DOT, **dot)
            if mechanisms == most and len(records) <= _MOST_NUMBERS:
                words = mark([record]) + limits.words(place[1])
                _write(ax, words, place, COLORS[most])
    if most in known.paper:
        line = points(known.paper[most], speed)
        ax.plot(*line, zorder=3.0, **PAPER_LINE)
    ax.set_rlim(0.0, max(1.1 * ax.get_rmax(), 1e-3))


def points(curve: Curve, speed: float = 1.0) -> Array:
    """The angles [rad] and radii (2, n) of a closed line; the unit is `speed`.

    NaNs break the line between directions that are too far apart.
    """
    corners, angles = [], sorted(curve)
    following = [*angles[1:], *(angle + 360.0 for angle in angles[:1])]
    for here, after in zip(angles, following, strict=True):
        corners.append((math.radians(here), curve[here] / speed))
        if after - here > _FARTHEST:
            corners.append((math.nan, math.nan))
    return np.array([*corners, *corners[:1]]).reshape(-1, 2).T


def _draw_limits(ax: PolarAxes, line: Array, mechanisms: str) -> None:
    color = COLORS[mechanisms]
    if line.size and not np.any(np.isnan(line)):
        pale = [1.0 - 0.2 * (1.0 - part) for part in palette.rgb(color)]
        ax.fill(*line, color=pale, lw=0, zorder=2.0)
    ax.plot(*line, zorder=2.5, color=color, lw=1.8, label=mechanisms)


def _write(
    ax: PolarAxes, words: str, place: tuple[float, float], color: str
) -> None:
    """Writes a number beside its dot, outward."""
    ax.annotate(
        words,
        place,
        xytext=(-15.0 * math.sin(place[0]), 12.0 * math.cos(place[0])),
        textcoords="offset points",
        ha="center",
        va="center",
        color=color,
        fontsize=9,
        zorder=4.0,
        path_effects=[withStroke(linewidth=2.5, foreground="white")],
    )


def key_names(mechanisms: Sequence[str]) -> Mapping[str, str]:
    """What each set adds to the one before; its name if one is missing."""
    order = list(MECHANISMS)
    return {
        name: NAMES[name]
        if name not in order
        or set(order[: order.index(name)]) <= set(mechanisms)
        else name
        for name in mechanisms
    }


def _draw_key(fig: Figure, limits: LimitTable) -> None:
    """One legend for the whole figure, to its right."""
    line = {"lw": 2, "marker": "o", "ms": 5}
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=COLORS[name], label=words, **line)
        for name, words in key_names(limits.mechanisms).items()
    ]
    if not all(record.complete for record in limits.records):
        dot = {"mfc": "white", "mec": FAINT, "label": SEARCHED_LABEL}
        handles.append(Line2D([], [], **DOT, **dot))
    if protocol := limits.protocol:
        handles.append(Line2D([], [], label=protocol.paper, **PAPER_LINE))
    if limits.assumptions:
        patch = Patch(facecolor=BEYOND, edgecolor=LIMIT, label=LIMIT_LABEL)
        handles += [patch, Line2D([], [], label=HIPS_LABEL, **HIPS_LINE)]
    notes = []
    if scale := limits.scale:
        unit, speed = _unit(limits)
        text = f"1 {unit} is {speed * scale.mass:.3g} N s,\n"
        notes.append(f"{text}{speed / scale.speed:.3f} $\\sqrt{{gz}}$")
    if not all(limits.references[s].paper for s in limits.situations):
        notes.append("\n".join(["the paper's: only for", *PROTOCOLS]))
    handles += [Line2D([], [], ls="none", label=note) for note in notes]
    fig.legend(
        handles=handles,
        loc="outside right center",
        fontsize=9.5,
        labelspacing=0.8,
        handlelength=2.2,
    )
