"""Execution of a sweep by Dask: the search of each cell, trial by trial."""

import contextlib
import functools
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent import futures

from distributed import Client, LocalCluster
from distributed.comm import get_address_host_port
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from tqdm import tqdm

from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.diagrams import simulation
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.parameters.yaml_reader import load_typed
from nadia_balance.parameters.yaml_writer import dump
from nadia_balance.results.summary import Run
from nadia_balance.sweep.lipm_limit import LipmLimit
from nadia_balance.sweep.search import Sweep
from nadia_balance.sweep.trials import (
    FROM_SUMMARY,
    Cell,
    Results,
    Rows,
    of_process,
    results_of,
)

CONNECT_TIMEOUT = 5.0  # [s]
LOOK = 0.2  # period of the checks whether to stop [s]
MOST_WALKS = 32  # walks that a process keeps, about 10 MB each


@contextlib.contextmanager
def open_workers(
    workers: int, scheduler: str | None = None
) -> Iterator[futures.Executor]:
    """Yields an Executor; what runs at the end of the block is abandoned.

    It has `workers` processes of this machine, or all workers of the Dask
    cluster of the `scheduler`.

    Raises ValueError: no worker, or no such scheduler.
    """
    if scheduler is None:
        if workers < 1:
            raise ValueError(f"workers = {workers}: must be >= 1")
        # The scheduler's pages: at any free port, as 8787 may be taken.
        less = {"dashboard_address": "127.0.0.1:0", "memory_limit": None}
        less |= {"threads_per_worker": 1, "silence_logs": logging.CRITICAL}
        cluster = LocalCluster(n_workers=workers, host="127.0.0.1", **less)
        with cluster, Client(cluster, set_as_default=False) as client:
            client.run(os.setsid)  # Ctrl-C interrupts only this process
            yield client.get_executor(pure=False)
        return
    own = {"timeout": CONNECT_TIMEOUT, "set_as_default": False}
    try:
        get_address_host_port(scheduler)  # or else the Client may hang
        client = Client(scheduler, **own)
    except (OSError, OverflowError, ValueError) as error:
        why = f"must be a Dask scheduler ({error})"
        raise ValueError(f"scheduler = {scheduler!r}: {why}") from None
    with client:
        if not client.nthreads():
            raise ValueError(f"scheduler = {scheduler!r}: must have workers")
        yield client.get_executor(pure=False)


def run_sweep(
    sweep: Sweep,
    rows: Rows,
    executor: futures.Executor,
    stopped: Callable[[], bool] = lambda: False,
) -> bool:
    """Adds to `rows` all trials that they lack; returns True if it was done.

    Each cell is a task of the executor; its rows are added when it ends, so
    that they depend neither on the number of workers nor on their order.  When
    `stopped` returns True, running cells are abandoned.

    Raises RuntimeError: a worker fails; errors of a trial are in its row.
    """
    known = rows.by_cell()
    running = set()
    for cell in sweep.cells():
        task = sweep, rows.identity, cell, results_of(known.get(cell, []))
        running.add(executor.submit(search, *task))
    seldom = 0.5 if sys.stderr.isatty() else 30.0
    with tqdm(total=len(running), unit="limit", mininterval=seldom) as bar:
        while running and not stopped():
            until = LOOK, futures.FIRST_COMPLETED
            ended, running = futures.wait(running, *until)
            for future in ended:
                try:
                    found = future.result()
                except Exception as error:
                    reason = f"{type(error).__name__}: {error}"
                    raise RuntimeError(f"a worker failed: {reason}") from error
                for row in found:
                    rows.add(row)
                bar.update()
    return not running


def search(sweep: Sweep, identity: dict, cell: Cell, known: Results) -> list:
    """Makes the trials that the search of `cell` needs; returns their rows.

    It is repeated from its beginning: the `known` ones are not made again.

    Raises ValueError: this process has another code or robot than `identity`.
    """
    for name, value in of_process(sweep.one, sweep.controller).items():
        if identity.get(name, value) != value:
            why = f"must be {identity[name]}, as when the sweep began"
            raise ValueError(f"{name} = {value}: {why}")
    results: Results = {}
    rows = []
    while batch := sweep.attempts(cell, results):
        for attempt in batch:
            if attempt not in known:
                rows.append(run_trial(sweep, cell, *attempt))
                known |= results_of(rows[-1:])
            results[attempt] = known[attempt]
    return rows


def run_trial(sweep: Sweep, cell: Cell, delta_v: float, replica: int) -> dict:
    """Simulates one push of `delta_v` [m/s], and returns its row.

    The verdict is that of push.py, at the first instant at which it is certain:
    an improper contact, an exceeded limit, or a recovery.  `outcome` is
    recovered, fell, failed (upright, but not recovered), undecided (the run
    ended too early) or error: those of the simulation are not raised.
    """
    walk = sweep.walk(cell, replica)
    row = cell._asdict() | {"delta_v": delta_v, "replica": replica}
    row["seed"] = walk.seed
    system = sweep.plant, sweep.controller, threading.get_ident()
    diagram, walked, run = _walked(dump(walk), *system)
    try:
        push = simulation.pushed(diagram, walked, delta_v, cell.direction_deg)
        row |= _ended(diagram, push, run)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        row |= {"outcome": "error", "reason": reason}
    return row


@functools.lru_cache(MOST_WALKS)
def _walked(text: str, plant: str, controller: str, thread: int) -> tuple:
    """Diagram, Context and Run at the push; threads do not share diagrams."""
    scenario = load_typed(Scenario, "walk", data=text)
    diagram = simulation.closed_loop(scenario, plant, controller)
    return diagram, *simulation.walk_to_push(diagram)


def _ended(diagram: ClosedLoop, push: Simulator, run: Run) -> dict:
    """Returns the verdict of a `push`; of the `run` to it if that ended early.

    `predicted_at_push` is the least number of steps that capture the point mass
    at the end of the push, -1 for none; None if the push did not end, or for a
    policy, which has no plan.
    """
    scenario, watch = diagram.scenario, simulation.RecoveryWatch(diagram)
    plans = diagram.HasOutputPort("walking_state")
    at_push: int | None = None

    def decided(context: Context) -> bool:
        nonlocal at_push
        signal = simulation.push_signal(diagram, context)
        if plans and at_push is None and signal.waiting == 0.0:
            model = scenario.point_mass(diagram.robot)
            at_push = limit_from(diagram, context, model=model).least_steps()
        return watch(context)

    if run.until:
        ends = {"stop_at_failure": True, "until": decided}
        run = simulation.advance(push, scenario.duration, **ends)
    summary = run.summary
    outcome = "fell" if run.fell_at is not None else summary["outcome"]
    return {
        "outcome": "error" if run.error else outcome,
        **{name: summary[name] for name in FROM_SUMMARY},
        "predicted_at_push": at_push,
    }


def limit_from(diagram: ClosedLoop, context: Context, **more) -> LipmLimit:
    """The limit of any controller from the state in `context` on."""
    state, icp, swing = (
        diagram.GetOutputPort(name).Eval(context)
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
