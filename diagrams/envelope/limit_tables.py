"""The envelope in figures, beside the paper's and the physical limit."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from diagrams.envelope.envelope_data import Envelope
from diagrams.envelope.limit_search import Limit
from diagrams.envelope.markdown import NOTHING, table
from diagrams.envelope.moment import Moment

Words = Callable[[float], str]  # how a value is written

WORDS = {0.0: "forward", 90.0: "left", 180.0: "backward", 270.0: "right"}


@dataclass(frozen=True, kw_only=True)
class LimitTables:
    """Writes tables of an `envelope`.

    `speed` is sqrt(g z) [m/s]; None leaves its column out.
    """

    envelope: Envelope
    speed: float | None

    def summary(self, moment: Moment) -> str:
        """Worst and mean over the directions, a row for each mechanisms."""
        columns = self._columns(moment)
        rows = []
        for name in self.envelope.mechanisms:
            limits = self.envelope.curve(name, moment)
            lines = [
                self._values(name, moment, direction, limit)
                for direction, limit in limits.items()
            ]
            cells = [
                _worst_and_mean([line[i] for line in lines], write)
                for i, write in enumerate(columns.values())
            ]
            done = sum(limit.complete for limit in limits.values())
            of_all = f"{done} of {len(self.envelope.directions)}"
            rows.append([f"`{name}`", *cells, of_all])
        return table(["worst / mean", *columns, "complete"], rows)

    def details(self, mechanisms: str, moment: Moment) -> str:
        """A row for each direction."""
        columns = self._columns(moment)
        measured, *others = columns
        head = ["direction", measured, "fails at", *others, "complete"]
        rows = []
        limits = self.envelope.curve(mechanisms, moment)
        for direction in self.envelope.directions:
            name = direction_words(direction)
            limit = limits.get(direction)
            if limit is None:
                blank = [NOTHING] * (len(head) - 2)
                rows.append([name, *blank, "not begun"])
                continue
            values = self._values(mechanisms, moment, direction, limit)
            cells = [
                _text(value, write)
                for value, write in zip(values, columns.values(), strict=True)
            ]
            # Nothing larger was tried: the limit is here or above.
            bound = limit.complete and limit.failed is None
            cells[0] = f"≥ {cells[0]}" if bound else cells[0]
            cells.insert(1, _text(limit.failed, self.envelope.words))
            rows.append([name, *cells, "yes" if limit.complete else "no"])
        return table(head, rows)

    def over_moments(self) -> str:
        """Worst and mean over all moments and directions."""
        rows = []
        for name in self.envelope.mechanisms:
            found = {
                (moment, direction): limit.recovered
                for moment in self.envelope.moments
                for direction, limit in self.envelope.curve(
                    name, moment
                ).items()
            }
            moment, direction = min(found, key=lambda cell: found[cell])
            cells = _worst_and_mean(found.values(), self.envelope.words)
            where = f"{direction_words(direction)}, {moment}"
            rows.append([f"`{name}`", cells, where])
        head = ["worst / mean", "recovered [m/s]", "worst is"]
        return table(head, rows)

    def _columns(self, moment: Moment) -> dict[str, Words]:
        """Their names, and how their values are written."""
        columns: dict[str, Words] = {"recovered [m/s]": self.envelope.words}
        if self.envelope.known(moment):
            for name in ("paper [m/s]", "/ paper", "limit [m/s]", "/ limit"):
                columns[name] = "{:.2f}".format
        if self.speed:
            columns["/ sqrt(g z)"] = "{:.3f}".format
        return columns

    def _values(
        self, mechanisms: str, moment: Moment, direction: float, limit: Limit
    ) -> list[float | None]:
        """What the columns hold; None where it is not known."""
        known = self.envelope.known(moment)
        values: list[float | None] = [limit.recovered]
        if known:
            for curves in (known.paper, known.limit):
                other = curves.get(mechanisms, {}).get(direction)
                share = limit.recovered / other if other else None
                values += [other, share]
        return values + ([limit.recovered / self.speed] if self.speed else [])


def direction_words(direction: float) -> str:
    """Such as `90° left`."""
    return " ".join(filter(None, (f"{direction:g}°", WORDS.get(direction))))


def _text(value: float | None, write: Words) -> str:
    return NOTHING if value is None else write(value)


def _worst_and_mean(values: Iterable[float | None], write: Words) -> str:
    """Over those that are known."""
    known = [value for value in values if value is not None]
    if not known:
        return NOTHING
    return f"{write(min(known))} / {write(math.fsum(known) / len(known))}"
