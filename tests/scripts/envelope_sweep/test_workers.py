"""The same rows wherever they are computed: run_trial here is the oracle.

The cluster is a real one, of two processes on this machine.
"""

import logging
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, CancelledError

import pytest
from distributed import LocalCluster, get_worker

from nadia_balance.scripts.envelope_sweep import workers as module
from nadia_balance.scripts.envelope_sweep.plan import this_code
from nadia_balance.scripts.envelope_sweep.trial import run_trial
from nadia_balance.scripts.envelope_sweep.workers import open_workers, run_task
from tests.scripts.envelope_sweep.made_up import (
    ENDLESS,
    facts,
    stepping_sweep,
    walk_of,
)
from tests.source_files import ROOT

PATIENCE = 60.0  # with a machine that is busy [s]
LONG = (
    walk_of(stepping_sweep(ENDLESS, ", calm_steps: 0")),
    "lipm",
    0.01,
    0.0,
)
TRIALS = [
    (walk_of(replica=replica), "lipm", delta_v, 120.0, PATIENCE)
    for replica, delta_v in ((0, 0.2), (1, 0.4), (0, 2.5))
]


@pytest.fixture(scope="module")
def expected():
    return [facts(run_trial(*trial)) for trial in TRIALS]


def cluster_of(workers: int) -> LocalCluster:
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        dashboard_address="127.0.0.1:0",  # any port that is free
        host="127.0.0.1",
        silence_logs=logging.CRITICAL,
    )


@pytest.fixture(scope="module")
def scheduler():
    with cluster_of(2) as cluster:
        yield cluster.scheduler_address


def submit(workers, *trial):
    return workers.submit(run_task, {}, *trial)


def is_gone(pid: int) -> bool:
    """True soon after it has ended; a zombie has."""
    late = time.monotonic() + PATIENCE
    while time.monotonic() < late:
        try:
            with open(f"/proc/{pid}/stat") as file:
                if file.read().rpartition(")")[2].split()[0] == "Z":
                    return True
        except (FileNotFoundError, ProcessLookupError):
            return True
        time.sleep(0.05)
    return False


def test_processes_of_this_machine_give_the_rows_of_this_one(expected):
    with open_workers(2) as workers:
        futures = [submit(workers, *trial) for trial in TRIALS]
        assert [facts(f.result()) for f in futures] == expected
    assert workers.slots == 2


def test_begins_anew_after_a_process_has_died(expected):
    """Oracle: the row; the process is killed in the middle of a trial."""
    with open_workers(1) as workers:
        pid = workers.submit(os.getpid).result()
        lost = submit(workers, *LONG, 1e6)
        os.kill(pid, signal.SIGKILL)
        with pytest.raises(BrokenExecutor):
            lost.result()
        workers.renew()
        assert facts(submit(workers, *TRIALS[0]).result()) == expected[0]


def test_gives_up_what_runs_when_it_is_left():
    """Oracle: the trial has no end, but the block and the process have."""
    with open_workers(1) as workers:
        pid = workers.submit(os.getpid).result()
        running, waiting = (submit(workers, *LONG, 1e6) for _ in range(2))
        time.sleep(0.5)
        assert not running.done()
    with pytest.raises((BrokenExecutor, CancelledError)):
        running.result()
    with pytest.raises((BrokenExecutor, CancelledError)):
        waiting.result()
    assert is_gone(pid)


def test_a_process_ends_itself_if_a_trial_hangs_for_good():
    """Oracle: a trial that does not look at the clock."""
    with open_workers(1) as workers:
        workers.submit(forget_the_clock).result()
        with pytest.raises(BrokenExecutor):
            submit(workers, *LONG, 0.5).result(PATIENCE)


def forget_the_clock():
    module.GRACE = 0.5
    module.run_trial = lambda *trial: time.sleep(PATIENCE)


def test_a_cluster_gives_the_rows_of_this_process(scheduler, expected):
    with open_workers(1, scheduler) as workers:
        futures = [submit(workers, *trial) for trial in TRIALS]
        assert [facts(f.result()) for f in futures] == expected
        # The same once more: Dask could remember the first.
        again = submit(workers, *TRIALS[0]).result()
        assert facts(again) == expected[0]
        assert again["cpu_s"] != futures[0].result()["cpu_s"]
        with pytest.raises(BrokenExecutor):
            workers.renew()
    assert workers.slots == 2


