"""The rows of a sweep: a line of trials.csv for each finished trial.

The first line has what all rows share, as JSON: the identity of the sweep.  A
row is on the disk when `add` returns; the last line may be torn after a power
cut, and is left out.
"""

import contextlib
import csv
import hashlib
import io
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self, TextIO, cast

from pydrake.common.yaml import yaml_dump_typed

from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.core.walking.push import Moment
from nadia_balance.diagrams.own_blocks import NONE, file_of, names_class
from nadia_balance.diagrams.scenario import STANDING, Scenario
from nadia_balance.parameters.bounds import require
from nadia_balance.policy.contract import contract_files, is_text
from nadia_balance.results.folder import appearing, locked, write_csv
from nadia_balance.results.versions import versions
from nadia_balance.robot.model import load_robot

TRIALS = "trials.csv"
RECOVERED, UNDECIDED = "recovered", "undecided"
IDENTITY = (
    "robot",
    "scenario",
    "plant",
    "resolution",
    "stride",
    "replicas",
    "largest",
)
BLOCK = "block "  # before the role, in an identity
LARGEST_PUSH = 100.0  # no push is larger [m/s]
OUTCOMES = (RECOVERED, "fell", "failed", UNDECIDED, "error")

Row = dict[str, Any]  # a trial, by the names of COLUMNS
Identity = dict[str, Any]  # what all trials of a sweep share


class Cell(NamedTuple):
    """Conditions of one limit to find, named as the columns of a row.

    Attributes:
        scenario: its name.
        at: when the push begins, as Moment writes it.
        mechanisms: a name of NAMED.
        direction_deg: 0 forward, 90 left, in [0, 360) [deg].
    """

    scenario: str
    at: str
    mechanisms: str
    direction_deg: float

    @classmethod
    def of(cls, row: Row) -> "Cell":
        """The cell of a row's trial.

        Args:
            row: of a trial, or of a limit.

        Returns:
            Its cell.
        """
        return cls(*(row[name] for name in cls._fields))


# Name of the gait's scenario, and when the push begins, as Moment writes it.
Situation = tuple[str, str]
# delta_v [m/s], replica from 0 on.
Trial = tuple[float, int]
# True if the robot recovered; None: undecided, as the run was too short.
Results = dict[Trial, bool | None]

# Columns that are fields of a run's summary.
FROM_SUMMARY = (
    "reason",
    "steps_after_push",
    "max_icp_error_m",
    "max_torque_ratio",
    "max_joint_speed",
    "max_torso_tilt_deg",
    "max_pelvis_tilt_deg",
    "com_sag_m",
    "positive_power_w",
    "qp_failures",
    "max_landing_speed",
    "max_landing_force",
)

DIGITS = 4  # significant ones: what a measured number is worth [-]

KEY = (*Cell._fields, "delta_v", "replica")  # unique, and the order of rows
COLUMNS = (*KEY, "seed", "outcome", *FROM_SUMMARY, "predicted_at_push")
_LATER = {"max_landing_speed", "max_landing_force"}  # older rows lack them
_TEXTS = ("stage", "scenario", "at", "mechanisms", "outcome", "reason")


def with_digits(row: Row, columns: Iterable[str]) -> Row:
    """Rounds measured floats to `DIGITS` digits.

    Another processor, Python or Drake changes the digits beyond them.  A push
    that was tried is no measurement: it stays as it is, to the last bit.

    Args:
        row: of a trial, or of a limit.
        columns: names of what is rounded.

    Returns:
        The rounded row.
    """
    return row | {
        name: float(f"{row[name]:.{DIGITS}g}")
        for name in columns
        if isinstance(row[name], float)
    }


def results_of(rows: list[Row]) -> Results:
    """The results of the search of one cell.

    Args:
        rows: of its trials.

    Returns:
        True for a recovery, None for an undecided trial, by attempt.
    """
    recovered = {RECOVERED: True, UNDECIDED: None}
    return {
        (row["delta_v"], row["replica"]): recovered.get(row["outcome"], False)
        for row in rows
    }


