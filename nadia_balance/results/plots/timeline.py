"""Planned and measured contacts of both feet, with their durations."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from nadia_balance import palette
from nadia_balance.core.walking.vocabulary import Phase, Side
from nadia_balance.results.log import Log, PhaseSpan, contacts, phase_spans
from nadia_balance.results.plots import style
from nadia_balance.results.plots.style import FAINT, RC, TEXT

CHANGED = 0.03  # larger changes of a duration show the planned one, too [s]
_WIDTH, _MAX_ROWS, _ROW_SECONDS = 12.0, 6, 10.0
_FOOT_Y = {Side.LEFT: 2.0, Side.RIGHT: 0.0}
_PLAN, _MEASURED = (0.02, 0.42), (-0.42, -0.02)  # lanes of a foot
_LABEL_Y, _LINE = (1.36, 0.82), 0.27  # lanes of the durations, their lines
_NUMBER = {"ls": "none", "ms": 22}  # in the legend
_PALE = 0.3  # opacity of planned contacts
_LETTER = RC["font.size"] / 72.0 * 0.6  # width of a letter [in]


def draw(log: Log, summary: dict) -> Figure:
    """Draws rows of about ten seconds, one below the other."""
    t = log["t"]
    total = max(t[-1] - t[0], 1e-3)
    rows = min(max(round(total / _ROW_SECONDS), 1), _MAX_ROWS)
    fig = Figure(figsize=(_WIDTH, 1.0 + 1.75 * rows), layout="constrained")
    axes = np.atleast_1d(fig.subplots(rows, 1, squeeze=True))
    seconds = total / rows
    spans = phase_spans(log)
    for i, ax in enumerate(axes):
        begin = t[0] + i * seconds
        _draw_row(ax, log, spans, begin, begin + seconds)
        style.mark_pushes(ax, log, label=True)
    axes[-1].set_xlabel("time [s]")
    _add_key(fig, log)
    style.set_title(fig, summary, "Contacts")
    return fig


def _add_key(fig: Figure, log: Log) -> None:
    """Adds the legend of bars and numbers below the axes."""
    planned = "walking_signal" in log
    bars = [Patch(color=FAINT, alpha=_PALE, label="contact as planned")]
    bars = bars if planned else []
    if "foot_forces" in log:
        label = "as measured" if planned else "contact as measured"
        bars.append(Patch(color=FAINT, label=label))
    numbers = [
        Line2D([], [], color=color, marker=f"${text}$", label=label, **_NUMBER)
        for text, color, label in (
            ("0.54", palette.RIGHT, "swing [s], in the colour of its foot"),
            ("0.54", TEXT, "transfer [s]"),
            ("(0.70)", FAINT, "as planned, if changed"),
        )
        if planned
    ]
    style.key(fig, [*bars, *numbers, *style.push_key(log)])


def _draw_row(
    ax: Axes, log: Log, spans: list[PhaseSpan], begin: float, end: float
) -> None:
    ax.set_xlim(begin, end)
    ax.set_ylim(-0.6, 2.6)
    ax.set_yticks([_FOOT_Y[s] for s in Side], [s.value for s in Side])
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    ax.grid(axis="y", visible=False)
    for side in Side:
        plan = [(s.start, s.duration) for s in spans if s.carries(side)]
        _bars(ax, plan, _FOOT_Y[side], _PLAN, side, _PALE)
        if "foot_forces" in log:
            _bars(ax, contacts(log, side), _FOOT_Y[side], _MEASURED, side, 1.0)
    inches = _WIDTH * 0.9 / (end - begin)
    free = [-math.inf] * len(_LABEL_Y)  # end of each lane's last label [s]
    for span in spans:
        if begin <= 0.5 * (span.start + span.end) < end:
            _write_duration(ax, span, inches, free)


def _bars(ax: Axes, bars, y: float, lane, side: Side, alpha: float) -> None:
    look = {"facecolor": palette.foot_color(side), "alpha": alpha, "lw": 0}
    ax.broken_barh(bars, (y + lane[0], lane[1] - lane[0]), **look)


def _write_duration(
    ax: Axes, span: PhaseSpan, inches: float, free: list[float]
) -> None:
    """Writes the duration of a phase between the feet, if there is room.

    `inches` is the width of a second on paper.  Labels that would overlap
    alternate between the lanes; `free` is updated.
    """
    if span.phase is Phase.STANDING or not span.complete:
        return
    changed = abs(span.duration - span.planned) > CHANGED
    lines = [f"{span.duration:.2f}"]
    if changed and math.isfinite(span.planned):
        lines.append(f"({span.planned:.2f})")
    width = max(map(len, lines)) * _LETTER / inches
    if not changed and span.duration < width:
        return
    middle = 0.5 * (span.start + span.end)
    begins = middle - 0.5 * width
    lane = next((i for i, t in enumerate(free) if t <= begins), None)
    if lane is None:
        lane = free.index(min(free))
    free[lane] = middle + 0.5 * width
    swing = span.phase is Phase.SWING
    color = palette.foot_color(span.swing_side) if swing else TEXT
    looks = (
        {"color": color, "weight": "bold" if changed else "normal"},
        {"color": FAINT, "fontsize": 7.5},
    )
    for row, (text, look) in enumerate(zip(lines, looks, strict=False)):
        y = _LABEL_Y[lane] - row * _LINE
        ax.text(middle, y, text, ha="center", va="center", **look)
