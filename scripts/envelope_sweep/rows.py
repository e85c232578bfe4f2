"""The rows of a sweep: one per finished trial, in an SQLite database.

A row is on the disk when `add` returns.  One process at a time has a folder.
"""

import contextlib
import csv
import json
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.scripts.envelope_sweep.search import Cell, SearchParams
from nadia_balance.scripts.envelope_sweep.sweep import PROTOCOL

DATABASE = "trials.sqlite"
EXPORTS = ("trials.csv", "costs.csv")
RECOVERED, UNDECIDED = "recovered", "undecided"
# Outcomes without a result: a failure of the program, not of the robot.
NO_ANSWER = ("error", "crashed", "hung")
OUTCOMES = (RECOVERED, "fell", "failed", UNDECIDED, *NO_ANSWER)

_OWN = ("mechanisms", "at", "direction_deg", "delta_v", "replica")
KEY = ("scenario", *_OWN)  # unique in a sweep, and the order of the rows
RESULTS = (
    *("seed", "outcome", "reason", "steps_after_push", "max_icp_error_m"),
    *("max_torque_ratio", "max_joint_speed", "max_torso_tilt_deg"),
    *("max_pelvis_tilt_deg", "com_sag_m", "positive_power_w", "qp_failures"),
    *("predicted_at_push", "predicted_at_touchdowns"),
)
COSTS = ("cpu_s", "wall_s")  # differ between runs of the same trial
_COLUMNS = (*KEY, *RESULTS, *COSTS)
_SHARED = (  # of the identity, in every line of trials.csv
    *("plant", "parameters", "code"),
    *("nadia_balance", "drake", "daqp", "numpy", "python"),
)
_SCHEMA = (
    "CREATE TABLE sweep (identity TEXT NOT NULL)",  # one row, JSON
    f"CREATE TABLE trials ({', '.join(_COLUMNS)}, "
    f"PRIMARY KEY ({', '.join(KEY)}))",
)
# Sets of fewer mechanisms come first.
_ALL = (
    "SELECT * FROM trials ORDER BY scenario, "
    f"instr(',{','.join(NAMED)},', ',' || mechanisms || ','), "
    f"{', '.join(KEY[2:])}"
)
_HINTS = {
    "protocol": " (limits are searched and judged in another way now)",
    "parameters": " (the scenario, its duration or its robot differs)",
    "code": " (the program has changed since)",
}


def cell_of(row: dict) -> Cell:
    """The cell of a row's trial."""
    return Cell(*(row[name] for name in Cell._fields))


def recovered(row: dict) -> bool | None:
    """True if the robot recovered; None if the trial is undecided."""
    return None if row["outcome"] == UNDECIDED else row["outcome"] == RECOVERED


def search_of(identity: dict) -> SearchParams:
    """The parameters of the search of a sweep."""
    return SearchParams(
        **{name: identity[name] for name in vars(SearchParams())}
    )


class Rows:
    """The rows in a folder, which is this process's until the end of `opened`.

    `identity` is what all trials share, see Sweep.identity.
    """

    def __init__(self, path: Path, database: sqlite3.Connection):
        self.path, self._database = path, database
        (text,) = database.execute("SELECT identity FROM sweep").fetchone()
        self.identity: dict = json.loads(text)

    def all(self) -> list[dict]:
        """All rows, sorted by KEY; fewer mechanisms come first."""
        found = self._database.execute(_ALL)
        names = [column[0] for column in found.description]
        return [dict(zip(names, row, strict=True)) for row in found]

    def add(self, row: dict) -> None:
        """Adds a trial; missing values are None, lists become "1;2;3".

        Raises:
            OSError: it cannot be written, or is there already.
        """
        values = [_plain(row.get(name)) for name in _COLUMNS]
        marks = ", ".join("?" * len(values))
        try:
            self._database.execute(
                f"INSERT INTO trials VALUES ({marks})", values
            )
        except sqlite3.Error as error:
            raise OSError(f"{self.path}: {error}") from error

    def export(self, folder: Path) -> None:
        """Writes trials.csv, with the identity in its first line, and costs.

        Raises:
            OSError: a file cannot be written.
        """
        shared = {name: self.identity.get(name) for name in _SHARED}
        common = shared | {"robot": self.identity["robot"]}
        columns = (*_OWN, *RESULTS, "robot", "scenario", *_SHARED)
        head = f"# {json.dumps(self.identity)}\n"
        for name, first, names in (
            (EXPORTS[0], head, columns),
            (EXPORTS[1], "", (*KEY, *COSTS)),
        ):
            with open(folder / name, "w", encoding="utf-8", newline="") as file:
                file.write(first)
                lines = csv.DictWriter(
                    file, names, extrasaction="ignore", lineterminator="\n"
                )
                lines.writeheader()
                lines.writerows(common | row for row in self.all())


@contextlib.contextmanager
def opened(folder: Path, identity: dict | None = None) -> Iterator[Rows]:
    """Yields the rows in `folder`; with an `identity`, creates them if need be.

    Raises:
        ValueError: there are none, they are of another identity or protocol, or
            another process has them.
        OSError: they cannot be written.
    """
    path = folder / DATABASE
    if identity is None and not path.is_file():
        raise ValueError(
            f"folder = {str(folder)!r}: must have a {DATABASE} of a sweep"
        )
    # Each statement is a transaction; the first one takes the lock.
    database = sqlite3.connect(path, timeout=0.0, isolation_level=None)
    with contextlib.closing(database):
        try:
            database.execute("PRAGMA locking_mode = EXCLUSIVE")
            database.execute("BEGIN EXCLUSIVE")
            if identity is not None:
                _create(database, identity)
            database.execute("COMMIT")
            rows = Rows(path, database)
        except (sqlite3.Error, TypeError, json.JSONDecodeError) as error:
            named, rule = f"trials = {path}", f"a {DATABASE} of this program"
            if "locked" in str(error):
                named = f"folder = {str(folder)!r}"
                rule = "in use by no other sweep"
            raise ValueError(f"{named}: must be {rule} ({error})") from None
        ours = rows.identity | {"protocol": PROTOCOL}
        _compare(path, rows.identity, ours if identity is None else identity)
        yield rows


def _create(database: sqlite3.Connection, identity: dict) -> None:
    if not database.execute("SELECT * FROM sqlite_master").fetchone():
        for table in _SCHEMA:
            database.execute(table)
        text = json.dumps(identity)
        database.execute("INSERT INTO sweep VALUES (?)", [text])


def _compare(path: Path, found: dict, asked: dict) -> None:
    """Raises ValueError that names the first field that differs."""
    for name in asked | found:
        if found.get(name) != asked.get(name):
            raise ValueError(
                f"{name} = {asked.get(name)}: must be {found.get(name)} as in "
                f"{path}{_HINTS.get(name, '')}"
            )


def _plain(value: object) -> object:
    if isinstance(value, (list, tuple)):
        return ";".join(map(str, value))
    return " ".join(value.split()) if isinstance(value, str) else value
