"""The search for the largest push.

Oracle: every replica of every level, tried one by one.
"""

import math
import random
from itertools import takewhile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagrams.envelope.limit_search import (
    Limit,
    SearchParams,
    limit,
    next_batch,
    verdict,
)

SEARCH = SearchParams()


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
    """Each replica recovers up to a level of its own, and falls above."""
    search = draw(searches())
    levels = st.integers(0, search.top + 1)
    count = search.replicas
    limits = draw(st.lists(levels, min_size=count, max_size=count))
    return search, lambda level, replica: level <= limits[replica]


@st.composite
def robots_with_pockets(draw):
    """Recovers or falls anywhere, now more often, now less."""
    search = draw(searches())
    dice = random.Random(draw(st.integers(0, 2**32)))
    falls = draw(st.sampled_from([0.02, 0.1, 0.3, 0.7]))
    recovers = {
        (level, replica): dice.random() > falls
        for level in range(1, search.top + 1)
        for replica in range(search.replicas)
    }
    return search, lambda level, replica: recovers[level, replica]


def run(search, robot, check=lambda results: None):
    """All results; `check` sees those that are there after each trial."""
    results = {}
    while batch := next_batch(results, search):
        assert len(set(batch)) == len(batch)
        assert not set(batch) & set(results), "a trial is repeated"
        assert all(
            verdict(results, level, search) is None for level, _ in batch
        )
        for trial in batch:
            results[trial] = robot(*trial)
            check(results)
    return results


def recovers(search, robot, level):
    """True if four in five of all replicas recover, tried or not."""
    outcomes = [robot(level, replica) for replica in range(search.replicas)]
    return sum(outcomes) >= 0.8 * search.replicas


@given(robots_of_one_limit() | robots_with_pockets())
def test_the_limit_is_what_the_protocol_says(example):
    search, robot = example
    results = run(search, robot)
    found = limit(results, search)
    tried = sorted({level for level, _ in results})
    good = list(takewhile(lambda n: recovers(search, robot, n), tried))
    bad = [n for n in tried if not recovers(search, robot, n)]
    assert found.complete
    assert found.recovered == max(good, default=0) * search.resolution
    assert found.failed == (bad[0] * search.resolution if bad else None)
    if bad:  # known to one resolution
        assert bad[0] == max(good, default=0) + 1
    else:
        assert good[-1] == search.top


@given(robots_of_one_limit())
def test_a_robot_of_one_limit_is_measured_exactly(example):
    """Oracle: all levels from below, one after the other."""
    search, robot = example
    level = 0
    while level < search.top and recovers(search, robot, level + 1):
        level += 1
    found = limit(run(search, robot), search)
    assert found.recovered == level * search.resolution


@given(robots_of_one_limit() | robots_with_pockets())
def test_a_verdict_is_that_of_all_replicas(example):
    """Oracle: the replicas that were not needed any more as well."""
    search, robot = example

    def check(results):
        for level in {level for level, _ in results}:
            good = verdict(results, level, search)
            assert good in (None, recovers(search, robot, level))

    levels, replicas = zip(*run(search, robot, check), strict=True)
    assert set(levels) <= set(range(1, search.top + 1))
    assert set(replicas) <= set(range(search.replicas))


@given(searches(), st.integers(0, 31))
def test_a_clear_limit_costs_a_known_number_of_trials(search, last):
    """Oracle: strides up, halves down, and the replicas of each level."""
    results = run(search, lambda level, _: level <= last)
    passed = {level for (level, _), good in results.items() if good}
    failed = {level for (level, _), good in results.items() if not good}
    enough = 1 + search.replicas - search.required
    assert len(results) == search.required * len(passed) + enough * len(failed)
    march = math.ceil(min(last + 1, search.top) / search.stride)
    halves = math.ceil(math.log2(search.stride))
    assert len(passed | failed) <= march + halves


def test_a_search_by_hand():
    """Falls above level 21: 8, 16, 24 up, then 20, 22, 21, then replicas."""
    results, batches = {}, []
    while batch := next_batch(results, SEARCH):
        batches.append(batch)
        results |= {trial: trial[0] <= 21 for trial in batch}
    assert batches[:-1] == [
        [trial]
        for trial in [
            *((8, 0), (16, 0), (24, 0), (24, 1)),
            *((20, 0), (22, 0), (22, 1), (21, 0)),
        ]
    ]
    assert batches[-1] == [(n, r) for n in (8, 16, 20, 21) for r in (1, 2, 3)]
    assert limit(results, SEARCH) == Limit(21 * 0.02, 22 * 0.02, True)


