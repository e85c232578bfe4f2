"""The folder of a run: a new one, locked, whose files appear when whole."""

import contextlib
import csv
import fcntl
import itertools
import os
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from nadia_balance.parameters.bounds import require


@contextlib.contextmanager
def new_folder(
    out: str | os.PathLike[str] | None, name: str, files: Iterable[str]
) -> Iterator[Path]:
    """Yields a folder for new files, locked within the block.

    Args:
        out: the folder, or None for a new one (see prepare_folder).
        name: part of the name of a new folder.
        files: names of the files that the folder must not have yet.

    Yields:
        The folder.

    Raises:
        ValueError: a file exists, another run has the lock, or the folder
            cannot be made or written to.
    """
    with locked(prepare_folder(out, name)) as folder:
        for file in files:
            require(
                not (folder / file).exists(),
                f"out = {str(out)!r}: must be a folder without {file}",
            )
        yield folder


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[Path]:
    """Yields a folder that no other process has within the block.

    Args:
        folder: an existing folder.

    Yields:
        The same folder.

    Raises:
        ValueError: another process has it.
    """
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f"out = {str(folder)!r}: must be in use by no other run"
            ) from None
        yield folder
    finally:
        os.close(lock)


def prepare_folder(
    out: str | os.PathLike[str] | None, name: str = "run"
) -> Path:
    """Creates a folder, if it does not exist.

    Args:
        out: the folder, by default a new one: runs/<date>_<time>_<name>.
        name: part of the name of a new folder.

    Returns:
        The folder.

    Raises:
        ValueError: it cannot be created, or is not writable.
    """
    folder = first = Path(
        f"runs/{datetime.now():%Y-%m-%d_%H-%M-%S}_{name}"
        if out is None
        else out
    )
    numbers = itertools.count(2)
    try:
        while out is None and folder.exists():  # of the same second
            folder = Path(f"{first}_{next(numbers)}")
        folder.mkdir(parents=True, exist_ok=out is not None)
        # A test write also detects a full disk, unlike permissions.
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"x")
            file.flush()
    except (OSError, ValueError, RecursionError) as error:  # too deep
        raise ValueError(
            f"out = {str(folder)!r}: must be a folder to write to "
            f"({getattr(error, 'strerror', None) or error})"
        ) from error
    return folder


@contextlib.contextmanager
def appearing(folder: Path) -> Iterator[Path]:
    """Yields a temporary folder whose files then move to another, complete.

    Args:
        folder: where the files appear.

    Yields:
        The temporary folder.

    Raises:
        OSError: a file cannot be written; then none appears in `folder`.
    """
    with tempfile.TemporaryDirectory(prefix=".", dir=folder) as place:
        drafts = Path(place)
        yield drafts
        for draft in sorted(drafts.iterdir()):
            draft.replace(folder / draft.name)


def write_csv(
    path: Path,
    columns: Collection[str],
    rows: Iterable[Mapping[str, Any]],
    head: str = "",
) -> None:
    """Writes a CSV.

    Args:
        path: of the file.
        columns: their names.
        rows: values by column.
        head: text before the names.

    Raises:
        OSError: it cannot be written.
        ValueError: a row has a value of no column.
    """
    with open(path, "w", encoding="utf-8", newline="") as file:
        file.write(head)
        lines = csv.DictWriter(file, columns, lineterminator="\n")
        lines.writeheader()
        lines.writerows(rows)
