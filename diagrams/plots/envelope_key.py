"""What the lines and the feet in a picture of an envelope mean."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from diagrams.envelope.envelope_data import Envelope
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import MOMENT, ROBOT, SCENARIO
from diagrams.plots.envelope_style import (
    BEYOND,
    COLORS,
    LIMIT,
    LIMIT_LABEL,
    PAPER_LABEL,
    PAPER_LINE,
    SEARCHED_LABEL,
    key_name,
)
from diagrams.plots.plan_view import SOLE
from diagrams.plots.style import FAINT
from nadia_balance.core.walking import Side
from nadia_balance.systems import palette


def draw_key(fig: Figure, envelope: Envelope) -> None:
    """One legend for the whole figure, to its right."""
    line = {"lw": 2, "marker": "o", "ms": 5}
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=COLORS[m], label=key_name(envelope, m), **line)
        for m in envelope.mechanisms
    ]
    if envelope.missing:
        dot = {"ls": "none", "marker": "o", "ms": 5, "mfc": "white"}
        dot |= {"mec": FAINT, "mew": 1.4, "label": SEARCHED_LABEL}
        handles.append(Line2D([], [], **dot))
    handles += reference_handles(envelope)
    fig.legend(
        handles=handles,
        loc="outside right center",
        fontsize=9.5,
        labelspacing=0.8,
        handlelength=2.2,
    )


def reference_handles(envelope: Envelope) -> list[Line2D | Patch]:
    """What the references look like, or why there are none."""
    known = [m for m in envelope.moments if envelope.known(m)]
    handles: list[Line2D | Patch] = []
    if known:
        handles += [
            Line2D([], [], label=PAPER_LABEL, **PAPER_LINE),
            Patch(facecolor=BEYOND, edgecolor=LIMIT, label=LIMIT_LABEL),
        ]
    if len(known) < len(envelope.moments):
        text = f"references: only for\n{ROBOT}, {SCENARIO}, {MOMENT}"
        handles.append(Line2D([], [], ls="none", label=text))
    return handles


def draw_soles(ax: Axes, moment: Moment, place: tuple[float, float]) -> None:
    """Draws at the lower left where the feet are: stance solid, swing dashed.

    `place` is that of its lower left corner, as shares of `ax`.
    """
    corner = ax.inset_axes([*place, 0.28, 0.13])
    corner.set(xlim=(0.4, -0.4), ylim=(-0.15, 0.3), aspect="equal")
    corner.axis("off")
    corner.set_anchor("SW")
    for side in Side:
        color = palette.foot_color(side)
        swings = side.value == moment.side
        forward, left = SOLE.T
        middle = 0.18 * side.sign
        corner.fill(
            left + middle,
            forward,
            facecolor=(*palette.rgb(color), 0.0 if swings else 0.3),
            edgecolor=color,
            ls=(0, (3, 1.5)) if swings else "-",
            lw=1.2,
        )
        word = ("swings" if swings else "stands") + (
            "\nnext" if swings and moment.phase == "transfer" else ""
        )
        text = corner.text(middle, 0.15, word, ha="center", va="bottom")
        text.set(fontsize=8, color=color)
