"""A row of the league: what a controller recovers from by push-v1.

Its folder has row.json, a Row, and trials.csv, all trials.
"""

import csv
import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from nadia_balance.diagrams.own_blocks import NONE, file_of, names_class
from nadia_balance.parameters.bounds import bounded, check, parameters, require
from nadia_balance.parameters.yaml_reader import naming, one_line, typed
from nadia_balance.results.folder import appearing, write_csv
from nadia_balance.results.pages import CONTRACT
from nadia_balance.results.versions import versions
from nadia_balance.robot.model import load_robot
from nadia_balance.sweep import push_v1
from nadia_balance.sweep.limits import Record, limit_table, worst_at
from nadia_balance.sweep.report import table
from nadia_balance.sweep.search import Sweep, limit
from nadia_balance.sweep.trials import (
    COLUMNS,
    RECOVERED,
    TRIALS,
    Cell,
    Rows,
    results_of,
    trial_of,
    with_digits,
)
from nadia_balance.sweep.trials import Row as Trial

ROW = "row.json"
OURS = "nadia_balance"  # name of our controller
SCHEMA = "docs/row.schema.json"
MEASURED = {
    "landing_speed": "max_landing_speed",
    "landing_force": "max_landing_force",
    "power": "positive_power_w",
}
_KEY = ("scenario", "fidelity", "engine", "at", "direction_deg")


@parameters
class Program:
    """What was measured: a controller, or a block in the place of ours."""

    name: str = bounded(
        OURS, doc="of the file of a policy, or module:Class, or nadia_balance"
    )
    sha256: str = bounded(
        "", doc="of the file; empty: of this package, at its version"
    )


@parameters
class MeasuredRobot:
    """The robot that was pushed."""

    name: str = bounded(
        "nadia", one_of=tuple(push_v1.ROBOTS), doc="of a model of the package"
    )
    files: dict[str, str] = bounded(dict, doc="sha256 of its files, by name")
    mass: float = bounded(1.0, above=0.0, most=1e4, unit="kg", doc="of it all")
    speed: float = bounded(
        1.0, above=0.0, most=100.0, unit="m/s", doc="sqrt(g z), z of the CoM"
    )


@parameters
class MeasuredLimit:
    """The largest push from one direction, and what ended it there."""

    scenario: str = bounded(
        push_v1.IN_PLACE,
        one_of=(push_v1.IN_PLACE, push_v1.WALKING),
        doc="push: in place; walking: at 0.5 m/s",
    )
    fidelity: str = bounded(
        "realistic", one_of=("realistic", "ideal"), doc="of the drives"
    )
    engine: str = bounded(
        "drake", one_of=("drake", "mujoco"), doc="of the physics"
    )
    at: str = bounded("", doc="when the push begins")
    direction_deg: float = bounded(
        0.0, least=0.0, below=360.0, unit="deg", doc="0 forward, 90 left"
    )
    recovered: float | None = bounded(
        None,
        least=0.0,
        most=100.0,
        unit="m/s",
        doc="largest recovered push; null: it was not pushed, or undecided",
    )
    complete: bool = bounded(False, doc="whether the search has ended")
    froude: float | None = bounded(None, doc="the push over sqrt(g z)")
    impulse: float | None = bounded(None, unit="N s", doc="of the push")
    share: float | None = bounded(
        None, doc="of the limit of a point mass that steps; null if it stands"
    )
    landing_speed: float | None = bounded(
        None, unit="m/s", doc="largest along the ground, of a sole's corner"
    )
    landing_force: float | None = bounded(
        None, doc="largest over 10 ms of a landing, per weight"
    )
    power: float | None = bounded(
        None, unit="W", doc="largest of the drives that do not brake"
    )
    ended_by: str = bounded("", doc="why it failed at the next larger push")

    @property
    def key(self) -> tuple[Any, ...]:
        """What no other limit of the row has."""
        return tuple(getattr(self, name) for name in _KEY)


