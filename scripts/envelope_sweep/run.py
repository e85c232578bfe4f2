"""Parallel execution of the trials of a sweep, by Dask."""

import asyncio
import contextlib
import logging
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from typing import NamedTuple

from distributed import Client, KilledWorker, LocalCluster, Security, rpc
from pydrake.common.yaml import yaml_dump_typed
from tqdm import tqdm

from nadia_balance.scripts.envelope_sweep import trial
from nadia_balance.scripts.envelope_sweep.rows import Rows, cell_of, recovered
from nadia_balance.scripts.envelope_sweep.search import (
    Attempt,
    Cell,
    attempts_left,
    next_attempts,
)
from nadia_balance.scripts.envelope_sweep.sweep import Sweep

CONNECT_TIMEOUT = 5.0  # [s]
LOOK = 0.2  # period of the checks whether to stop [s]
# If no trial has ended for NO_TRIAL + TRIES timeouts, there are no workers:
# Dask begins a trial four times if its process dies, each up to the timeout.
NO_TRIAL, TRIES = 300.0, 5  # [s], timeouts
DIED = "crashed", "the process of the trial died"


@contextlib.contextmanager
def open_workers(
    workers: int, scheduler: str | None = None
) -> Iterator[tuple[Executor, int]]:
    """Yields an Executor, and how many trials it runs at a time.

    They are `workers` processes of this machine, or all workers of the Dask
    cluster of the `scheduler`.  Trials that run at the end of the block are
    abandoned.

    Raises:
        ValueError: no worker, or no such scheduler.
    """
    if scheduler is None and workers < 1:
        raise ValueError(f"workers = {workers}: must be >= 1")
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=None,
                memory_limit=None,
                silence_logs=logging.CRITICAL,
            )
            stack.enter_context(cluster)
            client = stack.enter_context(Client(cluster, set_as_default=False))
            client.run(os.setsid)  # Ctrl-C interrupts only this process
        else:
            client = stack.enter_context(_client(scheduler))
        yield client.get_executor(pure=False), len(client.nthreads())


def _client(scheduler: str) -> Client:
    """A client of a scheduler that has workers."""
    try:
        with ThreadPoolExecutor(1) as thread:  # which has no event loop yet
            found = thread.submit(asyncio.run, _identity(scheduler)).result()
        if found["type"] == "Scheduler" and found["workers"]:
            usual = {"timeout": CONNECT_TIMEOUT, "set_as_default": False}
            return Client(scheduler, **usual)
        why = f"this is a {found['type']} without workers"
    except TimeoutError:
        why = f"no answer for {CONNECT_TIMEOUT:g} s"
    except (OSError, TypeError, ValueError) as error:
        why = str(error)
    raise ValueError(
        f"scheduler = {scheduler!r}: must be a running Dask scheduler ({why})"
    )


async def _identity(scheduler: str) -> dict:
    """What answers there.  A Client would wait for an answer without end."""
    keys = Security().get_connection_args("client")
    async with rpc(scheduler, connection_args=keys) as remote:
        return await asyncio.wait_for(remote.identity(), CONNECT_TIMEOUT)


class Progress(NamedTuple):
    """Progress of a sweep; its total is an estimate until the end."""

    done: int  # trials
    total: int  # trials done and expected
    complete: int  # cells
    cells: int


class Job(NamedTuple):
    """A trial that runs; `alone` if no other one can have ended its process."""

    search: "CellSearch"
    attempt: Attempt
    alone: bool = False


class CellSearch:
    """The search of one cell, given its trials so far."""

    def __init__(self, sweep: Sweep, cell: Cell):
        """Begins without any trial."""
        self.cell = cell
        self.known: dict[Attempt, bool | None] = {}  # -> recovered
        self.waiting: list[Attempt] = []  # can run now
        self.left = 0  # expected number of trials
        self._search = sweep.search, sweep.first(cell)
        self._running: set[Attempt] = set()

    def go_on(self) -> None:
        """Looks for the attempts that can run, given those that are known."""
        needed = next_attempts(self.known, *self._search)
        self.waiting = [a for a in needed if a not in self._running]
        foreseen = attempts_left(self.known, *self._search)
        self.left = max(len(needed), foreseen) if needed else 0

    def begin(self) -> Job:
        """Returns the next attempt, which runs from now on."""
        attempt = self.waiting.pop(0)
        self._running.add(attempt)
        return Job(self, attempt)

    def record(self, row: dict) -> None:
        """Records a trial, which may have been begun before."""
        attempt = row["delta_v"], row["replica"]
        self._running.discard(attempt)
        self.known[attempt] = recovered(row)


def searches_of(sweep: Sweep, rows: Iterable[dict]) -> list[CellSearch]:
    """Returns the searches of all cells; ignores the rows of others."""
    searches = {cell: CellSearch(sweep, cell) for cell in sweep.cells()}
    for row in rows:
        if (cell := cell_of(row)) in searches:
            searches[cell].record(row)
    for search in searches.values():
        search.go_on()
    return list(searches.values())


