"""Workers that run trials: Dask processes of this machine, or a cluster."""

import asyncio
import contextlib
import logging
import os
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor

from distributed import Client, LocalCluster, Security, rpc

from nadia_balance.scripts.envelope_sweep.fingerprint import this_code

CONNECT_TIMEOUT = 5.0  # [s]


@contextlib.contextmanager
def open_workers(
    workers: int, scheduler: str | None = None
) -> Iterator[tuple[Executor, int]]:
    """Yields an Executor, and how many trials it runs at a time.

    They are `workers` processes of this machine, or all workers of the Dask
    cluster of the `scheduler`.  Trials that run at the end of the block are
    abandoned.

    Raises:
        ValueError: no worker, no such scheduler, or workers with other code.
    """
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            if workers < 1:
                raise ValueError(f"workers = {workers}: must be >= 1")
            cluster = stack.enter_context(_local_cluster(workers))
            client = stack.enter_context(Client(cluster, set_as_default=False))
            client.run(os.setsid)  # Ctrl-C interrupts only this process
        else:
            client = stack.enter_context(_client(scheduler))
            codes = client.run(this_code, on_error="return")
            _check_workers(scheduler, codes)
        yield client.get_executor(pure=False), len(client.nthreads())


def _local_cluster(workers: int) -> LocalCluster:
    """Processes of one thread each, without a limit of memory."""
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address=None,
        memory_limit=None,
        silence_logs=logging.CRITICAL,
    )


def _client(scheduler: str) -> Client:
    try:
        with ThreadPoolExecutor(1) as thread:  # which has no event loop yet
            kind = thread.submit(asyncio.run, _kind(scheduler)).result()
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
    keys = Security().get_connection_args("client")
    async with rpc(scheduler, connection_args=keys) as remote:
        answer = asyncio.wait_for(remote.identity(), CONNECT_TIMEOUT)
        return (await answer)["type"]


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