@parameters
class Row:
    """What a controller recovers from on one robot."""

    protocol: str = bounded(
        push_v1.NAME, one_of=(push_v1.NAME,), doc="by which it was pushed"
    )
    variant: str = bounded(
        push_v1.FULL, one_of=tuple(push_v1.VARIANTS), doc="how much of it"
    )
    who: str = bounded("", doc="has measured it")
    controller: Program = bounded(Program, doc="what balances the robot")
    contract: str = bounded(
        "", doc="of a policy: policy.yaml, its fields with their sources"
    )
    blocks: dict[str, Program] = bounded(
        dict, doc="those in the place of ours, by role"
    )
    robot: MeasuredRobot = bounded(MeasuredRobot, doc="what was pushed")
    versions: dict[str, str] = bounded(dict, doc="of all that determines it")
    seeds: list[int] = bounded(list, doc="of the replicas")
    trials: str = bounded("", doc="sha256 of trials.csv")
    limits: list[MeasuredLimit] = bounded(list, doc="of every cell")
    worst: dict[str, float] = bounded(
        dict,
        doc="least limit in m/s of all moments, realistic, in Drake, by "
        "direction; 0 where it was not even pushed",
    )


def write_row(
    folder: Path, variant: str, sweeps: Mapping[str, Sweep], who: str
) -> Row:
    """Writes the row that follows from the sweeps of the protocol.

    Args:
        folder: of the row, with a folder for each part.
        variant: of the protocol.
        sweeps: its sweeps, by the names of its parts.
        who: has measured it.

    Returns:
        The row.

    Raises:
        ValueError: a folder has no trials.
        OSError: it cannot be written; then nothing is.
    """
    rows = {name: Rows.read(folder / name) for name in sweeps}
    contract = folder / next(iter(sweeps)) / CONTRACT
    first = next(iter(sweeps.values()))
    robot = _robot(first.one.robot)
    limits = [
        _measured(record, sweep, rows[name].by_cell(), robot)
        for name, sweep in sweeps.items()
        for record in limit_table(rows[name], sweep.scenarios).records
    ]
    with appearing(folder) as drafts:
        write_csv(
            drafts / TRIALS,
            ["fidelity", "engine", *COLUMNS],
            (
                {
                    "fidelity": sweep.one.fidelity,
                    "engine": sweep.one.engine,
                    **trial,
                }
                for name, sweep in sweeps.items()
                for trial in rows[name].all
            ),
        )
        row = Row(
            variant=variant,
            who=who,
            controller=_program(first.controller),
            contract=contract.read_text("utf-8") if contract.exists() else "",
            blocks={
                role: _program(name) for role, name in first.blocks.items()
            },
            robot=robot,
            versions={
                package: version
                for sweep in sweeps.values()
                for package, version in versions(sweep.one.engine).items()
            },
            seeds=sorted(
                {trial["seed"] for part in rows.values() for trial in part.all}
            ),
            trials=push_v1.sha256(drafts / TRIALS),
            limits=limits,
            worst=worst_of(limits),
        )
        check(row)
        (drafts / ROW).write_text(
            json.dumps(dataclasses.asdict(row), indent=1) + "\n",
            encoding="utf-8",
        )
    return row


def _robot(name: str) -> MeasuredRobot:
    model = load_robot(name).point_mass
    return MeasuredRobot(
        name=name,
        files=push_v1.robot_files(name),
        mass=model.mass,
        speed=model.froude_speed,
    )


def _measured(
    record: Record,
    sweep: Sweep,
    groups: Mapping[Cell, list[Trial]],
    robot: MeasuredRobot,
) -> MeasuredLimit:
    trials = groups.get(Cell.of(record), [])
    delta_v, largest = record["recovered"], record["limit"]
    share = None if delta_v is None or not largest else delta_v / largest
    return MeasuredLimit(
        scenario=record["scenario"],
        fidelity=sweep.one.fidelity,
        engine=sweep.one.engine,
        at=record["at"],
        direction_deg=record["direction_deg"],
        recovered=delta_v,
        complete=record["complete"] or delta_v is None,
        **with_digits({"share": share}, ["share"]),
        **_from_trials(delta_v, trials, robot),
    )


