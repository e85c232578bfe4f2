"""How the largest recovered push depends on when in a step it comes."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from diagrams.envelope.envelope_data import WORDS, Envelope
from diagrams.plots.envelope_style import (
    COLORS,
    NAMES,
    SEARCHED_LABEL,
    tint,
    title,
)
from diagrams.plots.style import TEXT

_MARKERS = "o^sDvPX*<>"
_WIDTH, _ROW, _COLUMNS = 10.0, 2.9, 2  # [in], [in], [-]
_MARK = {"ls": "none", "ms": 4, "mec": TEXT, "mew": 0.7, "alpha": 0.75}


def draw(envelope: Envelope) -> Figure | None:
    """Draws a panel for each mechanisms; None if there is but one moment."""
    if len(envelope.moments) < 2:
        return None
    names = envelope.mechanisms
    columns = min(_COLUMNS, len(names))
    rows = math.ceil(len(names) / columns)
    fig = Figure(figsize=(_WIDTH, rows * _ROW + 0.9), layout="constrained")
    grid = {"sharex": True, "sharey": True, "squeeze": False}
    axes = list(fig.subplots(rows, columns, **grid).flat)
    for ax, name in zip(axes, names, strict=False):
        _draw_band(ax, envelope, name)
        _draw_moments(ax, envelope, name)
        ax.set_title(f"{name}:  {NAMES[name]}")
        ax.tick_params(labelbottom=True)
    for ax in axes[len(names) :]:
        ax.remove()
    axes[0].set(xlim=(-8, 368), ylim=(0, None))
    axes[0].set_xticks([*WORDS, 360], [*WORDS.values(), ""])
    fig.supylabel("velocity [m/s]", fontsize=9, color=TEXT)
    _key(fig, axes[: len(names)], envelope)
    what = title(envelope, "Largest recovered push, by when it comes")
    fig.suptitle(what, x=0.01, ha="left", fontsize=12, color=TEXT)
    return fig


def band(
    envelope: Envelope, mechanisms: str
) -> dict[float, tuple[float, float]]:
    """Direction -> the worst and the best over the moments [m/s].

    Directions that were not tried at every moment have none.
    """
    curves = [envelope.curve(mechanisms, m) for m in envelope.moments]
    return {
        angle: (
            min(curve[angle].recovered for curve in curves),
            max(curve[angle].recovered for curve in curves),
        )
        for angle in envelope.directions
        if all(angle in curve for curve in curves)
    }


def _draw_band(ax: Axes, envelope: Envelope, mechanisms: str) -> None:
    found = band(envelope, mechanisms)
    if not found:
        return
    if 0.0 in found:
        found[360.0] = found[0.0]
    angles, color = list(found), COLORS[mechanisms]
    worst, best = np.array(list(found.values())).T
    ax.fill_between(angles, worst, best, color=tint(color), lw=0)
    ax.plot(angles, worst, color=color, lw=2.2, label="worst")
    ax.plot(angles, best, color=color, lw=0.8, label="best")


def _draw_moments(ax: Axes, envelope: Envelope, mechanisms: str) -> None:
    """A mark for each limit; hollow where the search goes on."""
    for i, moment in enumerate(envelope.moments):
        limits = envelope.curve(mechanisms, moment)
        marker = _MARKERS[i % len(_MARKERS)]
        for complete, face in ((True, TEXT), (False, "white")):
            shown = {
                direction: limit.recovered
                for direction, limit in limits.items()
                if limit.complete is complete
            }
            ax.plot(
                list(shown),
                list(shown.values()),
                marker=marker,
                mfc=face,
                label=str(moment) if complete else None,
                **_MARK,
            )


def _key(fig: Figure, axes: Sequence[Axes], envelope: Envelope) -> None:
    """One legend for all panels: a band may not be in each of them."""
    found: dict[str, Artist] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    if envelope.missing:
        found[SEARCHED_LABEL] = Line2D([], [], marker="o", mfc="white", **_MARK)
    fig.legend(
        list(found.values()),
        list(found),
        loc="outside lower center",
        ncols=min(len(found), 6),
        title="left and right are the robot's own, whichever foot swings",
    )
