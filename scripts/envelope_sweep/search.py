"""Search for the largest push that a robot recovers from.

Pushes are multiples of the resolution.  A push is tried with replicas that
differ slightly, because the outcome of one trial may be chance.  The search
increases the push in strides until it fails, bisects the interval to one
resolution, and then confirms the push that it has found and the next smaller
one that was tried.
"""

import functools
import math
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from nadia_balance.core.math.bounds import bounded

FINEST = 1e-4  # resolution [m/s]
LARGEST = 100.0  # bound of pushes, far above any recovery [m/s]
TYPICAL = 0.6  # assumed limit of a cell without trials [m/s]

# delta_v [m/s], replica from 0 on.
Attempt = tuple[float, int]
# True if the robot recovered; None: undecided, as the run was too short.
Results = Mapping[Attempt, bool | None]


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
    def grid(self) -> tuple[float, ...]:
        """Zero and all pushes that may be tried [m/s], to nine decimals."""
        return _grid(self.resolution, self.largest)


@functools.lru_cache
def _grid(resolution: float, largest: float) -> tuple[float, ...]:
    count = math.floor(largest / resolution * (1.0 + 1e-9))
    return tuple(round(i * resolution, 9) for i in range(count + 1))


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


@dataclass(frozen=True)
class Limit:
    """Present knowledge of the limit between recovery and fall."""

    # Largest push such that the robot recovers from it and from every smaller
    # push that was tried; 0 if there is none.  Before the search is complete,
    # a push counts if all its trials until now have recovered.
    recovered: float  # [m/s]
    # The smallest push that fails [m/s]; None if no failure is known.
    failed: float | None
    complete: bool  # the search has ended


@dataclass(frozen=True)
class _Push:
    """Results of one push that was tried."""

    delta_v: float  # [m/s]
    outcomes: dict[int, bool | None]  # replica -> recovered
    verdict: bool | None  # True: the robot recovers; None: more to try

    @property
    def is_doubtful(self) -> bool:
        return self.verdict is None and not all(self.outcomes.values())

    @property
    def is_decided(self) -> bool:
        return None not in self.outcomes.values()


def _pushes(results: Results, search: SearchParams) -> list[_Push]:
    """Every push that was tried, the smallest first.

    An undecided push counts as failed: no larger push is tried.
    """
    tried: dict[float, dict[int, bool | None]] = {}
    for (delta_v, replica), recovered in sorted(results.items()):
        tried.setdefault(delta_v, {})[replica] = recovered
    found = []
    for delta_v, outcomes in tried.items():
        good, verdict = list(outcomes.values()).count(True), None
        if None in outcomes.values():
            verdict = False
        elif good >= search.required:
            verdict = True
        elif len(outcomes) - good > search.replicas - search.required:
            verdict = False
        found.append(_Push(delta_v, outcomes, verdict))
    return found


def next_batch(
    results: Results, search: SearchParams, first: float = 0.0
) -> list[Attempt]:
    """Returns the attempts to make next; empty when done.

    The first push is near `first` [m/s], or one stride if that is larger.  The
    attempts of a batch are independent.  If each batch is complete before the
    next call, the set of all attempts depends on their outcomes only.
    """
    grid, pushes = search.grid, _pushes(results, search)
    failed = [push.delta_v for push in pushes if push.verdict is False]
    below = [p for p in pushes if not failed or p.delta_v < failed[0]]
    # Doubtful pushes come first: if they fail, larger ones are not needed.
    for push in below:
        if push.is_doubtful:
            missing = set(range(search.replicas)).difference(push.outcomes)
            return [(push.delta_v, min(missing))]
    # Places in the grid.
    lower = bisect_left(grid, below[-1].delta_v) if below else 0
    upper = bisect_left(grid, failed[0]) if failed else len(grid)
    if not failed and lower < len(grid) - 1:
        begin = max(round(first / search.resolution), search.stride)
        place = lower + search.stride if below else begin
        return [(grid[min(place, len(grid) - 1)], 0)]
    if upper - lower > 1:
        return [(grid[(lower + upper) // 2], 0)]
    return [
        (push.delta_v, replica)
        for push in below[-2:]
        if push.verdict is None
        for replica in range(search.required)
        if replica not in push.outcomes
    ]


def next_attempts(
    known: Results, search: SearchParams, first: float = 0.0
) -> list[Attempt]:
    """Returns what is missing of the batch that the search of a cell needs.

    The search is repeated from its beginning, in whole batches: the attempts do
    not depend on the order in which trials end, or on an interruption.
    """
    told: dict[Attempt, bool | None] = {}
    while batch := next_batch(told, search, first):
        if missing := [attempt for attempt in batch if attempt not in known]:
            return missing
        told.update({attempt: known[attempt] for attempt in batch})
    return []


def limit(results: Results, search: SearchParams) -> Limit | None:
    """Returns the limit that follows from `results`, complete or not.

    None if no trial was decided: the limit is then unknown, not 0.
    """
    if all(recovered is None for recovered in results.values()) and results:
        return None
    pushes, recovered = _pushes(results, search), 0.0
    for push in pushes:
        if push.verdict is False or push.is_doubtful:
            break
        recovered = push.delta_v
    failed = [push for push in pushes if push.verdict is False][:1]
    return Limit(
        recovered=recovered,
        failed=failed[0].delta_v if failed and failed[0].is_decided else None,
        complete=not next_batch(results, search),
    )


def attempts_left(
    results: Results, search: SearchParams, first: float = 0.0
) -> int:
    """Returns the expected number of further attempts of the search.

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
        foreseen |= {attempt: attempt[0] <= middle for attempt in batch}
    return len(foreseen) - len(results)