def _from_trials(
    delta_v: float | None, trials: Sequence[Trial], robot: MeasuredRobot
) -> dict[str, Any]:
    """The fields of a MeasuredLimit that follow from the limit's trials."""
    failed = [row for row in trials if row["outcome"] != RECOVERED]
    first = min(failed, key=lambda row: row["delta_v"], default={})
    worst = worst_at(delta_v, trials, MEASURED.values())
    values: dict[str, Any] = {
        "froude": None if delta_v is None else delta_v / robot.speed,
        "impulse": None if delta_v is None else delta_v * robot.mass,
        **{name: worst[column] for name, column in MEASURED.items()},
    }
    return {
        "ended_by": first.get("reason") or first.get("outcome", ""),
        **with_digits(values, [*values]),
    }


def _program(name: str) -> Program:
    """A controller or block, by its flag."""
    if not name:
        return Program()
    if name == NONE:
        return Program(name=NONE)
    path = file_of(name) if names_class(name) else Path(name)
    return Program(
        name=name if names_class(name) else path.name,
        sha256=push_v1.sha256(path),
    )


def worst_of(limits: list[MeasuredLimit]) -> dict[str, float]:
    """The least limit of all moments.

    Args:
        limits: of a row.

    Returns:
        Limits [m/s] by direction [deg], of realistic drives in Drake; 0 where
        none is known.
    """
    worst: dict[str, float] = {}
    for one in limits:
        if (one.fidelity, one.engine) == ("realistic", "drake"):
            direction = f"{one.direction_deg:g}"
            value = one.recovered or 0.0
            worst[direction] = min(worst.get(direction, value), value)
    return worst


Situation = tuple[str, str, str, str]  # scenario, fidelity, engine, at


def by_situation(row: Row) -> dict[Situation, list[MeasuredLimit]]:
    """The limits of each situation.

    Args:
        row: of the league.

    Returns:
        The limits of all directions.
    """
    groups: dict[Situation, list[MeasuredLimit]] = {}
    for one in row.limits:
        groups.setdefault(one.key[:-1], []).append(one)
    return groups


def lines_of(row: Row) -> list[str]:
    """A table of what a controller recovers from.

    Args:
        row: of the league.

    Returns:
        Its lines, with the mean and the least of all directions.
    """
    cells = []
    for situation, limits in by_situation(row).items():
        speeds = [one.recovered or 0.0 for one in limits]
        cells.append(
            [", ".join(situation), f"{fmean(speeds):.2f}", f"{min(speeds):.2f}"]
        )
    return [
        f"{row.protocol}, {row.variant}: {row.controller.name} on "
        f"{row.robot.name}, largest recovered push [m/s]",
        table(["", "mean", "least"], cells),
    ]


def read_row(folder: Path) -> Row:
    """Reads a row, and checks that it is one of the protocol.

    Args:
        folder: of the row.

    Returns:
        The row, whose limits follow from its trials.

    Raises:
        ValueError: another protocol or robot, a field that is missing or
            unknown, or trials of another row; one line that names it.
        OSError: a file cannot be read.
    """
    path = folder / ROW
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        protocol = tree.get("protocol") if isinstance(tree, dict) else tree
        require(
            protocol == push_v1.NAME,
            f"protocol = {protocol!r}: must be {push_v1.NAME!r}",
        )
        row = typed(Row, tree)
        check(row)
        other = _difference(dataclasses.asdict(row), tree)
        require(not other, f"{other}: must be there, as in {SCHEMA}")
        require(
            row.who.strip() != "",
            f"who = {row.who!r}: must be who has measured it",
        )
        push_v1.check_robot(row.robot.name, row.robot.files)
        ours = _robot(row.robot.name)
        for name in "mass", "speed":
            claim, value = getattr(row.robot, name), getattr(ours, name)
            require(
                math.isclose(claim, value),
                f"robot.{name} = {claim}: must be {value}",
            )
        digest = push_v1.sha256(folder / TRIALS)
        require(
            row.trials == digest,
            f"trials = {row.trials!r}: must be the sha256 of {TRIALS}, "
            f"{digest!r}",
        )
        trials = read_trials(folder)
        errors = [one["reason"] for one in trials if one["outcome"] == "error"]
        require(
            not errors, f"trials ended by an error of a block: {errors[:1]}"
        )
        _check_limits(row, trials)
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(f"row = {path}: {one_line(error)}") from None
    return row


