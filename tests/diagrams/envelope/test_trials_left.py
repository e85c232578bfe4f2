"""The forecast is right where the limit is as foreseen.

The oracle is the search itself, played to its end with a known limit.
"""

import pytest

from diagrams.envelope.limit_search import SearchParams, next_batch
from diagrams.envelope.trials_left import TYPICAL, trials_left

SEARCHES = [
    SearchParams(),
    SearchParams(resolution=0.1, stride=4, replicas=1),
    SearchParams(resolution=0.05, stride=1, replicas=3, largest=0.4),
]


def forecasts(limit, search):
    """What was foreseen before every batch, and how many trials were made."""
    results, said = {}, []
    while batch := next_batch(results, search):
        said.append((len(results), trials_left(results, search)))
        for level, replica in batch:
            results[level, replica] = level * search.resolution <= limit
    said.append((len(results), trials_left(results, search)))
    return said, len(results)


@pytest.mark.parametrize("search", SEARCHES)
def test_is_exact_for_a_typical_limit_at_the_start(search):
    said, total = forecasts(TYPICAL + 1e-9, search)
    assert said[0] == (0, total)


@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("limit", [0.0, 0.13, 0.37, 1.3, 5.0])
def test_is_exact_at_the_end_and_never_zero_before(search, limit):
    said, total = forecasts(limit, search)
    assert said[-1] == (total, 0)
    assert all(left > 0 for _, left in said[:-1])


@pytest.mark.parametrize("limit", [0.13, 0.37, 1.3, 5.0])
def test_is_exact_once_only_the_confirmation_is_left(limit):
    said, total = forecasts(limit, SearchParams())
    done, left = said[-2]
    assert done + left == total
