"""Execution of a sweep by Dask: the search of each cell, trial by trial."""

import contextlib
import functools
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent import futures
from typing import Any, cast

import dask.system
import distributed
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from tqdm import tqdm

from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.diagrams import simulation
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.diagrams.verdict import RecoveryWatch, push_signal
from nadia_balance.parameters import yaml_reader, yaml_writer
from nadia_balance.parameters.bounds import require
from nadia_balance.results.summary import Run
from nadia_balance.sweep.lipm_limit import LipmLimit
from nadia_balance.sweep.search import Sweep
from nadia_balance.sweep.trials import (
    FROM_SUMMARY,
    Cell,
    Identity,
    Results,
    Row,
    Rows,
    of_process,
    results_of,
)

CONNECT_TIMEOUT = 5.0  # [s]
LOOK = 0.2  # period of the checks whether to stop [s]
MOST_WALKS = 32  # walks that a process keeps, about 10 MB each
MOST_WORKERS = 4 * dask.system.CPU_COUNT


def check_workers(workers: int) -> None:
    """Checks a number of processes of this machine.

    Args:
        workers: the number.

    Raises:
        ValueError: it is none in [1, MOST_WORKERS].
    """
    require(
        isinstance(workers, int) and 1 <= workers <= MOST_WORKERS,
        f"workers = {workers}: must be in [1, {MOST_WORKERS}], up to 4 for "
        "each core",
    )


@contextlib.contextmanager
def open_workers(
    workers: int, scheduler: str | None = None
) -> Iterator[futures.Executor]:
    """Opens an Executor; what runs at the end of the block is abandoned.

    Args:
        workers: number of processes of this machine, at most MOST_WORKERS.
        scheduler: address of a Dask cluster, tcp://host:port, all of whose
            workers are taken instead; None: this machine.

    Yields:
        The Executor.

    Raises:
        ValueError: no worker, too many, or no such scheduler.
    """
    untyped: Any = distributed
    if scheduler is None:
        check_workers(workers)
        with (
            # Workers are not missed after Ctrl-Z, or the sleep of a laptop.
            dask.config.set({"distributed.scheduler.worker-ttl": None}),
            untyped.LocalCluster(
                n_workers=workers,
                host="127.0.0.1",
                # The scheduler's pages: at any free port, 8787 may be taken.
                dashboard_address="127.0.0.1:0",
                memory_limit=None,
                threads_per_worker=1,
                silence_logs=logging.CRITICAL,
            ) as cluster,
            untyped.Client(cluster, set_as_default=False) as client,
        ):
            client.run(os.setsid)  # Ctrl-C interrupts only this process
            yield client.get_executor(pure=False)
        return
    try:
        # Or else the Client may hang.
        untyped.comm.get_address_host_port(scheduler)
        client = untyped.Client(
            scheduler, timeout=CONNECT_TIMEOUT, set_as_default=False
        )
    except (OSError, OverflowError, ValueError) as error:
        raise ValueError(
            f"scheduler = {scheduler!r}: must be a Dask scheduler ({error})"
        ) from None
    with client:
        require(
            len(client.nthreads()) > 0,
            f"scheduler = {scheduler!r}: must have workers",
        )
        yield client.get_executor(pure=False)


def run_sweep(
    sweep: Sweep,
    rows: Rows,
    executor: futures.Executor,
    stopped: Callable[[], bool] = lambda: False,
) -> bool:
    """Makes all trials that the rows lack.

    Each cell is a task of the executor; its rows are added when it ends, so
    that they depend neither on the number of workers nor on their order.

    Args:
        sweep: its cells and their search.
        rows: opened; the trials are added to them.
        executor: makes the trials.
        stopped: once it returns True, running cells are abandoned.

    Returns:
        True if all was done.

    Raises:
        RuntimeError: as collect.
    """
    earlier = rows.by_cell()
    running = {
        executor.submit(
            search,
            sweep,
            rows.identity,
            cell,
            results_of(earlier.get(cell, [])),
        )
        for cell in sweep.cells()
    }
    return collect(running, rows, stopped, "limit")


def collect(
    running: "set[futures.Future[list[Row]]]",
    rows: Rows,
    stopped: Callable[[], bool],
    unit: str,
) -> bool:
    """Adds the rows of tasks as they end.

    Args:
        running: the tasks.
        rows: opened; those of the tasks are added to them.
        stopped: once it returns True, running tasks are abandoned.
        unit: what a task makes, for the bar.

    Returns:
        True if all was done.

    Raises:
        RuntimeError: a worker fails; or a trial, which ended by an error of a
            block, no fall.  Its row is kept, as all others are.
    """
    with tqdm(
        total=len(running),
        unit=unit,
        mininterval=0.5 if sys.stderr.isatty() else 30.0,
    ) as bar:
        while running and not stopped():
            ended, running = futures.wait(
                running, timeout=LOOK, return_when=futures.FIRST_COMPLETED
            )
            # What has been made is kept before a failure is told.
            for future in sorted(
                ended, key=lambda one: one.exception() is not None
            ):
                for row in _rows_of(future):
                    rows.add(row)
                bar.update()
    errors = [row["reason"] for row in rows.all if row["outcome"] == "error"]
    if errors:
        raise RuntimeError(
            f"{len(errors)} of {len(rows.all)} trials ended by an error of a "
            f"block: {errors[0]}"
        )
    return not running