def _difference(value: object, tree: object, path: str = "row") -> str:
    """Path of the first value that the tree lacks, or has otherwise."""
    if isinstance(value, dict) and isinstance(tree, dict):
        parts = (
            (f"{path}.{key}", x, tree.get(key, ...)) for key, x in value.items()
        )
    elif isinstance(value, list) and isinstance(tree, list):
        pairs = zip(value, tree, strict=True)
        parts = ((f"{path}[{i}]", *pair) for i, pair in enumerate(pairs))
    else:
        return "" if value == tree else path
    return next(filter(None, (_difference(x, y, p) for p, x, y in parts)), "")


def read_trials(folder: Path) -> list[Trial]:
    """Reads the trials of a row.

    Args:
        folder: of the row.

    Returns:
        The trials, with `fidelity` and `engine`.

    Raises:
        ValueError: a line is no trial.
        OSError: the file cannot be read.
    """
    trials = []
    with open(folder / TRIALS, encoding="utf-8", newline="") as file:
        for number, line in enumerate(csv.DictReader(file), start=2):
            conditions = {
                name: line.pop(name, "") for name in ("fidelity", "engine")
            }
            with naming(f"{TRIALS}, line {number}"):
                trials.append(conditions | trial_of(line))
    return trials


def _check_limits(row: Row, trials: list[Trial]) -> None:
    """Checks that each cell of the protocol has the limit of its trials."""
    variant = push_v1.VARIANTS[row.variant]
    step = 360.0 / variant.directions
    keys = {
        (part.scenario, part.fidelity, part.engine, at, i * step)
        for part in variant.parts
        for at in part.at
        for i in range(variant.directions)
    }
    require(
        sorted(keys) == sorted(one.key for one in row.limits),
        f"limits: must have each of the {len(keys)} of {push_v1.NAME}, "
        f"{row.variant}, once",
    )
    groups: dict[tuple[Any, ...], list[Trial]] = {}
    for trial in trials:
        groups.setdefault(tuple(trial[n] for n in _KEY), []).append(trial)
    for one in row.limits:
        group, name = groups.get(one.key, []), ", ".join(map(str, one.key))
        results = results_of(group)
        require(
            len(results) == len(group), f"trials of {name}: must be there once"
        )
        reached = limit(results, variant.search)
        require(
            one.recovered == reached.recovered,
            f"limit of {name} = {one.recovered}: must be {reached.recovered}, "
            "as the trials say",
        )
        # Where it was never pushed, there is nothing more to search.
        is_complete = reached.complete or reached.recovered is None
        require(
            one.complete == is_complete,
            f"complete of {name} = {one.complete}: must be {is_complete}, as "
            "the trials say",
        )
        require(
            one.complete, f"complete of {name} = False: the search must end"
        )
        measured = _from_trials(one.recovered, group, row.robot)
        for field, value in measured.items():
            require(
                getattr(one, field) == value,
                f"{field} of {name} = {getattr(one, field)}: must be {value}, "
                "as the trials say",
            )
    require(row.worst == worst_of(row.limits), "worst: must be of the limits")
