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
from concurrent.futures import CancelledError

import pytest
from distributed import LocalCluster, get_worker

from diagrams.envelope import executors
from diagrams.envelope.executors import open_executor
from diagrams.envelope.fingerprints import this_code
from diagrams.envelope.trial import run_trial
from diagrams.envelope.trial_process import run_in_process
from tests.diagrams.envelope.quick_trials import (
    ENDLESS,
    facts,
    stepping,
    text_of,
    trial,
)
from tests.source_files import ROOT

PATIENCE = 60.0  # with a machine that is busy [s]
LONG = text_of(trial(base=stepping(ENDLESS)))
SCENARIOS = [trial(0.2), trial(0.4, replica=1), trial(2.5)]


@pytest.fixture(scope="module")
def expected():
    return [facts(run_trial(scenario, "lipm")) for scenario in SCENARIOS]


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


def submit(executor, text):
    return executor.submit(run_in_process, text, "lipm", PATIENCE, {})


@pytest.mark.parametrize("workers", [1, 2])
def test_threads_of_this_machine_give_the_rows_of_this_process(
    workers, expected
):
    with open_executor(workers) as (executor, slots):
        futures = [submit(executor, text_of(s)) for s in SCENARIOS]
        assert [facts(f.result()) for f in futures] == expected
    assert slots == workers


def test_a_cluster_gives_the_rows_of_this_process(scheduler, expected):
    with open_executor(1, scheduler) as (executor, slots):
        futures = [submit(executor, text_of(s)) for s in SCENARIOS]
        assert [facts(f.result()) for f in futures] == expected
    assert slots == 2


def test_runs_the_same_trial_again_if_it_is_asked_to(scheduler):
    """Oracle: another processor time; Dask could remember the first."""
    with open_executor(1, scheduler) as (executor, _):
        first, second = (
            submit(executor, text_of(trial())).result() for _ in range(2)
        )
    assert facts(first) == facts(second)
    assert first["cpu_s"] != second["cpu_s"]


def test_a_trial_survives_the_worker_that_dies(expected):
    """Oracle: the row; a real signal ends the first worker that tries."""
    with cluster_of(1) as cluster:
        with open_executor(1, cluster.scheduler_address) as (executor, _):
            worker = executor.submit(os.getpid).result()
            future = submit(executor, text_of(SCENARIOS[0]))
            time.sleep(0.2)
            os.kill(worker, signal.SIGKILL)
            assert facts(future.result(PATIENCE)) == expected[0]
            assert executor.submit(os.getpid).result() != worker


def test_gives_up_what_runs_when_it_is_left():
    """Oracle: the trials have no end, but the block has."""
    with open_executor(2) as (executor, _):
        futures = [submit(executor, LONG) for _ in range(3)]
        time.sleep(0.5)
    *ran, waited = futures
    for future in ran:  # in the trial, or still on the way to it
        assert "SIGKILL" in str(future.exception() or future.result())
    assert waited.cancelled()


def test_gives_up_what_runs_on_the_cluster_when_it_is_left():
    """Oracle: as above; a child that is left alone ends with its time."""
    with cluster_of(1) as cluster:
        with open_executor(1, cluster.scheduler_address) as (executor, _):
            future = executor.submit(run_in_process, LONG, "lipm", 2.0, {})
            time.sleep(0.5)
            assert not future.done()
        with pytest.raises(CancelledError):
            future.result(PATIENCE)


def test_gives_up_on_a_cluster_that_loses_its_workers(monkeypatch):
    """Oracle: a task that takes as long as the test waits, or longer."""
    monkeypatch.setattr(executors, "NO_WORKERS", 0.5)
    with cluster_of(1) as cluster:
        with open_executor(1, cluster.scheduler_address) as (executor, _):
            future = executor.submit(time.sleep, PATIENCE)
            cluster.scale(0)
            with pytest.raises(CancelledError):
                future.result(PATIENCE)


def test_a_scheduler_that_is_gone_ends_it_without_a_word(monkeypatch):
    """Oracle: the client's own word that it has been closed."""
    monkeypatch.setattr(executors, "CONNECT_TIMEOUT", 0.5)
    with cluster_of(1) as cluster:
        with open_executor(1, cluster.scheduler_address) as (executor, _):
            future = executor.submit(time.sleep, PATIENCE)
            cluster.close()
            with pytest.raises(CancelledError):
                future.result(PATIENCE)
            late = time.monotonic() + PATIENCE
            while executor._client.status != "closed":
                assert time.monotonic() < late
                time.sleep(0.05)


def test_needs_a_worker():
    with pytest.raises(ValueError, match=r"^workers = 0: must be >= 1$"):
        with open_executor(0):
            pass


def refusal(scheduler: str) -> str:
    """What is said of it, in brackets."""
    with pytest.raises(ValueError) as caught:
        with open_executor(1, scheduler):
            pass
    said = f"scheduler = {scheduler!r}: must be a running Dask scheduler ("
    message = str(caught.value)
    assert message.startswith(said)
    assert "\n" not in message
    return message.removeprefix(said).removesuffix(")")


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("", "missing port number in address ''"),
        ("tcp://host", "missing port number in address 'host'"),
        ("host:port", "invalid literal for int() with base 10: 'port'"),
        ("http://host:1", "unknown address scheme 'http' (known schemes: "),
        ("tls://127.0.0.1:1", "TLS expects a `ssl_context` argument"),
    ],
)
def test_refuses_what_is_no_address(address, why):
    """Oracle: the words of Dask."""
    assert refusal(address).startswith(why)


def test_refuses_a_scheduler_that_is_not_there(monkeypatch):
    """Oracle: a port at which nobody speaks, and then nobody listens."""
    monkeypatch.setattr(executors, "CONNECT_TIMEOUT", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        assert refusal(address) == "no answer for 0.5 s"
    assert refusal(address) == "no answer for 0.5 s"


def test_refuses_a_worker_in_the_place_of_the_scheduler(scheduler):
    with open_executor(1, scheduler) as (executor, _):
        worker = executor.submit(address_of_worker).result()
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
    assert said == 'pip install "nadia_balance[cluster]"'


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
    for name in ("nadia_balance", "diagrams", "models"):
        shutil.copytree(ROOT / name, tmp_path / name)
    with (tmp_path / "diagrams/summary.py").open("a") as file:
        file.write("# Judges in another way.\n")
    said = refused_worker(empty_cluster, [], PYTHONPATH=str(tmp_path))
    match = re.fullmatch(r"worker tcp://\S+: code (\w+), not (\w+)", said)
    assert match[2] == this_code()["code"] != match[1]


def test_refuses_a_worker_without_our_packages(empty_cluster):
    """Oracle: Python's words; it does not read the path to an editable one."""
    import distributed

    packages = os.path.dirname(os.path.dirname(distributed.__file__))
    said = refused_worker(empty_cluster, ["-S"], PYTHONPATH=packages)
    assert "No module named 'diagrams'" in said
