"""A sweep: its cells, the search of each limit, and what all trials share.

Pushes are multiples of the resolution.  A push is tried with replicas that
differ slightly, because the outcome of one trial may be chance.  The search
increases the push in strides until it fails, bisects the interval to one
resolution, and then confirms the push it found and the next smaller one tried.
"""

import itertools
import math
from bisect import bisect_left
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

from nadia_balance.core.walking.mechanisms import MECHANISMS, NAMED
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.scenario import AT, Scenario
from nadia_balance.diagrams.simulation import closed_loop
from nadia_balance.parameters.bounds import (
    bounded,
    check,
    check_number,
    parameters,
    require,
)
from nadia_balance.parameters.yaml_writer import dump
from nadia_balance.sweep.trials import (
    LARGEST_PUSH,
    Cell,
    Identity,
    Results,
    Rows,
    Trial,
    digest,
    of_process,
)


@parameters
class SearchParams:
    """Resolution, strides and replicas of a search."""

    resolution: float = bounded(
        0.02, doc="of the limit", least=1e-4, most=1.0, unit="m/s"
    )
    stride: int = bounded(
        8,
        doc="increments before the first failure, in resolutions",
        least=1,
        most=1000,
    )
    replicas: int = bounded(5, doc="of the same push", least=1, most=1000)
    largest: float = bounded(
        3.0, doc="push", above=0.0, most=LARGEST_PUSH, unit="m/s"
    )

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "SearchParams":
        """The parameters that have been given; defaults for all others.

        Args:
            values: by the names of fields, and more.

        Returns:
            The parameters, unchecked.
        """
        return cls(
            **{
                one.name: values[one.name]
                for one in fields(cls)
                if one.name in values
            }
        )

    @property
    def required(self) -> int:
        """Number of replicas that must recover: four in five, rounded up."""
        return -(-4 * self.replicas // 5)

    @property
    def grid(self) -> tuple[float, ...]:
        """Zero and all pushes that may be tried [m/s], to nine decimals."""
        count = math.floor(self.largest / self.resolution * (1.0 + 1e-9))
        return tuple(round(i * self.resolution, 9) for i in range(count + 1))


@dataclass(kw_only=True)
class Sweep:
    """Scenarios with one push each, and all variations of the push.

    Attributes:
        scenarios: by name, all of one robot.
        plant: humanoid, or lipm.
        controller: file of a policy, or `module:Class`, in the place of our
            controller.
        contract: of a policy, files and fields (see policy.contract).
        blocks: `module:Class` by role, in the place of our blocks.
        directions: each in [0, 360) [deg].
        at: moments of the push, as Moment writes them.
        mechanisms: names of NAMED.
        search: of each limit.
        first: push of each cell [m/s].
    """

    scenarios: dict[str, Scenario]
    plant: str = "humanoid"
    controller: str = ""
    contract: tuple[str, ...] = ()
    blocks: dict[str, str] = field(default_factory=dict)
    directions: tuple[float, ...] = (0.0,)
    at: tuple[str, ...] = (AT,)
    mechanisms: tuple[str, ...] = tuple(MECHANISMS)
    search: SearchParams = field(default_factory=SearchParams)
    first: dict[Cell, float] = field(default_factory=dict)

    def validate(self) -> None:
        """Checks the search, the scenarios and their pushes.

        Raises:
            ValueError: names field, value and what is allowed.
        """
        check(self.search)
        least, largest = self.search.resolution, self.search.largest
        require(
            largest >= least,
            f"largest = {largest}: must be >= resolution = {least} m/s",
        )
        for name in ("directions", "at", "mechanisms"):
            values = getattr(self, name)
            require(
                len(values) == len(set(values)) > 0,
                f"{name} = {values}: must be one or more, each once",
            )
        for angle in self.directions:
            check_number("directions", angle, least=0.0, below=360.0)
        for name in self.mechanisms:
            require(
                name in NAMED,
                f"mechanisms = {name!r}: must be one of {', '.join(NAMED)}",
            )
        for name, scenario in self.scenarios.items():
            require(
                len(scenario.pushes) == 1
                and scenario.robot == self.one.robot
                and scenario.seed == self.one.seed
                and scenario.engine == self.one.engine,
                f"scenario_name = {name!r}: must have one push, and the "
                "robot, seed and engine of the other scenarios",
            )
        for cell in self.cells():
            if cell.direction_deg == self.directions[0]:
                check(self.walk(cell, replica=0))

    @property
    def one(self) -> Scenario:
        """A scenario with the robot, engine and seed of all scenarios."""
        return next(iter(self.scenarios.values()))

    def cells(self) -> list[Cell]:
        """The cells whose limits are searched.

        Returns:
            All cells, by situation, mechanisms and direction.
        """
        return [
            Cell(*conditions)
            for conditions in itertools.product(
                self.scenarios, self.at, self.mechanisms, self.directions
            )
        ]

    def attempts(self, cell: Cell, results: Results) -> list[Trial]:
        """The trials to make next.

        Args:
            cell: whose limit is searched.
            results: of its trials until now.

        Returns:
            A batch (see next_batch); empty when done.
        """
        return next_batch(results, self.search, self.first.get(cell, 0.0))

    def build(self, cell: Cell, replica: int) -> ClosedLoop:
        """Builds the diagram of a trial, with blocks of its own.

        Args:
            cell: its conditions.
            replica: from 0 on.

        Returns:
            The diagram, whose push is zero.

        Raises:
            ValueError: a block cannot be made, or does not fit.
        """
        return closed_loop(
            self.walk(cell, replica),
            self.plant,
            self.controller,
            blocks=self.blocks,
            contract=self.contract,
        )

    def try_out(self) -> ClosedLoop:
        """Builds a diagram of each scenario: that checks robot and blocks.

        Returns:
            The last one.

        Raises:
            ValueError: a block cannot be made, or does not fit.
        """
        for cell in {cell.scenario: cell for cell in self.cells()}.values():
            diagram = self.build(cell, replica=0)
        return diagram

    def opened(self, folder: Path) -> AbstractContextManager[Rows]:
        """Opens the rows of this sweep, see Rows.opened.

        Args:
            folder: of the sweep.

        Returns:
            What yields the rows.
        """
        return Rows.opened(folder, self.identity())

    def walk(self, cell: Cell, replica: int) -> Scenario:
        """The scenario of a trial, with a zero push.

        Replica 0 is the scenario of push.py with the same flags; other replicas
        have other seeds, which shift the start slightly, and in odd ones the
        push begins one control period later.

        Args:
            cell: its conditions.
            replica: from 0 on.

        Returns:
            A scenario of its own.
        """
        scenario = self.scenarios[cell.scenario]
        scenario = scenario.with_push(
            direction=0.0, delta_v=0.0, at=cell.at
        ).changed(
            description="",
            mechanisms=cell.mechanisms,
            seed=scenario.seed + replica,
        )
        delay = (replica % 2) * scenario.period(self.plant)
        scenario.pushes[0].delay += delay
        return scenario

    def identity(self) -> Identity:
        """What all trials of a folder share.

        Returns:
            JSON, without the cells.
        """
        # The walks, without what differs between the cells.
        walks = [
            self.walk(Cell(name, AT, "icp_only", 0.0), replica=0)
            for name in self.scenarios
        ]
        return {
            "robot": self.one.robot,
            "scenario": ",".join(self.scenarios),
            "plant": self.plant,
            **asdict(self.search),
            "seed": self.one.seed,
            "parameters": digest(dump(walk).encode() for walk in walks),
            **of_process(self.one, self.controller, self.blocks, self.contract),
        }


class Limit(NamedTuple):
    """Present knowledge of the limit between recovery and fall.

    Attributes:
        recovered: largest push such that the robot recovers from it and from
            every smaller push that was tried [m/s]; 0 if there is none, None if
            no trial was decided.  Before the search is complete, a push counts
            if all its trials until now have recovered.
        failed: smallest push that fails [m/s]; None if no failure is known.
        complete: the search has ended.
    """

    recovered: float | None
    failed: float | None
    complete: bool


def _tried(
    results: Results, search: SearchParams
) -> tuple[dict[float, bool], float | None]:
    """All pushes [m/s] below the smallest that failed, and that.

    True: the push is in doubt, as one replica has not recovered, which others
    may make up for.  An undecided push counts as failed.
    """
    outcomes: dict[float, list[bool | None]] = {}
    for (delta_v, _), recovered in sorted(results.items()):
        outcomes.setdefault(delta_v, []).append(recovered)
    below: dict[float, bool] = {}
    for delta_v, replicas in outcomes.items():
        good, bad = replicas.count(True), replicas.count(False)
        if None in replicas or bad > search.replicas - search.required:
            return below, delta_v
        below[delta_v] = bad > 0 and good < search.required
    return below, None


def next_batch(
    results: Results, search: SearchParams, first: float = 0.0
) -> list[Trial]:
    """The attempts to make next.

    The first push is near `first`, or one stride if that is larger.  Each batch
    is to be complete before the next call: the set of all attempts then depends
    on their outcomes only.

    Args:
        results: of all attempts until now.
        search: its parameters.
        first: push with which it begins [m/s].

    Returns:
        A batch; empty when done.
    """
    grid = search.grid
    below, failed = _tried(results, search)
    # Doubts come first: if these pushes fail, larger ones are not needed.
    for delta_v, is_doubtful in below.items():
        if is_doubtful:
            replica = next(
                i for i in itertools.count() if (delta_v, i) not in results
            )
            return [(delta_v, replica)]
    # Places in the grid.
    lower = bisect_left(grid, max(below, default=0.0))
    upper = len(grid) if failed is None else bisect_left(grid, failed)
    if upper - lower > 1:
        if failed is not None:
            place = (lower + upper) // 2
        elif below:
            place = lower + search.stride
        else:
            place = max(round(first / search.resolution), search.stride)
        return [(grid[min(place, upper - 1)], 0)]
    return [
        (delta_v, replica)
        for delta_v in list(below)[-2:]
        for replica in range(search.required)
        if (delta_v, replica) not in results
    ]


def limit(results: Results, search: SearchParams) -> Limit:
    """The limit that follows from the trials, complete or not.

    Args:
        results: of all attempts until now.
        search: its parameters.

    Returns:
        What is known of it.
    """
    if all(recovered is None for recovered in results.values()):
        return Limit(None, None, False)
    below, failed = _tried(results, search)
    undecided = {v for (v, _), good in results.items() if good is None}
    return Limit(
        recovered=max(
            itertools.takewhile(lambda v: not below[v], below), default=0.0
        ),
        failed=None if failed in undecided else failed,
        complete=not next_batch(results, search),
    )
