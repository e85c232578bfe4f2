"""A sweep: its cells, the search of each limit, and what all trials share.

Pushes are multiples of the resolution.  A push is tried with replicas that
differ slightly, because the outcome of one trial may be chance.  The search
increases the push in strides until it fails, bisects the interval to one
resolution, and then confirms the push it found and the next smaller one tried.
"""

import functools
import itertools
import math
from bisect import bisect_left
from dataclasses import asdict, dataclass, field
from typing import NamedTuple

from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.diagrams.scenario import AT, Scenario
from nadia_balance.parameters.bounds import bounded, check
from nadia_balance.parameters.yaml_writer import dump
from nadia_balance.sweep.trials import Cell, Results, Trial, digest, of_process


@dataclass(kw_only=True)
class SearchParams:
    """Resolution, strides and replicas of a search."""

    # Resolution of the limit.
    resolution: float = bounded(0.02, least=1e-4, most=1.0, unit="m/s")
    # Increments before the first failure, in resolutions [-].
    stride: int = bounded(8, least=1, most=1000)
    replicas: int = bounded(5, least=1, most=1000)  # of the same push [-]
    largest: float = 3.0  # no push is larger [m/s]

    @property
    def required(self) -> int:
        """Number of replicas that must recover: four in five, rounded up."""
        return -(-4 * self.replicas // 5)

    @functools.cached_property
    def grid(self) -> tuple[float, ...]:
        """Zero and all pushes that may be tried [m/s], to nine decimals."""
        count = math.floor(self.largest / self.resolution * (1.0 + 1e-9))
        return tuple(round(i * self.resolution, 9) for i in range(count + 1))


@dataclass(kw_only=True)
class Sweep:
    """Scenarios with one push each, and all variations of the push."""

    scenarios: dict[str, Scenario]  # by name, all of one robot
    plant: str = "humanoid"  # or lipm
    controller: str = ""  # file of a policy in the place of our controller
    directions: tuple[float, ...] = (0.0,)  # each in [0, 360) [deg]
    at: tuple[str, ...] = (AT,)  # as Moment writes it
    mechanisms: tuple[str, ...] = tuple(MECHANISMS)
    search: SearchParams = field(default_factory=SearchParams)
    first: dict[Cell, float] = field(default_factory=dict)  # pushes [m/s]

    def validate(self) -> None:
        """Raises ValueError that names field, value and what is allowed."""
        check(self.search)
        for name, scenario in self.scenarios.items():
            given = scenario.robot, scenario.seed, scenario.engine
            shared = self.one.robot, self.one.seed, self.one.engine
            if len(scenario.pushes) != 1 or given != shared:
                own = "the robot, seed and engine of the other scenarios"
                why = f"must have one push, and {own}"
                raise ValueError(f"scenario_name = {name!r}: {why}")
        for cell in self.cells():
            if cell.direction_deg == self.directions[0]:
                check(self.walk(cell, replica=0))

    @property
    def one(self) -> Scenario:
        """A scenario with the robot, engine and seed of all scenarios."""
        return next(iter(self.scenarios.values()))

    def cells(self) -> list[Cell]:
        """Returns all cells, by situation, mechanisms and direction."""
        several = self.scenarios, self.at, self.mechanisms, self.directions
        return [Cell(*one) for one in itertools.product(*several)]

    def attempts(self, cell: Cell, results: Results) -> list[Trial]:
        """Returns the trials of a `cell` to make next; empty when done."""
        return next_batch(results, self.search, self.first.get(cell, 0.0))

    def walk(self, cell: Cell, replica: int) -> Scenario:
        """Returns the scenario of a trial, with a zero push.

        Replica 0 is the scenario of push.py with the same flags; other replicas
        have other seeds, which shift the start slightly, and in odd ones the
        push begins one control period later.
        """
        scenario = self.scenarios[cell.scenario]
        scenario = scenario.with_push(
            direction=0.0, delta_v=0.0, at=cell.at
        ).changed(
            description="",
            mechanisms=cell.mechanisms,
            seed=scenario.seed + replica,
        )
        period = scenario.controller.control_period
        if self.plant == "lipm":
            period = scenario.lipm_period
        scenario.pushes[0].delay += (replica % 2) * period
        return scenario

    def identity(self) -> dict:
        """Returns what all trials of a folder share, as JSON: no cells."""
        # The walks, without what differs between the cells.
        walks = (
            self.walk(Cell(n, AT, "icp_only", 0.0), 0) for n in self.scenarios
        )
        common = [dump(walk).encode() for walk in walks]
        return {
            "robot": self.one.robot,
            "scenario": ",".join(self.scenarios),
            "plant": self.plant,
            **asdict(self.search),
            "seed": self.one.seed,
            "parameters": digest(common),
            **of_process(self.one, self.controller),
        }


class Limit(NamedTuple):
    """Present knowledge of the limit between recovery and fall."""

    # Largest push such that the robot recovers from it and from every smaller
    # push that was tried; 0 if there is none, None if no trial was decided.
    # Before the search is complete, a push counts if all its trials until now
    # have recovered.
    recovered: float | None  # [m/s]
    # The smallest push that fails [m/s]; None if no failure is known.
    failed: float | None
    complete: bool  # the search has ended


def _tried(results: Results, search: SearchParams) -> tuple:
    """All pushes [m/s] below the smallest that failed, and that.

    True: the push is in doubt, as one replica has not recovered, which others
    may make up for.  An undecided push counts as failed.
    """
    outcomes: dict[float, list[bool | None]] = {}
    for (delta_v, _), recovered in sorted(results.items()):
        outcomes.setdefault(delta_v, []).append(recovered)
    below: dict[float, bool] = {}
    for delta_v, several in outcomes.items():
        good, bad = several.count(True), several.count(False)
        if None in several or bad > search.replicas - search.required:
            return below, delta_v
        below[delta_v] = bad > 0 and good < search.required
    return below, None


def next_batch(
    results: Results, search: SearchParams, first: float = 0.0
) -> list[Trial]:
    """Returns the attempts to make next; empty when done.

    The first push is near `first` [m/s], or one stride if that is larger.  Each
    batch is to be complete before the next call: the set of all attempts then
    depends on their outcomes only.
    """
    grid, (below, failed) = search.grid, _tried(results, search)
    # Doubts come first: if these pushes fail, larger ones are not needed.
    for delta_v, doubtful in below.items():
        if doubtful:
            more = ((delta_v, replica) for replica in itertools.count())
            return [next(one for one in more if one not in results)]
    # Places in the grid.
    lower = bisect_left(grid, max(below, default=0.0))
    upper = len(grid) if failed is None else bisect_left(grid, failed)
    if upper - lower > 1:
        place = (lower + upper) // 2
        if failed is None:
            begin = max(round(first / search.resolution), search.stride)
            place = lower + search.stride if below else begin
        return [(grid[min(place, upper - 1)], 0)]
    wanted = itertools.product(list(below)[-2:], range(search.required))
    return [attempt for attempt in wanted if attempt not in results]


def limit(results: Results, search: SearchParams) -> Limit:
    """Returns the limit that follows from `results`, complete or not."""
    if all(recovered is None for recovered in results.values()):
        return Limit(None, None, False)
    below, failed = _tried(results, search)
    sure = itertools.takewhile(lambda v: not below[v], below)
    undecided = {v for (v, _), good in results.items() if good is None}
    failed = None if failed in undecided else failed
    complete = not next_batch(results, search)
    return Limit(max(sure, default=0.0), failed, complete)
