"""The envelope in figures, beside the paper's and the physical limit."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass

from diagrams.envelope.envelope_data import WORDS, Envelope, mark
from diagrams.envelope.limit_search import Limit
from diagrams.envelope.markdown import NOTHING, table
from diagrams.envelope.moment import Moment

Words = Callable[[float], str]  # how a value is written

_RECOVERED = "recovered [m/s]"


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
            done = _complete(limits.values(), len(self.envelope.directions))
            both = self._recovered(limits.values())
            rows.append([f"`{name}`", both, *cells, done])
        return table(["worst / mean", _RECOVERED, *columns, "complete"], rows)

    def details(self, mechanisms: str, moment: Moment) -> str:
        """A row for each direction."""
        columns = self._columns(moment)
        head = ["direction", _RECOVERED, "fails at", *columns, "complete"]
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
                self.envelope.limit_words(limit),
                _text(limit.failed, self.envelope.words),
                *map(_text, values, columns.values()),
            ]
            rows.append([name, *cells, "yes" if limit.complete else "no"])
        return table(head, rows)

    def over_moments(self) -> str:
        """Worst and mean over all moments and directions."""
        moments = self.envelope.moments
        cells = len(moments) * len(self.envelope.directions)
        rows = []
        for name in self.envelope.mechanisms:
            found = {
                (moment, direction): limit
                for moment in moments
                for direction, limit in self.envelope.curve(
                    name, moment
                ).items()
            }
            both = self._recovered(found.values())
            moment, angle = min(found, key=lambda cell: found[cell].recovered)
            where = f"{direction_words(angle)}, {moment}"
            done = _complete(found.values(), cells)
            rows.append([f"`{name}`", both, where, done])
        head = ["worst / mean", _RECOVERED, "worst is", "complete"]
        return table(head, rows)

    def _recovered(self, limits: Collection[Limit]) -> str:
        """The worst and the mean of the limits, and how sure they are."""
        if not limits:
            return NOTHING
        worst = min(limits, key=lambda limit: limit.recovered)
        mean = math.fsum(limit.recovered for limit in limits) / len(limits)
        mean_words = f"{mark(limits)}{self.envelope.words(mean)}"
        return f"{self.envelope.limit_words(worst)} / {mean_words}"

    def _columns(self, moment: Moment) -> dict[str, Words]:
        """What a limit is compared with, and how that is written."""
        columns: dict[str, Words] = {}
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
        values: list[float | None] = []
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


def _complete(limits: Collection[Limit], cells: int) -> str:
    """How many of the cells have a limit that is complete."""
    return f"{sum(limit.complete for limit in limits)} of {cells}"


def _worst_and_mean(values: Collection[float | None], write: Words) -> str:
    """Over those that are known."""
    known = [value for value in values if value is not None]
    if not known:
        return NOTHING
    return f"{write(min(known))} / {write(math.fsum(known) / len(known))}"
