"""Runs the trials of a sweep, many at a time."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)

from pydrake.common.yaml import yaml_dump_typed

from diagrams.envelope.agenda import Agenda, Progress
from diagrams.envelope.moment import Moment
from diagrams.envelope.sweep_plan import Cell, Sweep, Trial
from diagrams.envelope.trial import trial_scenario
from diagrams.envelope.trial_process import run_in_process
from diagrams.envelope.trials_file import TrialsFile

LOOK = 0.2  # how often it is asked whether to stop [s]


def run_sweep(
    sweep: Sweep,
    trials_file: TrialsFile,
    executor: Executor,
    slots: int,
    progress: Callable[[Progress], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
) -> bool:
    """Runs all trials that the file lacks; returns whether none is left.

    The rows depend neither on `slots`, how many trials run at a time, nor on
    which of them ends first.  `progress` is called at first, and after every
    trial.  Once `stopped` says so, no trial is begun, nor is one waited for.

    Raises:
        RuntimeError: the executor takes no more trials, or a trial's future
            raises: the fault of a worker, for those of a trial are in its row.
        OSError: the file cannot be written.
    """
    agenda = agenda_of(sweep, trials_file)
    running: dict[Future, Trial] = {}
    progress(agenda.progress())
    try:
        while not stopped():
            # One more than can run: nobody waits for the next one.
            while len(running) <= slots and (trial := agenda.pop()):
                future = _submit(executor, sweep, trial, trials_file.identity)
                running[future] = trial
            if not running:
                return True
            for future in wait(running, LOOK, FIRST_COMPLETED).done:
                trial = running.pop(future)
                result = _result(future)
                trials_file.append({**_labels(sweep, trial), **result})
                agenda.record(trial, result["outcome"] == "recovered")
                progress(agenda.progress())
        return False
    finally:
        for future in running:
            future.cancel()


def agenda_of(sweep: Sweep, trials_file: TrialsFile) -> Agenda:
    """Returns what `sweep` has left to do, given the rows in the file."""
    return Agenda(sweep.cells(), sweep.search, _known(trials_file, sweep))


def timed(text: str, plant: str, timeout: float, identity: dict) -> dict:
    """Runs a trial where the executor says; adds its wall time [s]."""
    began = time.perf_counter()
    result = run_in_process(text, plant, timeout, identity)
    return {**result, "wall_s": time.perf_counter() - began}


def _known(
    trials_file: TrialsFile, sweep: Sweep
) -> Iterator[tuple[Trial, bool]]:
    for row in trials_file.rows():
        cell = Cell(
            row["mechanisms"], Moment.parse(row["phase"]), row["direction_deg"]
        )
        level = round(row["delta_v"] / sweep.search.resolution)
        trial = Trial(cell=cell, level=level, replica=row["replica"])
        yield trial, row["outcome"] == "recovered"


def _submit(
    executor: Executor, sweep: Sweep, trial: Trial, identity: dict
) -> Future:
    scenario = trial_scenario(
        sweep.scenario,
        trial.cell,
        sweep.delta_v(trial),
        trial.replica,
        sweep.period,
    )
    text = yaml_dump_typed(scenario)
    return executor.submit(timed, text, sweep.plant, sweep.timeout, identity)


def _labels(sweep: Sweep, trial: Trial) -> dict:
    """What a row says of the trial itself."""
    return {
        "mechanisms": trial.cell.mechanisms,
        "phase": str(trial.cell.moment),
        "direction_deg": trial.cell.direction_deg,
        "delta_v": sweep.delta_v(trial),
        "replica": trial.replica,
        "seed": sweep.scenario.seed + trial.replica,
    }


def _result(future: Future) -> dict:
    try:
        return future.result()
    except (CancelledError, BrokenExecutor) as error:
        raise RuntimeError("the workers are gone") from error
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise RuntimeError(f"a worker failed: {reason}") from error
