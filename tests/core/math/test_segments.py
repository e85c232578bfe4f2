"""Oracles: brute force along one segment of each pair, numpy's arrays.

And finite differences, for rates: see tests/robot/test_collision_avoidance.py.
"""

import numpy as np
import pytest

from nadia_balance.core.math.segments import Segment, SegmentPairs, gap_rates

NUM_PAIRS = 200  # of each kind
IDENTITY = np.eye(3, 4)


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


def by_numpy(begin, extent):
    """The same as geometry.c does, all pairs at once: points (3, 2, k)."""
    a, b = extent[:, 0], extent[:, 1]
    aa, bb = np.maximum(np.linalg.norm(extent, axis=0) ** 2, 1e-12)
    ab, apart = dot(a, b), begin[:, 0] - begin[:, 1]
    ar, br = dot(apart, a), dot(apart, b)
    det = np.maximum(aa * bb - ab * ab, 1e-12 * aa * bb)
    s = np.clip((ab * br - bb * ar) / det, 0.0, 1.0)
    t = np.clip((ab * s + br) / bb, 0.0, 1.0)
    s = np.clip((ab * t - ar) / aa, 0.0, 1.0)
    return begin + np.array([s, t]) * extent


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def gaps_of(begin, extent, radius=0.0, pose=IDENTITY, attention=np.inf):
    """The gaps of segments that are on one body, placed there by its pose."""
    ends = zip(begin.reshape(3, -1).T, extent.reshape(3, -1).T, strict=True)
    segments = [Segment(*both, radius=radius, body=0) for both in ends]
    num_pairs = begin.shape[2]
    pairs = [(k, num_pairs + k, attention) for k in range(num_pairs)]
    return SegmentPairs(segments, pairs).near(pose[None])


@pytest.mark.parametrize("kind", KINDS)
def test_points_are_on_the_segments_and_the_nearest(kind):
    """Oracles: brute force, to 1e-9 m of some metres; numpy, in bits."""
    begin, extent = KINDS[kind](np.random.default_rng(0))
    gaps = gaps_of(begin, extent)
    p = gaps[:, 4:10].reshape(-1, 2, 3).transpose(2, 1, 0)
    assert np.array_equal(p, by_numpy(begin, extent))
    lengths = np.linalg.norm(extent, axis=0)
    share = ((p - begin) * extent).sum(axis=0) / np.maximum(lengths, 1e-9) ** 2
    assert np.all((share >= -1e-12) & (share <= 1.0 + 1e-12))
    assert p == pytest.approx(begin + share * extent, abs=1e-12)
    assert gaps[:, 0] == pytest.approx(brute_force(begin, extent), abs=1e-9)


def test_the_gap_is_that_of_surfaces_and_the_near_ones_count():
    """Oracle: the definition, from the points of all pairs."""
    begin, extent = anywhere(np.random.default_rng(1))
    points = by_numpy(begin, extent)
    apart = points[:, 0] - points[:, 1]
    distance = np.linalg.norm(apart, axis=0)
    near = distance < 0.2 + 0.3
    gaps = gaps_of(begin, extent, radius=0.1, attention=0.3)
    assert 10 < len(gaps) < NUM_PAIRS
    assert gaps[:, 0] == pytest.approx(distance[near] - 0.2, abs=1e-15)
    normal = (apart / distance)[:, near].T
    # The rounding of the points, in the direction of a gap of a few mm.
    assert gaps[:, 1:4] == pytest.approx(normal, abs=1e-12)


def test_segments_move_with_their_body():
    """Oracle: the same segments, placed by numpy."""
    rng = np.random.default_rng(2)
    begin, extent = anywhere(rng)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    pose = np.column_stack([R, rng.normal(size=3)])
    placed = np.einsum("ij,jpk->ipk", R, begin) + pose[:, 3, None, None]
    expected = gaps_of(placed, np.einsum("ij,jpk->ipk", R, extent))
    assert gaps_of(begin, extent, pose=pose) == pytest.approx(
        expected, abs=1e-12
    )


def test_rates_are_those_of_points_along_the_normal():
    """Oracle: v + w x r of the closest points, by numpy."""
    rng = np.random.default_rng(3)
    n, m = 20, 4
    gaps, V = rng.normal(size=(n, 12)), rng.normal(size=(m, 6))
    gaps[:, 10:] = rng.integers(0, m, size=(n, 2))
    poses = rng.normal(size=(m, 3, 4))
    first, second = gaps[:, 10:].astype(int).T
    speeds = [
        V[body, 3:] + np.cross(V[body, :3], point - poses[body, :, 3])
        for body, point in ((first, gaps[:, 4:7]), (second, gaps[:, 7:10]))
    ]
    expected = ((speeds[0] - speeds[1]) * gaps[:, 1:4]).sum(axis=1)
    rates, W = gap_rates(gaps, poses, V)
    assert rates == pytest.approx(expected, abs=1e-12)
    by_body = (W[:, 0] * V[first] + W[:, 1] * V[second]).sum(axis=1)
    assert by_body == pytest.approx(expected, abs=1e-12)


def test_no_pairs_have_no_gaps():
    """Oracle: the shapes."""
    assert SegmentPairs([], []).near(IDENTITY[None]).shape == (0, 12)
