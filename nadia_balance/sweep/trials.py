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
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TextIO

from pydrake.common.yaml import yaml_dump_typed

from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.core.walking.push import Moment
from nadia_balance.diagrams.scenario import STANDING, Scenario
from nadia_balance.results.folder import appearing, locked
from nadia_balance.results.versions import versions
from nadia_balance.robot.model import load_robot

TRIALS = "trials.csv"
RECOVERED, UNDECIDED = "recovered", "undecided"
IDENTITY = "robot scenario plant resolution stride replicas largest".split()
MOST = 100.0  # no push is larger [m/s]
OUTCOMES = (RECOVERED, "fell", "failed", UNDECIDED, "error")


class Cell(NamedTuple):
    """Conditions of one limit to find, named as the columns of a row."""

    scenario: str  # its name
    at: str  # when the push begins, as Moment writes it
    mechanisms: str  # a name of NAMED
    direction_deg: float  # 0 forward, 90 left, in [0, 360) [deg]

    @classmethod
    def of(cls, row: dict) -> "Cell":
        """The cell of a row's trial."""
        return cls(*(row[name] for name in cls._fields))


# Name of the gait's scenario, and when the push begins, as Moment writes it.
Situation = tuple[str, str]
# delta_v [m/s], replica from 0 on.
Trial = tuple[float, int]
# True if the robot recovered; None: undecided, as the run was too short.
Results = dict[Trial, bool | None]

# Columns that are fields of a run's summary.
FROM_SUMMARY = (
    *("reason", "steps_after_push", "max_icp_error_m", "max_torque_ratio"),
    *("max_joint_speed", "max_torso_tilt_deg", "max_pelvis_tilt_deg"),
    *("com_sag_m", "positive_power_w", "qp_failures"),
)

DIGITS = 4  # significant ones: what a measured number is worth [-]

KEY = (*Cell._fields, "delta_v", "replica")  # unique, and the order of rows
COLUMNS = (*KEY, "seed", "outcome", *FROM_SUMMARY, "predicted_at_push")
_TEXTS = ("scenario", "at", "mechanisms", "outcome", "reason")


def with_digits(row: dict, columns: Iterable[str]) -> dict:
    """Returns a row whose floats in `columns` have `DIGITS` digits.

    Another processor, Python or Drake changes the digits beyond them.  A push
    that was tried is no measurement: it stays as it is, to the last bit.
    """
    measured = {
        name: float(f"{row[name]:.{DIGITS}g}")
        for name in columns
        if isinstance(row[name], float)
    }
    return {**row, **measured}


def results_of(rows: list[dict]) -> Results:
    """The results of the search of one cell, by its rows."""
    good = {RECOVERED: True, UNDECIDED: None}
    ended = {(r["delta_v"], r["replica"]): r["outcome"] for r in rows}
    return {attempt: good.get(how, False) for attempt, how in ended.items()}


