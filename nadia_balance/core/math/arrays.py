"""Arrays of floats: their type, read-only ones, and small geometry."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def read_only(values: object, size: int) -> Array:
    """Returns a read-only float copy of `values`, shape (size,)."""
    array = np.array(values, dtype=float).reshape(size)
    array.flags.writeable = False
    return array


def rectangle(length: float, width: float) -> Array:
    """Corners (4, 2) [m] of a centred rectangle, counter-clockwise."""
    x, y = 0.5 * length, 0.5 * width
    return np.array([[x, y], [-x, y], [-x, -y], [x, -y]])


def cross(a: Array, b: Array) -> Array:
    """Returns the products a x b (3, ...) of vectors along the first axis."""
    # numpy.cross takes four times as long.
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))
