"""Arrays of floats: their type, read-only ones, and small geometry."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TINY = 1e-12  # lower bound of divisors, for spheres and parallel segments


def read_only(values: object, size: int) -> Array:
    """Returns a read-only float copy of `values`, shape (size,)."""
    array = np.array(values, dtype=float).reshape(size)
    array.flags.writeable = False
    return array


def rectangle(length: float, width: float) -> Array:
    """Corners (4, 2) [m] of a centred rectangle, counter-clockwise."""
    x, y = 0.5 * length, 0.5 * width
    return np.array([[x, y], [-x, y], [-x, -y], [x, -y]])


class SegmentPairs:
    """Pairs of segments, such as the axes of capsules.

    `lengths` (2, k) [m] are those of the first and the second segments,
    constant; a segment of length 0 is the centre of a sphere.
    """

    def __init__(self, lengths: Array) -> None:
        self._aa, self._bb = np.maximum(lengths**2, _TINY)
        self._aabb = self._aa * self._bb
        self._least = 1e-12 * self._aa * self._bb

    def closest_points(self, begin: Array, way: Array) -> Array:
        """Returns the closest points (3, 2, k) [m] of each pair.

        Segments begin at `begin` (3, 2, k) [m] and end at begin + way.
        Ericson, Real-time collision detection (2005), Sec. 5.1.9.
        """
        da, db = way[:, 0], way[:, 1]
        ab = np.einsum("ik,ik->k", da, db)
        ar, br = np.einsum("ik,ipk->pk", begin[:, 0] - begin[:, 1], way)
        det = np.maximum(self._aabb - ab * ab, self._least)
        shares = np.empty(way.shape[1:])
        s, t = shares
        # Closest point on line a, then on segment b, then on segment a.
        np.divide(ab * br - self._bb * ar, det, out=s)
        np.minimum(np.maximum(s, 0.0, out=s), 1.0, out=s)
        np.divide(ab * s + br, self._bb, out=t)
        np.minimum(np.maximum(t, 0.0, out=t), 1.0, out=t)
        np.divide(ab * t - ar, self._aa, out=s)
        np.minimum(np.maximum(s, 0.0, out=s), 1.0, out=s)
        return np.asarray(begin + shares * way)


def cross(a: Array, b: Array) -> Array:
    """Returns the products a x b (3, ...) of vectors along the first axis."""
    # numpy.cross takes four times as long.
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))
