"""What is simulated, and what becomes of it: one whole run is the oracle."""

import functools
import os
import signal

import numpy as np
import pytest
from distributed import LocalCluster

from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.sweep import run_trial
from nadia_balance.sweep.search import Sweep
from nadia_balance.sweep.trials import FROM_SUMMARY, Cell
from tests.diagrams import simulated
from tests.sweep.made_up import PATIENCE, cell_to, stepping_sweep

CELL = cell_to(120.0)


@pytest.fixture(autouse=True)
def no_walk_of_another_test():
    run_trial._walked.cache_clear()


def tried(sweep, delta_v, cell=CELL, replica=0):
    """The row of one trial."""
    return run_trial.run_trial(sweep, cell, delta_v, replica)


def judged(sweep, delta_v, cell=CELL, replica=0):
    """The run of that push from start to end, and its summary."""
    scenario = sweep.walk(cell, replica)
    scenario = scenario.with_push(cell.direction_deg, delta_v)
    run = simulated.run_of(scenario, sweep.plant)
    return run, run.summary


def standing(text, plant):
    """A sweep of who only stands, and its cell, forward."""
    scenario = load_scenario("push_standing", text=text)
    cell = Cell("s", scenario.pushes[0].at, scenario.mechanisms, 0.0)
    return Sweep(scenarios={"s": scenario}, plant=plant), cell


def test_a_row_does_not_depend_on_what_was_tried_before():
    """Oracle: each of them from its own start to its own end.

    One walk for all; the run is too short to end before its time.
    """
    sweep = stepping_sweep()
    sizes = [(0.1, 0.0), (0.45, 90.0), (2.5, 200.0)]
    for i in (2, 0, 1, 1):
        push = sizes[i][0], cell_to(sizes[i][1]), 1
        row, (_, summary) = tried(sweep, *push), judged(sweep, *push)
        assert (row["outcome"] == "recovered") is summary["recovered"]
        for name in FROM_SUMMARY:
            assert row[name] == summary[name], name


def test_the_robot_itself_gives_the_bits_of_one_run():
    """Oracle: as above, of the whole robot, which is pushed at a time."""
    text = "{duration: 0.5, pushes: [{delta_v: 0, at: 0.1 s}]}"
    sweep, cell = standing(text, "humanoid")
    cell = cell._replace(direction_deg=30.0)
    _, summary = judged(sweep, 0.2, cell)
    row = tried(sweep, 0.2, cell)
    assert row["max_icp_error_m"] == summary["max_icp_error_m"] > 0.01
    assert row["max_torque_ratio"] == summary["max_torque_ratio"]


def test_an_error_is_a_row_like_any_other(monkeypatch):
    """Oracle: Python's own words."""
    monkeypatch.setattr(run_trial, "RecoveryWatch", {}.__getitem__)
    row = tried(stepping_sweep(0.1), 0.3)
    assert row["outcome"] == "error"
    assert row["reason"].startswith("KeyError: <")


# What the capture regions foretell, beside what becomes of it.


@pytest.mark.parametrize(
    ("mechanisms", "told"),
    [("all_with_cross_over", ("recovered", 1)), ("icp_only", ("fell", -1))],
)
def test_what_becomes_of_a_push_is_foretold(mechanisms, told):
    """Oracle: the run; it steps away from the stance foot."""
    row = tried(stepping_sweep(5.0), 0.7, cell_to(270.0, mechanisms))
    assert (row["outcome"], row["predicted_at_push"]) == told


def test_a_push_on_who_only_stands_is_captured_by_the_feet_or_not_at_all():
    """Oracle: the ICP, v / omega ahead of the middle; the toes at 0.105 m."""
    sweep, cell = standing("{duration: 1.3}", "lipm")
    for delta_v, expected in (0.2, 0), (1.0, -1):
        run, _ = judged(sweep, delta_v, cell)
        assert (np.max(run.logs["icp"][:, 0]) < 0.105) == (expected == 0)
        row = tried(sweep, delta_v, cell)
        assert row["predicted_at_push"] == expected


def test_workers_give_the_rows_of_this_process_even_if_one_dies(monkeypatch):
    """Oracle: run_trial here.  The cluster is a real one, of this machine.

    It has an address, too.  A real signal ends who is first at the last trial.
    One that is silent, as after the sleep of a laptop, is not dead: by Dask's
    own setting.
    """
    cluster = functools.partial(  # a sweep may have Dask's own port
        LocalCluster, scheduler_kwargs={"dashboard_address": "127.0.0.1:0"}
    )
    monkeypatch.setattr(run_trial.distributed, "LocalCluster", cluster)
    sweep, cell = stepping_sweep(2.0), cell_to(120.0)
    trials = (sweep, cell, 0.4, 1), (sweep, cell, 2.5, 0)
    make = run_trial.run_trial
    expected = [make(*trial) for trial in trials]
    with run_trial.open_workers(1) as executor:
        address = executor._client.scheduler.address
        assert executor._client.cluster.scheduler.worker_ttl is None
        with run_trial.open_workers(1, address) as remote:
            futures = [remote.submit(make, *trial) for trial in trials]
            rows = [future.result(PATIENCE) for future in futures]
        pid = executor.submit(os.getpid).result(PATIENCE)
        future = executor.submit(make, *trials[0])
        os.kill(pid, signal.SIGKILL)
        again = future.result(PATIENCE)
    assert [*rows, again] == [*expected, expected[0]]
