"""A sweep on a Dask cluster whose workers are programs of their own."""

import contextlib
import os
import signal
import time

import pytest
from distributed import Client

from nadia_balance.sweep import run_trial
from nadia_balance.sweep.search import SearchParams
from nadia_balance.sweep.trials import Rows
from tests.scripts.running import python
from tests.sweep.made_up import PATIENCE, stepping_sweep

LOOPBACK = "127.0.0.1"


@pytest.fixture
def cluster(tmp_path):
    """The address of a scheduler, and the pids of its two workers.

    They have no nanny: nobody starts another one in the place of a dead one.
    """
    file, programs = tmp_path / "scheduler.json", []
    common = ["--scheduler-file", file]
    with contextlib.ExitStack() as ended:
        for argv in (
            ["scheduler", "--host", LOOPBACK, "--port", "0", "--no-dashboard"],
            ["worker", "--no-nanny", "--nthreads", "1", "--no-dashboard"],
            ["worker", "--no-nanny", "--nthreads", "1", "--no-dashboard"],
        ):
            with open(tmp_path / f"{len(programs)}.log", "w") as log:
                program = python(
                    *("-m", "distributed.cli.dask_" + argv[0]),
                    *(argv[1:] + common),
                    stdout=log,
                    stderr=log,
                    cwd=tmp_path,
                )
            ended.callback(program.wait)
            ended.callback(program.kill)
            programs.append(program)
        late = time.monotonic() + PATIENCE
        while not file.exists():
            assert time.monotonic() < late
            time.sleep(0.05)
        with Client(scheduler_file=str(file), set_as_default=False) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
            address = client.scheduler.address
        yield address, [program.pid for program in programs[1:]]


def swept(sweep, folder, executor, stopped=lambda: False):
    """The rows of a sweep."""
    folder.mkdir()
    with Rows.opened(folder, sweep.identity()) as rows:
        assert run_trial.run_sweep(sweep, rows, executor, stopped)
    return (folder / "trials.csv").read_bytes()


def test_nothing_is_lost_if_a_worker_elsewhere_is_killed(cluster, tmp_path):
    """Oracle: the file of the same sweep in this process, bit for bit.

    A worker is killed once the first row is there, as it works at a cell: the
    other one makes that cell's trials, and all later ones.
    """
    address, (victim, _) = cluster
    sweep = stepping_sweep(2.0)
    sweep.directions = (0.0, 90.0, 180.0, 270.0)
    sweep.mechanisms = ("icp_only", "step")
    sweep.search = SearchParams(resolution=0.1, stride=4, replicas=1)
    killed = []

    def kill_once():
        rows = Rows.read(tmp_path / "there").all
        if rows and not killed:
            os.kill(victim, signal.SIGKILL)
            killed.append(len(rows))
        return False

    with run_trial.open_workers(1, address) as executor:
        there = swept(sweep, tmp_path / "there", executor, kill_once)
    expected = []
    for cell in sweep.cells():
        expected += run_trial.search(sweep, sweep.identity(), cell, {})
    with Rows.opened(tmp_path, sweep.identity()) as rows:
        for row in expected:
            rows.add(row)
    assert there == (tmp_path / "trials.csv").read_bytes()
    assert 0 < killed[0] < len(expected)
