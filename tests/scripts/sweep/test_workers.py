"""The same rows wherever they are computed: run_trial here is the oracle.

The cluster is a real one, of a process on this machine.
"""

import os
import signal

import pytest

from nadia_balance.scripts.sweep.trial import open_workers, run_trial
from tests.scripts.sweep.made_up import PATIENCE, cell_to, facts, stepping_sweep


@pytest.fixture(scope="module")
def expected():
    """Trials, and what is in their rows."""
    sweep, cell = stepping_sweep(), cell_to(120.0)
    trials = (sweep, cell, 0.4, 1), (sweep, cell, 2.5, 0)
    return [(trial, facts(run_trial(*trial))) for trial in trials]


@pytest.fixture(scope="module")
def local():
    """An executor, and the address of its scheduler."""
    with open_workers(1) as executor:
        yield executor, executor._client.scheduler.address


def test_a_cluster_gives_the_rows_of_this_process(local, expected):
    """Oracle: the rows; by its address, as the processes of this machine."""
    _, address = local
    with open_workers(1, address) as remote:
        futures = [remote.submit(run_trial, *trial) for trial, _ in expected]
        rows = [facts(future.result(PATIENCE)) for future in futures]
    assert rows == [row for _, row in expected]


def test_a_trial_survives_the_worker_that_dies(local, expected):
    """Oracle: the row; a real signal ends the first worker that tries."""
    (executor, _), ((trial, row), _) = local, expected
    pid = executor.submit(os.getpid).result(PATIENCE)
    future = executor.submit(run_trial, *trial)
    os.kill(pid, signal.SIGKILL)
    assert facts(future.result(PATIENCE)) == row