@dataclass
class Rows:
    """The rows in a folder, in the order in which the trials ended.

    Attributes:
        folder: of the sweep.
        identity: what all trials share, see Sweep.identity.
        all: the rows; missing numbers are None.
        file: for `add`.
    """

    FILE: ClassVar[str] = TRIALS
    KEY: ClassVar[tuple[str, ...]] = KEY  # unique, and the order of rows
    COLUMNS: ClassVar[tuple[str, ...]] = COLUMNS
    MEASURED: ClassVar[tuple[str, ...]] = FROM_SUMMARY
    IDENTITY: ClassVar[tuple[str, ...]] = IDENTITY

    folder: Path
    identity: Identity
    all: list[Row]
    file: TextIO | None = None

    def add(self, row: Row) -> None:
        """Adds a trial, which is then on the disk.

        Args:
            row: of the trial; what it lacks of COLUMNS is None.

        Raises:
            OSError: it cannot be written.
        """
        row = with_digits({n: row.get(n) for n in self.COLUMNS}, self.MEASURED)
        row["reason"] = " ".join((row["reason"] or "").split())
        file = cast(TextIO, self.file)
        csv.DictWriter(file, self.COLUMNS, lineterminator="\n").writerow(row)
        file.flush()
        os.fsync(file.fileno())
        self.all.append(row)

    def by_cell(self) -> dict[Cell, list[Row]]:
        """The rows of each cell.

        Returns:
            Cells in the order of their first rows.
        """
        cells: dict[Cell, list[Row]] = {}
        for row in self.all:
            cells.setdefault(Cell.of(row), []).append(row)
        return cells

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Reads the rows in a folder.

        Args:
            folder: of a sweep.

        Returns:
            The rows without a torn last line.

        Raises:
            ValueError: there are none, or of another program.
        """
        path = folder / cls.FILE
        try:
            text = path.read_text(encoding="utf-8")
            first, _, lines = text[: text.rfind("\n") + 1].partition("\n")
            identity = json.loads(first.removeprefix("# "))
            require(
                {*cls.IDENTITY} <= {*identity}, "its first line is of no sweep"
            )
            rows = [
                cls.parsed(line, identity)
                for line in csv.DictReader(io.StringIO(lines))
            ]
            return cls(folder, identity, rows)
        except (
            OSError,
            AttributeError,
            KeyError,
            TypeError,
            ValueError,
            csv.Error,
        ) as error:
            raise ValueError(
                f"{cls.FILE.removesuffix('.csv')} = {path}: must be rows of "
                f"this program ({error})"
            ) from None

    @classmethod
    @contextlib.contextmanager
    def opened(cls, folder: Path, identity: Identity) -> Iterator[Self]:
        """Opens the rows in a folder, to be added to; creates them if need be.

        At the end they are sorted, whatever the order of the trials.

        Args:
            folder: of the sweep.
            identity: what all trials share, see Sweep.identity.

        Yields:
            The rows that are there.

        Raises:
            ValueError: the rows are of another identity, or another process
                has the folder.
            OSError: they cannot be written.
        """
        path = folder / cls.FILE
        with locked(folder):
            rows = (
                cls.read(folder) if path.exists() else cls(folder, identity, [])
            )
            for name in identity | rows.identity:
                require(
                    identity.get(name) == rows.identity.get(name),
                    f"{name} = {identity.get(name)}: must be "
                    f"{rows.identity.get(name)} as in {path}, or --out "
                    "another folder",
                )
            rows._write()  # without a torn line
            with open(path, "a", encoding="utf-8", newline="") as rows.file:
                yield rows
            rows._write()

    def _write(self) -> None:
        """Writes the whole file, or nothing."""
        self.all.sort(key=lambda row: [row[name] for name in self.KEY])
        with appearing(self.folder) as drafts:
            write_csv(
                drafts / self.FILE,
                self.COLUMNS,
                self.all,
                head=f"# {json.dumps(self.identity)}\n",
            )

    @classmethod
    def parsed(cls, line: dict[str, str], identity: Identity) -> Row:
        """The row of a line.

        Args:
            line: texts, by column.
            identity: that of the first line.

        Returns:
            The row.

        Raises:
            ValueError: it is of no trial of this sweep.
        """
        row = trial_of(line)
        require(
            row["scenario"] in identity["scenario"].split(","),
            "a scenario is not of the first line",
        )
        return row


def trial_of(line: dict[str, str]) -> Row:
    """The trial of a line.

    Args:
        line: texts, by column; older ones lack some.

    Returns:
        The row, with all COLUMNS.

    Raises:
        ValueError: it is no trial.
    """
    row: Row = dict.fromkeys(COLUMNS) | numbers(line)
    require(
        [*line] == [n for n in COLUMNS if n in line or n not in _LATER]
        and row["outcome"] in OUTCOMES
        and row["mechanisms"] in NAMED
        and 0.0 <= row["delta_v"] <= LARGEST_PUSH
        and 0.0 <= row["direction_deg"] < 360.0
        and row["replica"] >= 0,
        f"{', '.join(map(str, line.values()))}: is no trial",
    )
    if row["at"] != STANDING:
        Moment.parse(row["at"])
    return row


def numbers(line: dict[str, str]) -> Row:
    """The values of a line's texts.

    Args:
        line: texts, by column.

    Returns:
        Numbers, and what is a text.

    Raises:
        ValueError: a number is none.
    """
    row: Row = {
        name: text if name in _TEXTS else json.loads(text or "null")
        for name, text in line.items()
    }
    require(
        all(
            type(value) in (int, float, type(None))
            for name, value in row.items()
            if name not in _TEXTS
        ),
        f"{', '.join(map(str, line.values()))}: is no trial",
    )
    return row


def of_process(
    scenario: Scenario,
    controller: str = "",
    blocks: Mapping[str, str] | None = None,
    contract: Sequence[str] = (),
) -> dict[str, str]:
    """What the rows of this process depend on, besides the sweep's parameters.

    Args:
        scenario: one of the sweep.
        controller: path of a policy, `module:Class`, or "".
        blocks: `module:Class` by role.
        contract: of a policy, files and fields.

    Returns:
        The versions, and hashes of the robot's files, of the policy and its
        contract, and of the files in which the user's classes are.

    Raises:
        ValueError: there is no such class.
    """
    hashes = {"robot_files": robot_hash(scenario.robot)}
    if controller:
        hashes["controller"] = _hashed(controller)
        if not names_class(controller):
            hashes |= _hashed_contract(controller, contract)
    hashes |= {
        f"{BLOCK}{role}": _hashed(name) for role, name in (blocks or {}).items()
    }
    return versions(scenario.engine) | hashes


def _hashed(name: str) -> str:
    """The name of a policy's file or of a class, and its file's hash."""
    if name == NONE:
        return name
    if names_class(name):
        return f"{name} {digest([file_of(name).read_bytes()])}"
    return f"{Path(name).name} {digest([Path(name).read_bytes()])}"


def _hashed_contract(onnx: str, given: Sequence[str]) -> dict[str, str]:
    """The hash of what a contract is read from besides the ONNX file."""
    parts = contract_files(onnx, given)
    texts = [
        part.encode() if is_text(part) else Path(part).read_bytes()
        for part in parts
    ]
    return {"contract": digest(texts)} if texts else {}


def robot_hash(name: str) -> str:
    """Hashes a robot's files, not their paths.

    Args:
        name: of a model, or of a robot.yaml.

    Returns:
        16 hex digits.
    """
    robot = load_robot(name)
    params = yaml_dump_typed(robot.params)  # type: ignore[no-untyped-call]
    return digest([params.encode(), robot.urdf.read_bytes()])


def digest(parts: Iterable[bytes]) -> str:
    """Hashes the parts and their order.

    Args:
        parts: texts or files.

    Returns:
        16 hex digits.
    """
    return hashlib.sha256(
        b"".join(hashlib.sha256(part).digest() for part in parts)
    ).hexdigest()[:16]
