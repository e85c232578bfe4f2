"""Search for the largest push that a robot recovers from.

The size of a push is a level: 1, 2, ... times the resolution.  A level is
tried with replicas that differ slightly, because the outcome of one trial may
be chance.  The search increases the level in strides until one fails, bisects
the interval to one resolution, and then confirms the level that it has found
and the next lower one that was tried.
"""

import heapq
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from nadia_balance.core.bounds import bounded

FINEST = 1e-4  # resolution [m/s]
LARGEST = 100.0  # bound of pushes, far above any recovery [m/s]
TYPICAL = 0.6  # assumed limit of a cell without trials [m/s]

# (level, replica) -> recovered; None: undecided, as the run was too short.
Results = Mapping[tuple[int, int], bool | None]


@dataclass(kw_only=True)
class SearchParams:
    """Resolution, strides and replicas of a search."""

    # Resolution of the limit.
    resolution: float = bounded(0.02, least=FINEST, unit="m/s")
    # Increments before the first failure, in resolutions [-].
    stride: int = bounded(8, least=1, most=1000)
    replicas: int = bounded(5, least=1, most=1000)  # of the same push [-]
    largest: float = 3.0  # largest push that is tried [m/s]

    def validate_more(self) -> None:
        """Raises ValueError for fields that contradict each other."""
        if not self.resolution <= self.largest <= LARGEST:
            raise ValueError(
                f"largest = {self.largest}: must be in [resolution = "
                f"{self.resolution}, {LARGEST:g}] m/s"
            )

    @property
    def required(self) -> int:
        """Number of replicas that must recover: four in five, rounded up."""
        return -(-4 * self.replicas // 5)

    @property
    def top(self) -> int:
        """The highest level that is tried."""
        return math.floor(self.largest / self.resolution * (1.0 + 1e-9))


class Situation(NamedTuple):
    """The gait and the moment of the gait at which the push begins."""

    scenario: str  # its name
    at: str  # when the push begins, as Moment writes it

    def __str__(self) -> str:
        """A heading."""
        return f"{self.scenario}, {self.at}"


@dataclass(frozen=True)
class Cell:
    """Conditions of one limit to find."""

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
    """Present knowledge of the limit between recovery and fall."""

    # Largest push such that the robot recovers from it and from every smaller
    # push that was tried; 0 if there is none.  Before the search is complete,
    # a level counts if all its trials until now have recovered.
    recovered: float  # [m/s]
    # The smallest push that fails [m/s]; None if no failure is known.
    failed: float | None
    complete: bool  # the search has ended


@dataclass(frozen=True)
class _Level:
    """Results of one level that was tried."""

    level: int
    outcomes: dict[int, bool | None]  # replica -> recovered
    verdict: bool | None  # True: the robot recovers; None: more to try

    @property
    def is_doubtful(self) -> bool:
        return self.verdict is None and not all(self.outcomes.values())

    @property
    def is_decided(self) -> bool:
        return None not in self.outcomes.values()


def _levels(results: Results, search: SearchParams) -> list[_Level]:
    """Every level that was tried, the lowest first.

    An undecided level counts as failed: no larger push is tried.
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

    The first level is `first`, or one stride if that is higher.  The trials of
    a batch are independent.  If each batch is complete before the next call,
    the set of all trials depends on their outcomes only.
    """
    levels = _levels(results, search)
    failed = [found.level for found in levels if found.verdict is False]
    upper = min(failed, default=search.top + 1)
    below = [found for found in levels if found.level < upper]
    # Doubtful levels come first: if they fail, higher ones are not needed.
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
    """Returns the limit that follows from `results`, complete or not.

    None if no trial was decided: the limit is then unknown, not 0.
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
    """Returns the expected number of further trials of the search.

    The search is run to its end for an assumed limit, in the middle of the
    interval that `results` leave: recovery below it, failure above.
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
    """Progress of a sweep."""

    done: int  # trials
    total: int  # trials done and expected
    complete: int  # cells
    cells: int


class Agenda:
    """Schedules the trials of some cells, depending on their outcomes.

    Situations are processed one by one, because their trials share the walk to
    the push.  Within a situation, first replicas come first, which gives a
    coarse envelope early; then the cell with the fewest trials comes first.
    """

    def __init__(
        self,
        cells: Iterable[Cell],
        search: SearchParams,
        known: Iterable[tuple[Trial, bool | None]] = (),
        first: Mapping[Cell, int] | None = None,
    ):
        """Takes the `known` trials of these cells as done; ignores others.

        The search of a cell begins at its level `first`, if given.
        """
        self._search, self._first = search, first or {}
        self._rank = {cell: rank for rank, cell in enumerate(cells)}
        situations = dict.fromkeys(cell.situation for cell in self._rank)
        self._turn = {each: turn for turn, each in enumerate(situations)}
        # (level, replica) -> recovered: all known trials of a cell, and those
        # that the search has used, in whole batches.
        self._known: dict[Cell, dict] = {cell: {} for cell in self._rank}
        self._told: dict[Cell, dict] = {cell: {} for cell in self._rank}
        self._missing = dict.fromkeys(self._rank, 0)  # of the last batch
        self._left = dict.fromkeys(self._rank, 0)  # expected trials
        self._heap: list[tuple] = []
        for trial, recovered in known:
            if trial.cell in self._rank:
                key = trial.level, trial.replica
                self._known[trial.cell][key] = recovered
        for cell in self._rank:
            self._go_on(cell)

    def pop(self) -> Trial | None:
        """Returns the next trial to run; None if none is ready."""
        if not self._heap:
            return None
        *_, cell, level, replica = heapq.heappop(self._heap)
        return Trial(cell=cell, level=level, replica=replica)

    def record(self, trial: Trial, recovered: bool | None) -> None:
        """Records the outcome of a trial that `pop` returned."""
        cell = trial.cell
        self._known[cell][trial.level, trial.replica] = recovered
        self._missing[cell] -= 1
        if self._missing[cell] == 0:
            self._go_on(cell)
        else:
            self._left[cell] -= 1

    def progress(self) -> Progress:
        """The progress; its total is an estimate until the end."""
        done = sum(map(len, self._known.values()))
        return Progress(
            done=done,
            total=done + sum(self._left.values()),
            complete=sum(not missing for missing in self._missing.values()),
            cells=len(self._rank),
        )

    def _go_on(self, cell: Cell) -> None:
        """Continues the search of `cell` until it needs unknown trials."""
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
