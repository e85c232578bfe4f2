"""The folder of a run: a new one, locked, whose files appear when whole."""

import contextlib
import fcntl
import itertools
import os
import tempfile
from collections.abc import Iterable, Iterator
from datetime import datetime
from pathlib import Path


@contextlib.contextmanager
def new_folder(
    out: str | os.PathLike | None, name: str, files: Iterable[str]
) -> Iterator[Path]:
    """Yields the folder `out` (see prepare_folder), locked, for new `files`.

    Raises ValueError: a file exists, another run has the lock, or as there.
    """
    with locked(prepare_folder(out, name)) as folder:
        for file in files:
            if (folder / file).exists():
                why = f"must be a folder without {file}"
                raise ValueError(f"out = {str(out)!r}: {why}")
        yield folder


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[Path]:
    """Yields `folder`, which no other process has within the block.

    Raises ValueError: another process has it.
    """
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            why = "must be in use by no other run"
            raise ValueError(f"out = {str(folder)!r}: {why}") from None
        yield folder
    finally:
        os.close(lock)


def prepare_folder(out: str | os.PathLike | None, name: str = "run") -> Path:
    """Creates the folder `out`, by default runs/<date>_<time>_<name>.

    Raises ValueError: it cannot be created, or is not writable.
    """
    now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    folder = first = Path(f"runs/{now}_{name}" if out is None else out)
    try:
        numbers = itertools.count(2)
        while out is None and folder.exists():  # of the same second
            folder = Path(f"{first}_{next(numbers)}")
        folder.mkdir(parents=True, exist_ok=out is not None)
        # A test write also detects a full disk, unlike permissions.
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"x")
            file.flush()
    except (OSError, ValueError, RecursionError) as error:  # too deep
        why = getattr(error, "strerror", None) or str(error)
        what = f"out = {str(folder)!r}: must be a folder to write to"
        raise ValueError(f"{what} ({why})") from error
    return folder


@contextlib.contextmanager
def appearing(folder: Path) -> Iterator[Path]:
    """Yields a temporary folder whose files then move to `folder`, complete.

    Raises OSError: a file cannot be written; then none appears in `folder`.
    """
    with tempfile.TemporaryDirectory(prefix=".", dir=folder) as place:
        drafts = Path(place)
        yield drafts
        for draft in sorted(drafts.iterdir()):
            draft.replace(folder / draft.name)
