"""The file trials.csv: one row per finished trial, safe against crashes."""

import contextlib
import csv
import fcntl
import io
import json
import math
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path

from nadia_balance.analysis.lipm_limit import LOST
from nadia_balance.core.bounds import check
from nadia_balance.core.mechanisms import NAMED
from nadia_balance.scripts.envelope_sweep.plan import PROTOCOL, moment_of
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    SearchParams,
    Situation,
)
from nadia_balance.typed_yaml import load_typed

RECOVERED, UNDECIDED = "recovered", "undecided"
# Outcomes without a result: a failure of the program, not of the robot.
NO_ANSWER = ("error", "crashed", "hung")
OUTCOMES = (RECOVERED, "fell", "failed", UNDECIDED, *NO_ANSWER)

_OWN = ("mechanisms", "at", "direction_deg", "delta_v", "replica")
KEY = ("scenario", *_OWN)
RESULTS = (
    *("outcome", "reason", "steps_after_push", "max_icp_error_m"),
    *("max_torque_ratio", "max_joint_speed", "max_torso_tilt_deg"),
    *("max_pelvis_tilt_deg", "com_sag_m", "positive_power_w", "qp_failures"),
    *("predicted_at_push", "predicted_at_touchdowns"),
)
_COMMON = (  # the same in all rows of a file, but for the scenario
    *("robot", "scenario", "plant", "parameters", "code"),
    *("nadia_balance", "drake", "daqp", "numpy", "python"),
)
COLUMNS = (*_OWN, "seed", *RESULTS, *_COMMON)
# Not part of COLUMNS: these values differ between runs of the same trial.
COST_COLUMNS = (*KEY, "cpu_s", "wall_s")
_WHOLE = (
    *("replica", "seed", "steps_after_push", "qp_failures"),
    "predicted_at_push",
)
_FIGURES = (
    *("max_icp_error_m", "max_torque_ratio", "max_joint_speed"),
    *("max_torso_tilt_deg", "max_pelvis_tilt_deg", "com_sag_m"),
    "positive_power_w",
)
_REAL = ("direction_deg", "delta_v", *_FIGURES)
_MEASURED = ("steps_after_push", *_FIGURES, "qp_failures")
_INTEGER = re.compile(r"-?\d{1,9}")
MOST_STEPS = 10  # largest number of steps of capture regions
_TYPES = {**dict.fromkeys(_WHOLE, int), **dict.fromkeys(_REAL, float)}

_HINTS = {
    "protocol": " (limits are searched and judged in another way now)",
    "parameters": " (the scenario, its duration or its robot differs)",
    "code": " (the program has changed since)",
}

Key = tuple[str, str, str, float, float, int]  # the values of KEY


def key_of(row: dict) -> Key:
    """The key of a row, unique in a file."""
    return tuple(row[name] for name in KEY)


def sort_key(row: dict) -> tuple:
    """Sorts by scenario, by mechanisms (fewer first), then by the rest."""
    scenario, mechanisms, *rest = key_of(row)
    return scenario, list(NAMED).index(mechanisms), *rest


def cell_of(row: dict) -> Cell:
    """The cell of a row's trial."""
    situation = Situation(row["scenario"], row["at"])
    return Cell(row["mechanisms"], situation, row["direction_deg"])


def recovered(row: dict) -> bool | None:
    """True if the robot recovered; None if the trial is undecided."""
    return None if row["outcome"] == UNDECIDED else row["outcome"] == RECOVERED


def line_of(row: dict, columns: Sequence[str] = COLUMNS) -> str:
    """Returns `row` as one line; missing values are empty.

    Numbers keep all digits; line breaks become spaces, lists "1;2;3".
    """
    return csv_line(_text(row.get(name)) for name in columns)


