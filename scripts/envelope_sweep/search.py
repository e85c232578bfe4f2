"""Which pushes to try, to find the largest one that a robot recovers from.

The size of a push is a level: 1, 2, ... times the resolution.  A level is
tried with replicas that differ a little, since a single fall may be bad luck.
The search marches up in strides until a level fails, halves what is left to
one resolution, and then confirms the level it has found and the one below it,
of those that were tried.
"""

import heapq
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from nadia_balance.core.bounds import bounded

FINEST = 1e-4  # resolution [m/s]
LARGEST = 100.0  # push, far above any recovery [m/s]
TYPICAL = 0.6  # the limit of a cell that has not been tried yet [m/s]

# (level, replica) -> recovered; None: undecided, as the run was too short.
Results = Mapping[tuple[int, int], bool | None]


@dataclass(kw_only=True)
class SearchParams:
    """How finely and how thoroughly to search."""

    # Of the limit.
    resolution: float = bounded(0.02, least=FINEST, unit="m/s")
    # Of the march upward, in resolutions [-].
    stride: int = bounded(8, least=1, most=1000)
    replicas: int = bounded(5, least=1, most=1000)  # of the same push [-]
    largest: float = 3.0  # nothing larger is tried [m/s]

    def validate_more(self) -> None:
        """Raises ValueError for fields that do not go together."""
        if not self.resolution <= self.largest <= LARGEST:
            raise ValueError(
                f"largest = {self.largest}: must be in [resolution = "
                f"{self.resolution}, {LARGEST:g}] m/s"
            )

    @property
    def required(self) -> int:
        """So many replicas must recover: four in five, rounded up."""
        return -(-4 * self.replicas // 5)

    @property
    def top(self) -> int:
        """The highest level that is tried."""
        return math.floor(self.largest / self.resolution * (1.0 + 1e-9))


class Situation(NamedTuple):
    """In which gait, and when in it, the robot is pushed."""

    scenario: str  # its name
    at: str  # when the push begins, in Moment's own spelling

    def __str__(self) -> str:
        """Words for a heading."""
        return f"{self.scenario}, {self.at}"


@dataclass(frozen=True)
class Cell:
    """One limit to find."""

    mechanisms: str  # a name of NAMED
    situation: Situation
    direction_deg: float  # 0 forward, 90 left, in [0, 360) [deg]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One push in one cell."""

    cell: Cell
    level: int  # of the push, in resolutions, from 1 on
    replica: int  # from 0 on


@dataclass(frozen=True)
class Limit:
    """What is known of the limit between recovery and fall."""

    # It and every smaller push that was tried are recovered from.  While the
    # search is incomplete, all trials so far are enough.  0 if there is none.
    recovered: float  # [m/s]
    # The smallest push that fails [m/s]; None if none is known to.
    failed: float | None
    complete: bool  # nothing is left to try


@dataclass(frozen=True)
class _Level:
    """What is known of one level that was tried."""

    level: int
    outcomes: dict[int, bool | None]  # replica -> recovered
    verdict: bool | None  # whether it is recovered from; None: more to try

    @property
    def is_doubtful(self) -> bool:
        return self.verdict is None and not all(self.outcomes.values())

    @property
    def is_decided(self) -> bool:
        return None not in self.outcomes.values()


def _levels(results: Results, search: SearchParams) -> list[_Level]:
    """Every level that was tried, the lowest first.

    One that is undecided counts as failed: no larger push is tried.
    """
    tried: dict[int, dict[int, bool | None]] = {}
    for (level, replica), recovered in sorted(results.items()):
        tried.setdefault(level, {})[replica] = recovered
    found = []
    for level, outcomes in tried.items():
        good, verdict = list(outcomes.values()).count(True), None
        if None in outcomes.values():
            verdict = False
        elif good >= search.required:
            verdict = True
        elif len(outcomes) - good > search.replicas - search.required:
            verdict = False
        found.append(_Level(level, outcomes, verdict))
    return found


def next_batch(
    results: Results, search: SearchParams, first: int = 1
) -> list[tuple[int, int]]:
    """Returns the trials (level, replica) to run next; empty when done.

    The march begins at the level `first`, or at the first stride if that is
    higher.
    They do not depend on each other.  If a batch is complete before the next
    one is asked for, the set of all trials depends on their outcomes alone.
    """
    levels = _levels(results, search)
    failed = [found.level for found in levels if found.verdict is False]
    upper = min(failed, default=search.top + 1)
    below = [found for found in levels if found.level < upper]
    # Doubt is settled first: it may make all that is above it needless.
    for found in below:
        if found.is_doubtful:
            missing = set(range(search.replicas)).difference(found.outcomes)
            return [(found.level, min(missing))]
    lower = below[-1].level if below else 0
    if not failed and lower < search.top:
        level = lower + search.stride if below else max(first, search.stride)
        return [(min(level, search.top), 0)]
    if upper - lower > 1:
        return [((lower + upper) // 2, 0)]
    return [
        (found.level, replica)
        for found in below[-2:]
        if found.verdict is None
        for replica in range(search.required)
        if replica not in found.outcomes
    ]


def limit(results: Results, search: SearchParams) -> Limit | None:
    """Returns what `results`, be they complete or not, say of the limit.

    None if no trial was decided: then there is none, not even 0.
    """
    if all(recovered is None for recovered in results.values()) and results:
        return None
    levels, recovered = _levels(results, search), 0
    for found in levels:
        if found.verdict is False or found.is_doubtful:
            break
        recovered = found.level
    failed = [found for found in levels if found.verdict is False][:1]
    return Limit(
        recovered=recovered * search.resolution,
        failed=failed[0].level * search.resolution
        if failed and failed[0].is_decided
        else None,
        complete=not next_batch(results, search),
    )


def trials_left(results: Results, search: SearchParams, first: int = 1) -> int:
    """Returns how many trials the search makes if all goes as foreseen.

    It is played to its end with the limit in the middle of where `results`
    leave it: recovered from below, not above.
    """
    known = limit(results, search) or Limit(0.0, None, False)
    middle = max(
        TYPICAL, known.recovered + 0.5 * search.stride * search.resolution
    )
    if known.failed is not None:
        middle = 0.5 * (known.recovered + known.failed)
    foreseen = dict(results)
    while batch := next_batch(foreseen, search, first):
        for level, replica in batch:
            foreseen[level, replica] = level * search.resolution <= middle
    return len(foreseen) - len(results)


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a sweep is."""

    done: int  # trials
    total: int  # trials: those done and those foreseen
    complete: int  # cells
    cells: int


class Agenda:
    """Hands out the trials of some cells, and learns from their outcomes.

    One situation comes after the other, since trials with the same way to
    the push share it.  Of one, the first replicas come first, so that
    the whole envelope is soon known roughly; among equals it is the turn of
    the cell with the fewest trials.
    """

    def __init__(
        self,
        cells: Iterable[Cell],
        search: SearchParams,
        known: Iterable[tuple[Trial, bool | None]] = (),
        first: Mapping[Cell, int] | None = None,
    ):
        """Takes the trials that are `known` as done; others' are ignored.

        The march begins at the level `first` of a cell, if it has one.
        """
        self._search, self._first = search, first or {}
        self._rank = {cell: rank for rank, cell in enumerate(cells)}
        situations = dict.fromkeys(cell.situation for cell in self._rank)
        self._turn = {each: turn for turn, each in enumerate(situations)}
        # (level, replica) -> recovered: all that is known of a cell, and what
        # of it the search has been told, in whole batches.
        self._known: dict[Cell, dict] = {cell: {} for cell in self._rank}
        self._told: dict[Cell, dict] = {cell: {} for cell in self._rank}
        self._missing = dict.fromkeys(self._rank, 0)  # of the last batch
        self._left = dict.fromkeys(self._rank, 0)  # as foreseen
        self._heap: list[tuple] = []
        for trial, recovered in known:
            if trial.cell in self._rank:
                key = trial.level, trial.replica
                self._known[trial.cell][key] = recovered
        for cell in self._rank:
            self._go_on(cell)

    def pop(self) -> Trial | None:
        """Returns the next trial to run; None if there is none for now."""
        if not self._heap:
            return None
        *_, cell, level, replica = heapq.heappop(self._heap)
        return Trial(cell=cell, level=level, replica=replica)

    def record(self, trial: Trial, recovered: bool | None) -> None:
        """Takes note of the outcome of a trial that was handed out."""
        cell = trial.cell
        self._known[cell][trial.level, trial.replica] = recovered
        self._missing[cell] -= 1
        if self._missing[cell] == 0:
            self._go_on(cell)
        else:
            self._left[cell] -= 1

    def progress(self) -> Progress:
        """How far this is; the total becomes exact toward the end."""
        done = sum(map(len, self._known.values()))
        return Progress(
            done=done,
            total=done + sum(self._left.values()),
            complete=sum(not missing for missing in self._missing.values()),
            cells=len(self._rank),
        )

    def _go_on(self, cell: Cell) -> None:
        """Plays the search of `cell` on, until it needs unknown trials."""
        known, told = self._known[cell], self._told[cell]
        search = self._search, self._first.get(cell, 1)
        missing: list[tuple[int, int]] = []
        while not missing and (batch := next_batch(told, *search)):
            missing = [key for key in batch if key not in known]
            if not missing:
                told.update({key: known[key] for key in batch})
        for level, replica in missing:
            turn = self._turn[cell.situation], min(replica, 1)
            entry = *turn, len(known), self._rank[cell], cell, level, replica
            heapq.heappush(self._heap, entry)
        self._missing[cell] = len(missing)
        self._left[cell] = max(len(missing), trials_left(known, *search))
