"""Runs the trials of a sweep, many at a time."""

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

HEADROOM = 0.16  # so far below a limit that is known a march begins [m/s]
LOOK = 0.2  # how often it is asked whether to stop [s]
DIED = "crashed", "the process of the trial died"


@contextlib.contextmanager
def progress_bar(start: Progress) -> Iterator[Callable[[Progress], None]]:
    """Yields what shows how far a sweep is on stderr.

    The time left is the mean time of this run's trials times the number of
    trials foreseen.  It is too short at first: a fall ends a trial early, and
    the many trials that confirm a limit come last, and do not fall.
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
    """Returns what `sweep` has left to do, given the rows in the file."""
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
    """Runs all trials that the file lacks; returns whether none is left.

    The rows depend neither on how many trials run at a time, nor on which of
    them ends first.  `progress` is called at first, and after every trial.
    Once `stopped` says so, no trial is begun, nor is one waited for.

    Raises:
        RuntimeError: the workers are gone, or a trial's future raises: the
            fault of a worker, for those of a trial are in its row.
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
    """The trials that run, and those that may have killed a process.

    When one dies, nobody knows for which trial.  All that ran are tried once
    more, each alone: one that is alone when its process dies has crashed.
    """

    def __init__(
        self, sweep: Sweep, identity: dict, agenda: Agenda, workers: Workers
    ):
        self._sweep, self._identity = sweep, identity
        self._agenda, self._workers = agenda, workers
        self.running: dict[Future, Trial] = {}
        self._suspects: deque[Trial] = deque()

    def fill(self) -> None:
        """Begins as many trials as should run."""
        if self._suspects:
            if not self.running:
                self._begin(self._suspects.popleft())
            return
        # One more than can run: nobody waits for the next one.
        while len(self.running) <= self._workers.slots:
            if (trial := self._agenda.pop()) is None:
                return
            self._begin(trial)

    def wait(self) -> list[tuple[Trial, dict]]:
        """Returns the trials that have ended meanwhile, with their results."""
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
        """Begins anew after a process has died."""
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
    """What a row says of the trial itself."""
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
        if type(error).__name__ == "KilledWorker":  # Dask's, after some deaths
            return row_without_run(*DIED)
        reason = f"{type(error).__name__}: {error}"
        raise RuntimeError(f"a worker failed: {reason}") from error
