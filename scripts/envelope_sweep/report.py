"""Report of a sweep: pictures and tables."""

import math
import textwrap
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl

from nadia_balance.results.folder import appearing
from nadia_balance.results.plots.style import RC
from nadia_balance.scripts.envelope_sweep.limits import (
    AT_LEAST,
    UNSURE,
    Envelope,
    Rates,
    Scale,
    confusion,
    mark,
    scale_of,
)
from nadia_balance.scripts.envelope_sweep.plots import (
    NAMES,
    PLANTS,
    WORDS,
    draw_envelope,
)
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    Limit,
    Situation,
)
from nadia_balance.scripts.envelope_sweep.trials_file import (
    NO_ANSWER,
    OUTCOMES,
    UNDECIDED,
    cell_of,
    recovered,
)

PICTURE = "envelope.png"
TABLES = "tables.md"
NOTHING = "–"  # a missing value
_MOST_REASONS = 10

_NOTES = f"""\
A push changes the velocity of the robot's whole mass by so many m/s; direction
0 is forward, 90 left, of the stance foot's heading. *recovered* is the largest
push from which, as from every smaller one that was tried, the robot recovered
(`{UNSURE}` the search is not complete, `{AT_LEAST}` nothing larger was
decided), *fails at* the smallest from which it did not; z is the height of the
centre of mass."""


def write_report(folder: Path, envelope: Envelope) -> list[str]:
    """Writes plots and tables into `folder`, and returns their names.

    Raises:
        OSError: the folder cannot be written to.
    """
    scale = scale_of(envelope.robot)
    text = report_text(envelope, scale)
    with mpl.rc_context(RC), appearing(folder) as drafts:
        draw_envelope(envelope, scale).savefig(drafts / PICTURE)
        (drafts / TABLES).write_text(text, encoding="utf-8")
    return [PICTURE, TABLES]


def report_text(envelope: Envelope, scale: Scale | None) -> str:
    """Returns the text of tables.md."""
    limits = LimitTables(envelope=envelope, scale=scale)
    parts = [
        f"# Push-recovery envelope: {envelope.robot}, "
        f"{PLANTS.get(envelope.plant, envelope.plant)}",
        f"![envelope]({PICTURE})",
        _NOTES,
        *_notes_on_the_paper(envelope),
        *_notes_on_the_limit(envelope),
        what_was_done(envelope),
        "## Largest recovered pushes",
    ]
    for situation in envelope.situations:
        parts += [f"### {situation}", limits.summary(situation)]
        for name in envelope.mechanisms:
            parts += [f"`{name}`: {NAMES[name]}"]
            parts += [limits.details(name, situation)]
    parts += ["## How the trials ended", outcomes_table(envelope)]
    parts += ["## Predictions of the point-mass limit"]
    parts += [capturability_table(envelope)]
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


def _notes_on_the_paper(envelope: Envelope) -> list[str]:
    if (protocol := envelope.protocol) is None:
        return []
    text = f"*paper* is {protocol.paper}"
    if protocol.unit_speed != 1.0:
        text += f": forces over the robot's {protocol.unit}, for 0.1 s; 1 is"
        text += f"\n{protocol.unit_speed:g} m/s"
    return [f"{text}."]


