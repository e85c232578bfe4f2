"""Report of a sweep: its limits as text, CSV, and a picture from above.

The picture follows Fig. 10 of the Nadia paper and Fig. 6 of the Atlas paper:
the radius is the change of velocity by the push; forward is up, left is left.
"""

import csv
import math
import textwrap
from collections import Counter
from collections.abc import Iterable, Sequence
from statistics import fmean
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.mechanisms import COLORS
from nadia_balance.results.folder import appearing
from nadia_balance.results.plots.style import FAINT, RC, TEXT
from nadia_balance.robot.model import load_robot
from nadia_balance.sweep.limits import (
    LIMITS,
    OTHERS,
    WORST,
    LimitTable,
    Record,
    protocol_of,
)
from nadia_balance.sweep.trials import (
    DIGITS,
    OUTCOMES,
    Rows,
    Situation,
    with_digits,
)

PICTURE, TABLES = "envelope.png", "tables.md"

_NOTES = f"""\
A push changes the velocity of the robot's whole mass by so many m/s; direction
0 is forward, 90 left, of the stance foot's heading. It recovered from the
largest push, and from every smaller one that was tried (`~`: the search has not
ended, or nothing larger was decided). The limit is the largest push that any
controller could recover from, computed for {{}}. With hips, the eCMP may leave
the soles by as much as the controller's may; falling, the CoM sinks as fast as
the controller's may at each touchdown, too (to first order).
[`{LIMITS}`]({LIMITS}) has {DIGITS} digits of each number."""
# What each table has: column of a record, its title, digits, and the column by
# which it is divided.
Kind = tuple[str, str, int, str]
_TILT = "tilt of the torso at the largest push [deg]"
RECOVERED: Kind = ("recovered", "largest recovered push [m/s]", 2, "")
_TABLES = (
    RECOVERED,
    ("recovered", "times the paper's", 2, "paper"),
    ("recovered", "share of the limit", 2, "limit"),
    ("recovered", "share of the limit with hips", 2, "with_hips"),
    ("limit", "limit [m/s]", 2, ""),
    ("falling", "limit with hips, falling [m/s]", 2, ""),
    ("max_torso_tilt_deg", _TILT, 0, ""),
    ("com_sag_m", "sag of the CoM [m]", 2, ""),
    ("positive_power_w", "power of the drives [W]", 0, ""),
)

# Names of directions [deg], relative to the heading of the stance foot.
WORDS = {0.0: "forward", 90.0: "left", 180.0: "backward", 270.0: "right"}
LIMIT_LABEL = "beyond the limit of any\ncontroller on a point\nmass, computed"
HIPS_LABEL = "and with the momentum\nof the upper body"
BEYOND = "#eceef2"
BESIDE = "#7a5195"  # another sweep's limits
_MOST_NUMBERS = 16  # with more directions, limits are not written [-]
_PANEL, _KEY, _COLUMNS = 6.0, 2.5, 2  # sizes [in]; columns of panels


def write_report(limits: LimitTable, rows: Rows) -> list[str]:
    """Writes picture, tables and CSV beside the rows.

    Args:
        limits: of the sweep.
        rows: from which they follow.

    Returns:
        The names of the files.

    Raises:
        OSError: they cannot be written; then none is.
    """
    with mpl.rc_context(cast(Any, RC)), appearing(rows.folder) as drafts:
        draw_envelope(limits).savefig(drafts / PICTURE)
        (drafts / TABLES).write_text(
            report_text(limits, rows), encoding="utf-8"
        )
        with open(drafts / LIMITS, "w", encoding="utf-8", newline="") as file:
            lines = csv.DictWriter(file, limits.records[0], lineterminator="\n")
            lines.writeheader()
            lines.writerows(
                with_digits(record, [*OTHERS, *WORST])
                for record in limits.records
            )
    return [PICTURE, TABLES, LIMITS]


def report_text(limits: LimitTable, rows: Rows) -> str:
    """Writes down what was done, and a table of each kind for each situation.

    Args:
        limits: of the sweep.
        rows: from which they follow.

    Returns:
        The text of tables.md.
    """
    notes = _NOTES.format(
        "; or ".join(limits.assumptions) or "a robot that steps already"
    )
    robot = limits.identity["robot"]
    model = load_robot(robot).point_mass
    speed = model.omega * model.com_height  # sqrt(g z)
    done = {
        "1 m/s": f"{model.mass:.1f} N s, {1.0 / speed:.3f} sqrt(g z)",
        "limits": f"{sum(record['complete'] for record in limits.records)} "
        f"of {len(limits.records)} complete",
        "trials": outcomes(rows),
        **{name: str(value) for name, value in limits.identity.items()},
    }
    parts = [
        f"# Push-recovery envelope: {robot}",
        f"![envelope]({PICTURE})",
        textwrap.fill(notes.replace("\n", " "), 80, break_on_hyphens=False),
        table(["sweep", ""], done.items()),
    ]
    for situation in limits.situations:
        parts.append(f"## {', '.join(situation)}")
        for kind in _TABLES:
            parts += table_of(limits, situation, kind)
    return "\n\n".join(parts) + "\n"