def most_urgent(searches: Iterable[CellSearch]) -> CellSearch | None:
    """Returns the search whose next attempt is to run first, if one can run.

    Situations are processed one by one, because their trials share the walk to
    the push.  Within a situation, first replicas come first, which gives a
    coarse envelope early; then the cell with the fewest trials comes first.
    """
    ready = [search for search in searches if search.waiting]

    def later(search: CellSearch) -> tuple[bool, bool, int]:
        replica = search.waiting[0][1]
        of_another = search.cell.situation != ready[0].cell.situation
        return of_another, replica > 0, len(search.known)

    return min(ready, key=later, default=None)


def progress_of(searches: Sequence[CellSearch]) -> Progress:
    """The progress of all searches."""
    done = sum(len(search.known) for search in searches)
    return Progress(
        done=done,
        total=done + sum(search.left for search in searches),
        complete=sum(not search.left for search in searches),
        cells=len(searches),
    )


@contextlib.contextmanager
def progress_bar(start: Progress) -> Iterator[Callable[[Progress], None]]:
    """Yields a function that shows the progress of a sweep on stderr.

    The remaining time is the mean time of this run's trials times the expected
    number of trials.  It is underestimated at first: trials with a fall are
    short, and the trials that confirm a limit come last and do not fall.
    """
    with tqdm(
        total=start.total,
        initial=start.done,
        unit="trial",
        smoothing=0.0,
        dynamic_ncols=True,
        mininterval=0.5 if sys.stderr.isatty() else 30.0,
    ) as bar:

        def show(now: Progress) -> None:
            bar.total = now.total
            words = f"{now.complete}/{now.cells} limits found"
            bar.set_postfix_str(words, refresh=False)
            bar.update(now.done - bar.n)

        yield show


def run_sweep(
    sweep: Sweep,
    rows: Rows,
    executor: Executor,
    slots: int,
    show: Callable[[Progress], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
) -> bool:
    """Runs all trials that the rows lack; returns True if they are complete.

    The executor runs `slots` trials at a time.  The rows depend neither on
    their number nor on the order in which trials end.  `show` is called at the
    start and after every trial.  When `stopped` returns True, running trials
    are abandoned.

    Raises:
        RuntimeError: the workers are lost, or one fails: errors of a trial are
            in its row.
        OSError: a row cannot be written.
    """
    searches = searches_of(sweep, rows.all())
    running: dict[Future, Job] = {}
    # Jobs whose process died, perhaps of another one that it was to run.
    suspects: list[Job] = []

    def next_job() -> Job | None:
        if suspects or any(job.alone for job in running.values()):
            return suspects.pop() if suspects and not running else None
        # One more than can run, so that no worker waits for the next one.
        search = most_urgent(searches) if len(running) <= slots else None
        return search and search.begin()

    show(progress_of(searches))
    patience = NO_TRIAL + TRIES * sweep.timeout
    latest = time.monotonic() + patience
    try:
        while not stopped():
            while job := next_job():
                arguments = _arguments(sweep, rows.identity, job)
                running[executor.submit(trial.run_trial, *arguments)] = job
            if not running:
                return True
            for future in wait(running, LOOK, FIRST_COMPLETED).done:
                job, latest = running.pop(future), time.monotonic() + patience
                result = _result(future)
                if result is None and not job.alone:
                    suspects.append(job._replace(alone=True))
                    continue
                row = _row(sweep, job, result)
                rows.add(row)
                job.search.record(row)
                job.search.go_on()
                show(progress_of(searches))
            if time.monotonic() > latest:
                raise RuntimeError("the workers are gone: no trial has ended")
        return False
    finally:
        for future in running:
            future.cancel()


def _arguments(sweep: Sweep, identity: dict, job: Job) -> tuple:
    """The arguments of run_trial."""
    cell, (delta_v, replica) = job.search.cell, job.attempt
    walk = yaml_dump_typed(sweep.walk(cell, replica))
    push = delta_v, cell.direction_deg
    return identity, walk, sweep.plant, *push, sweep.timeout


def _row(sweep: Sweep, job: Job, result: dict | None) -> dict:
    """The row of a trial that has ended; without a result, its process died."""
    delta_v, replica = job.attempt
    return {
        **job.search.cell._asdict(),
        "delta_v": delta_v,
        "replica": replica,
        "seed": sweep.common.seed + replica,
        **(result or trial.row_without_run(*DIED)),
    }


def _result(future: Future) -> dict | None:
    """What a trial returned; None if its process died, after some tries."""
    try:
        return future.result()
    except KilledWorker:
        return None
    except CancelledError as error:
        raise RuntimeError("the workers are gone") from error
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise RuntimeError(f"a worker failed: {reason}") from error
