"""Report of a sweep: its limits as text, CSV, and a picture."""

import textwrap
from collections import Counter
from collections.abc import Iterable, Sequence
from statistics import fmean
from typing import Any, cast

import matplotlib as mpl

from nadia_balance.results.folder import appearing, write_csv
from nadia_balance.results.plots.style import RC, save
from nadia_balance.robot.model import load_robot
from nadia_balance.sweep.envelope_plot import draw_envelope
from nadia_balance.sweep.limits import (
    LIMITS,
    OTHERS,
    WORST,
    LimitTable,
    Record,
    mark,
)
from nadia_balance.sweep.trials import (
    DIGITS,
    OUTCOMES,
    Rows,
    Situation,
    with_digits,
)

PICTURE, DRAWING, TABLES = "envelope.png", "envelope.svg", "tables.md"

_NOTES = f"""\
A push changes the velocity of the robot's whole mass by so many m/s; direction
0 is forward, 90 left, of the stance foot's heading. It recovered from the
largest push, and from every smaller one that was tried (`~`: the search has not
ended, or nothing larger was decided). The limit is the largest push from which
a point mass recovers, computed for {{}}. With hips, the eCMP may leave the
soles by as much as the controller's may; falling, the CoM sinks as fast as the
controller's may at each touchdown, too (to first order). A robot has hips,
falls, and may step at other times: it can be beyond the limit.
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
        save(draw_envelope(limits), drafts / PICTURE)
        (drafts / TABLES).write_text(
            report_text(limits, rows), encoding="utf-8"
        )
        write_csv(
            drafts / LIMITS,
            limits.records[0],
            (
                with_digits(record, [*OTHERS, *WORST])
                for record in limits.records
            ),
        )
    return [PICTURE, DRAWING, TABLES, LIMITS]


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
    done = {
        "1 m/s": f"{model.mass:.1f} N s, "
        f"{1.0 / model.froude_speed:.3f} sqrt(g z)",
        "limits": f"{sum(record['complete'] for record in limits.records)} "
        f"of {len(limits.records)} complete",
        "trials": outcomes(rows),
        **{name: str(value) for name, value in limits.identity.items()},
        **limits.walk,
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
    return f"{len(rows.all)}: {', '.join(words) or 'none yet'}"


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

    A bar or a line break in a cell stays in its cell.

    Args:
        head: title of each column.
        lines: cells of each row.

    Returns:
        The table, without a line break at its end.
    """
    rows = [
        [" ".join(cell.split()).replace("|", r"\|") for cell in row]
        for row in (head, *lines)
    ]
    widths = [max(3, *map(len, column)) for column in zip(*rows, strict=True)]
    first, *others = [
        f"| {' | '.join(map(str.rjust, row, widths))} |" for row in rows
    ]
    rule = "|".join("-" * (width + 1) + ":" for width in widths)
    return "\n".join([first, f"|{rule}|", *others])
