"""What is known of every cell of a sweep, and which trial comes next."""

import heapq
from collections.abc import Iterable
from dataclasses import dataclass

from diagrams.envelope.limit_search import SearchParams, next_batch
from diagrams.envelope.sweep_plan import Cell, Trial
from diagrams.envelope.trials_left import trials_left


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a sweep is."""

    done: int  # trials
    total: int  # trials: those done and those foreseen
    complete: int  # cells
    cells: int


class Agenda:
    """Hands out the trials of some cells, and learns from their outcomes.

    The first replicas come first, so that the whole envelope is soon known
    roughly; among equals it is the turn of the cell with the fewest trials.
    """

    def __init__(
        self,
        cells: Iterable[Cell],
        search: SearchParams,
        known: Iterable[tuple[Trial, bool]] = (),
    ):
        """Takes the trials that are `known` as done; others' are ignored."""
        self._search = search
        self._rank = {cell: rank for rank, cell in enumerate(cells)}
        # (level, replica) -> recovered: all that is known of a cell, and what
        # of it the search has been told, in whole batches.
        self._known: dict[Cell, dict] = {cell: {} for cell in self._rank}
        self._told: dict[Cell, dict] = {cell: {} for cell in self._rank}
        self._missing = dict.fromkeys(self._rank, 0)  # of the last batch
        self._left = dict.fromkeys(self._rank, 0)  # as foreseen
        self._heap: list[tuple] = []
        for trial, recovered in known:
            if trial.cell in self._rank:
                key = trial.level, trial.replica
                self._known[trial.cell][key] = recovered
        for cell in self._rank:
            self._go_on(cell)

    def pop(self) -> Trial | None:
        """Returns the next trial to run; None if there is none for now."""
        if not self._heap:
            return None
        *_, cell, level, replica = heapq.heappop(self._heap)
        return Trial(cell=cell, level=level, replica=replica)

    def record(self, trial: Trial, recovered: bool) -> None:
        """Takes note of the outcome of a trial that was handed out."""
        cell = trial.cell
        self._known[cell][trial.level, trial.replica] = recovered
        self._missing[cell] -= 1
        if self._missing[cell] == 0:
            self._go_on(cell)
        else:
            self._left[cell] -= 1

    def progress(self) -> Progress:
        """How far this is; the total becomes exact toward the end."""
        done = sum(map(len, self._known.values()))
        return Progress(
            done=done,
            total=done + sum(self._left.values()),
            complete=sum(not missing for missing in self._missing.values()),
            cells=len(self._rank),
        )

    def _go_on(self, cell: Cell) -> None:
        """Plays the search of `cell` on, until it needs unknown trials."""
        known, told = self._known[cell], self._told[cell]
        missing: list[tuple[int, int]] = []
        while not missing and (batch := next_batch(told, self._search)):
            missing = [key for key in batch if key not in known]
            if not missing:
                told.update({key: known[key] for key in batch})
        for level, replica in missing:
            priority = min(replica, 1), len(known), self._rank[cell]
            heapq.heappush(self._heap, (*priority, cell, level, replica))
        self._missing[cell] = len(missing)
        self._left[cell] = max(len(missing), trials_left(known, self._search))
