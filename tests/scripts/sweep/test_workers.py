"""The same rows wherever they are computed: run_trial here is the oracle.

The cluster is a real one, of two processes on this machine.
"""

import os
import signal

import pytest

from nadia_balance.scripts.sweep.trial import open_workers, run_trial
from tests.scripts.sweep.made_up import PATIENCE, cell_to, facts, stepping_sweep

TRIALS = [
    (stepping_sweep(), cell_to(120.0), delta_v, replica)
    for delta_v, replica in ((0.4, 1), (2.5, 0))
]


@pytest.fixture(scope="module")
def local():
    """An executor, and the address of its scheduler."""
    with open_workers(2) as executor:
        yield executor, executor._client.scheduler.address


def test_a_cluster_gives_the_rows_of_this_process(local):
    """Oracle: the rows; by its address, as the processes of this machine."""
    _, address = local
    expected = [facts(run_trial(*trial)) for trial in TRIALS]
    with open_workers(1, address) as remote:
        futures = [remote.submit(run_trial, *trial) for trial in TRIALS]
        assert [facts(f.result(PATIENCE)) for f in futures] == expected


def test_a_trial_survives_the_worker_that_dies(local):
    """Oracle: the row; a real signal ends the first worker that tries."""
    executor, _ = local
    pid = executor.submit(os.getpid).result(PATIENCE)
    future = executor.submit(run_trial, *TRIALS[0])
    os.kill(pid, signal.SIGKILL)
    assert facts(future.result(PATIENCE)) == facts(run_trial(*TRIALS[0]))
