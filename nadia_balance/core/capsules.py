"""Distances of capsules and spheres, of many pairs at once."""

import numpy as np

from nadia_balance.core.walking import Array

_TINY = 1e-12  # keeps products of lengths from zero: spheres, parallels


class SegmentPairs:
    """Pairs of segments whose lengths do not change, such as of capsules.

    One without length is the centre of a sphere.
    """

    def __init__(self, lengths: Array) -> None:
        """`lengths` (2, k) [m] are those of the first and the second ones."""
        self._aa, self._bb = np.maximum(lengths**2, _TINY)
        self._aabb, self._least = (
            self._aa * self._bb,
            1e-12 * self._aa * self._bb,
        )

    def closest_points(self, begin: Array, way: Array) -> Array:
        """Returns the points (3, 2, k) on each pair that are nearest.

        Segments begin at `begin` (3, 2, k) [m] and end at begin + way.
        Ericson, Real-time collision detection (2005), Sec. 5.1.9.
        """
        da, db = way[:, 0], way[:, 1]
        ab = np.einsum("ik,ik->k", da, db)
        ar, br = np.einsum("ik,ipk->pk", begin[:, 0] - begin[:, 1], way)
        det = np.maximum(self._aabb - ab * ab, self._least)
        shares = np.empty(way.shape[1:])
        s, t = shares
        # Of the lines; then what is next to that on b, and to this on a.
        np.divide(ab * br - self._bb * ar, det, out=s)
        np.minimum(np.maximum(s, 0.0, out=s), 1.0, out=s)
        np.divide(ab * s + br, self._bb, out=t)
        np.minimum(np.maximum(t, 0.0, out=t), 1.0, out=t)
        np.divide(ab * t - ar, self._aa, out=s)
        np.minimum(np.maximum(s, 0.0, out=s), 1.0, out=s)
        return np.asarray(begin + shares * way)


def cross(a: Array, b: Array) -> Array:
    """The products a x b (3, ...), of vectors along the first axis."""
    # numpy's own takes four times as long.
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))
