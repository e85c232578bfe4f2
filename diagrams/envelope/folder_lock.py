"""Keeps two programs from writing into one folder."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Keeps others out of `folder`, until the end of this process at most.

    A file system that knows no locks keeps nobody out.

    Raises:
        ValueError: somebody else is in it.
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
