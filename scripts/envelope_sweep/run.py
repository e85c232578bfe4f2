"""Parallel execution of the trials of a sweep."""

import contextlib
import sys
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Future,
    wait,
)

from pydrake.common.yaml import yaml_dump_typed
from tqdm import tqdm

from nadia_balance.scripts.envelope_sweep.plan import Sweep
from nadia_balance.scripts.envelope_sweep.search import (
    Agenda,
    Progress,
    Trial,
)
from nadia_balance.scripts.envelope_sweep.trial import row_without_run
from nadia_balance.scripts.envelope_sweep.trials_file import (
    TrialsFile,
    cell_of,
    recovered,
)
from nadia_balance.scripts.envelope_sweep.workers import Workers, run_task

HEADROOM = 0.16  # distance of the first push below a known limit [m/s]
LOOK = 0.2  # period of the checks whether to stop [s]
DIED = "crashed", "the process of the trial died"


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


def agenda_of(sweep: Sweep, trials_file: TrialsFile) -> Agenda:
    """Returns the Agenda of `sweep`, with the trials of the file as known."""
    known = []
    for row in trials_file.rows():
        cell = cell_of(row)
        level = round(row["delta_v"] / sweep.search.resolution)
        trial = Trial(cell=cell, level=level, replica=row["replica"])
        known.append((trial, recovered(row)))
    first = {
        cell: round((speed - HEADROOM) / sweep.search.resolution)
        for cell, speed in sweep.known_limits.items()
    }
    return Agenda(sweep.cells(), sweep.search, known, first)


def run_sweep(
    sweep: Sweep,
    trials_file: TrialsFile,
    workers: Workers,
    progress: Callable[[Progress], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
) -> bool:
    """Runs all trials that the file lacks; returns True if it is complete.

    The rows depend neither on the number of workers nor on the order in which
    trials end.  `progress` is called at the start and after every trial.
    When `stopped` returns True, running trials are abandoned.

    Raises:
        RuntimeError: the workers are lost, or a future raises: an error of a
            worker, since errors of a trial are in its row.
        OSError: the file cannot be written.
    """
    agenda = agenda_of(sweep, trials_file)
    queue = _Queue(sweep, trials_file.identity, agenda, workers)
    progress(agenda.progress())
    try:
        while not stopped():
            queue.fill()
            if not queue.running:
                return True
            for trial, result in queue.wait():
                trials_file.append({**_labels(sweep, trial), **result})
                agenda.record(trial, recovered(result))
                progress(agenda.progress())
        return False
    finally:
        for future in queue.running:
            future.cancel()


class _Queue:
    """The running trials, and those that may have killed a process.

    If a process dies, its trial is unknown.  All running trials are repeated
    one by one: a trial whose process dies while it runs alone has crashed.
    """

    def __init__(
        self, sweep: Sweep, identity: dict, agenda: Agenda, workers: Workers
    ):
        self._sweep, self._identity = sweep, identity
        self._agenda, self._workers = agenda, workers
        self.running: dict[Future, Trial] = {}
        self._suspects: deque[Trial] = deque()

    def fill(self) -> None:
        """Starts trials until all workers are busy."""
        if self._suspects:
            if not self.running:
                self._begin(self._suspects.popleft())
            return
        # One more than can run, so that no worker waits for the next one.
        while len(self.running) <= self._workers.slots:
            if (trial := self._agenda.pop()) is None:
                return
            self._begin(trial)

    def wait(self) -> list[tuple[Trial, dict]]:
        """Returns the trials that have ended, with their results."""
        done, ended = wait(self.running, LOOK, FIRST_COMPLETED).done, []
        try:
            for future in done:
                ended.append((self.running[future], _result(future)))
                del self.running[future]
        except BrokenExecutor:
            ended += self._sort_out()
        return ended

    def _begin(self, trial: Trial) -> None:
        sweep = self._sweep
        walk = sweep.walk(trial.cell, trial.replica)
        try:
            future = self._workers.submit(
                run_task,
                self._identity,
                yaml_dump_typed(walk),
                sweep.plant,
                sweep.delta_v(trial),
                trial.cell.direction_deg,
                sweep.timeout,
            )
        except BrokenExecutor as error:
            future = Future()
            future.set_exception(error)
        self.running[future] = trial

    def _sort_out(self) -> list[tuple[Trial, dict]]:
        """Restarts the workers after a process has died."""
        trials = list(self.running.values())
        self.running.clear()
        try:
            self._workers.renew()
        except BrokenExecutor as error:
            raise RuntimeError("the workers are gone") from error
        if len(trials) == 1:
            return [(trials[0], row_without_run(*DIED))]
        self._suspects.extend(trials)
        return []


def _labels(sweep: Sweep, trial: Trial) -> dict:
    """The cells of a row that describe the trial."""
    return {
        **trial.cell.situation._asdict(),
        "mechanisms": trial.cell.mechanisms,
        "direction_deg": trial.cell.direction_deg,
        "delta_v": sweep.delta_v(trial),
        "replica": trial.replica,
        "seed": sweep.seed + trial.replica,
    }


def _result(future: Future) -> dict:
    try:
        return future.result()
    except BrokenExecutor:
        raise
    except CancelledError as error:
        raise RuntimeError("the workers are gone") from error
    except Exception as error:
        if type(error).__name__ == "KilledWorker":  # Dask's, after retries
            return row_without_run(*DIED)
        reason = f"{type(error).__name__}: {error}"
        raise RuntimeError(f"a worker failed: {reason}") from error
