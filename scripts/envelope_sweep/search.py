"""Search for the largest push that a robot recovers from.

Pushes are multiples of the resolution.  A push is tried with replicas that
differ slightly, because the outcome of one trial may be chance.  The search
increases the push in strides until it fails, bisects the interval to one
resolution, and then confirms the push that it has found and the next smaller
one that was tried.
"""

import functools
import itertools
import math
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from nadia_balance.core.math.bounds import bounded

# delta_v [m/s], replica from 0 on.
Attempt = tuple[float, int]
# True if the robot recovered; None: undecided, as the run was too short.
Results = Mapping[Attempt, bool | None]


@dataclass(kw_only=True)
class SearchParams:
    """Resolution, strides and replicas of a search."""

    # Resolution of the limit.
    resolution: float = bounded(0.02, least=1e-4, most=1.0, unit="m/s")
    # Increments before the first failure, in resolutions [-].
    stride: int = bounded(8, least=1, most=1000)
    replicas: int = bounded(5, least=1, most=1000)  # of the same push [-]
    largest: float = 3.0  # no push is larger [m/s]

    @property
    def required(self) -> int:
        """Number of replicas that must recover: four in five, rounded up."""
        return -(-4 * self.replicas // 5)

    @functools.cached_property
    def grid(self) -> tuple[float, ...]:
        """Zero and all pushes that may be tried [m/s], to nine decimals."""
        count = math.floor(self.largest / self.resolution * (1.0 + 1e-9))
        return tuple(round(i * self.resolution, 9) for i in range(count + 1))


class Limit(NamedTuple):
    """Present knowledge of the limit between recovery and fall."""

    # Largest push such that the robot recovers from it and from every smaller
    # push that was tried; 0 if there is none, None if no trial was decided.
    # Before the search is complete, a push counts if all its trials until now
    # have recovered.
    recovered: float | None  # [m/s]
    # The smallest push that fails [m/s]; None if no failure is known.
    failed: float | None
    complete: bool  # the search has ended


def _tried(
    results: Results, search: SearchParams
) -> tuple[dict[float, bool], float | None]:
    """All pushes [m/s] below the smallest that failed, and that.

    True: the push is in doubt, as one replica has not recovered, which others
    may make up for.  An undecided push counts as failed.
    """
    outcomes: dict[float, list[bool | None]] = {}
    for (delta_v, _), recovered in sorted(results.items()):
        outcomes.setdefault(delta_v, []).append(recovered)
    below: dict[float, bool] = {}
    for delta_v, several in outcomes.items():
        good, bad = several.count(True), several.count(False)
        if None in several or bad > search.replicas - search.required:
            return below, delta_v
        below[delta_v] = bad > 0 and good < search.required
    return below, None


def next_batch(
    results: Results, search: SearchParams, first: float = 0.0
) -> list[Attempt]:
    """Returns the attempts to make next; empty when done.

    The first push is near `first` [m/s], or one stride if that is larger.  The
    attempts of a batch are independent.  If each batch is complete before the
    next call, the set of all attempts depends on their outcomes only.
    """
    grid, (below, failed) = search.grid, _tried(results, search)
    # Doubts come first: if these pushes fail, larger ones are not needed.
    for delta_v, doubtful in below.items():
        if doubtful:
            more = ((delta_v, replica) for replica in itertools.count())
            return [next(one for one in more if one not in results)]
    # Places in the grid.
    lower = bisect_left(grid, max(below, default=0.0))
    upper = len(grid) if failed is None else bisect_left(grid, failed)
    if upper - lower > 1:
        place = (lower + upper) // 2
        if failed is None:
            begin = max(round(first / search.resolution), search.stride)
            place = lower + search.stride if below else begin
        return [(grid[min(place, upper - 1)], 0)]
    return [
        (delta_v, replica)
        for delta_v in list(below)[-2:]
        for replica in range(search.required)
        if (delta_v, replica) not in results
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


def limit(results: Results, search: SearchParams) -> Limit:
    """Returns the limit that follows from `results`, complete or not."""
    if all(recovered is None for recovered in results.values()):
        return Limit(None, None, False)
    below, failed = _tried(results, search)
    sure = itertools.takewhile(lambda v: not below[v], below)
    undecided = {
        v for (v, _), recovered in results.items() if recovered is None
    }
    return Limit(
        recovered=max(sure, default=0.0),
        failed=None if failed in undecided else failed,
        complete=not next_batch(results, search),
    )