@dataclass
class Rows:
    """The rows in a folder, in the order in which the trials ended."""

    folder: Path
    identity: dict  # what all trials share, see Sweep.identity
    all: list[dict]  # missing numbers are None
    file: TextIO | None = None  # for `add`

    def add(self, row: dict) -> None:
        """Adds a trial; raises OSError if it cannot be written."""
        row = {k: row.get(k) for k in COLUMNS}
        row["reason"] = " ".join((row["reason"] or "").split())
        row = with_digits(row, FROM_SUMMARY)
        csv.DictWriter(self.file, COLUMNS, lineterminator="\n").writerow(row)
        self.file.flush()
        os.fsync(self.file.fileno())
        self.all.append(row)

    def by_cell(self) -> dict[Cell, list[dict]]:
        """The rows of each cell."""
        cells: dict[Cell, list[dict]] = {}
        for row in self.all:
            cells.setdefault(Cell.of(row), []).append(row)
        return cells

    @classmethod
    def read(cls, folder: Path) -> "Rows":
        """The rows in a folder; ValueError: none, or of another program."""
        path = folder / TRIALS
        try:
            text = path.read_text(encoding="utf-8")
            first, _, lines = text[: text.rfind("\n") + 1].partition("\n")
            identity = json.loads(first.removeprefix("# "))
            if not {*IDENTITY} <= {*identity}:
                raise ValueError("its first line is of no sweep")
            found = list(csv.DictReader(io.StringIO(lines)))
            rows = list(map(_parsed, found))
            known = identity["scenario"].split(",")
            if any(row["scenario"] not in known for row in rows):
                raise ValueError("a scenario is not of the first line")
            return cls(folder, identity, rows)
        except (
            *(OSError, AttributeError, KeyError, TypeError, ValueError),
            csv.Error,
        ) as error:
            why = f"must be rows of this program ({error})"
            raise ValueError(f"trials = {path}: {why}") from None

    @classmethod
    @contextlib.contextmanager
    def opened(cls, folder: Path, identity: dict) -> Iterator["Rows"]:
        """Yields the rows in `folder`, to be added to; creates them if need be.

        At the end they are sorted, whatever the order of the trials.

        Raises ValueError: the rows are of another identity, or another process
        has the folder.  Raises OSError: they cannot be written.
        """
        with locked(folder):
            rows = cls(folder, identity, [])
            if (folder / TRIALS).exists():
                rows = cls.read(folder)
            for name in identity | rows.identity:
                asked, found = identity.get(name), rows.identity.get(name)
                if asked != found:
                    where = f"in {folder / TRIALS}, or --out another folder"
                    what = f"{name} = {asked}: must be {found} as"
                    raise ValueError(f"{what} {where}")
            rows._write()  # without a torn line
            file = folder / TRIALS
            with open(file, "a", encoding="utf-8", newline="") as rows.file:
                yield rows
            rows._write()

    def _write(self) -> None:
        """Writes the whole file, or nothing."""
        self.all.sort(key=lambda row: [row[name] for name in KEY])
        with (
            appearing(self.folder) as drafts,
            open(drafts / TRIALS, "w", encoding="utf-8", newline="") as file,
        ):
            file.write(f"# {json.dumps(self.identity)}\n")
            lines = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            lines.writeheader()
            lines.writerows(self.all)


def _parsed(line: dict[str, str]) -> dict:
    row = {
        name: text if name in _TEXTS else json.loads(text or "null")
        for name, text in line.items()
    }
    numbers = [value for name, value in row.items() if name not in _TEXTS]
    if not (
        tuple(line) == COLUMNS
        and row["outcome"] in OUTCOMES
        and row["mechanisms"] in NAMED
        and all(type(x) in (int, float, type(None)) for x in numbers)
        and 0.0 <= row["delta_v"] <= MOST
        and 0.0 <= row["direction_deg"] <= 360.0
        and row["replica"] >= 0
    ):
        raise ValueError(f"{', '.join(map(str, line.values()))}: is no trial")
    if row["at"] != STANDING:
        Moment.parse(row["at"])
    return row


def of_process(scenario: Scenario, controller: str = "") -> dict[str, str]:
    """Returns the versions of this process, its robot's and its policy's hash.

    Args:
        scenario: one of the sweep.
        controller: path of a policy, or "".
    """
    found = versions(scenario.engine)
    found |= {"robot_files": robot_hash(scenario.robot)}
    if controller:
        policy = Path(controller)
        found |= {
            "controller": f"{policy.name} {digest([policy.read_bytes()])}"
        }
    return found


def robot_hash(name: str) -> str:
    """Returns a hash (16 hex digits) of a robot's files, not of their paths."""
    robot = load_robot(name)
    params = yaml_dump_typed(robot.params).encode()
    return digest([params, robot.urdf.read_bytes()])


def digest(parts: Iterable[bytes]) -> str:
    """Returns a hash (16 hex digits) of the parts and their order."""
    whole = b"".join(hashlib.sha256(part).digest() for part in parts)
    return hashlib.sha256(whole).hexdigest()[:16]