def _notes_on_the_limit(envelope: Envelope) -> list[str]:
    said = dict.fromkeys(p.assumptions for p in envelope.physical.values())
    if not said:
        return []
    text = (
        "*limit* is the largest push that any controller could recover from, "
        f"computed for {'; or '.join(said)}. *with hips*: the eCMP may leave "
        "the soles by as much as the controller's may."
    )
    return ["\n".join(textwrap.wrap(text, 80, break_on_hyphens=False))]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Returns a table; the first column is aligned left, the others right."""
    lines = [
        [cell.replace("|", "\\|") for cell in line] for line in (head, *rows)
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


def what_was_done(envelope: Envelope) -> str:
    """Table of the search parameters, its progress and the versions."""
    search, row = envelope.search, envelope.rows[0]
    cells, missing = len(envelope.cells), len(envelope.missing)
    found = {
        "scenario": ", ".join({s.scenario: 0 for s in envelope.situations}),
        "limits": f"{cells - missing} of {cells} complete",
        "trials": len(envelope.rows),
        "resolution [m/s]": f"{search.resolution:g}",
        "largest [m/s]": f"{search.largest:g}",
        "replicas": f"{search.required} of {search.replicas} recover",
    } | {name: row[name] for name in ("code", "parameters", "nadia_balance")}
    found |= {name: row[name] for name in ("drake", "daqp", "numpy", "python")}
    return table(
        ["sweep", ""], [[name, str(value)] for name, value in found.items()]
    )


Words = Callable[[float], str]  # formats a value

_RECOVERED = "recovered [m/s]"
# Motion of the body at the largest recovered push, its worst replica.
_POSTURE: dict[str, tuple[str, Words]] = {
    "torso [deg]": ("max_torso_tilt_deg", "{:.0f}".format),
    "pelvis [deg]": ("max_pelvis_tilt_deg", "{:.0f}".format),
    "CoM sag [m]": ("com_sag_m", "{:.2f}".format),
    "power [W]": ("positive_power_w", "{:.0f}".format),
}


@dataclass(frozen=True, kw_only=True)
class LimitTables:
    """Writes tables of an `envelope`; without a `scale`, in m/s only."""

    envelope: Envelope
    scale: Scale | None

    def summary(self, situation: Situation) -> str:
        """Worst and mean over the directions, a row per set of mechanisms."""
        columns, rows = self._columns(situation), []
        for name in self.envelope.mechanisms:
            limits = self.envelope.curve(name, situation)
            lines = [
                self._values(name, situation, direction, limit)
                for direction, limit in limits.items()
            ]
            cells = [
                _worst_and_mean([line[i] for line in lines], write)
                for i, write in enumerate(columns.values())
            ]
            done = _complete(limits.values(), len(self.envelope.directions))
            both = self._recovered(limits.values())
            rows.append([f"`{name}`", both, *cells, done])
        return table(["worst / mean", _RECOVERED, *columns, "complete"], rows)

    def details(self, mechanisms: str, situation: Situation) -> str:
        """Limits of one set of mechanisms, a row per direction."""
        columns, rows = self._columns(situation), []
        head = ["direction", _RECOVERED, "fails at", *columns]
        head += [*_POSTURE, "complete"]
        limits = self.envelope.curve(mechanisms, situation)
        for direction in self.envelope.directions:
            name = direction_words(direction)
            limit = limits.get(direction)
            if limit is None:
                blank = [NOTHING] * (len(head) - 2)
                rows.append([name, *blank, "no limit"])
                continue
            values = self._values(mechanisms, situation, direction, limit)
            cells = [
                self.envelope.limit_words(limit),
                _text(limit.failed, self.envelope.words),
                *map(_text, values, columns.values()),
                *self._posture(Cell(mechanisms, situation, direction), limit),
            ]
            rows.append([name, *cells, "yes" if limit.complete else "no"])
        return table(head, rows)

    def _posture(self, cell: Cell, limit: Limit) -> Iterator[str]:
        rows = [
            row
            for row in self.envelope.rows
            if cell_of(row) == cell
            and recovered(row)
            and math.isclose(row["delta_v"], limit.recovered)
        ]
        for name, write in _POSTURE.values():
            known = [row[name] for row in rows if row[name] is not None]
            yield _text(max(known, default=None), write)

    def _recovered(self, limits: Collection[Limit]) -> str:
        """The worst and the mean of the limits, with their marks."""
        if not limits:
            return NOTHING
        worst = min(limits, key=lambda limit: limit.recovered)
        mean = math.fsum(limit.recovered for limit in limits) / len(limits)
        mean_words = f"{mark(limits)}{self.envelope.words(mean)}"
        return f"{self.envelope.limit_words(worst)} / {mean_words}"

    def _columns(self, situation: Situation) -> dict[str, Words]:
        """Names and formats of the columns of references and scales."""
        columns: dict[str, Words] = {}
        for name, curves in self.envelope.known(situation)._asdict().items():
            if curves:
                name = name.replace("_", " ")
                for column in (f"{name} [m/s]", f"/ {name}"):
                    columns[column] = "{:.2f}".format
        if self.scale:
            columns["[N s]"] = "{:.0f}".format
            columns["/ sqrt(g z)"] = "{:.3f}".format
        return columns

    def _values(
        self,
        mechanisms: str,
        situation: Situation,
        direction: float,
        limit: Limit,
    ) -> list[float | None]:
        """The values of the columns; None if unknown."""
        known = self.envelope.known(situation)
        values: list[float | None] = []
        for curves in filter(None, known):
            other = curves.get(mechanisms, {}).get(direction)
            share = limit.recovered / other if other else None
            values += [other, share]
        if self.scale:
            pushed = limit.recovered
            values += [pushed * self.scale.mass, pushed / self.scale.speed]
        return values


def direction_words(direction: float) -> str:
    """A direction in words, such as `90° left`."""
    return " ".join(filter(None, (f"{direction:g}°", WORDS.get(direction))))


def _text(value: float | None, write: Words) -> str:
    return NOTHING if value is None else write(value)


def _complete(limits: Collection[Limit], cells: int) -> str:
    """The number of complete limits among `cells`."""
    return f"{sum(limit.complete for limit in limits)} of {cells}"


def _worst_and_mean(values: Collection[float | None], write: Words) -> str:
    """Worst and mean of the known values."""
    known = [value for value in values if value is not None]
    if not known:
        return NOTHING
    return f"{write(min(known))} / {write(math.fsum(known) / len(known))}"


def table_lines(envelope: Envelope) -> list[str]:
    """Returns a table for each situation, and notes on the trials."""
    lines = []
    for situation in envelope.situations:
        columns = [["direction", *(f"{a:g}" for a in envelope.directions)]]
        for name in envelope.mechanisms:
            curve = envelope.curve(name, situation)
            cells = [
                envelope.limit_words(curve[a]) if a in curve else "-"
                for a in envelope.directions
            ]
            columns.append([name, *cells])
        widths = [max(map(len, column)) for column in columns]
        lines += ["", f"largest recovered push [m/s], {situation}"]
        lines += [
            "  ".join(map(str.rjust, line, widths))
            for line in zip(*columns, strict=True)
        ]
    marks = {mark([limit]) for limit in envelope.limits.values()}
    if UNSURE in marks:
        lines.append(f"{UNSURE} the search is not complete")
    if AT_LEAST in marks:
        lines.append(f"{AT_LEAST} nothing larger was decided")
    odd = sum(row["outcome"] in NO_ANSWER for row in envelope.rows)
    if odd:
        lines.append(
            f"{odd} of {len(envelope.rows)} trials did not run to their end "
            f"({', '.join(NO_ANSWER)}): see `reason` in trials.csv"
        )
    if short := sum(row["outcome"] == UNDECIDED for row in envelope.rows):
        lines.append(
            f"{short} of {len(envelope.rows)} trials are undecided: see "
            "`reason` in trials.csv; a longer --duration helps"
        )
    return [*lines, ""]


def outcomes_table(envelope: Envelope) -> str:
    """Numbers of trials by outcome and mechanisms; reasons without a result."""
    rows = envelope.rows
    counts = Counter((row["outcome"], row["mechanisms"]) for row in rows)
    lines = []
    for outcome in OUTCOMES:
        cells = [counts[outcome, name] for name in envelope.mechanisms]
        if any(cells):
            lines.append([outcome, *map(str, [*cells, sum(cells)])])
    head = ["outcome", *(f"`{name}`" for name in envelope.mechanisms), "all"]
    reasons = Counter(
        f"{row['outcome']}: {row['reason']}"
        for row in rows
        if row["outcome"] in (UNDECIDED, *NO_ANSWER) and row["reason"]
    )
    odd = [[reason, str(n)] for reason, n in reasons.most_common(_MOST_REASONS)]
    if (more := len(reasons) - _MOST_REASONS) > 0:
        odd.append([f"and {more} other reasons", NOTHING])
    text = table(head, lines)
    return f"{text}\n{table(['reason', 'trials'], odd)}" if odd else text


def capturability_table(envelope: Envelope) -> str:
    """Table of the false predictions of the point-mass limit."""
    groups = {
        f"`{name}`": [r for r in envelope.rows if r["mechanisms"] == name]
        for name in envelope.mechanisms
    }
    lines = [
        [name, when, *_rate_cells(rates)]
        for name, rows in {**groups, "all": envelope.rows}.items()
        for when, rates in confusion(rows).items()
    ]
    head = ["mechanisms", "when"]
    head += ["predicted capturable", "of them did not recover"]
    return table([*head, "predicted lost", "of them recovered"], lines)


def _rate_cells(rates: Rates) -> Iterator[str]:
    for whole, false in (
        (rates.capturable, rates.false_capturable),
        (rates.lost, rates.false_lost),
    ):
        yield str(whole)
        yield f"{false} ({100.0 * false / whole:.1f} %)" if whole else NOTHING
