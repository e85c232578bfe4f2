"""Parallel execution of the trials of a sweep, by Dask."""

import asyncio
import contextlib
import logging
import os
import sys
from collections.abc import Callable, Collection, Iterator
from concurrent import futures

from distributed import Client, KilledWorker, LocalCluster
from distributed.comm import connect
from pydrake.common.yaml import yaml_dump_typed
from tqdm import tqdm

from nadia_balance.scripts.envelope_sweep.rows import Rows, by_cell, results_of
from nadia_balance.scripts.envelope_sweep.sweep import Attempt, Cell, Sweep
from nadia_balance.scripts.envelope_sweep.trial import run_trial

CONNECT_TIMEOUT = 5.0  # [s]
LOOK = 0.2  # period of the checks whether to stop [s]
DIED = {"outcome": "crashed", "reason": "the process of the trial died"}

Trial = tuple[Cell, Attempt]


@contextlib.contextmanager
def open_workers(
    workers: int, scheduler: str | None = None
) -> Iterator[tuple[futures.Executor, int]]:
    """Yields an Executor, and how many trials it runs at a time.

    They are `workers` processes of this machine, or all workers of the Dask
    cluster of the `scheduler`.  Trials that run at the end of the block are
    abandoned.

    Raises ValueError: no worker, or no such scheduler.
    """
    if scheduler is None and workers < 1:
        raise ValueError(f"workers = {workers}: must be >= 1")
    where = scheduler
    if scheduler is not None:
        try:
            _greet(scheduler)
        except (OSError, ValueError, TypeError) as error:
            raise ValueError(
                f"scheduler = {scheduler!r}: must be a Dask scheduler ({error})"
            ) from None
    else:
        where = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,
            memory_limit=None,
            silence_logs=logging.CRITICAL,
        )
    client = Client(where, timeout=CONNECT_TIMEOUT, set_as_default=False)
    with where if scheduler is None else contextlib.nullcontext(), client:
        if not client.nthreads():
            raise ValueError(f"scheduler = {scheduler!r}: must have workers")
        if scheduler is None:
            client.run(os.setsid)  # Ctrl-C interrupts only this process
        yield client.get_executor(pure=False), len(client.nthreads())


def _greet(scheduler: str) -> None:
    """Connects once, as a Client that fails to start may hang when freed."""

    async def greet() -> None:
        comm = await connect(scheduler, timeout=CONNECT_TIMEOUT)
        await comm.close()

    # In a thread of its own: that of the caller may have an event loop.
    with futures.ThreadPoolExecutor(1) as thread:
        thread.submit(lambda: asyncio.run(greet())).result()


def urgent(sweep: Sweep, rows: Rows, running: Collection[Trial]) -> list[Trial]:
    """Returns the trials that can run now, the most urgent first.

    Situations are processed one by one, because their trials share the walk to
    the push.  Within a situation, first replicas come first, which gives a
    coarse envelope early; then the cell with the fewest trials.
    """
    known, several = by_cell(rows.all), []
    for cell in sweep.cells():
        attempts = sweep.attempts(cell, results_of(known.get(cell, [])))
        several += [
            (cell, one) for one in attempts if (cell, one) not in running
        ]

    def later(trial: Trial) -> tuple[bool, bool, int]:
        (cell, (_, replica)), (first, _) = trial, several[0]
        return cell[:2] != first[:2], replica > 0, len(known.get(cell, []))

    return sorted(several, key=later)


def run_sweep(
    sweep: Sweep,
    rows: Rows,
    executor: futures.Executor,
    slots: int,
    stopped: Callable[[], bool] = lambda: False,
) -> bool:
    """Runs all trials that the rows lack; returns True if they are complete.

    The executor runs `slots` trials at a time.  The rows depend neither on
    their number nor on the order in which trials end.  When `stopped` returns
    True, running trials are abandoned.

    Raises RuntimeError: a worker fails; errors of a trial are in its row.
    """
    running: dict[futures.Future, Trial] = {}
    seldom = 0.5 if sys.stderr.isatty() else 30.0
    with tqdm(initial=len(rows.all), unit="trial", mininterval=seldom) as bar:
        while not stopped():
            if free := slots - len(running):
                for trial in urgent(sweep, rows, running.values())[:free]:
                    cell, (delta_v, replica) = trial
                    walk = yaml_dump_typed(sweep.walk(cell, replica))
                    system = sweep.plant, sweep.controller
                    push = delta_v, cell.direction_deg
                    task = run_trial, rows.identity, walk, system, *push
                    running[executor.submit(*task)] = trial
            if not running:
                return True
            for future in futures.wait(
                running, LOOK, futures.FIRST_COMPLETED
            ).done:
                cell, (delta_v, replica) = running.pop(future)
                trial = {"delta_v": delta_v, "replica": replica}
                seed = {"seed": sweep.one.seed + replica}
                rows.add(cell._asdict() | trial | seed | _result(future))
                bar.update()
    return False


def _result(future: futures.Future) -> dict:
    """What a trial returned, or that its process died, after some tries."""
    try:
        return future.result()
    except KilledWorker:
        return DIED
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise RuntimeError(f"a worker failed: {reason}") from error