def _rows_of(future: "futures.Future[list[Row]]") -> list[Row]:
    try:
        return future.result()
    except Exception as error:
        raise RuntimeError(
            f"a worker failed: {type(error).__name__}: {error}"
        ) from error


def search(
    sweep: Sweep, identity: Identity, cell: Cell, earlier: Results
) -> list[Row]:
    """Makes the trials that the search of a cell needs.

    It is repeated from its beginning.

    Args:
        sweep: the search and its parameters.
        identity: what all trials share, see Sweep.identity.
        cell: whose limit is searched.
        earlier: results of trials that are not made again; those of the new
            ones are added.

    Returns:
        The rows of the new trials.

    Raises:
        ValueError: this process has another code or robot than `identity`.
    """
    present = of_process(
        sweep.one, sweep.controller, sweep.blocks, sweep.contract
    )
    check_process(identity, present)
    results: Results = {}
    rows = []
    while batch := sweep.attempts(cell, results):
        for attempt in batch:
            if attempt not in earlier:
                rows.append(run_trial(sweep, cell, *attempt))
                earlier |= results_of(rows[-1:])
            results[attempt] = earlier[attempt]
    return rows


def check_process(identity: Identity, present: Mapping[str, str]) -> None:
    """Checks that a worker has the code with which a sweep began.

    Args:
        identity: what all trials share.
        present: what the rows of this process depend on (see of_process).

    Raises:
        ValueError: this process has another code or robot than `identity`.
    """
    for name, value in present.items():
        require(
            identity.get(name, value) == value,
            f"{name} = {value}: must be {identity.get(name)}, as when the "
            "sweep began",
        )


def run_trial(sweep: Sweep, cell: Cell, delta_v: float, replica: int) -> Row:
    """Simulates one push.

    The verdict is that of push.py, at the first instant at which it is certain:
    an improper contact, an exceeded limit, or a recovery.

    Args:
        sweep: the scenarios, the plant and the controller.
        cell: conditions of the push.
        delta_v: its size [m/s].
        replica: from 0 on, see Sweep.walk.

    Returns:
        The row of the trial.  Its `outcome` is recovered, fell, failed
        (upright, but not recovered), undecided (the run ended too early) or
        error: those of the simulation are not raised.
    """
    walk = sweep.walk(cell, replica)
    diagram, walked, run = _walked(
        yaml_writer.dump(walk),
        sweep.plant,
        sweep.controller,
        blocks=tuple(sweep.blocks.items()),
        contract=sweep.contract,
        thread=threading.get_ident(),
    )
    try:
        verdict = _ended(
            diagram,
            simulation.pushed(diagram, walked, delta_v, cell.direction_deg),
            run,
        )
    except Exception as error:
        verdict = {
            "outcome": "error",
            "reason": f"{type(error).__name__}: {error}",
        }
    return {
        **cell._asdict(),
        "delta_v": delta_v,
        "replica": replica,
        "seed": walk.seed,
        **verdict,
    }


@functools.lru_cache(MOST_WALKS)
def _walked(
    text: str,
    plant: str,
    controller: str,
    blocks: tuple[tuple[str, str], ...],
    contract: tuple[str, ...],
    thread: int,
) -> tuple[ClosedLoop, Context, Run]:
    """Diagram, Context and Run at the push; threads do not share diagrams."""
    diagram = simulation.closed_loop(
        yaml_reader.load_typed(Scenario, "walk", data=text),
        plant,
        controller,
        blocks=dict(blocks),
        contract=contract,
    )
    return diagram, *simulation.walk_to_push(diagram)


def _ended(diagram: ClosedLoop, push: Simulator, run: Run) -> Row:
    """Returns the verdict of a `push`; of the `run` to it if that ended early.

    `predicted_at_push` is the least number of steps that capture the point mass
    at the end of the push, -1 for none; None if the push did not end, or for a
    policy, which has no plan.
    """
    scenario, watch = diagram.scenario, RecoveryWatch(diagram)
    has_plan = diagram.HasOutputPort("walking_state")
    at_push: int | None = None

    def decided(context: Context) -> bool:
        nonlocal at_push
        if (
            has_plan
            and at_push is None
            and push_signal(diagram, context).waiting == 0.0
        ):
            at_push = limit_from(
                diagram, context, model=scenario.point_mass(diagram.robot)
            ).least_steps()
        return watch(context)

    if run.until:
        run = simulation.advance(
            push, scenario.duration, stop_at_failure=True, until=decided
        )
    summary = run.summary
    outcome = "fell" if run.fell_at is not None else summary["outcome"]
    return {
        "outcome": "error" if run.error else outcome,
        **{name: summary[name] for name in FROM_SUMMARY},
        "predicted_at_push": at_push,
    }


def limit_from(diagram: ClosedLoop, context: Context, **more: Any) -> LipmLimit:
    """The limit of any controller from an instant of a simulation on.

    Args:
        diagram: of our controller.
        context: the diagram's, at that instant.
        **more: `model`, and other fields of LipmLimit.

    Returns:
        The limit of a point mass.
    """
    state, icp, swing = (
        cast(Any, diagram.GetOutputPort(name).Eval(context))
        for name in ("walking_state", "icp", "swing_foot_reference")
    )
    scenario = diagram.scenario
    return LipmLimit(
        state=state,
        icp=icp,
        foot=swing[:2],
        timing=scenario.controller.timing_adapter,
        on=NAMED[scenario.mechanisms],
        **more,
    )
