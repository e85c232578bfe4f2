"""trials.csv: a row for every finished trial, safe against a sudden end."""

import contextlib
import csv
import json
import math
import os
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.moment import Moment
from diagrams.envelope.trial_rows import (
    COLUMNS,
    COST_COLUMNS,
    Key,
    csv_line,
    key_of,
    line_of,
    parse_cells,
    sort_key,
)
from diagrams.mechanisms import MECHANISMS

_HINTS = {
    "parameters": " (the scenario, its duration or its robot differs)",
    "code": " (the program has changed since)",
}


class TrialsFile:
    """A trials.csv, and the costs.csv beside it.

    A row is on the disk as soon as `append` returns, whatever happens to the
    process after that.
    """

    def __init__(self, path: Path, identity: dict):
        """Opens the files, or makes them.

        A row that was torn while it was written is cut off.

        Raises:
            ValueError: what is there has another `identity`, or is no file of
                trials.
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
        """All rows with typed values; None where a number is not known."""
        return list(self._rows.values())

    def append(self, result: dict) -> None:
        """Adds a trial: its key, seed and results, and its costs if known.

        Raises:
            ValueError: the file has this trial already.
            OSError: the disk is full, or gone.
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
        """Sorts the rows, so that they do not tell in what order they came."""
        rows = sorted(self._rows.values(), key=sort_key)
        _replace(self.path, _head(self.identity) + "".join(map(line_of, rows)))


def read_trials(path: Path) -> tuple[dict, list[dict]]:
    """Returns the identity and the rows of a trials.csv, with typed values.

    Nothing is changed; a row that was torn at the end is left out.

    Raises:
        ValueError: it is no file of trials, or has a trial twice.
        OSError: it cannot be read.
    """
    whole = path.read_bytes()
    try:
        first, *lines = whole.decode("utf-8", "replace").split("\n")[:-1]
        identity = json.loads(first.removeprefix("# "))
        columns, *table = csv.reader(lines, strict=True)
        if not isinstance(identity, dict) or tuple(columns) != COLUMNS:
            raise ValueError("other columns")
    except (ValueError, csv.Error):
        raise ValueError(
            f"trials = {path}: must be a trials.csv of this program"
        ) from None
    with _naming_the_line(path, 1):
        search = _search_of(identity)
    rows: dict[Key, dict] = {}
    for number, cells in enumerate(table, start=3):
        with _naming_the_line(path, number):
            row = parse_cells(cells)
            _check_key(row, search)
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
    """Raises ValueError naming a field that is missing or makes no sense."""
    found = {}
    for field in fields(SearchParams):
        kind, value = type(field.default), identity.get(field.name)
        if not isinstance(value, int | kind):
            raise ValueError(
                f"{field.name} = {value!r}: must be of type {kind.__name__}"
            )
        found[field.name] = value
    search = SearchParams(**found)
    search.validate()
    return search


def _check_key(row: dict, search: SearchParams) -> None:
    """Raises ValueError naming a cell that no trial of a search has."""
    if (name := row["mechanisms"]) not in MECHANISMS:
        raise ValueError(
            f"mechanisms = {name!r}: must be one of {', '.join(MECHANISMS)}"
        )
    try:
        Moment.parse(text := row["phase"])
    except ValueError:
        raise ValueError(
            f'phase = {text!r}: must be like "right swing 25 %"'
        ) from None
    for name, least, most in (
        ("direction_deg", 0.0, 360.0),
        ("delta_v", 0.0, search.largest + 1e-9),
        ("replica", 0, math.inf),
    ):
        if (value := row[name]) is None or not least <= value <= most:
            raise ValueError(
                f"{name} = {value}: must be in [{least:g}, {most:g}]"
            )


def _head(identity: dict) -> str:
    return f"# {json.dumps(identity)}\n{csv_line(COLUMNS)}"


def _compare(path: Path, found: dict, asked: dict) -> None:
    """Raises ValueError naming the first field that differs."""
    for name in {**asked, **found}:
        if found.get(name) != asked.get(name):
            raise ValueError(
                f"{name} = {asked.get(name)}: must be {found.get(name)} as in "
                f"{path}{_HINTS.get(name, '')}"
            )


def _mend(path: Path) -> None:
    """Cuts off a last line that was not written to its end."""
    with open(path, "rb+") as file:
        whole = file.read()
        file.truncate(whole.rfind(b"\n") + 1)
        os.fsync(file.fileno())


def _append(path: Path, line: str) -> None:
    """Writes in one piece, and waits until it is on the disk."""
    with open(path, "ab", buffering=0) as file:
        data = line.encode("utf-8", "replace")
        if file.write(data) != len(data):
            raise OSError(f"{path}: the disk is full")
        os.fsync(file.fileno())


def _replace(path: Path, text: str) -> None:
    """Puts `text` in place of the file at once, or not at all."""
    draft = path.with_name(f"{path.name}.tmp")
    with open(draft, "wb") as file:
        file.write(text.encode("utf-8", "replace"))
        file.flush()
        os.fsync(file.fileno())
    os.replace(draft, path)
