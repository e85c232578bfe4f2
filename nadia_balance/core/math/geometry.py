"""The compiled geometry, geometry.c, by ctypes.

A function gets arrays of floats as bytes (`doubles`), which is five times as
fast as their addresses, and writes to new memory (`room`): nothing is shared.
No argument types are declared, as that doubles the time of a call: bytes, int,
`room` and `c_double` are what may be given.
"""

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

FLOAT = np.dtype(float)

_PATH = Path(__file__).with_name("libgeometry.so.1")
_USUAL = 128  # numbers: an array type costs more than its memory


def _library() -> ctypes.PyDLL:
    """The library, whose calls keep Python's lock: they are short.

    Raises:
        ImportError: it has not been built.
    """
    if not _PATH.is_file():
        raise ImportError(
            f"{_PATH} is missing: pip install --editable . builds it"
        )
    return ctypes.PyDLL(str(_PATH))


library: Any = _library()
library.area.restype = ctypes.c_double
library.closest_point.restype = ctypes.c_double
_UsualRoom = ctypes.c_double * _USUAL


def doubles(values: ArrayLike) -> bytes:
    """Floats as C has them, row by row.

    Args:
        values: numbers of any shape.

    Returns:
        8 bytes for each.
    """
    return np.asarray(values, FLOAT).tobytes()


def room(size: int) -> Any:
    """Memory for results.

    Args:
        size: least number of floats.

    Returns:
        A buffer of zeros, for C and for np.ndarray.
    """
    return _UsualRoom() if size <= _USUAL else (ctypes.c_double * size)()
