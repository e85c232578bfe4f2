"""The agenda makes the trials of the search, each once, in a good order."""

import random

from hypothesis import given
from hypothesis import strategies as st

from diagrams.envelope.agenda import Agenda
from diagrams.envelope.limit_search import SearchParams, next_batch
from diagrams.envelope.moment import Moment
from diagrams.envelope.sweep_plan import Cell, Trial

SEARCH = SearchParams(resolution=0.1, stride=3, replicas=3, largest=1.5)
MOMENT = Moment("swing", "right", 0.25)
CELLS = [Cell("step", MOMENT, 30.0 * i) for i in range(4)]
RUGGED = 0.15  # so often does a trial not go as its cell's limit says


def recovers(trial: Trial) -> bool:
    """Rugged, but always the same for the same trial."""
    luck = random.Random(repr(trial)).random()
    limit = 3 + trial.cell.direction_deg / 10.0
    return (trial.level <= limit) != (luck < RUGGED)


def one_by_one() -> set[Trial]:
    """The oracle: each cell's search alone, by the definition."""
    trials = set()
    for cell in CELLS:
        results = {}
        while batch := next_batch(results, SEARCH):
            for level, replica in batch:
                trial = Trial(cell=cell, level=level, replica=replica)
                results[level, replica] = recovers(trial)
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
        agenda.record(trial, recovers(trial))
        done.append(trial)
    return done


@given(slots=st.integers(1, 12), seed=st.integers(0, 100))
def test_the_trials_are_the_same_whatever_ends_first(slots, seed):
    done = play(Agenda(CELLS, SEARCH), slots, random.Random(seed))
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
    first = play(Agenda(CELLS, SEARCH), slots, rng, most)
    rng.shuffle(first)
    known = [(trial, recovers(trial)) for trial in first]
    rest = play(Agenda(CELLS, SEARCH, known), slots, rng)
    assert not set(first) & set(rest)
    assert {*first, *rest} == one_by_one()


def test_first_replicas_of_all_cells_come_before_any_other():
    """Oracle: one trial at a time; limits without a rough edge."""
    agenda, done = Agenda(CELLS, SEARCH), []
    while trial := agenda.pop():
        agenda.record(trial, trial.level <= 3)
        done.append(trial)
    replicas = [min(trial.replica, 1) for trial in done]
    assert replicas == sorted(replicas)
    assert {trial.cell for trial in done[: len(CELLS)]} == set(CELLS)


def test_ignores_trials_of_other_cells():
    other = Trial(cell=Cell("step", MOMENT, 1.0), level=3, replica=0)
    agenda = Agenda(CELLS, SEARCH, [(other, True)])
    assert agenda.progress().done == 0
    assert agenda.progress().cells == len(CELLS)


def test_the_count_ends_where_the_total_is():
    agenda = Agenda(CELLS, SEARCH)
    before = agenda.progress()
    assert (before.done, before.complete, before.cells) == (0, 0, 4)
    assert before.total > 0
    number = 0
    while trial := agenda.pop():
        agenda.record(trial, recovers(trial))
        number += 1
        now = agenda.progress()
        assert now.done == number
        assert now.total >= now.done + (now.complete < now.cells)
    after = agenda.progress()
    assert after.total == after.done == len(one_by_one())
    assert after.complete == after.cells


def test_counts_what_was_done_before():
    trials = [(trial, recovers(trial)) for trial in one_by_one()]
    agenda = Agenda(CELLS, SEARCH, trials)
    assert agenda.pop() is None
    assert agenda.progress().complete == len(CELLS)
    assert agenda.progress().total == agenda.progress().done == len(trials)
