"""Where trials run: in processes of this machine, or on a Dask cluster."""

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

# Each trial has one thread; BLAS reads this when it is loaded.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
GRACE = 10.0  # after its time is up a trial's process ends itself [s]
CONNECT_TIMEOUT = 5.0  # [s]
NO_WORKERS = 300.0  # so long a cluster may be without any [s]
LOOK = 1.0  # between two looks [s]

_trial_ends = math.inf  # at the latest, on the monotonic clock [s]


def run_task(identity: dict, walk: str, *trial: object) -> dict:
    """Runs a trial (see run_trial); adds the wall time it took [s].

    Raises:
        ValueError: this process has other code, or the robot other files, than
            the `identity` of the sweep says.
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
        """Runs a function of this package somewhere."""
        return self._executor.submit(function, *args)

    def renew(self) -> None:
        """Starts anew after a process has died.

        Raises:
            BrokenExecutor: there is no new start (Dask replaces what dies).
        """
        raise BrokenExecutor

    def close(self) -> None:
        """Gives up all trials."""
        with contextlib.suppress(Exception):  # such as: the scheduler is gone
            self._executor.shutdown(wait=False)


class Processes(Workers):
    """Workers of this machine, which end with this process, however it ends."""

    def __init__(self, slots: int):
        """Starts processes as they are needed."""
        os.environ |= ONE_THREAD
        spawn = multiprocessing.get_context("spawn")
        leash, self._leash = spawn.Pipe(duplex=False)
        super().__init__(
            slots, ProcessPoolExecutor(slots, spawn, _begin, (leash,))
        )

    def renew(self) -> None:
        """See Workers."""
        self.close()
        self.__init__(self.slots)
        self.submit(os.getpid).result()

    def close(self) -> None:
        """Ends all processes, in the middle of a trial, too."""
        self._leash.close()
        self._executor.shutdown(cancel_futures=True)


@contextlib.contextmanager
def open_workers(
    workers: int, scheduler: str | None = None
) -> Iterator[Workers]:
    """Yields what runs `run_task`.

    On this machine, `workers` trials at a time, or on the Dask cluster with
    this `scheduler` as many as it has workers.  Trials that have not ended when
    this is left are given up, as are those of a cluster that has lost all its
    workers.

    Raises:
        ValueError: no worker, no such scheduler, or workers that cannot run
            the same code.
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
    """A new process; Ctrl-C is for the parent alone."""
    os.setsid()
    Thread(target=_watch, args=(leash,), daemon=True).start()


def _watch(leash: Connection) -> None:
    """Ends this process with its parent, or with a trial that hangs."""
    with contextlib.suppress(OSError):
        while not leash.poll(LOOK) and time.monotonic() < _trial_ends:
            pass
    os._exit(1)


def _watch_cluster(client, workers: Workers, left: Event) -> None:
    """Gives the trials up without workers: they would wait for ever."""
    while not left.wait(LOOK):
        try:
            client.wait_for_workers(1, timeout=NO_WORKERS)
        except TimeoutError:
            return workers.close()
        except Exception:  # noqa: BLE001
            continue  # without a scheduler all are given up, anyway


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
    """Raises ValueError if a worker would give other rows than this machine.

    `codes` is what each has, by address, or the error when it was asked.
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
