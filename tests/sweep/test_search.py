"""The search for the largest push.

Oracle: every replica of every push, tried one by one.
"""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.sweep.search import Limit, SearchParams, limit, next_batch

COARSE = SearchParams(resolution=0.1)  # five replicas, strides of 0.8 m/s


@st.composite
def searches(draw):
    resolution = draw(st.sampled_from([0.01, 0.02, 0.1]))
    return SearchParams(
        resolution=resolution,
        stride=draw(st.integers(1, 9)),
        replicas=draw(st.integers(1, 6)),
        largest=resolution * draw(st.integers(1, 30)),
    )


@st.composite
def robots_of_one_limit(draw):
    """Each replica recovers up to a push of its own, and falls above."""
    search = draw(searches())
    pushes = st.sampled_from([*search.grid, 9.0])
    count = search.replicas
    limits = draw(st.lists(pushes, min_size=count, max_size=count))
    return search, lambda delta_v, replica: delta_v <= limits[replica]


@st.composite
def robots_with_pockets(draw):
    """Recovers or falls anywhere, now more often, now less."""
    search = draw(searches())
    dice = random.Random(draw(st.integers(0, 2**32)))
    falls = draw(st.sampled_from([0.02, 0.1, 0.3, 0.7]))
    recovers = {
        (delta_v, replica): dice.random() > falls
        for delta_v in search.grid
        for replica in range(search.replicas)
    }
    return search, lambda *attempt: recovers[attempt]


def run(search, robot, first=0.0, look=lambda results: None):
    """All results; `look` sees those that are there after each trial."""
    results = {}
    while batch := next_batch(results, search, first):
        assert len(set(batch)) == len(batch)
        assert not set(batch) & set(results), "a trial is repeated"
        for attempt in batch:
            results[attempt] = robot(*attempt)
            look(results)
    return results


def recovers(search, robot, delta_v):
    """True if four in five of all replicas recover, tried or not."""
    outcomes = [robot(delta_v, replica) for replica in range(search.replicas)]
    return sum(outcomes) >= 0.8 * search.replicas


@given(robots_of_one_limit() | robots_with_pockets(), st.floats(0.0, 0.4))
def test_the_limit_is_what_the_protocol_says(example, first):
    """Oracle: replicas count at the limit and one tried push below it.

    Of all others below, those that were tried recovered, every one of them.
    """
    search, robot = example
    results = run(search, robot, first)
    found = limit(results, search)
    tried = sorted({delta_v for delta_v, _ in results})
    below = [delta_v for delta_v in tried if delta_v <= found.recovered]
    assert found.complete
    for delta_v in below[-2:]:
        assert recovers(search, robot, delta_v)
    for delta_v in below[:-2]:
        assert recovers(search, robot, delta_v) or all(
            good for (other, _), good in results.items() if other == delta_v
        )
    if tried[-1] > found.recovered:  # known to one resolution
        place = search.grid.index(found.recovered)
        assert found.failed == search.grid[place + 1]
        assert not recovers(search, robot, found.failed)
    else:
        assert (found.failed, found.recovered) == (None, search.grid[-1])


@pytest.mark.parametrize(
    ("first", "pushes"),
    [
        (0.0, [0.8, 1.6, 2.4, 2.0, 2.2, 2.1]),
        # From 0.8 m/s below: one stride up, then halves.
        (1.4, [1.4, 2.2, 1.8, 2.0, 2.1]),
        # Too high: halves from zero.
        (2.8, [2.8, 1.4, 2.1, 2.4, 2.2]),
        # Lower than the first stride.
        (0.3, [0.8, 1.6, 2.4, 2.0, 2.2, 2.1]),
    ],
)
def test_a_search_by_hand(first, pushes):
    """It falls above 2.1 m/s, wherever the search begins.

    At last come the replicas at the limit and at the push below it.
    """
    results, batches = {}, []
    while batch := next_batch(results, COARSE, first):
        batches.append(batch)
        results |= {attempt: attempt[0] <= 2.1 for attempt in batch}
    tried = [v for batch in batches for v, replica in batch if replica == 0]
    assert tried == pushes
    below = sorted(push for push in pushes if push <= 2.1)[-2:]
    assert batches[-1] == [(v, r) for v in below for r in (1, 2, 3)]
    assert limit(results, COARSE) == Limit(2.1, 2.2, True)


def test_pushes_are_round_numbers_up_to_the_largest():
    """Oracle: decimals; 3 * 0.1 is not 0.3, 0.3 / 0.1 not 3 in binary."""
    search = SearchParams(resolution=0.1, stride=2, replicas=1, largest=0.3)
    assert search.grid == (0.0, 0.1, 0.2, 0.3)
    assert list(run(search, lambda *_: True)) == [(0.2, 0), (0.3, 0)]
    assert SearchParams(resolution=0.1, largest=0.39).grid[-1] == 0.3
    assert SearchParams().grid[7] == 0.14


@pytest.mark.parametrize(
    ("results", "expected"),
    [
        ({(0.8, 0): None, (0.4, 0): None}, (None, None)),
        ({(0.8, 0): True, (1.6, 0): None}, (0.8, None)),
        ({(0.8, 0): True, (1.6, 0): None, (0.9, 0): False}, (0.8, 0.9)),
    ],
)
def test_undecided_trials_give_no_limit_and_no_failure(results, expected):
    """Oracle: by hand, with one replica."""
    search = SearchParams(resolution=0.1, replicas=1)
    found = limit(results, search)
    assert (found.recovered, found.failed) == expected
    assert all(delta_v < 1.6 for delta_v, _ in next_batch(results, search))
