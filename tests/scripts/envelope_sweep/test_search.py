"""The search for the largest push, and the agenda of many searches.

Oracle: every replica of every level, tried one by one.
"""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.bounds import check
from nadia_balance.scripts.envelope_sweep.search import (
    TYPICAL,
    Agenda,
    Cell,
    Limit,
    SearchParams,
    Situation,
    Trial,
    limit,
    next_batch,
    trials_left,
)
from tests.scripts.envelope_sweep.made_up import AT

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


def run(search, robot, look=lambda results: None):
    """All results; `look` sees those that are there after each trial."""
    results = {}
    while batch := next_batch(results, search):
        assert len(set(batch)) == len(batch)
        assert not set(batch) & set(results), "a trial is repeated"
        for trial in batch:
            results[trial] = robot(*trial)
            look(results)
    return results


def recovers(search, robot, level):
    """True if four in five of all replicas recover, tried or not."""
    outcomes = [robot(level, replica) for replica in range(search.replicas)]
    return sum(outcomes) >= 0.8 * search.replicas


@given(robots_of_one_limit() | robots_with_pockets())
def test_the_limit_is_what_the_protocol_says(example):
    """Oracle: replicas count at the limit and one tried level below it.

    Of all others below, those that were tried recovered, every one of them.
    """
    search, robot = example
    results = run(search, robot)
    found = limit(results, search)
    tried = sorted({level for level, _ in results})
    at_limit = round(found.recovered / search.resolution)
    below = [level for level in tried if level <= at_limit]
    assert found.complete
    for level in below[-2:]:
        assert recovers(search, robot, level)
    for level in below[:-2]:
        assert recovers(search, robot, level) or all(
            good for (n, _), good in results.items() if n == level
        )
    failed = [level for level in tried if level > at_limit]
    if failed:  # known to one resolution
        assert found.failed == (at_limit + 1) * search.resolution
        assert not recovers(search, robot, at_limit + 1)
    else:
        assert (found.failed, at_limit) == (None, search.top)


@given(searches(), st.integers(0, 31))
def test_a_clear_limit_costs_a_known_number_of_trials(search, last):
    """Oracle: strides up, halves down, replicas at two levels and at falls."""
    results = run(search, lambda level, _: level <= last)
    passed = {level for (level, _), good in results.items() if good}
    failed = {level for (level, _), good in results.items() if not good}
    enough = 1 + search.replicas - search.required
    confirmed = min(len(passed), 2) * (search.required - 1)
    assert len(results) == len(passed) + confirmed + enough * len(failed)
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
    assert batches[-1] == [(n, r) for n in (20, 21) for r in (1, 2, 3)]
    assert limit(results, SEARCH) == Limit(21 * 0.02, 22 * 0.02, True)


@pytest.mark.parametrize(
    ("first", "levels"),
    [
        # From 8 below: one stride up, then halves.
        (14, [14, 22, 18, 20, 21]),
        # Too high: halves from zero.
        (30, [30, 15, 22, 18, 20, 21]),
        # Lower than the first stride.
        (-5, [8, 16, 24, 20, 22, 21]),
    ],
)
def test_a_search_may_begin_where_the_limit_was_known(first, levels):
    """Oracle: by hand; it falls above level 21, and ends where others do."""
    results, tried = {}, []
    while batch := next_batch(results, SEARCH, first):
        tried += [level for level, replica in batch if replica == 0]
        results |= {trial: trial[0] <= 21 for trial in batch}
    assert tried == levels
    assert limit(results, SEARCH) == Limit(21 * 0.02, 22 * 0.02, True)


def test_a_pocket_that_a_replica_finds_is_searched_below():
    """By hand: level 20 of the search above fails in the end."""
    results = {(n, 0): True for n in (8, 16, 20, 21)}
    results |= {(n, r): False for n in (22, 24) for r in (0, 1)}
    results |= {(20, 1): False}
    assert next_batch(results, SEARCH) == [(20, 2)]
    assert limit(results, SEARCH) == Limit(16 * 0.02, 22 * 0.02, False)
    results |= {(20, 2): False}
    assert next_batch(results, SEARCH) == [(18, 0)]
    assert limit(results, SEARCH) == Limit(16 * 0.02, 20 * 0.02, False)
    results |= {(18, r): False for r in (0, 1)} | {(17, 0): True}
    assert next_batch(results, SEARCH) == [
        (n, r) for n in (16, 17) for r in (1, 2, 3)
    ]


def test_one_fall_in_five_is_bad_luck():
    required = [SearchParams(replicas=n).required for n in (1, 2, 3, 4, 5, 10)]
    assert required == [1, 2, 3, 4, 4, 8]
    results = {(8, r): r != 2 for r in range(5)}
    assert limit(results, SEARCH) == Limit(8 * 0.02, None, False)
    results |= {(8, 4): False}
    assert limit(results, SEARCH) == Limit(0.0, 8 * 0.02, False)
    assert next_batch({(8, 0): True, (8, 1): False}, SEARCH) == [(8, 2)]


@given(robots_of_one_limit() | robots_with_pockets())
def test_what_is_known_so_far_is_a_limit_too(example):
    """Oracle: its definition; what is complete does not change any more."""
    search, robot = example
    complete = []

    def look(results):
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
    run(search, robot, look)
    assert complete


def test_the_largest_push_is_tried_and_nothing_above():
    """Oracle: 0.3 / 0.1 = 2.9999999999999996 in floating point."""
    search = SearchParams(resolution=0.1, stride=2, replicas=1, largest=0.3)
    assert list(run(search, lambda *_: True)) == [(2, 0), (3, 0)]
    assert SearchParams(resolution=0.1, largest=0.39).top == 3
    assert SearchParams().top == 150


