"""The largest push that is recovered from, by direction, seen from above.

As Fig. 10 of the Nadia paper: a point of a curve lies as far out as a push in
its direction changes the velocity [m/s]; forward is up, left is left.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from diagrams.envelope.envelope_data import Envelope, Limits
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import Curve
from diagrams.plots.envelope_key import draw_key, draw_soles
from diagrams.plots.envelope_style import (
    BEYOND,
    COLORS,
    LIMIT,
    PAPER_LINE,
    tint,
    title,
)
from diagrams.plots.push_plane import (
    at,
    draw_directions,
    draw_rings,
    points,
    spoke_angle,
)
from diagrams.plots.style import TEXT
from nadia_balance.core.walking import Array

_HEIGHTS = 6.6, 5.0  # of one panel, and of each of several [in]
_KEY = 2.5  # width of the key [in]
_COLUMNS = 2  # of panels
_MOST_NUMBERS = 16  # directions with the limit written beside them


def draw(envelope: Envelope) -> Figure:
    """Draws a panel for each moment, with the references where there are."""
    moments = envelope.moments
    columns = min(len(moments), _COLUMNS)
    rows = math.ceil(len(moments) / columns)
    (left, right), (low, high) = _window(envelope)
    height = _HEIGHTS[0] if len(moments) == 1 else _HEIGHTS[1]
    width = height * (right - left) / (high - low)
    size = columns * width + _KEY, rows * (height + 0.25) + 0.4
    fig = Figure(figsize=size, layout="constrained")
    grid = list(fig.subplots(rows, columns, squeeze=False).flat)
    for ax, moment in zip(grid, moments, strict=False):
        ax.set(xlim=(left, right), ylim=(low, high), aspect="equal")
        ax.set_title(str(moment), fontsize=10.5)
        _draw_panel(ax, envelope, moment)
    for ax in grid[len(moments) :]:
        ax.remove()
    draw_key(fig, envelope)
    what = title(envelope, "Largest recovered push [m/s], by direction")
    fig.suptitle(what, x=0.01, ha="left", fontsize=12, color=TEXT)
    return fig


def _window(envelope: Envelope) -> Array:
    """What of the plane is seen, so that all curves are: x and y (2, 2)."""
    measured, others = [], []
    for moment in envelope.moments:
        for mechanisms in envelope.mechanisms:
            limits = envelope.curve(mechanisms, moment)
            measured.append({a: v.recovered for a, v in limits.items()})
        known = envelope.known(moment)
        for table in (known.paper, known.limit):
            others.append(table.get(envelope.mechanisms[-1], {}))
    least = 2.0 * envelope.search.resolution
    # More room around the measured ones: their limits are written there.
    inner = _extent(measured, 0.5, least)
    outer = _extent(others, 0.3, least)
    left, right = np.maximum(inner, outer)[0]
    top = np.max(np.maximum(inner, outer)[1])
    return np.array([[-left, right], [-top, top]])


def _extent(curves: list[Curve], margin: float, least: float) -> Array:
    """How far curves go [[left, right], [down, up]], and some more [m/s].

    The `margin` is relative to half the larger side, the `least` of that.
    """
    corners = [points(curve) for curve in curves if curve]
    seen = np.vstack([np.zeros((1, 2)), *corners])
    low, high = np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)
    half = max(0.5 * np.max(high - low), least)
    sides = np.maximum(np.column_stack([-low, high]), 0.6 * half)
    return sides + margin * half * np.array([[1.0], [0.7]])


def _draw_panel(ax: Axes, envelope: Envelope, moment: Moment) -> None:
    known = envelope.known(moment)
    most = envelope.mechanisms[-1]
    if most in known.limit:
        ax.set_facecolor(BEYOND)
        ax.fill(*points(known.limit[most]).T, fc="white", ec=LIMIT, zorder=0.5)
    draw_rings(ax, moment)
    draw_directions(ax, moment, envelope.directions)
    for mechanisms in reversed(envelope.mechanisms):
        if limits := envelope.curve(mechanisms, moment):
            _draw_limits(ax, limits, mechanisms)
    if most in known.paper:
        ax.plot(*points(known.paper[most]).T, zorder=3.0, **PAPER_LINE)
    _write_limits(ax, envelope, moment)
    # Clear of where spokes leave the picture.
    spoke = spoke_angle(envelope.directions)
    draw_soles(ax, moment, (0.01, 0.1) if spoke == 30.0 else (0.07, 0.01))


def _draw_limits(ax: Axes, limits: Limits, mechanisms: str) -> None:
    """A line through the limits; a dot is hollow where the search goes on."""
    color = COLORS[mechanisms]
    curve = {angle: limit.recovered for angle, limit in limits.items()}
    corners = points(curve)
    if not np.any(np.isnan(corners)):
        ax.fill(*corners.T, color=tint(color), lw=0, zorder=2.0)
    line = {"color": color, "lw": 1.8, "label": mechanisms}
    ax.plot(*corners.T, zorder=2.5, **line)
    for complete, face in ((True, color), (False, "white")):
        dots = [
            at(angle, curve[angle])
            for angle, limit in limits.items()
            if limit.complete is complete
        ]
        if dots:
            dot = {"ls": "none", "marker": "o", "ms": 5.0, "mew": 1.4}
            ax.plot(*np.array(dots).T, mfc=face, mec=color, zorder=3.1, **dot)


def _write_limits(ax: Axes, envelope: Envelope, moment: Moment) -> None:
    """Writes the limits with the most mechanisms beside their dots, outward."""
    most = envelope.mechanisms[-1]
    limits = envelope.curve(most, moment)
    if len(limits) > _MOST_NUMBERS:
        return
    for angle, limit in limits.items():
        ax.annotate(
            envelope.limit_words(limit),
            at(angle, limit.recovered),
            xytext=at(angle, 13.0) * [1.25, 1.0],
            textcoords="offset points",
            ha="center",
            va="center",
            color=COLORS[most],
            fontsize=9,
            zorder=4.0,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )
