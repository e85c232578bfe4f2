"""Arrays of a file, whose sizes are asked before they are read."""

import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from nadia_balance.parameters.bounds import require


def read_npz(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """Reads all arrays of an npz file.

    Args:
        path: of the file.

    Returns:
        The arrays, by name.

    Raises:
        ValueError: an array is of objects, or larger than its file.
        zipfile.BadZipFile: it is no npz file.
        OSError: it cannot be read.
    """
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            with archive.open(entry) as file:
                shape, dtype = _header(file)
            require(
                math.prod(shape) * dtype.itemsize <= entry.file_size,
                f"{entry.filename} says it is {shape}",
            )
    with np.load(path, allow_pickle=False) as data:
        return dict(data)


def _header(file: Any) -> tuple[tuple[int, ...], np.dtype[Any]]:
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    version = np.lib.format.read_magic(file)
    require(version in read, f"is of version {version}")
    shape, _, dtype = read[version](file)
    return shape, dtype
