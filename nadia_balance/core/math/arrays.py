"""Arrays of floats: their type, read-only ones, and a few products."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def read_only(values: object, size: int | tuple[int, int]) -> Array:
    """A read-only copy of numbers.

    Args:
        values: `size` numbers, as an array, a list or a scalar.
        size: length of a vector, or shape of a matrix.

    Returns:
        Floats of this size.
    """
    array = np.array(values, dtype=float).reshape(size)
    array.flags.writeable = False
    return array


def rectangle(length: float, width: float) -> Array:
    """Corners of a rectangle about the origin.

    Args:
        length: along x [m].
        width: along y [m].

    Returns:
        Corners (4, 2) [m], counter-clockwise.
    """
    x, y = 0.5 * length, 0.5 * width
    return np.array([[x, y], [-x, y], [-x, -y], [x, -y]])


def cross(a: Array, b: Array) -> Array:
    """The products a x b of vectors along the first axis.

    It takes a quarter of the time of numpy.cross.

    Args:
        a: vectors (3, ...).
        b: vectors (3, ...).

    Returns:
        Products (3, ...).
    """
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))
