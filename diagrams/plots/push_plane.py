"""The plane of pushes: as far out as their velocity, seen from above."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from diagrams.envelope.moment import Moment
from diagrams.envelope.references import Curve
from diagrams.plots.envelope_style import direction_name, inward
from diagrams.plots.style import FAINT, TEXT
from nadia_balance.core.walking import Array

_FARTHEST = 100.0  # directions farther apart are not joined [deg]
_RINGS = (0.05, 0.1, 0.2, 0.5, 1.0)  # distances of rings [m/s]
_MOST_RINGS = 5
_RING_LABELS = 15.0  # where their labels are, backward of inward [deg]


def points(values: Curve) -> Array:
    """The corners (n, 2) [m/s], right and up in the picture, of a closed line.

    A NaN breaks it where directions are too far apart to join.
    """
    corners = []
    angles = sorted(values)
    for here, after in zip(angles, [*angles[1:], angles[0] + 360], strict=True):
        corners.append(at(here, values[here]))
        if after - here > _FARTHEST:
            corners.append(np.full(2, np.nan))
    return np.array([*corners, corners[0]])


def at(direction: float, size: float) -> Array:
    """The point (2,) of the picture for a push in a direction [deg]."""
    angle = math.radians(direction)
    return size * np.array([-math.sin(angle), math.cos(angle)])


def draw_rings(ax: Axes, moment: Moment) -> None:
    """Rings at round velocities; the outer ones, with room, say which."""
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set_visible(False)
    (left, right), (_, top) = ax.get_xlim(), ax.get_ylim()
    gap = next((g for g in _RINGS if top / g <= _MOST_RINGS), _RINGS[-1])
    angle = 90.0 + _RING_LABELS
    if inward(moment) > 180.0:
        angle = -angle
    for ring in np.arange(gap, 1.5 * top, gap):
        circle = Circle((0, 0), ring, fill=False, ec=FAINT, lw=0.6, alpha=0.5)
        ax.add_patch(circle).set_zorder(1.0)
        place = at(angle, ring)
        if ring > 0.35 * top and 0.88 * left < place[0] < 0.88 * right:
            text = ax.text(*place, f"{ring:g} m/s", ha="center", va="center")
            text.set(color=FAINT, fontsize=8.5, zorder=1.2)


def spoke_angle(directions: Sequence[float]) -> float:
    """Between spokes [deg]: 45 if these are the directions, else 30."""
    return 45.0 if all(d % 45.0 == 0.0 for d in directions) else 30.0


def draw_directions(
    ax: Axes, moment: Moment, directions: Sequence[float]
) -> None:
    """Spokes: words for four of them, degrees for others."""
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    for angle in np.arange(0.0, 360.0, spoke_angle(directions)):
        way = at(angle, 1.0)
        sides = np.where(way > 0, [right, high], [left, low])
        with np.errstate(divide="ignore"):
            end = way * np.min(np.abs(sides / np.where(way == 0, 1e-9, way)))
        ax.plot(*np.array([np.zeros(2), end]).T, color=FAINT, lw=0.5, alpha=0.5)
        main = angle % 90.0 == 0.0
        ax.annotate(
            direction_name(angle, moment).replace(" ", "\n"),
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
