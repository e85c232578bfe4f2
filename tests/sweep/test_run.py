"""A sweep makes each of its trials once, whatever happens meanwhile."""

import contextlib
import time
from concurrent.futures import Future

import pytest

from nadia_balance.sweep import run_trial
from nadia_balance.sweep.trials import Rows
from tests.sweep import made_up


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Runs the sweep on a made-up robot; returns its rows, and if all."""

    def run(robot=None, **more):
        robot = robot or made_up.MadeUpRobot()
        monkeypatch.setattr(run_trial, "run_trial", robot.trial)
        monkeypatch.setattr(run_trial, "of_process", lambda *_: {})
        sweep = made_up.made_up_sweep()
        with (
            Rows.opened(tmp_path, made_up.identity_of()) as rows,
            contextlib.ExitStack() as later,
        ):
            # What is abandoned must not go on in another test.
            later.callback(robot.threads.shutdown, cancel_futures=True)
            done = run_trial.run_sweep(sweep, rows, robot, **more)
        return Rows.read(tmp_path).all, done

    return run


@pytest.mark.parametrize("workers", [1, 7])
def test_the_rows_do_not_depend_on_how_many_work(run, workers):
    """Oracle: the search of each cell, trial by trial; none is repeated."""
    robot = made_up.MadeUpRobot(workers)
    rows, done = run(robot)
    assert done
    of_a_trial = "mechanisms", "direction_deg", "delta_v", "replica"
    tried = [tuple(row[name] for name in of_a_trial) for row in rows]
    assert tried == sorted(robot.tried)
    assert len(tried) == len(set(tried)) == 51
    largest = {}
    for row in rows:
        if row["outcome"] == "recovered":
            cell = row["mechanisms"], row["direction_deg"]
            largest[cell] = max(largest.get(cell, 0.0), row["delta_v"])
    for cell, delta_v in largest.items():
        assert 0.0 <= made_up.largest(*cell) - delta_v < 0.1 + made_up.WEAKER


def test_goes_on_where_it_was_stopped(run):
    """Oracle: the trials that were made; cells that have ended are kept."""
    robot, late = made_up.MadeUpRobot(1), time.monotonic() + made_up.PATIENCE

    def stop_after_two():
        return len({t[:2] for t in robot.tried}) > 2 or time.monotonic() > late

    rows, done = run(robot, stopped=stop_after_two)
    assert not done and rows
    again = made_up.MadeUpRobot()
    whole, done = run(again)
    assert done and len(whole) == len(rows) + len(again.tried)
    assert [row for row in whole if row in rows] == rows


def test_what_has_been_made_is_kept_when_a_worker_fails():
    """Oracle: the rows of twenty tasks that ended with one that failed."""

    class Kept(list):
        add = list.append

    tasks, rows = [Future() for _ in range(21)], Kept()
    for i, task in enumerate(tasks[1:]):
        task.set_result([{"number": i}])
    tasks[0].set_exception(OSError("full"))
    with pytest.raises(RuntimeError, match="a worker failed: OSError: full"):
        run_trial.collect(set(tasks), rows, lambda: False, unit="limit")
    assert sorted(row["number"] for row in rows) == [*range(20)]


def test_ends_when_the_workers_fail(run):
    """No row is made up for what was not tried: it can go on later."""

    def spoil(cell):
        if cell.mechanisms == "step":
            raise OSError("full")

    with pytest.raises(RuntimeError, match="a worker failed: OSError: full"):
        run(made_up.MadeUpRobot(1, spoil=spoil))
    rows, done = run()
    assert done and len(rows) == 51
