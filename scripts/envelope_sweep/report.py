"""Report of a sweep: the table of its limits as text, picture and CSV."""

import csv
import math
import textwrap
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import matplotlib as mpl

from nadia_balance.analysis.lipm_limit import LOST
from nadia_balance.results.folder import appearing
from nadia_balance.results.plots.style import RC
from nadia_balance.scripts.envelope_sweep import plots
from nadia_balance.scripts.envelope_sweep.rows import (
    NO_ANSWER,
    OUTCOMES,
    UNDECIDED,
    recovered,
    search_of,
)
from nadia_balance.scripts.envelope_sweep.search import Situation
from nadia_balance.scripts.envelope_sweep.table import (
    AT_LEAST,
    UNSURE,
    LimitTable,
    Record,
    mark,
)

PICTURE, TABLES, LIMITS = "envelope.png", "tables.md", "limits.csv"
NOTHING = "–"  # a missing value

_NOTES = f"""\
A push changes the velocity of the robot's whole mass by so many m/s; direction
0 is forward, 90 left, of the stance foot's heading. *recovered* is the largest
push from which, as from every smaller one that was tried, the robot recovered
(`{UNSURE}` the search is not complete, `{AT_LEAST}` nothing larger was
decided), *fails at* the smallest from which it did not; z is the height of the
centre of mass. [`{LIMITS}`]({LIMITS}) has all digits."""
# Columns beside the limits, and their formats.
_COLUMNS = {
    **{
        name: "{:.2f}"
        for other in ("paper", "limit", "with hips")
        for name in (f"{other} [m/s]", f"/ {other}")
    },
    **{"[N s]": "{:.0f}", "/ sqrt(g z)": "{:.3f}", "torso [deg]": "{:.0f}"},
    **{"pelvis [deg]": "{:.0f}", "CoM sag [m]": "{:.2f}"},
    "power [W]": "{:.0f}",
}


def write_report(folder: Path, limits: LimitTable) -> list[str]:
    """Writes picture, tables and CSV into `folder`, and returns their names.

    Raises:
        OSError: the folder cannot be written to.
    """
    with mpl.rc_context(RC), appearing(folder) as drafts:
        plots.draw_envelope(limits).savefig(drafts / PICTURE)
        (drafts / TABLES).write_text(report_text(limits), encoding="utf-8")
        with open(drafts / LIMITS, "w", encoding="utf-8", newline="") as file:
            records = list(map(asdict, limits.records))
            lines = csv.DictWriter(file, records[0], lineterminator="\n")
            lines.writeheader()
            lines.writerows(records)
    return [PICTURE, TABLES, LIMITS]


def report_text(limits: LimitTable) -> str:
    """Returns the text of tables.md."""
    plant = plots.PLANTS.get(limits.identity["plant"], "")
    parts = [
        f"# Push-recovery envelope: {limits.identity['robot']}, {plant}",
        f"![envelope]({PICTURE})",
        _NOTES,
        *_notes_on_references(limits),
        what_was_done(limits),
    ]
    for situation in limits.situations:
        parts += [f"## Largest recovered pushes [m/s], {situation}"]
        parts += [overview(limits, situation)]
        for name in limits.mechanisms:
            parts += [f"`{name}`: {plots.NAMES[name]}"]
            parts += [details(limits, limits.of(name, situation))]
    parts += ["## How the trials ended", outcomes_table(limits)]
    parts += ["## Predictions of the point-mass limit"]
    parts += [predictions_table(limits)]
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


