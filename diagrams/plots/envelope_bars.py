"""The largest recovered push beside the paper's and the limit, as bars."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from diagrams.envelope.envelope_data import Envelope
from diagrams.envelope.references import Curve, References
from diagrams.plots.envelope_style import (
    BEYOND,
    COLORS,
    LIMIT,
    LIMIT_BAR_LABEL,
    NAMES,
    PAPER_BAR,
    PAPER_LABEL,
    SEARCHED_LABEL,
    direction_name,
    title,
)
from diagrams.plots.style import FAINT, TEXT

_WIDTH, _SCALE = 10.0, 1.0  # [in], height of a bar of 1 m/s [in]
_TITLE = 0.45  # height of what is above each row [in]
_LOWEST = 0.3  # the least that a row's axis goes up to [m/s]
_MOST_NUMBERS = 16  # directions with the limit written above their bars


def draw(envelope: Envelope) -> Figure:
    """Draws a row for each mechanisms, at the first moment of the envelope."""
    moment = envelope.moments[0]
    known = envelope.known(moment)
    tops = [_top(envelope, known, name) for name in envelope.mechanisms]
    scale = _SCALE * max(1.0, 2.0 / max(tops))
    height = scale * sum(tops) + _TITLE * len(tops) + 1.0
    fig = Figure(figsize=(_WIDTH, height), layout="constrained")
    # One scale for all rows, but no row higher than its bars.
    ratios = {"height_ratios": tops}
    grid = {"sharex": True, "squeeze": False, "gridspec_kw": ratios}
    axes = list(fig.subplots(len(tops), 1, **grid).flat)
    for ax, name, top in zip(axes, envelope.mechanisms, tops, strict=True):
        _draw_row(ax, envelope, known, name)
        ax.set(ylim=(0.0, top), yticks=_ticks(top))
    named = {
        x: direction_name(angle, moment).replace(" ", "\n")
        for x, angle in enumerate(envelope.directions)
        if angle % 30.0 == 0.0 or len(envelope.directions) <= _MOST_NUMBERS
    }
    axes[-1].set_xticks(list(named), list(named.values()))
    fig.supylabel("velocity [m/s]", fontsize=9, color=TEXT)
    _key(fig, envelope, known)
    what = title(envelope, f"Largest recovered push, {moment}")
    fig.suptitle(what, x=0.01, ha="left", fontsize=12, color=TEXT)
    return fig


def _draw_row(
    ax: Axes, envelope: Envelope, known: References, mechanisms: str
) -> None:
    places = {angle: x for x, angle in enumerate(envelope.directions)}
    limit = known.limit.get(mechanisms, {})
    paper = known.paper.get(mechanisms, {})
    _bars(ax, places, limit, (0.0, 0.84), fc=BEYOND, ec=LIMIT, lw=0.8)
    side = 0.19 if paper else 0.0
    _bars(ax, places, paper, (side, 0.36), **PAPER_BAR)
    _draw_limits(ax, envelope, mechanisms, side)
    ax.set_title(f"{mechanisms}:  {NAMES[mechanisms]}")
    ax.grid(axis="x", visible=False)
    ax.margins(x=0.01)


def _top(envelope: Envelope, known: References, mechanisms: str) -> float:
    """How high a row must be for all of its bars [m/s]."""
    found = [
        limit.recovered
        for limit in envelope.curve(mechanisms, envelope.moments[0]).values()
    ]
    for table in (known.paper, known.limit):
        curve = table.get(mechanisms, {})
        found += [curve[a] for a in envelope.directions if a in curve]
    return max(1.04 * max(found, default=0.0) + 0.08, _LOWEST)


def _ticks(top: float) -> np.ndarray:
    return np.arange(0.0, top, 0.5 if top > 0.6 else 0.2)


def _bars(
    ax: Axes,
    places: dict[float, int],
    curve: Curve,
    where: tuple[float, float],
    **style,
) -> None:
    """Bars in the directions that were tried; `where`: offset and width."""
    shown = {places[a]: value for a, value in curve.items() if a in places}
    offset, width = where
    middles = np.array(list(shown), dtype=float) + offset
    ax.bar(middles, list(shown.values()), width, zorder=2, **style)


def _draw_limits(
    ax: Axes, envelope: Envelope, mechanisms: str, side: float
) -> None:
    """The measured ones; hollow where the search goes on."""
    limits = envelope.curve(mechanisms, envelope.moments[0])
    places = {angle: x for x, angle in enumerate(envelope.directions)}
    color = COLORS[mechanisms]
    for angle, limit in limits.items():
        x = places[angle] - side
        style = {"fc": color if limit.complete else "white", "ec": color}
        ax.bar(x, limit.recovered, 0.36, lw=1.2, zorder=3, **style)
        if len(places) > _MOST_NUMBERS:
            continue
        ax.annotate(
            envelope.limit_words(limit),
            (x, limit.recovered),
            xytext=(0, 1.5),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8,
            color=TEXT,
            zorder=4,
            path_effects=[withStroke(linewidth=2, foreground="white")],
        )


def _key(fig: Figure, envelope: Envelope, known: References) -> None:
    """One legend below; the measured bars of each row have its colour."""
    color = COLORS[envelope.mechanisms[-1]]
    handles = [Patch(fc=color, ec=color, label="measured here")]
    if envelope.missing:
        handles.append(Patch(fc="white", ec=FAINT, label=SEARCHED_LABEL))
    if known:
        handles += [
            Patch(label=PAPER_LABEL, **PAPER_BAR),
            Patch(fc=BEYOND, ec=LIMIT, label=LIMIT_BAR_LABEL),
        ]
    fig.legend(handles=handles, loc="outside lower center", ncols=len(handles))