@pytest.mark.parametrize(
    ("field", "value", "rule"),
    [
        ("resolution", 1e-309, "must be >= 0.0001 m/s"),
        ("resolution", math.nan, "must be finite and >= 0.0001 m/s"),
        ("stride", 0, "must be in [1, 1000]"),
        ("replicas", 0, "must be in [1, 1000]"),
        ("largest", 0.01, "must be in [resolution = 0.02, 100] m/s"),
        ("largest", 1e3, "must be in [resolution = 0.02, 100] m/s"),
    ],
)
def test_refuses_bad_parameters(field, value, rule):
    with pytest.raises(ValueError) as refused:
        check(SearchParams(**{field: value}))
    assert str(refused.value) == f"{field} = {value}: {rule}"
    check(SEARCH)


SEARCHES = [
    SearchParams(),
    SearchParams(resolution=0.1, stride=4, replicas=1),
    SearchParams(resolution=0.05, stride=1, replicas=3, largest=0.4),
]


@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("last", [0.0, 0.37, TYPICAL + 1e-9, 5.0])
def test_what_is_left_is_foreseen(search, last):
    """Oracle: the search itself, played to its end with that limit.

    Right at the end, and from the start on if the limit is the typical one.
    """
    results, said = {}, []
    while batch := next_batch(results, search):
        said.append(len(results) + trials_left(results, search))
        assert said[-1] > len(results)
        for level, replica in batch:
            results[level, replica] = level * search.resolution <= last
    assert trials_left(results, search) == 0
    if last == TYPICAL + 1e-9:
        assert said[0] == len(results)


COARSE = SearchParams(resolution=0.1, stride=3, replicas=3, largest=1.5)
CELLS = [Cell("step", AT, 30.0 * i) for i in range(4)]
RUGGED = 0.15  # so often does a trial not go as its cell's limit says


def goes_well(trial: Trial) -> bool:
    """Rugged, but always the same for the same trial."""
    luck = random.Random(repr(trial)).random()
    limit = 3 + trial.cell.direction_deg / 10.0
    return (trial.level <= limit) != (luck < RUGGED)


def one_by_one() -> set[Trial]:
    """The oracle: each cell's search alone, by the definition."""
    trials = set()
    for cell in CELLS:
        results = {}
        while batch := next_batch(results, COARSE):
            for level, replica in batch:
                trial = Trial(cell=cell, level=level, replica=replica)
                results[level, replica] = goes_well(trial)
                trials.add(trial)
    return trials


def play(agenda, slots, rng, most=10_000) -> list[Trial]:
    """Runs up to `most` trials, which end in a random order."""
    running, done = [], []
    while len(done) < most:
        while len(running) < slots and (trial := agenda.pop()):
            running.append(trial)
        if not running:
            break
        trial = running.pop(rng.randrange(len(running)))
        agenda.record(trial, goes_well(trial))
        done.append(trial)
    return done


@given(slots=st.integers(1, 12), seed=st.integers(0, 100))
def test_the_trials_are_the_same_whatever_ends_first(slots, seed):
    done = play(Agenda(CELLS, COARSE), slots, random.Random(seed))
    assert len(done) == len(set(done))
    assert set(done) == one_by_one()


@given(
    slots=st.integers(1, 12),
    seed=st.integers(0, 100),
    most=st.integers(0, 70),
)
def test_goes_on_after_an_end_at_any_time(slots, seed, most):
    """Trials that ran when it ended are lost, and made again."""
    rng = random.Random(seed)
    first = play(Agenda(CELLS, COARSE), slots, rng, most)
    rng.shuffle(first)
    known = [(trial, goes_well(trial)) for trial in first]
    rest = play(Agenda(CELLS, COARSE, known), slots, rng)
    assert not set(first) & set(rest)
    assert {*first, *rest} == one_by_one()


def test_one_moment_comes_after_the_other():
    """Oracle: one trial at a time; all but two have the same way to go."""
    later = Cell("step", Situation("push", "left swing 5 %"), 0.0)
    agenda, done = Agenda([*CELLS[:2], later], COARSE), []
    while trial := agenda.pop():
        agenda.record(trial, trial.level <= 3)
        done.append(trial.cell.situation.at)
    assert done == sorted(done, key=[AT.at, later.situation.at].index)


def test_the_count_ends_where_the_total_is():
    agenda = Agenda(CELLS, COARSE)
    before = agenda.progress()
    assert (before.done, before.complete, before.cells) == (0, 0, 4)
    assert before.total > 0
    number = 0
    while trial := agenda.pop():
        agenda.record(trial, goes_well(trial))
        number += 1
        now = agenda.progress()
        assert now.done == number
        assert now.total >= now.done + (now.complete < now.cells)
    after = agenda.progress()
    assert after.total == after.done == len(one_by_one())
    assert after.complete == after.cells


@pytest.mark.parametrize(
    ("results", "expected"),
    [
        ({(8, 0): None, (4, 0): None}, None),
        ({(8, 0): True, (16, 0): None}, (8, None)),
        ({(8, 0): True, (16, 0): None, (9, 0): False}, (8, 9)),
    ],
)
def test_undecided_trials_give_no_limit_and_no_failure(results, expected):
    """Oracle: by hand, with one replica and levels of 0.1 m/s."""
    search = SearchParams(resolution=0.1, replicas=1)
    found = limit(results, search)
    if expected is None:
        assert found is None
    else:
        recovered, failed = expected
        assert found.recovered == pytest.approx(0.1 * recovered)
        assert found.failed == (failed and pytest.approx(0.1 * failed))
    assert (8, 0) not in next_batch(results, search)
    assert all(level < 16 for level, _ in next_batch(results, search))
