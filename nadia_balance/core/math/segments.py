"""Pairs of segments: closest points, and the acceleration of a distance."""

import numpy as np

from nadia_balance.core.math.arrays import Array, cross

_TINY = 1e-12  # lower bound of divisors, for spheres and parallel segments
# Lower bound of the squared sine between axes: on parallel ones, points would
# slide infinitely fast, and be at an end soon.
_SKEW = 0.5


class SegmentPairs:
    """Pairs of segments, such as the axes of capsules.

    `lengths` (2, k) [m] are those of the first and the second segments,
    constant; a segment of length 0 is the centre of a sphere.
    """

    def __init__(self, lengths: Array) -> None:
        self._inverse = 1.0 / np.maximum(lengths, _TINY)
        self._aa, self._bb = np.maximum(lengths**2, _TINY)
        self._aabb = self._aa * self._bb
        self._least = 1e-12 * self._aa * self._bb

    def closest_points(self, begin: Array, way: Array) -> tuple[Array, Array]:
        """Returns the closest points (3, 2, k) [m] of each pair, their axes.

        Segments begin at `begin` (3, 2, k) [m] and end at begin + way.  Axes
        (3, 2, k) are the directions in which the points slide, 0 at an end.
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
        slides = ((shares > 0.0) & (shares < 1.0)) * self._inverse
        return np.asarray(begin + shares * way), np.asarray(slides * way)


def acceleration(
    normal: Array, curvature: Array, axes: Array, w: Array, v: Array, a: Array
) -> Array:
    """Returns the accelerations (k,) [m/s^2] of distances of links.

    `normal` (3, k) points from the second link, B, to the first, A; their
    closest points are 1 / `curvature` (k,) [1/m] = l apart; 0: flat links.  The
    links turn at `w` (3, 2, k) [rad/s]; with them, the points move at `v` and
    accelerate by `a` (3, 2, k) [m/s, m/s^2].  Along `axes` E (3, 2, k) they
    slide at the speeds x that minimise the distance.  With the part u of
    v_A - v_B across the normal n, it is

        n . (a_A - a_B) + u . u / l + min_x (2 b . x + x . G x / l),
        b = +-(n . (w x E) + u . E / l), G = [[1, -c], [-c, 1]], c = E_A . E_B.
    """
    u = v[:, 0] - v[:, 1]
    u -= normal * np.einsum("ik,ik->k", normal, u)
    b_A, b_B = np.einsum("ik,ipk->pk", normal, cross(w, axes)) + (
        curvature * np.einsum("ik,ipk->pk", u, axes)
    )
    c = np.einsum("ik,ik->k", axes[:, 0], axes[:, 1])
    slide = b_A * b_A + b_B * b_B - 2.0 * c * b_A * b_B
    slide /= np.maximum(1.0 - c * c, _SKEW) * np.maximum(curvature, _TINY)
    moved = np.einsum("ik,ik->k", normal, a[:, 0] - a[:, 1])
    return np.asarray(moved + curvature * np.einsum("ik,ik->k", u, u) - slide)