def test_a_trial_survives_the_worker_that_dies(expected):
    """Oracle: the row; a real signal ends the first worker that tries."""
    with cluster_of(1) as cluster:
        with open_workers(1, cluster.scheduler_address) as workers:
            worker = workers.submit(os.getpid).result()
            future = submit(workers, *TRIALS[0])
            time.sleep(0.2)
            os.kill(worker, signal.SIGKILL)
            assert facts(future.result(PATIENCE)) == expected[0]
            assert workers.submit(os.getpid).result() != worker


def test_gives_up_on_a_cluster_that_loses_its_workers(monkeypatch):
    """Oracle: a task that takes as long as the test waits, or longer."""
    monkeypatch.setattr(module, "NO_WORKERS", 0.5)
    with cluster_of(1) as cluster:
        with open_workers(1, cluster.scheduler_address) as workers:
            future = workers.submit(time.sleep, PATIENCE)
            cluster.scale(0)
            with pytest.raises(CancelledError):
                future.result(PATIENCE)


def test_a_scheduler_that_is_gone_ends_it_without_a_word(monkeypatch):
    """Oracle: the client's own word that it has been closed."""
    monkeypatch.setattr(module, "CONNECT_TIMEOUT", 2.0)
    with cluster_of(1) as cluster:
        with open_workers(1, cluster.scheduler_address) as workers:
            future = workers.submit(time.sleep, PATIENCE)
            cluster.close()
            with pytest.raises(CancelledError):
                future.result(PATIENCE)
            late = time.monotonic() + PATIENCE
            while workers._executor._client.status != "closed":
                assert time.monotonic() < late
                time.sleep(0.05)


def refusal(scheduler: str) -> str:
    """What is said of it, in brackets."""
    with pytest.raises(ValueError) as caught:
        with open_workers(1, scheduler):
            pass
    said = f"scheduler = {scheduler!r}: must be a running Dask scheduler ("
    message = str(caught.value)
    assert message.startswith(said)
    assert "\n" not in message
    return message.removeprefix(said).removesuffix(")")


def test_refuses_what_is_no_address():
    """Oracle: the words of Dask."""
    for address, why in (
        ("", "missing port number in address ''"),
        ("host:port", "invalid literal for int() with base 10: 'port'"),
        ("http://host:1", "unknown address scheme 'http' (known schemes: "),
        ("tls://127.0.0.1:1", "TLS expects a `ssl_context` argument"),
    ):
        assert refusal(address).startswith(why)


def test_refuses_a_scheduler_that_is_not_there(monkeypatch):
    """Oracle: a port at which nobody speaks, and then nobody listens."""
    monkeypatch.setattr(module, "CONNECT_TIMEOUT", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        assert refusal(address) == "no answer for 0.5 s"
    assert refusal(address) == "no answer for 0.5 s"


def test_refuses_a_worker_in_the_place_of_the_scheduler(scheduler):
    with open_workers(1, scheduler) as workers:
        worker = workers.submit(address_of_worker).result()
    assert refusal(worker) == "this is a Worker"


def address_of_worker() -> str:
    return get_worker().address


def test_refuses_a_cluster_without_workers():
    with cluster_of(0) as cluster:
        said = refusal(cluster.scheduler_address)
    assert said == "with workers; it has none"


def test_says_what_to_install(monkeypatch):
    """Oracle: Python's way to say that a module is not there."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    said = refusal("tcp://127.0.0.1:8786")
    assert said == "pip install distributed"


@pytest.fixture
def empty_cluster():
    with cluster_of(0) as cluster:
        yield cluster


def refused_worker(cluster, python: list[str], **env: str) -> str:
    """What is said of a cluster with a worker of this Python."""
    code = "from distributed.cli.dask_worker import main; main()"
    flags = "--nthreads 1 --no-nanny --no-dashboard --death-timeout 60"
    worker = subprocess.Popen(
        [sys.executable, *python, "-c", code, cluster.scheduler_address]
        + flags.split(),
        env=os.environ | env,
        cwd="/",
        stderr=subprocess.DEVNULL,
    )
    try:
        cluster.wait_for_workers(1, timeout=PATIENCE)
        return refusal(cluster.scheduler_address)
    finally:
        worker.kill()
        worker.wait()


def test_refuses_a_worker_with_other_code(empty_cluster, tmp_path):
    """Oracle: a copy of the packages, of which one line is another."""
    for name in ("nadia_balance", "diagrams", "models", "scripts"):
        shutil.copytree(ROOT / name, tmp_path / name)
    with (tmp_path / "nadia_balance/results/summary.py").open("a") as file:
        file.write("ICP_BACK = 0.5\n")
    said = refused_worker(empty_cluster, [], PYTHONPATH=str(tmp_path))
    match = re.fullmatch(r"worker tcp://\S+: code (\w+), not (\w+)", said)
    assert match[2] == this_code()["code"] != match[1]
