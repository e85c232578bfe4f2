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
from itertools import takewhile
from typing import NamedTuple

from nadia_balance.core.math.bounds import bounded

LARGEST = 100.0  # bound of pushes, far above any recovery [m/s]
TYPICAL = 0.6  # assumed limit of a cell without trials [m/s]

# delta_v [m/s], replica from 0 on.
Attempt = tuple[float, int]
# True if the robot recovered; None: undecided, as the run was too short.
Results = Mapping[Attempt, bool | None]
# Verdicts on a push: required replicas recovered; all until now have; one has
# not, which others may make up for; too many have not, or one is undecided.
PASSED, LIKELY, DOUBTFUL, FAILED = "passed", "likely", "doubtful", "failed"


@dataclass(kw_only=True)
class SearchParams:
    """Resolution, strides and replicas of a search."""

    # Resolution of the limit.
    resolution: float = bounded(0.02, least=1e-4, unit="m/s")
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

    @functools.cached_property
    def grid(self) -> tuple[float, ...]:
        """Zero and all pushes that may be tried [m/s], to nine decimals."""
        count = math.floor(self.largest / self.resolution * (1.0 + 1e-9))
        return tuple(round(i * self.resolution, 9) for i in range(count + 1))


class Situation(NamedTuple):
    """The gait and the moment of the gait at which the push begins."""

    scenario: str  # its name
    at: str  # when the push begins, as Moment writes it

    def __str__(self) -> str:
        """A heading."""
        return f"{self.scenario}, {self.at}"


class Cell(NamedTuple):
    """Conditions of one limit to find, named as the columns of a row."""

    scenario: str
    at: str
    mechanisms: str  # a name of NAMED
    direction_deg: float  # 0 forward, 90 left, in [0, 360) [deg]

    @property
    def situation(self) -> Situation:
        """The gait and its moment."""
        return Situation(self.scenario, self.at)


class Limit(NamedTuple):
    """Present knowledge of the limit between recovery and fall."""

    # Largest push such that the robot recovers from it and from every smaller
    # push that was tried; 0 if there is none.  Before the search is complete,
    # a push counts if all its trials until now have recovered.
    recovered: float | None  # [m/s]
    # The smallest push that fails [m/s]; None if no failure is known.
    failed: float | None
    complete: bool  # the search has ended


class _Push(NamedTuple):
    """Results of one push that was tried."""

    delta_v: float  # [m/s]
    outcomes: dict[int, bool | None]  # replica -> recovered
    verdict: str


def _pushes(results: Results, search: SearchParams) -> list[_Push]:
    """Every push that was tried, the smallest first.

    An undecided push counts as failed: no larger push is tried.
    """
    tried: dict[float, dict[int, bool | None]] = {}
    for (delta_v, replica), recovered in sorted(results.items()):
        tried.setdefault(delta_v, {})[replica] = recovered
    return [
        _Push(v, found, _verdict(found, search)) for v, found in tried.items()
    ]


def _verdict(outcomes: dict[int, bool | None], search: SearchParams) -> str:
    good = list(outcomes.values()).count(True)
    bad = len(outcomes) - good
    if None in outcomes.values() or bad > search.replicas - search.required:
        return FAILED
    if good >= search.required:
        return PASSED
    return DOUBTFUL if bad else LIKELY


def _below(pushes: list[_Push]) -> list[_Push]:
    """The pushes below the smallest that failed."""
    return list(takewhile(lambda push: push.verdict != FAILED, pushes))


def next_batch(
    results: Results, search: SearchParams, first: float = 0.0
) -> list[Attempt]:
    """Returns the attempts to make next; empty when done.

    The first push is near `first` [m/s], or one stride if that is larger.  The
    attempts of a batch are independent.  If each batch is complete before the
    next call, the set of all attempts depends on their outcomes only.
    """
    grid, pushes = search.grid, _pushes(results, search)
    below = _below(pushes)
    # Doubtful pushes come first: if they fail, larger ones are not needed.
    for push in below:
        if push.verdict == DOUBTFUL:
            missing = set(range(search.replicas)).difference(push.outcomes)
            return [(push.delta_v, min(missing))]
    # Places in the grid.
    lower, upper = (
        (bisect_left(grid, below[-1].delta_v) if below else 0),
        len(grid),
    )
    if len(below) < len(pushes):
        upper = bisect_left(grid, pushes[len(below)].delta_v)
    elif lower < upper - 1:
        begin = max(round(first / search.resolution), search.stride)
        place = lower + search.stride if below else begin
        return [(grid[min(place, upper - 1)], 0)]
    if upper - lower > 1:
        return [(grid[(lower + upper) // 2], 0)]
    return [
        (push.delta_v, replica)
        for push in below[-2:]
        if push.verdict == LIKELY
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
    if results and all(recovered is None for recovered in results.values()):
        return None
    pushes = _pushes(results, search)
    below = _below(pushes)
    sure = list(takewhile(lambda push: push.verdict != DOUBTFUL, below))
    failed = None
    for push in pushes[len(below) : len(below) + 1]:
        if None not in push.outcomes.values():
            failed = push.delta_v
    return Limit(
        recovered=sure[-1].delta_v if sure else 0.0,
        failed=failed,
        complete=not next_batch(results, search),
    )


def attempts_left(
    results: Results, search: SearchParams, first: float = 0.0
) -> int:
    """Returns the expected number of further attempts of the search.

    The search is run to its end for an assumed limit, in the middle of the
    interval that `results` leave: recovery below it, failure above.
    """
    recovered, failed, _ = limit(results, search) or (0.0, None, False)
    middle = max(TYPICAL, recovered + 0.5 * search.stride * search.resolution)
    if failed is not None:
        middle = 0.5 * (recovered + failed)
    foreseen = dict(results)
    while batch := next_batch(foreseen, search, first):
        foreseen |= {attempt: attempt[0] <= middle for attempt in batch}
    return len(foreseen) - len(results)
