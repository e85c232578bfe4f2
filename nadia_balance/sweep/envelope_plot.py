"""Picture of the limits of a sweep, from above.

It follows Fig. 10 of the Nadia paper and Fig. 6 of the Atlas paper: the radius
is the change of velocity by the push; forward is up, left is left.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any, cast

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MultipleLocator

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.mechanisms import COLORS
from nadia_balance.results.plots.style import FAINT, TEXT
from nadia_balance.sweep.limits import LimitTable, Record, mark
from nadia_balance.sweep.trials import Situation

# Names of directions [deg], relative to the heading of the stance foot.
WORDS = {0.0: "forward", 90.0: "left", 180.0: "backward", 270.0: "right"}
# A robot may be outside: it has hips, it falls, a policy steps when it likes.
LIMIT_LABEL = (
    "more than a point mass\nrecovers from, with this\nreach and step times"
)
HIPS_LABEL = "the same point mass with\nan upper body's momentum"
BEYOND = "#eceef2"
PAPER = "#3d4552"
BESIDE = "#7a5195"  # another sweep's limits
_MOST_NUMBERS = 16  # with more directions, limits are not written [-]
_PANEL, _KEY, _COLUMNS = 6.0, 2.5, 2  # sizes [in]; columns of panels
_RING, _ROOM = 0.5, 1.05  # between rings [m/s]; least radius over the largest
_NAMED_AT = 105.0  # the direction in which rings are named [deg]
_RADIUS = 170.0  # of a panel, about [pt]
_APART = 3.0  # between points on a line [pt]
_HALF = np.array([12.0, 6.0])  # of a number's width and height [pt]
_LETTERS = np.array([[-8.0, 0.0], [0.0, 0.0], [8.0, 0.0]])  # of a number [pt]
# Behind a number, so that a line below it does not cross it.
_PLATE = {"facecolor": "white", "alpha": 0.75, "pad": 0.6, "linewidth": 0.0}


def draw_envelope(limits: LimitTable) -> Figure:
    """Draws a panel for each situation, with its references.

    Args:
        limits: of the sweep.

    Returns:
        The picture.
    """
    columns = min(len(limits.situations), _COLUMNS)
    rows = math.ceil(len(limits.situations) / columns)
    fig = Figure(
        figsize=(columns * _PANEL + _KEY, rows * _PANEL + 0.4),
        layout="constrained",
    )
    panels = []
    for number, situation in enumerate(limits.situations, start=1):
        ax = cast(
            PolarAxes,
            fig.add_subplot(rows, columns, number, projection="polar"),
        )
        eighths = all(r["direction_deg"] % 45.0 == 0.0 for r in limits.records)
        draw_directions(ax, 45 if eighths else 30)
        ax.set_title(", ".join(situation), fontsize=10.5)
        _draw_curves(ax, limits, situation)
        panels.append(ax)
    share_scale(panels)
    for ax, situation in zip(panels, limits.situations, strict=True):
        records = limits.of(limits.mechanisms[-1], situation)
        if len(records) <= _MOST_NUMBERS:
            _write_numbers(ax, records)
    _draw_key(fig, limits)
    fig.suptitle(
        "Largest recovered push, by direction   ·   "
        f"{limits.identity['robot']}, {limits.identity['plant']}",
        x=0.01,
        ha="left",
        fontsize=12,
        color=TEXT,
    )
    return fig


def draw_directions(ax: PolarAxes, step: int = 30) -> None:
    """Turns polar axes so that forward is up, and names directions and rings.

    Args:
        ax: axes to change.
        step: from one direction to the next [deg].
    """
    angles = np.arange(0.0, 360.0, step)
    ax.set_theta_zero_location("N")
    ax.set_thetagrids(
        angles,
        [WORDS.get(angle, f"{angle:g}°") for angle in angles],
        color=TEXT,
    )
    ax.yaxis.set_major_locator(MultipleLocator(_RING))
    ax.yaxis.set_major_formatter("")
    ax.grid(color=FAINT, lw=0.5, alpha=0.5)
    ax.spines[:].set_visible(False)


def share_scale(panels: Sequence[PolarAxes]) -> None:
    """Gives panels that are compared one radius, a whole number of rings.

    Args:
        panels: axes, with all that is drawn in them.
    """
    largest = max(
        float(np.max(line.get_ydata(), initial=0.0))
        for ax in panels
        for line in ax.lines
    )
    rings = max(math.ceil(_ROOM * largest / _RING), 1)
    for ax in panels:
        ax.set_rlim(0.0, _RING * rings)
        for ring in range(rings, min(rings - 1, 1), -2):
            ax.text(
                math.radians(_NAMED_AT),
                _RING * ring,
                f"{_RING * ring:g} m/s",
                color=FAINT,
                ha="center",
                va="center",
                fontsize=8.5,
                zorder=3.5,
                bbox=_PLATE,
            )


def _draw_curves(
    ax: PolarAxes, limits: LimitTable, situation: Situation
) -> None:
    """Draws the limits over those of the paper and of any controller."""
    last = limits.mechanisms[-1]
    _draw_limit(ax, limits.of(last, situation))
    for mechanisms in reversed(limits.mechanisms):
        line = closed(_curve(limits.of(mechanisms, situation), "recovered"))
        color = COLORS[mechanisms]
        if line.shape[1] > 3:
            pale = [1.0 - 0.2 * (1.0 - part) for part in palette.rgb(color)]
            ax.fill(*line, color=pale, lw=0, zorder=2.0)
        ax.plot(
            *line,
            color=color,
            lw=1.8,
            marker="o",
            ms=5.0,
            zorder=2.5,
            label=mechanisms,
        )
    protocol = limits.protocols.get(situation)
    if protocol:
        ax.plot(
            *closed(protocol.curves(situation[0]).get(last, {})),
            color=PAPER,
            ls=(0, (4, 2)),
            lw=1.5,
            zorder=3.0,
            label=protocol.paper,
        )
    if limits.beside:
        ax.plot(
            *closed(limits.of_beside(last, situation)),
            color=BESIDE,
            lw=1.5,
            marker="s",
            ms=3.5,
            zorder=2.8,
            label=limits.beside_title,
        )


def _draw_limit(ax: PolarAxes, records: Iterable[Record]) -> None:
    """Draws the limits of any controller, without and with the hips."""
    ax.plot(
        *closed(_curve(records, "with_hips")),
        color=FAINT,
        ls=":",
        lw=1.4,
        zorder=0.6,
        label=HIPS_LABEL,
    )
    area = closed(_curve(records, "limit"))
    if area.shape[1] > 3:
        ax.set_facecolor(BEYOND)
        ax.fill(*area, fc="white", ec=FAINT, zorder=0.5)


def _curve(records: Iterable[Record], name: str) -> dict[float, float]:
    """The known values of a column, by direction [deg]."""
    return {
        record["direction_deg"]: record[name]
        for record in records
        if record[name] is not None
    }


def closed(curve: dict[float, float]) -> Array:
    """Closes a line around the origin.

    Args:
        curve: radii by angle [deg].

    Returns:
        Angles [rad] and radii, (2, n); the last point is the first one.
    """
    angles = [*sorted(curve), *sorted(curve)[:1]]
    return np.array([np.radians(angles), [curve[angle] for angle in angles]])


def _write_numbers(ax: PolarAxes, records: Iterable[Record]) -> None:
    """Writes the known limits beside their dots, where no line is near."""
    points = {
        record["direction_deg"]: (record["recovered"], record)
        for record in records
        if record["recovered"] is not None
    }
    taken = _drawn(ax)
    for direction, (radius, record) in points.items():
        angle = math.radians(direction)
        point = _on_page(ax, angle, radius)
        place = _free_place(point, taken)
        taken = np.vstack([taken, place + _LETTERS])
        x, y = (place - point).tolist()
        ax.annotate(
            f"{mark([record])}{radius:.2f}",
            xy=(angle, radius),
            xytext=(x, y),
            textcoords="offset points",
            color=COLORS[record["mechanisms"]],
            ha="center",
            va="center",
            fontsize=9,
            zorder=4.0,
            bbox=_PLATE,
        )


def _on_page(ax: PolarAxes, angles: Any, radii: Any) -> Array:
    """About where points are, from the centre of the axes (n, 2) [pt]."""
    scale = _RADIUS / ax.get_rmax()
    return scale * np.array([-radii * np.sin(angles), radii * np.cos(angles)]).T


def _drawn(ax: PolarAxes) -> Array:
    """Points (n, 2) [pt] on all lines of the axes, _APART from each other."""
    points = [np.zeros((0, 2))]
    for line in ax.lines:
        corners = _on_page(ax, *np.asarray(line.get_data(), dtype=float))
        for start, end in itertools.pairwise(corners):
            count = max(math.ceil(math.dist(start, end) / _APART), 1)
            shares = np.linspace(0.0, 1.0, count + 1)[:, None]
            points.append(start + shares * (end - start))
    names = [_on_page(ax, *text.get_position()) + _LETTERS for text in ax.texts]
    return np.concatenate(points + names)


def _free_place(point: Array, taken: Array) -> Array:
    """The place (2,) [pt] about a point that is farthest from what is taken.

    Of places that are as free, it is the one farther from the centre.
    """
    angles = np.linspace(0.0, math.tau, 24, endpoint=False)
    near = np.column_stack([18.0 * np.cos(angles), 13.0 * np.sin(angles)])
    around = np.concatenate([near, 1.4 * near])
    outward = around @ point / max(float(np.linalg.norm(point)), 1.0)
    gaps = np.abs((point + around)[:, None] - taken[None]) - _HALF
    room = np.min(np.max(gaps, axis=2), axis=1)
    far = np.repeat([0.0, 2.0], len(near))
    best = np.argmax(np.minimum(room, 3.0) + 0.1 * outward - far)
    return np.asarray(point + around[best])


def _draw_key(fig: Figure, limits: LimitTable) -> None:
    """Explains the lines of the first panel, and the area beyond the limit."""
    lines = {str(line.get_label()): line for line in fig.axes[0].lines}
    labels = {name: limits.title(name) for name in limits.mechanisms}
    protocol = limits.protocols.get(limits.situations[0])
    if protocol:
        labels[protocol.paper] = protocol.paper
    if limits.beside:
        labels[limits.beside_title] = limits.beside_title
    handles: list[Artist] = [lines[name] for name in labels]
    # Where no limit is known, as from standing, nothing is drawn of it.
    if np.size(lines[HIPS_LABEL].get_xdata()):
        handles += [Patch(facecolor=BEYOND, edgecolor=FAINT), lines[HIPS_LABEL]]
        labels |= {LIMIT_LABEL: LIMIT_LABEL, HIPS_LABEL: HIPS_LABEL}
    fig.legend(
        handles=handles,
        labels=[*labels.values()],
        loc="outside right center",
        fontsize=9.5,
    )
