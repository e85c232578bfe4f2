"""Which pushes to try, to find the largest one that a robot recovers from.

The size of a push is a level: 1, 2, ... times the resolution.  A level is
tried with replicas that differ a little, since a single fall may be bad luck.
The search marches up in strides until a level fails, halves what is left to
one resolution, and then confirms all levels that it has passed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

FINEST = 1e-4  # resolution [m/s]
LARGEST = 100.0  # push, far above any recovery [m/s]

Results = Mapping[tuple[int, int], bool]  # (level, replica) -> recovered


@dataclass(frozen=True, kw_only=True)
class SearchParams:
    """How finely and how thoroughly to search."""

    resolution: float = 0.02  # of the limit [m/s]
    stride: int = 8  # of the march upward, in resolutions [-]
    replicas: int = 5  # of the same push [-]
    largest: float = 3.0  # nothing larger is tried [m/s]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        if not FINEST <= self.resolution < math.inf:
            raise ValueError(
                f"resolution = {self.resolution}: must be finite and >= "
                f"{FINEST:g} m/s"
            )
        for name in ("stride", "replicas"):
            if not (value := getattr(self, name)) >= 1:
                raise ValueError(f"{name} = {value}: must be >= 1")
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


@dataclass(frozen=True)
class Limit:
    """What is known of the limit between recovery and fall."""

    # It and every smaller push that was tried are recovered from.  While the
    # search is incomplete, all trials so far are enough.  0 if there is none.
    recovered: float  # [m/s]
    failed: float | None  # the smallest push that fails [m/s], if there is one
    complete: bool  # nothing is left to try


def verdict(results: Results, level: int, search: SearchParams) -> bool | None:
    """Returns whether a level is recovered from; None if still undecided."""
    outcomes = [done for (tried, _), done in results.items() if tried == level]
    successes = sum(outcomes)
    if successes >= search.required:
        return True
    if len(outcomes) - successes > search.replicas - search.required:
        return False
    return None


def next_batch(results: Results, search: SearchParams) -> list[tuple[int, int]]:
    """Returns the trials (level, replica) to run next; empty when done.

    They do not depend on each other.  If a batch is complete before the next
    one is asked for, the set of all trials depends on their outcomes alone.
    """
    verdicts = _verdicts(results, search)
    upper = _lowest_failed(verdicts)
    below = [level for level in verdicts if upper is None or level < upper]
    undecided = [level for level in below if verdicts[level] is None]
    # Doubt is settled first: it may make all that is above it needless.
    for level in undecided:
        if _has_failure(results, level):
            return [(level, _next_replica(results, level))]
    if (level := _next_level(max(below, default=0), upper, search)) is not None:
        return [(level, 0)]
    return [
        (level, replica)
        for level in undecided
        for replica in range(search.required)
        if (level, replica) not in results
    ]


def limit(results: Results, search: SearchParams) -> Limit:
    """Returns what `results`, be they complete or not, say of the limit."""
    verdicts = _verdicts(results, search)
    recovered = 0
    for level, good in verdicts.items():
        if good is False or (good is None and _has_failure(results, level)):
            break
        recovered = level
    upper = _lowest_failed(verdicts)
    return Limit(
        recovered=recovered * search.resolution,
        failed=None if upper is None else upper * search.resolution,
        complete=not next_batch(results, search),
    )


def _verdicts(results: Results, search: SearchParams) -> dict[int, bool | None]:
    """The verdict of every level that was tried, the lowest level first."""
    levels = sorted({level for level, _ in results})
    return {level: verdict(results, level, search) for level in levels}


def _lowest_failed(verdicts: Mapping[int, bool | None]) -> int | None:
    failed = (level for level, good in verdicts.items() if good is False)
    return min(failed, default=None)


def _has_failure(results: Results, level: int) -> bool:
    return any(
        tried == level and not recovered
        for (tried, _), recovered in results.items()
    )


def _next_replica(results: Results, level: int) -> int:
    replica = 0
    while (level, replica) in results:
        replica += 1
    return replica


def _next_level(
    lower: int, upper: int | None, search: SearchParams
) -> int | None:
    """The level to try between `lower` and `upper`; None if there is none."""
    if upper is None:
        level = min(lower + search.stride, search.top)
        return level if level > lower else None
    return (lower + upper) // 2 if upper - lower > 1 else None