def test_a_pocket_that_a_replica_finds_is_searched_below():
    """By hand: level 16 of the search above fails in the end."""
    results = {(n, 0): True for n in (8, 16, 20, 21)}
    results |= {(n, r): False for n in (22, 24) for r in (0, 1)}
    results |= {(16, 1): False}
    assert next_batch(results, SEARCH) == [(16, 2)]
    assert limit(results, SEARCH) == Limit(8 * 0.02, 22 * 0.02, False)
    results |= {(16, 2): False}
    assert next_batch(results, SEARCH) == [(12, 0)]
    assert limit(results, SEARCH) == Limit(8 * 0.02, 16 * 0.02, False)


def test_one_fall_in_five_is_bad_luck():
    results = {(8, r): r != 2 for r in range(5)}
    assert verdict(results, 8, SEARCH) is True
    assert verdict(results | {(8, 4): False}, 8, SEARCH) is False
    assert verdict({(8, 0): True, (8, 1): False}, 8, SEARCH) is None
    assert limit(results, SEARCH).recovered == 8 * 0.02


@pytest.mark.parametrize(
    ("replicas", "required"), [(1, 1), (2, 2), (3, 3), (4, 4), (5, 4), (10, 8)]
)
def test_four_in_five_replicas_are_required(replicas, required):
    assert SearchParams(replicas=replicas).required == required


@given(robots_of_one_limit() | robots_with_pockets())
def test_what_is_known_so_far_is_a_limit_too(example):
    """Oracle: its definition; what is complete does not change any more."""
    search, robot = example
    complete = []

    def check(results):
        found = limit(results, search)
        assert all(found == before for before in complete)
        if found.complete:
            complete.append(found)
        level = 0
        for tried in sorted({level for level, _ in results}):
            outcomes = [ok for (n, _), ok in results.items() if n == tried]
            if not (all(outcomes) or sum(outcomes) >= 0.8 * search.replicas):
                break
            level = tried
        assert found.recovered == level * search.resolution
        assert found.failed is None or found.failed > found.recovered

    assert limit({}, search) == Limit(0.0, None, False)
    run(search, robot, check)
    assert complete


@given(robots_of_one_limit() | robots_with_pockets(), st.randoms())
def test_the_order_of_the_results_does_not_matter(example, dice):
    search, robot = example

    def check(results):
        mixed = list(results.items())
        dice.shuffle(mixed)
        assert next_batch(dict(mixed), search) == next_batch(results, search)
        assert limit(dict(mixed), search) == limit(results, search)

    run(search, robot, check)


def test_the_largest_push_is_tried_and_nothing_above():
    """Oracle: 0.3 / 0.1 = 2.9999999999999996 in floating point."""
    search = SearchParams(resolution=0.1, stride=2, replicas=1, largest=0.3)
    assert list(run(search, lambda *_: True)) == [(2, 0), (3, 0)]
    assert SearchParams(resolution=0.1, largest=0.39).top == 3
    assert SearchParams().top == 150


@pytest.mark.parametrize(
    ("field", "value", "rule"),
    [
        ("resolution", 0.0, "must be finite and >= 0.0001 m/s"),
        ("resolution", 1e-309, "must be finite and >= 0.0001 m/s"),
        ("resolution", math.nan, "must be finite and >= 0.0001 m/s"),
        ("resolution", math.inf, "must be finite and >= 0.0001 m/s"),
        ("stride", 0, "must be >= 1"),
        ("replicas", 0, "must be >= 1"),
        ("largest", 0.01, "must be in [resolution = 0.02, 100] m/s"),
        ("largest", 1e308, "must be in [resolution = 0.02, 100] m/s"),
        ("largest", math.nan, "must be in [resolution = 0.02, 100] m/s"),
        ("largest", math.inf, "must be in [resolution = 0.02, 100] m/s"),
    ],
)
def test_refuses_bad_parameters(field, value, rule):
    with pytest.raises(ValueError) as refused:
        SearchParams(**{field: value}).validate()
    assert str(refused.value) == f"{field} = {value}: {rule}"
    SEARCH.validate()
