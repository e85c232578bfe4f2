"""Braking of links that approach each other, and distances of capsules."""

from dataclasses import dataclass

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.bounds import bounded

_TINY = 1e-12  # lower bound of divisors, for spheres and parallel segments


@dataclass(kw_only=True)
class CollisionAvoidanceParams:
    """Avoidance of self-collisions.

    Links closer than `attention` are kept `clearance` apart, as a hard limit:
    their distance d decreases no faster than with the dynamics
    (d/dt + rate)^2 (d - clearance) = 0.
    """

    attention: float = bounded(0.08, above=0.0, unit="m")
    # Upper body links closer than this brake early, by a soft task: late
    # braking saturates the arm torques and disturbs the legs.
    arm_attention: float = bounded(0.4, above=0.0, unit="m")
    arm_weight: float = bounded(3.0, least=0.0)
    clearance: float = bounded(0.02, least=0.0, unit="m")
    rate: float = bounded(25.0, above=0.0, unit="1/s")

    def braking(self, distances: Array, rates: Array) -> Array:
        """Returns the least accelerations (k,) [m/s^2] of link distances.

        They solve (d/dt + rate)^2 (d - clearance) = 0 for the `distances` d
        (k,) [m] of links and their `rates` (k,) [m/s].
        """
        room = self.rate * (distances - self.clearance)
        return -self.rate * (2.0 * rates + room)


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
