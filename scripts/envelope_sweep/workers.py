"""Workers that run trials: processes of this machine, or a Dask cluster."""

import asyncio
import contextlib
import functools
import math
import multiprocessing
import os
import time
from collections.abc import Iterator
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
)
from multiprocessing.connection import Connection
from threading import Event, Thread

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.scripts.envelope_sweep.plan import robot_hash, this_code
from nadia_balance.scripts.envelope_sweep.trial import run_trial
from nadia_balance.typed_yaml import load_typed

# Each trial has one thread; BLAS reads these variables when it is loaded.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
GRACE = 10.0  # time after a trial's timeout at which its process exits [s]
CONNECT_TIMEOUT = 5.0  # [s]
NO_WORKERS = 300.0  # longest time of a cluster without workers [s]
LOOK = 1.0  # period of checks [s]

_trial_ends = math.inf  # latest end of a trial, on the monotonic clock [s]


def run_task(identity: dict, walk: str, *trial: object) -> dict:
    """Runs a trial (see run_trial); adds its wall time [s].

    Raises:
        ValueError: the code of this process, or the robot's files, differ from
            the `identity` of the sweep.
    """
    global _trial_ends
    began = time.monotonic()
    *_, timeout = trial
    _check_identity(walk, frozenset(identity.items()))
    _trial_ends = began + timeout + GRACE
    try:
        row = run_trial(walk, *trial)
    finally:
        _trial_ends = math.inf
    return row | {"wall_s": time.monotonic() - began}


@functools.lru_cache
def _check_identity(walk: str, identity: frozenset) -> None:
    scenario, asked = load_typed(Scenario, "walk", data=walk), dict(identity)
    ours = {**this_code(), "robot_files": robot_hash(scenario.robot)}
    for name, value in ours.items():
        if asked.get(name, value) != value:
            raise ValueError(
                f"{name} = {value}: must be {asked[name]}, as when the sweep "
                "began"
            )


class Workers:
    """An Executor for `slots` trials at a time."""

    def __init__(self, slots: int, executor: Executor):
        self.slots, self._executor = slots, executor

    def submit(self, function, *args) -> Future:
        """Runs a function of this package on a worker."""
        return self._executor.submit(function, *args)

    def renew(self) -> None:
        """Restarts the workers after a process has died.

        Raises:
            BrokenExecutor: always; Dask replaces its workers itself.
        """
        raise BrokenExecutor

    def close(self) -> None:
        """Abandons all trials."""
        with contextlib.suppress(Exception):  # e.g. of a lost scheduler
            self._executor.shutdown(wait=False)


class Processes(Workers):
    """Worker processes of this machine, which always end with this process."""

    def __init__(self, slots: int):
        """Starts up to `slots` processes on demand."""
        os.environ |= ONE_THREAD
        spawn = multiprocessing.get_context("spawn")
        leash, self._leash = spawn.Pipe(duplex=False)
        super().__init__(
            slots, ProcessPoolExecutor(slots, spawn, _begin, (leash,))
        )

    def renew(self) -> None:
        """Restarts all processes."""
        self.close()
        self.__init__(self.slots)
        self.submit(os.getpid).result()

    def close(self) -> None:
        """Ends all processes, including those that run a trial."""
        self._leash.close()
        self._executor.shutdown(cancel_futures=True)


@contextlib.contextmanager
def open_workers(
    workers: int, scheduler: str | None = None
) -> Iterator[Workers]:
    """Yields Workers for `run_task`.

    They run `workers` trials at a time on this machine, or as many as the Dask
    cluster of the `scheduler` has workers.  Trials that run at the end of the
    block are abandoned, as are those of a cluster that has lost all workers.

    Raises:
        ValueError: no worker, no such scheduler, or workers with other code.
    """
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            if workers < 1:
                raise ValueError(f"workers = {workers}: must be >= 1")
            opened = Processes(workers)
        else:
            client, left = stack.enter_context(_client(scheduler)), Event()
            _check_workers(scheduler, client.run(this_code, on_error="return"))
            executor = client.get_executor(pure=False)
            opened = Workers(len(client.nthreads()), executor)
            stack.callback(left.set)
            Thread(
                target=_watch_cluster, args=(client, opened, left), daemon=True
            ).start()
        stack.callback(opened.close)
        yield opened


def _begin(leash: Connection) -> None:
    """Initialises a process; Ctrl-C interrupts only the parent."""
    os.setsid()
    Thread(target=_watch, args=(leash,), daemon=True).start()


def _watch(leash: Connection) -> None:
    """Ends this process when its parent ends, or when a trial hangs."""
    with contextlib.suppress(OSError):
        while not leash.poll(LOOK) and time.monotonic() < _trial_ends:
            pass
    os._exit(1)


def _watch_cluster(client, workers: Workers, left: Event) -> None:
    """Abandons the trials of a cluster that has no workers for too long."""
    while not left.wait(LOOK):
        try:
            client.wait_for_workers(1, timeout=NO_WORKERS)
        except TimeoutError:
            return workers.close()
        except Exception:  # noqa: BLE001
            continue  # without a scheduler all futures are cancelled


def _client(scheduler: str):
    """Returns a distributed.Client; it is an optional dependency."""
    try:
        from distributed import Client
    except ImportError:
        why = "pip install distributed"
        raise _refusal(scheduler, why) from None
    try:
        kind = asyncio.run(asyncio.wait_for(_kind(scheduler), CONNECT_TIMEOUT))
    except TimeoutError:
        why = f"no answer for {CONNECT_TIMEOUT:g} s"
        raise _refusal(scheduler, why) from None
    except (OSError, TypeError, ValueError) as error:
        raise _refusal(scheduler, str(error)) from error
    if kind != "Scheduler":
        raise _refusal(scheduler, f"this is a {kind}")
    return Client(scheduler, timeout=CONNECT_TIMEOUT, set_as_default=False)


async def _kind(scheduler: str) -> str:
    """What answers there.  A Client would wait for an answer without end."""
    from distributed import Security, rpc

    keys = Security().get_connection_args("client")
    async with rpc(scheduler, connection_args=keys) as remote:
        return (await remote.identity())["type"]


def _check_workers(scheduler: str, codes: dict[str, object]) -> None:
    """Raises ValueError if the code of a worker differs from this machine's.

    `codes` is this_code() of each worker, by address, or an error.
    """
    if not codes:
        raise _refusal(scheduler, "with workers; it has none")
    ours = this_code()
    for worker, theirs in sorted(codes.items()):
        if isinstance(theirs, Exception):
            raise _refusal(scheduler, f"worker {worker}: {theirs}")
        for name, value in ours.items():
            if theirs[name] != value:
                why = f"worker {worker}: {name} {theirs[name]}, not {value}"
                raise _refusal(scheduler, why)


def _refusal(scheduler: str, why: str) -> ValueError:
    return ValueError(
        f"scheduler = {scheduler!r}: must be a running Dask scheduler ({why})"
    )