def csv_line(cells: Iterable[str]) -> str:
    """Returns the cells as one line, with its end."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerow(cells)
    return buffer.getvalue()


def parse_cells(cells: Sequence[str]) -> dict:
    """Returns the row of these cells; None for an empty number.

    Raises:
        ValueError: too few or too many cells, or one is no number; names it.
    """
    if len(cells) != len(COLUMNS):
        raise ValueError(f"must have {len(COLUMNS)} cells, has {len(cells)}")
    row: dict = {}
    for name, text in zip(COLUMNS, cells, strict=True):
        kind = _TYPES.get(name, str)
        try:
            row[name] = kind(text) if text or kind is str else None
        except ValueError:
            raise ValueError(f"{name} = {text!r}: must be a number") from None
    return row


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, (list, tuple)):
        return ";".join(map(_text, value))
    return " ".join(str(value).split())


class TrialsFile:
    """A trials.csv, and the costs.csv beside it.

    `append` returns when the row is on the disk.
    """

    def __init__(self, path: Path, identity: dict):
        """Opens the files, or creates them; cuts off an incomplete last row.

        Raises:
            ValueError: an existing file has another `identity`, or is no file
                of trials.
            OSError: the files cannot be read or written.
        """
        self.path, self.identity = path, identity
        self._costs, rows = path.with_name("costs.csv"), []
        if path.exists():
            found, rows = read_trials(path)
            _compare(path, found, identity)
            _mend(path)
        else:
            _replace(path, _head(identity))
        if self._costs.exists():
            _mend(self._costs)
        else:
            _replace(self._costs, csv_line(COST_COLUMNS))
        self._rows: dict[Key, dict] = {key_of(row): row for row in rows}

    def rows(self) -> list[dict]:
        """All rows with typed values; None for an unknown number."""
        return list(self._rows.values())

    def append(self, result: dict) -> None:
        """Adds a trial: its key, seed and results, and its costs if known.

        Raises:
            ValueError: the file has this trial already.
            OSError: the file cannot be written.
        """
        line = line_of({**self.identity, **result})
        (cells,) = csv.reader([line], strict=True)
        row = parse_cells(cells)
        if (key := key_of(row)) in self._rows:
            raise ValueError(f"trial = {key}: must not be repeated")
        _append(self.path, line)
        self._rows[key] = row
        _append(self._costs, line_of(result, COST_COLUMNS))

    def finish(self) -> None:
        """Sorts the rows, so that the file does not depend on their order."""
        rows = sorted(self._rows.values(), key=sort_key)
        _replace(self.path, _head(self.identity) + "".join(map(line_of, rows)))


def read_trials(path: Path) -> tuple[dict, list[dict]]:
    """Returns the identity and the rows of a trials.csv, with typed values.

    The file is not changed; an incomplete last row is left out.

    Raises:
        ValueError: it is no file of trials, or has a trial twice.
        OSError: it cannot be read.
    """
    whole = path.read_bytes()
    try:
        first, *lines = whole.decode("utf-8", "replace").split("\n")[:-1]
        identity = json.loads(first.removeprefix("# "))
        columns, *table = csv.reader(lines, strict=True)
        if not isinstance(identity, dict):
            raise ValueError("no identity")
    except (ValueError, csv.Error):
        raise ValueError(
            f"trials = {path}: must be a trials.csv of this program"
        ) from None
    with _naming_the_line(path, 1):
        if (protocol := identity.get("protocol")) != PROTOCOL:
            raise ValueError(
                f"protocol = {protocol}: must be {PROTOCOL}{_HINTS['protocol']}"
            )
        search = _search_of(identity)
    if tuple(columns) != COLUMNS:
        raise ValueError(
            f"trials = {path}: must be a trials.csv of this program"
        )
    rows: dict[Key, dict] = {}
    for number, cells in enumerate(table, start=3):
        with _naming_the_line(path, number):
            row = parse_cells(cells)
            _check_cell(row, search)
            if key_of(row) in rows:
                raise ValueError("must not repeat a trial")
        rows[key_of(row)] = row
    return identity, list(rows.values())


@contextlib.contextmanager
def _naming_the_line(path: Path, number: int) -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise ValueError(f"trials = {path}: line {number}: {error}") from None


def _search_of(identity: dict) -> SearchParams:
    """Raises ValueError that names a missing or invalid field."""
    names = [field.name for field in fields(SearchParams)]
    text = json.dumps({name: identity.get(name) for name in names})
    search = load_typed(SearchParams, "search", data=text)
    check(search)
    return search


def _check_cell(row: dict, search: SearchParams) -> None:
    """Raises ValueError that names a value that no trial can have."""
    if (name := row["mechanisms"]) not in NAMED:
        raise ValueError(
            f"mechanisms = {name!r}: must be one of {', '.join(NAMED)}"
        )
    if (outcome := row["outcome"]) not in OUTCOMES:
        raise ValueError(
            f"outcome = {outcome!r}: must be one of {', '.join(OUTCOMES)}"
        )
    moment_of(row["at"])
    landings = filter(None, row["predicted_at_touchdowns"].split(";"))
    foretold = [
        row["predicted_at_push"],
        *(int(n) if _INTEGER.fullmatch(n) else math.nan for n in landings),
    ]
    for name, least, most, values in (
        ("direction_deg", 0, 360.0, [row["direction_deg"]]),
        ("delta_v", 0, search.largest + 1e-9, [row["delta_v"]]),
        ("replica", 0, 1000, [row["replica"]]),
        *((name, 0, math.inf, _given(row[name])) for name in _MEASURED),
        ("predicted_at_touchdowns", LOST, MOST_STEPS, _given(*foretold)),
    ):
        for value in values:
            if value is None or not least <= value <= most:
                raise ValueError(
                    f"{name} = {value}: must be in [{least}, {most:g}]"
                )


def _given(*values: float | None) -> list[float | None]:
    return [value for value in values if value is not None]


def _head(identity: dict) -> str:
    return f"# {json.dumps(identity)}\n{csv_line(COLUMNS)}"


def _compare(path: Path, found: dict, asked: dict) -> None:
    """Raises ValueError that names the first field that differs."""
    for name in {**asked, **found}:
        if found.get(name) != asked.get(name):
            raise ValueError(
                f"{name} = {asked.get(name)}: must be {found.get(name)} as in "
                f"{path}{_HINTS.get(name, '')}"
            )


def _mend(path: Path) -> None:
    """Cuts off an incomplete last line."""
    with open(path, "rb+") as file:
        whole = file.read()
        file.truncate(whole.rfind(b"\n") + 1)
        os.fsync(file.fileno())


def _append(path: Path, line: str) -> None:
    """Appends `line` in one write, and waits until it is on the disk."""
    with open(path, "ab", buffering=0) as file:
        data = line.encode("utf-8", "replace")
        if file.write(data) != len(data):
            raise OSError(f"{path}: the disk is full")
        os.fsync(file.fileno())


def _replace(path: Path, text: str) -> None:
    """Replaces the file by `text` atomically."""
    draft = path.with_name(f"{path.name}.tmp")
    with open(draft, "wb") as file:
        file.write(text.encode("utf-8", "replace"))
        file.flush()
        os.fsync(file.fileno())
    os.replace(draft, path)


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Locks `folder` against other processes.

    On a file system without locks it has no effect.

    Raises:
        ValueError: another process has the lock.
    """
    directory = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(directory, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f"out = {str(folder)!r}: must not be in use by another sweep"
            ) from None
        except OSError:
            pass
        yield
    finally:
        os.close(directory)
