"""Runs of the benchmark's tour, in parallel; a row of tours.csv for each."""

from collections.abc import Callable
from concurrent import futures
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

from nadia_balance.diagrams import tour
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.yaml_reader import load_typed
from nadia_balance.parameters.yaml_writer import dump
from nadia_balance.results.folder import appearing
from nadia_balance.results.versions import version_of
from nadia_balance.sweep.report import table
from nadia_balance.sweep.run_trial import check_process, collect
from nadia_balance.sweep.trials import (
    Identity,
    Row,
    Rows,
    digest,
    numbers,
    of_process,
)

TOURS, TABLE = "tours.csv", "tours.md"
MOST_SEEDS = 512  # as many as the benchmark has
RESULT = (
    "survival_s",
    "upright_s",
    "waypoints",
    "position_error_cm",
    "yaw_error_deg",
    "power_w",
)
OUTCOMES = "complete", "fell", "error"


class TourCell(NamedTuple):
    """A run of the tour.

    Attributes:
        stage: one of STAGES.
        seed: its number in the benchmark.
    """

    stage: str
    seed: int


class TourRows(Rows):
    """The rows of tours.csv."""

    FILE: ClassVar[str] = TOURS
    KEY: ClassVar[tuple[str, ...]] = TourCell._fields
    COLUMNS: ClassVar[tuple[str, ...]] = (*KEY, "outcome", "reason", *RESULT)
    MEASURED: ClassVar[tuple[str, ...]] = RESULT
    IDENTITY: ClassVar[tuple[str, ...]] = "robot", "parameters"

    @classmethod
    def parsed(cls, line: dict[str, str], identity: Identity) -> Row:
        """The row of a line.

        Args:
            line: texts, by column.
            identity: that of the first line.

        Returns:
            The row.

        Raises:
            ValueError: it is of no tour.
        """
        row = numbers(line)
        require(
            tuple(line) == cls.COLUMNS
            and row["stage"] in tour.STAGES
            and row["outcome"] in OUTCOMES,
            f"{', '.join(map(str, line.values()))}: is no tour",
        )
        return row


@dataclass(kw_only=True)
class Tour:
    """Runs of the tour.

    Attributes:
        scenario: a robot that stands.
        stages: names of STAGES.
        seeds: from 0 to this number, in each stage.
    """

    scenario: Scenario
    stages: tuple[str, ...]
    seeds: int

    @property
    def scenarios(self) -> dict[str, Scenario]:
        """The scenario, by its name."""
        return {"tour": self.scenario}

    def validate(self) -> None:
        """Checks stages and seeds.

        Raises:
            ValueError: names field, value and what is allowed.
        """
        for stage in self.stages:
            require(
                stage in tour.STAGES,
                f"stages = {stage!r}: must be of {', '.join(tour.STAGES)}",
            )
        require(
            1 <= self.seeds <= MOST_SEEDS,
            f"seeds = {self.seeds}: must be in [1, {MOST_SEEDS}]",
        )

    def cells(self) -> list[TourCell]:
        """The runs.

        Returns:
            All stages of the first seed, and so on.
        """
        return [
            TourCell(stage, seed)
            for seed in range(self.seeds)
            for stage in self.stages
        ]

    def try_out(self) -> ClosedLoop:
        """Builds a diagram: that checks robot and wheel.

        Returns:
            The diagram.

        Raises:
            ValueError: the robot does not fit, or there is no wheel.
        """
        return tour.TourDiagram(self.scenario, self.stages[-1], seed=0)

    def identity(self) -> Identity:
        """What all runs of a folder share.

        Returns:
            JSON.
        """
        return {
            "robot": self.scenario.robot,
            "parameters": digest([dump(self.scenario).encode()]),
            **self.of_process(),
        }

    def of_process(self) -> dict[str, str]:
        """What the rows of this process depend on.

        Returns:
            Versions and hashes.
        """
        return of_process(self.scenario) | {tour.WHEEL: version_of(tour.WHEEL)}

    def opened(self, folder: Path) -> AbstractContextManager[TourRows]:
        """Opens the rows of this sweep, see Rows.opened.

        Args:
            folder: of the sweep.

        Returns:
            What yields the rows.
        """
        return TourRows.opened(folder, self.identity())


def run_tours(
    tours: Tour,
    rows: TourRows,
    executor: futures.Executor,
    stopped: Callable[[], bool] = lambda: False,
) -> bool:
    """Makes all runs that the rows lack.

    Args:
        tours: the runs.
        rows: opened; the runs are added to them.
        executor: makes the runs.
        stopped: once it returns True, running ones are abandoned.

    Returns:
        True if all was done.

    Raises:
        RuntimeError: a worker fails; errors of a run are in its row.
    """
    made = {TourCell(row["stage"], row["seed"]) for row in rows.all}
    text = dump(tours.scenario)
    running = {
        executor.submit(run_cell, text, rows.identity, cell)
        for cell in tours.cells()
        if cell not in made
    }
    return collect(running, rows, stopped, "tour")


def run_cell(text: str, identity: Identity, cell: TourCell) -> list[Row]:
    """Makes a run.

    Args:
        text: YAML of the scenario.
        identity: what all runs share.
        cell: the run.

    Returns:
        Its row.

    Raises:
        ValueError: this process has another code or robot than `identity`.
    """
    scenario = load_typed(Scenario, "tour", data=text)
    whole = Tour(scenario=scenario, stages=(cell.stage,), seeds=1)
    check_process(identity, whole.of_process())
    return [cell._asdict() | tour.run_tour(scenario, *cell)]


def summary(rows: TourRows, stage: str) -> list[str]:
    """The line of a stage in the table.

    Args:
        rows: of the runs.
        stage: one of STAGES.

    Returns:
        The cells: runs, share completed, mean time of survival, and means of
        the errors and of the power.
    """
    runs = [row for row in rows.all if row["stage"] == stage]
    complete = sum(row["outcome"] == "complete" for row in runs)

    def mean(name: str) -> str:
        values = [row[name] for row in runs if row[name] is not None]
        return f"{sum(values) / len(values):.1f}" if values else "-"

    return [
        stage,
        f"{complete} of {len(runs)}",
        *map(mean, RESULT[:2]),
        *map(mean, RESULT[3:]),
    ]


def write_table(rows: TourRows) -> list[str]:
    """Writes the table of the stages into the folder of the rows.

    Args:
        rows: of the runs.

    Returns:
        Its lines.
    """
    lines: list[str] = table(
        (
            "stage",
            "completed",
            "survival [s]",
            "upright [s]",
            "position [cm]",
            "yaw [deg]",
            "power [W]",
        ),
        [
            summary(rows, stage)
            for stage in tour.STAGES
            if any(row["stage"] == stage for row in rows.all)
        ],
    ).splitlines()
    with appearing(rows.folder) as drafts:
        (drafts / TABLE).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return lines
