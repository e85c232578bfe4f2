"""Oracle: brute force along one segment of each pair."""

import numpy as np
import pytest

from nadia_balance.core.math.arrays import SegmentPairs

NUM_PAIRS = 200  # of each kind


def brute_force(begin, extent):
    """Distances (k,): a ternary search along the first segments.

    That of a point to the second one is exact, and convex along the first.
    """
    (a, b), (da, db) = begin.swapaxes(0, 1), extent.swapaxes(0, 1)
    square = np.maximum((db * db).sum(axis=0), 1e-300)

    def distance_at(share):
        p = a + share * da - b
        t = np.clip((p * db).sum(axis=0) / square, 0.0, 1.0)
        return np.linalg.norm(p - t * db, axis=0)

    low, high = np.zeros(a.shape[1]), np.ones(a.shape[1])
    for _ in range(80):  # (2/3)^80 = 1e-14
        third = (high - low) / 3.0
        nearer = distance_at(low + third) < distance_at(high - third)
        low = np.where(nearer, low, low + third)
        high = np.where(nearer, high - third, high)
    return distance_at(0.5 * (low + high))


def anywhere(rng):
    """Begins and ways (3, 2, k) of about a metre."""
    return rng.normal(size=(2, 3, 2, NUM_PAIRS))


def along(rng, bend, sign):
    """The second is parallel to the first but for an angle `bend` [rad]."""
    begin, extent = anywhere(rng)
    extent[:, 1] = sign * rng.uniform(0.1, 3.0, NUM_PAIRS) * extent[:, 0]
    extent[:, 1] += bend * rng.normal(size=(3, NUM_PAIRS))
    return begin, extent


def meeting(rng, s, t):
    """The points at these shares of the way are the same on both."""
    begin, extent = anywhere(rng)
    begin[:, 1] = begin[:, 0] + s * extent[:, 0] - t * extent[:, 1]
    return begin, extent


def spheres(rng, *which):
    """These have no length."""
    begin, extent = anywhere(rng)
    extent[:, which] = 0.0
    return begin, extent


KINDS = {
    "any": anywhere,
    "parallel": lambda rng: along(rng, 0.0, 1.0),
    "anti-parallel": lambda rng: along(rng, 0.0, -1.0),
    "almost parallel": lambda rng: along(rng, 1e-7, 1.0),
    "crossing": lambda rng: meeting(rng, *rng.uniform(size=(2, NUM_PAIRS))),
    "end to end": lambda rng: meeting(rng, 1.0, 0.0),
    "end on the middle": lambda rng: meeting(rng, 0.0, 0.5),
    "sphere first": lambda rng: spheres(rng, 0),
    "sphere second": lambda rng: spheres(rng, 1),
    "spheres": lambda rng: spheres(rng, 0, 1),
}


@pytest.mark.parametrize("kind", KINDS)
def test_points_are_on_the_segments_and_the_nearest(kind):
    """Oracle: brute force, to 1e-9 m of some metres."""
    begin, extent = KINDS[kind](np.random.default_rng(0))
    lengths = np.linalg.norm(extent, axis=0)
    p = SegmentPairs(lengths).closest_points(begin, extent)
    share = ((p - begin) * extent).sum(axis=0) / np.maximum(lengths, 1e-9) ** 2
    assert np.all((share >= -1e-12) & (share <= 1.0 + 1e-12))
    assert p == pytest.approx(begin + share * extent, abs=1e-12)
    distance = np.linalg.norm(p[:, 0] - p[:, 1], axis=0)
    assert distance == pytest.approx(brute_force(begin, extent), abs=1e-9)
