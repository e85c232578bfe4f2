"""Distances of segments on moving bodies, such as the axes of capsules."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.geometry import FLOAT, doubles, library, room

_TINY = 1e-12  # least squared length [m^2], for spheres


class Segment(NamedTuple):
    """The axis of a capsule, or the centre of a sphere.

    Args:
        begin: its first end (3,) in the frame of the body [m].
        axis: vector (3,) to the other end [m]; 0: a sphere.
        radius: of the capsule or sphere [m].
        body: number of the body.
    """

    begin: Array
    axis: Array
    radius: float
    body: int


# A gap in numbers: distance of the surfaces [m]; normal (3,) from the second to
# the first segment, and the closest points (2, 3) on both [m], in W; the
# numbers of both bodies.
GAP = 12
DISTANCE = 0
BODIES = slice(10, 12)


class SegmentPairs:
    """Pairs of segments, measured in closed form, all at once.

    Minimise |p_0 - p_1| subject to p_i = begin_i + s_i axis_i with s_i in
    [0, 1] (Ericson, Real-time collision detection (2005), Sec. 5.1.9).

    Args:
        segments: on their bodies.
        pairs: their numbers, and the largest distance that counts [m].
    """

    def __init__(
        self,
        segments: Sequence[Segment],
        pairs: Sequence[tuple[int, int, float]],
    ) -> None:
        self._num_segments, self._num_pairs = len(segments), len(pairs)
        self._pairs = doubles(pairs)
        axes = np.array([s.axis for s in segments]).reshape(-1, 3)
        squares = np.maximum(np.linalg.norm(axes, axis=1) ** 2, _TINY)
        self._segments = doubles(
            [
                [*s.begin, *s.axis, square, s.radius, s.body]
                for s, square in zip(segments, squares, strict=True)
            ]
        )

    def near(self, poses: Array) -> Array:
        """The pairs whose distance counts.

        Args:
            poses: [R, p] of the bodies (m, 3, 4) in W; p in [m].

        Returns:
            Gaps (n, GAP), one in each row.
        """
        gaps = room(GAP * self._num_pairs)
        count = library.near_pairs(
            doubles(poses),
            self._segments,
            self._num_segments,
            self._pairs,
            self._num_pairs,
            gaps,
            room(9 * self._num_segments),
        )
        return np.ndarray((count, GAP), FLOAT, gaps)


def gap_rates(
    gaps: Array, poses: Array, velocities: Array
) -> tuple[Array, Array]:
    """How fast distances change.

    Args:
        gaps: n of them (n, GAP).
        poses: [R, p] of the bodies (m, 3, 4) in W; p in [m].
        velocities: [w, v] of the bodies' origins (m, 6) in W.

    Returns:
        The rates (n,) [m/s], and their derivatives (n, 2, 6) by the velocities
        of the first and the second body.
    """
    n = len(gaps)
    rates, W = room(n), room(12 * n)
    library.gap_rates(
        doubles(gaps), n, doubles(poses), doubles(velocities), rates, W
    )
    return np.ndarray(n, FLOAT, rates), np.ndarray((n, 2, 6), FLOAT, W)