def outcomes(rows: Rows) -> str:
    """Counts how many trials ended how.

    Args:
        rows: of the trials.

    Returns:
        Words, such as "3: 2 recovered, 1 fell".
    """
    counts = Counter(row["outcome"] for row in rows.all)
    words = [f"{counts[name]} {name}" for name in OUTCOMES if counts[name]]
    return f"{len(rows.all)}: {', '.join(words)}"


def table_of(
    limits: LimitTable, situation: Situation, kind: Kind
) -> tuple[str, str]:
    """Makes a table of directions by mechanisms, with their means.

    Args:
        limits: of the sweep.
        situation: gait and moment of the push.
        kind: what it has.

    Returns:
        Its title, and the table.
    """
    columns = [limits.of(one, situation) for one in limits.mechanisms]
    head = ["direction", *map(limits.title, limits.mechanisms)]
    lines = [
        [
            f"{records[0]['direction_deg']:g}",
            *(_mean([one], kind) for one in records),
        ]
        for records in zip(*columns, strict=True)
    ]
    lines.append(["mean", *(_mean(column, kind) for column in columns)])
    beside = limits.of_beside(limits.mechanisms[-1], situation)
    if kind is RECOVERED and beside:
        head.append(limits.beside_title)
        values = [beside.get(r["direction_deg"]) for r in columns[-1]]
        numbers = [value for value in values if value is not None]
        for line, value in zip(
            lines, [*values, fmean(numbers) if numbers else None], strict=True
        ):
            line.append("–" if value is None else f"{value:.2f}")
    return kind[1], table(head, lines)


def _mean(records: Sequence[Record], kind: Kind) -> str:
    """The mean of the known values, marked if it is not sure."""
    name, _, digits, divisor = kind
    values = [
        record[name] / (record[divisor] if divisor else 1.0)
        for record in records
        if record[name] is not None and (not divisor or record[divisor])
    ]
    if not values:
        return "–"
    text = f"{fmean(values):.{digits}f}"
    return mark(records) + text if name == "recovered" else text


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Makes a Markdown table; its columns are aligned right.

    Args:
        head: title of each column.
        lines: cells of each row.

    Returns:
        The table, without a line break at its end.
    """
    rows = [head, *lines]
    widths = [max(3, *map(len, column)) for column in zip(*rows, strict=True)]
    first, *others = [
        f"| {' | '.join(map(str.rjust, row, widths))} |" for row in rows
    ]
    rule = "|".join("-" * (width + 1) + ":" for width in widths)
    return "\n".join([first, f"|{rule}|", *others])


def mark(records: Iterable[Record]) -> str:
    """Marks what is not sure.

    Args:
        records: of which something is told.

    Returns:
        `~` if a search has not ended, or knows no push that failed.
    """
    is_sure = all(r["complete"] and r["failed"] is not None for r in records)
    return "" if is_sure else "~"


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
    for number, situation in enumerate(limits.situations, start=1):
        ax = cast(
            PolarAxes,
            fig.add_subplot(rows, columns, number, projection="polar"),
        )
        _draw_directions(ax, limits)
        ax.set_title(", ".join(situation), fontsize=10.5)
        _draw_curves(ax, limits, situation)
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


def _draw_directions(ax: PolarAxes, limits: LimitTable) -> None:
    eighths = all(r["direction_deg"] % 45.0 == 0.0 for r in limits.records)
    angles = np.arange(0.0, 360.0, 45.0 if eighths else 30.0)
    ax.set_theta_zero_location("N")
    ax.set_thetagrids(
        angles,
        [WORDS.get(angle, f"{angle:g}°") for angle in angles],
        color=TEXT,
    )
    ax.yaxis.set_major_formatter(lambda ring, _: f"{ring:g} m/s")
    ax.tick_params(axis="y", labelcolor=FAINT, labelsize=8.5)
    ax.set_rlabel_position(105.0)
    ax.grid(color=FAINT, lw=0.5, alpha=0.5)
    ax.spines[:].set_visible(False)


def _draw_curves(
    ax: PolarAxes, limits: LimitTable, situation: Situation
) -> None:
    """Draws the limits over those of the paper and of any controller."""
    last = limits.mechanisms[-1]
    records = limits.of(last, situation)
    _draw_limit(ax, records)
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
    if len(records) <= _MOST_NUMBERS:
        _write_numbers(ax, records)
    protocol = protocol_of(limits.identity["robot"], situation)
    if protocol:
        ax.plot(
            *closed(protocol.curves(situation[0]).get(last, {})),
            color="#3d4552",
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
    ax.set_rlim(0.0, max(1.1 * ax.get_rmax(), 1e-3))


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
    """Writes the known limits beside their dots, outward."""
    for record in records:
        if record["recovered"] is not None:
            angle = math.radians(record["direction_deg"])
            ax.annotate(
                f"{mark([record])}{record['recovered']:.2f}",
                xy=(angle, record["recovered"]),
                xytext=(-15.0 * math.sin(angle), 12.0 * math.cos(angle)),
                textcoords="offset points",
                color=COLORS[record["mechanisms"]],
                ha="center",
                va="center",
                fontsize=9,
                zorder=4.0,
            )


def _draw_key(fig: Figure, limits: LimitTable) -> None:
    """Explains the lines of the first panel, and the area beyond the limit."""
    lines = {str(line.get_label()): line for line in fig.axes[0].lines}
    labels = {name: limits.title(name) for name in limits.mechanisms}
    protocol = protocol_of(limits.identity["robot"], limits.situations[0])
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
