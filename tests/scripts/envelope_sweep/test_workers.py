"""The same rows wherever they are computed: run_trial here is the oracle.

The cluster is a real one, of two processes on this machine.
"""

import os
import signal

import pytest

from nadia_balance.scripts.envelope_sweep.run import open_workers
from nadia_balance.scripts.envelope_sweep.trial import run_trial
from tests.scripts.envelope_sweep.made_up import PATIENCE, facts, walk_of

TRIALS = [
    ({}, walk_of(replica=replica), ("lipm", ""), delta_v, 120.0)
    for replica, delta_v in ((1, 0.4), (0, 2.5))
]


@pytest.fixture(scope="module")
def local():
    """An executor, its number of workers, and the address of the scheduler."""
    with open_workers(2) as (executor, slots):
        address = executor._client.scheduler.address
        yield executor, slots, address


def test_a_cluster_gives_the_rows_of_this_process(local):
    """Oracle: the rows; by its address, as the processes of this machine."""
    executor, slots, address = local
    expected = [facts(run_trial(*trial)) for trial in TRIALS]
    with open_workers(1, address) as (remote, other_slots):
        assert slots == other_slots == 2
        futures = [remote.submit(run_trial, *trial) for trial in TRIALS]
        assert [facts(f.result(PATIENCE)) for f in futures] == expected


def test_a_trial_survives_the_worker_that_dies(local):
    """Oracle: the row; a real signal ends the first worker that tries."""
    executor, *_ = local
    pid = executor.submit(os.getpid).result(PATIENCE)
    future = executor.submit(run_trial, *TRIALS[0])
    os.kill(pid, signal.SIGKILL)
    assert facts(future.result(PATIENCE)) == facts(run_trial(*TRIALS[0]))
