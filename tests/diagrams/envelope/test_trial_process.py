"""A child that dies or hangs costs its own row, and no other."""

import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from diagrams.envelope import trial_process
from diagrams.envelope.trial import run_trial
from diagrams.envelope.trial_process import TrialProcess, run_in_process
from tests.diagrams.envelope.quick_trials import (
    ENDLESS,
    facts,
    stepping,
    text_of,
    trial,
)

PATIENCE = 60.0  # with a machine that is busy [s]
QUICK = text_of(trial())
LONG = text_of(trial(base=stepping(ENDLESS)))


@pytest.fixture
def process():
    process = TrialProcess()
    yield process
    process.close()


@pytest.fixture(scope="module")
def expected():
    """The row of this very process."""
    return facts(run_trial(trial(), "lipm"))


def run_long(process, then):
    """Runs a trial without end, and does `then` in its midst."""
    process.run(QUICK, "lipm", PATIENCE, {})  # the child has started
    with ThreadPoolExecutor(1) as thread:
        future = thread.submit(process.run, LONG, "lipm", PATIENCE, {})
        time.sleep(0.3)
        assert not future.done()
        then()
        return future.result()


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGKILL])
def test_a_child_that_a_signal_kills_is_a_row_and_the_next_one_works(
    process, expected, number
):
    """Oracle: a real signal; the trial after it, in this process."""
    row = run_long(process, lambda: os.kill(process.pid, number))
    assert (row["outcome"], row["reason"]) == ("crashed", number.name)
    assert set(expected) < set(row)
    assert facts(process.run(QUICK, "lipm", PATIENCE, {})) == expected


def test_one_that_dies_between_two_trials_costs_no_row(process, expected):
    process.run(QUICK, "lipm", PATIENCE, {})
    dead = process.pid
    os.kill(dead, signal.SIGKILL)
    os.waitid(os.P_PID, dead, os.WEXITED | os.WNOWAIT)
    assert facts(process.run(QUICK, "lipm", PATIENCE, {})) == expected
    assert process.pid != dead


def test_a_trial_of_another_sweep_is_no_row(process, expected):
    """Oracle: the child is as good as ever."""
    with pytest.raises(RuntimeError, match=r"^code = \w+: must be x, as when"):
        process.run(QUICK, "lipm", PATIENCE, {"code": "x"})
    first = process.pid
    assert facts(process.run(QUICK, "lipm", PATIENCE, {})) == expected
    assert process.pid == first


def test_a_trial_that_takes_too_long_is_hung_and_its_child_gone(
    process, expected
):
    """Oracle: the system knows no such process any more."""
    process.run(QUICK, "lipm", PATIENCE, {})
    late = process.pid
    row = process.run(LONG, "lipm", 0.2, {})
    told = ("hung", "no result after 0.2 s")
    assert (row["outcome"], row["reason"]) == told
    with pytest.raises(ProcessLookupError):
        os.kill(late, 0)
    assert facts(process.run(QUICK, "lipm", PATIENCE, {})) == expected


def test_one_that_stands_still_is_hung_too(process):
    """Oracle: a process that is stopped does nothing, not even end."""
    process.run(QUICK, "lipm", PATIENCE, {})
    os.kill(process.pid, signal.SIGSTOP)
    assert process.run(QUICK, "lipm", 0.2, {})["outcome"] == "hung"


def test_keeps_its_child_but_not_forever(process, monkeypatch):
    """Oracle: the number of the process changes after so many trials."""
    monkeypatch.setattr(trial_process, "TRIALS_PER_CHILD", 2)
    assert process.pid is None
    pids = []
    for _ in range(5):
        process.run(QUICK, "lipm", PATIENCE, {})
        pids.append(process.pid)
    assert pids[0] == pids[1] != pids[2] == pids[3] != pids[4]


def test_can_be_killed_by_another_thread_and_then_runs_no_more(process):
    """Oracle: the row of a child that was killed; no new child."""
    row = run_long(process, process.kill)
    assert (row["outcome"], row["reason"]) == ("crashed", "SIGKILL")
    with pytest.raises(RuntimeError, match="has been closed"):
        process.run(QUICK, "lipm", PATIENCE, {})


def test_every_thread_has_a_child_of_its_own(expected, monkeypatch):
    """Oracle: the pids; what is to be closed at exit is closed here."""
    closes = []
    monkeypatch.setattr(trial_process.atexit, "register", closes.append)
    both = threading.Barrier(2)

    def twice(_):
        rows = []
        for _ in range(2):
            both.wait()
            rows.append(facts(run_in_process(QUICK, "lipm", PATIENCE, {})))
        assert rows == [expected] * 2
        return trial_process._this_thread.process

    with ThreadPoolExecutor(2) as threads:
        processes = list(threads.map(twice, range(2)))
    pids = [process.pid for process in processes]
    assert pids[0] != pids[1]
    assert len(closes) == 2
    for close in closes:
        close()
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
