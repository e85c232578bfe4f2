"""Where trials run: on the cores of this machine, or on a Dask cluster."""

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor

from diagrams.envelope.fingerprints import this_code
from diagrams.envelope.trial_process import TrialProcess, give_to_this_thread

CONNECT_TIMEOUT = 5.0  # [s]
NO_WORKERS = 300.0  # so long a cluster may be without any [s]
LOOK = 1.0  # between two looks whether it has some [s]


@contextlib.contextmanager
def open_executor(
    workers: int, scheduler: str | None = None
) -> Iterator[tuple[Executor, int]]:
    """Yields what runs `run_in_process`, and how many trials at a time.

    Those are `workers` on this machine, or as many as the Dask cluster with
    this `scheduler` has threads.  Trials that have not ended when this is left
    are given up, as are those of a cluster that has lost all its workers.

    Raises:
        ValueError: no worker, no such scheduler, or workers that cannot run
            the same code.
    """
    if scheduler is not None:
        with _cluster(scheduler) as opened:
            yield opened
    elif workers < 1:
        raise ValueError(f"workers = {workers}: must be >= 1")
    else:
        with _this_machine(workers) as executor:
            yield executor, workers


@contextlib.contextmanager
def _this_machine(workers: int) -> Iterator[Executor]:
    """A thread for each worker, which drives a process of its own."""
    processes = [TrialProcess() for _ in range(workers)]
    free = list(processes)
    executor = ThreadPoolExecutor(
        workers, initializer=lambda: give_to_this_thread(free.pop())
    )
    try:
        yield executor
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()
        executor.shutdown()
        for process in processes:
            process.close()


@contextlib.contextmanager
def _cluster(scheduler: str) -> Iterator[tuple[Executor, int]]:
    with _client(scheduler) as client:
        _check_workers(scheduler, client.run(this_code, on_error="return"))
        executor = client.get_executor(pure=False)
        left = threading.Event()
        threading.Thread(
            target=_watch, args=(client, executor, left), daemon=True
        ).start()
        try:
            yield executor, sum(client.nthreads().values())
        finally:
            left.set()
            _give_up(executor)


def _watch(client, executor: Executor, left: threading.Event) -> None:
    """Gives the trials up without workers: they would wait for ever."""
    while not left.wait(LOOK):
        try:
            client.wait_for_workers(1, timeout=NO_WORKERS)
        except TimeoutError:
            return _give_up(executor)
        except Exception:  # noqa: BLE001
            continue  # without a scheduler all trials are given up, anyway


def _give_up(executor: Executor) -> None:
    with contextlib.suppress(Exception):  # such as: the scheduler is gone
        executor.shutdown(wait=False)


def _client(scheduler: str):
    """Returns a distributed.Client; it is an optional dependency."""
    try:
        from distributed import Client
    except ImportError:
        why = 'pip install "nadia_balance[cluster]"'
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