def said_lines(limits: LimitTable) -> list[str]:
    """Returns the limits for the terminal, and notes on the trials."""
    lines = []
    for situation in limits.situations:
        lines += ["", f"largest recovered push [m/s], {situation}"]
        lines += overview(limits, situation).splitlines()
    marks = {mark([r]) for r in limits.records if r.recovered is not None}
    counts = Counter(row["outcome"] for row in limits.rows)
    odd = sum(counts[outcome] for outcome in NO_ANSWER)
    whole = len(limits.rows)
    for applies, text in (
        (UNSURE in marks, f"{UNSURE} the search is not complete"),
        (AT_LEAST in marks, f"{AT_LEAST} nothing larger was decided"),
        (
            odd,
            f"{odd} of {whole} trials did not run to their end "
            f"({', '.join(NO_ANSWER)}): see `reason` in trials.csv",
        ),
        (
            counts[UNDECIDED],
            f"{counts[UNDECIDED]} of {whole} trials are undecided: see "
            "`reason` in trials.csv; a longer --duration helps",
        ),
    ):
        lines += [text] if applies else []
    return [*lines, ""]


def _notes_on_references(limits: LimitTable) -> list[str]:
    notes = []
    if protocol := limits.protocol:
        text = f"*paper* is {protocol.paper}"
        if protocol.unit_speed != 1.0:
            text += f": forces over the robot's {protocol.unit}, for 0.1 s; "
            text += f"1 is {protocol.unit_speed:g} m/s"
        notes.append(f"{text}.")
    if limits.assumptions:
        notes.append(
            "*limit* is the largest push that any controller could recover "
            f"from, computed for {'; or '.join(limits.assumptions)}. *with "
            "hips*: the eCMP may leave the soles by as much as the "
            "controller's may."
        )
    return [
        "\n".join(textwrap.wrap(note, 80, break_on_hyphens=False))
        for note in notes
    ]


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Returns a table; the first column is aligned left, the others right."""
    lines = [
        [cell.replace("|", "\\|") for cell in line] for line in (head, *lines)
    ]
    widths = [max(3, *map(len, column)) for column in zip(*lines, strict=True)]
    text = []
    for first, *others in lines:
        cells = [first.ljust(widths[0])]
        cells += map(str.rjust, others, widths[1:])
        text.append(f"| {' | '.join(cells)} |")
    rules = [f":{'-' * (widths[0] + 1)}"]
    rules += [f"{'-' * (width + 1)}:" for width in widths[1:]]
    return "\n".join([text[0], f"|{'|'.join(rules)}|", *text[1:]]) + "\n"


def what_was_done(limits: LimitTable) -> str:
    """Table of the search parameters, its progress and the versions."""
    identity, records = limits.identity, limits.records
    search = search_of(identity)
    found = {
        "scenario": ", ".join({s.scenario: 0 for s in limits.situations}),
        "limits": f"{sum(r.complete for r in records)} of {len(records)} "
        "complete",
        "trials": len(limits.rows),
        "resolution [m/s]": f"{search.resolution:g}",
        "largest [m/s]": f"{search.largest:g}",
        "replicas": f"{search.required} of {search.replicas} recover",
    }
    names = "code", "parameters", "nadia_balance", "drake", "daqp"
    found |= {name: identity[name] for name in (*names, "numpy", "python")}
    return table(["sweep", ""], [[name, str(x)] for name, x in found.items()])


def overview(limits: LimitTable, situation: Situation) -> str:
    """Table of the limits: directions by mechanisms, and the mean."""
    columns = [limits.of(name, situation) for name in limits.mechanisms]
    lines = [
        [f"{group[0].direction_deg:g}", *(_limit(limits, [r]) for r in group)]
        for group in zip(*columns, strict=True)
    ]
    lines.append(["mean", *(_limit(limits, column) for column in columns)])
    return table(["direction", *limits.mechanisms], lines)


def details(limits: LimitTable, records: Sequence[Record]) -> str:
    """Table of all that is known of the limits of one set of mechanisms."""
    values = [_values(limits, record) for record in records]
    columns = [c for c in _COLUMNS if any(v[c] is not None for v in values)]
    lines = [
        [
            direction_words(record.direction_deg),
            _limit(limits, [record]),
            NOTHING if record.failed is None else limits.words(record.failed),
            *(_text(_COLUMNS[name], [value[name]]) for name in columns),
        ]
        for record, value in zip(records, values, strict=True)
    ]
    means = [_text(_COLUMNS[n], [v[n] for v in values]) for n in columns]
    lines.append(["mean", _limit(limits, records), NOTHING, *means])
    return table(["direction", "recovered [m/s]", "fails at", *columns], lines)


def direction_words(direction: float) -> str:
    """A direction in words, such as `90° left`."""
    return " ".join(
        filter(None, (f"{direction:g}°", plots.WORDS.get(direction)))
    )


def _values(limits: LimitTable, record: Record) -> dict[str, float | None]:
    """The values of _COLUMNS; None if unknown."""
    if (pushed := record.recovered) is None:
        return dict.fromkeys(_COLUMNS)
    values: list[float | None] = []
    for other in (record.paper, record.limit, record.with_hips):
        values += [other, pushed / other if other else None]
    if scale := limits.scale:
        values += [pushed * scale.mass, pushed / scale.speed]
    else:
        values += [None, None]
    values += [record.torso_deg, record.pelvis_deg]
    values += [record.com_sag_m, record.power_w]
    return dict(zip(_COLUMNS, values, strict=True))


def _text(write: str, values: Iterable[float | None]) -> str:
    """The mean of the known values."""
    known = [value for value in values if value is not None]
    return write.format(math.fsum(known) / len(known)) if known else NOTHING


def _limit(limits: LimitTable, records: Iterable[Record]) -> str:
    """The mean of the known limits, with its mark."""
    known = [record for record in records if record.recovered is not None]
    if not known:
        return NOTHING
    mean = math.fsum(record.recovered for record in known) / len(known)
    return f"{mark(known)}{limits.words(mean)}"


def outcomes_table(limits: LimitTable) -> str:
    """Numbers of trials by outcome and mechanisms."""
    lines = []
    counts = Counter((r["outcome"], r["mechanisms"]) for r in limits.rows)
    for outcome in OUTCOMES:
        cells = [counts[outcome, name] for name in limits.mechanisms]
        if any(cells):
            lines.append([outcome, *map(str, [*cells, sum(cells)])])
    head = ["outcome", *(f"`{name}`" for name in limits.mechanisms), "all"]
    return table(head, lines)


def predictions_table(limits: LimitTable) -> str:
    """Table of the false predictions of the point-mass limit."""
    groups = {
        f"`{name}`": [row for row in limits.rows if row["mechanisms"] == name]
        for name in limits.mechanisms
    }
    lines = [
        [name, when, *_shares(predictions)]
        for name, rows in {**groups, "all": limits.rows}.items()
        for when, predictions in foretold(rows).items()
    ]
    head = ["mechanisms", "when"]
    head += ["predicted capturable", "of them did not recover"]
    return table([*head, "predicted lost", "of them recovered"], lines)


def foretold(rows: Iterable[Mapping]) -> dict[str, list[tuple[bool, bool]]]:
    """Returns pairs by instant: predicted capturable, and recovered.

    Undecided trials and those without a result are left out.  The touchdowns of
    one trial are not independent, and recovered trials have more of them.
    """
    told: dict[str, list[tuple[bool, bool]]] = {
        "end of the push": [],
        "first touchdown": [],
        "every touchdown": [],
    }
    for row in rows:
        if row["outcome"] in (UNDECIDED, *NO_ANSWER):
            continue
        success, push = recovered(row), row["predicted_at_push"]
        landings = [
            int(n) for n in row["predicted_at_touchdowns"].split(";") if n
        ]
        steps = ([] if push is None else [push], landings[:1], landings)
        for found, predicted in zip(told.values(), steps, strict=True):
            found += [(n != LOST, success) for n in predicted]
    return told


def _shares(predictions: Sequence[tuple[bool, bool]]) -> list[str]:
    """Numbers of both predictions, each with how many were false."""
    cells = []
    for capturable in (True, False):
        whole = [ok for predicted, ok in predictions if predicted is capturable]
        false = whole.count(not capturable)
        share = f"{false} ({100.0 * false / len(whole):.1f} %)" if whole else ""
        cells += [str(len(whole)), share or NOTHING]
    return cells
