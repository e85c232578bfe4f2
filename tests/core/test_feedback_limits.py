"""Oracles: the limits by hand, brute force."""

import math

import numpy as np
import pytest

from nadia_balance.core.feedback_limits import feedback_limits
from nadia_balance.core.polygon import contains
from nadia_balance.core.walking import FootPose, rectangle

SOLE = rectangle(0.25, 0.12)
FOOT = FootPose([0.3, -0.2, 0.0], 0.7)
LIMITS = feedback_limits(FOOT.to_world(SOLE), FOOT.yaw, 0.005, 0.05)


def allowed(cop, kappa):
    """True if the rows allow this CoP and total kappa."""
    value = LIMITS.C @ np.concatenate((cop, kappa))
    return bool(np.all((LIMITS.lower <= value) & (value <= LIMITS.upper)))


def test_allows_the_cop_in_the_shrunk_sole_and_kappa_in_the_turned_box():
    """Oracle: the same, asked in the frame of the foot."""
    rng = np.random.default_rng(0)
    outcomes = set()
    for _ in range(500):
        cop_F = rng.uniform(-0.15, 0.15, 2)
        kappa_F = rng.uniform(-0.08, 0.08, 2)
        inside = bool(np.all(np.abs(cop_F) <= [0.12, 0.055]))
        small = bool(np.all(np.abs(kappa_F) <= 0.05))
        cop, kappa = FOOT.to_world(cop_F), FOOT.rotation @ kappa_F
        assert allowed(cop, kappa) is (inside and small)
        outcomes.add((inside, small))
    assert len(outcomes) == 4


def test_pads_the_rows_to_a_fixed_number():
    """Oracle: eight edges and two axes, whatever the polygon."""
    for corners in (SOLE, SOLE[:3]):
        limits = feedback_limits(corners, 0.0, 0.0, 0.05)
        assert limits.C.shape == (10, 4)
        idle = ~limits.C.any(axis=1)
        assert idle.sum() == 8 - len(corners)
        assert np.all(np.isinf(limits.upper[idle]))


def test_the_safe_distance_is_kept_from_every_edge():
    """Oracle: the distances between the polygon's sides."""
    polygon = feedback_limits(SOLE, 0.0, 0.01, 0.05).polygon
    assert np.ptp(polygon, axis=0) == pytest.approx([0.23, 0.10], abs=1e-12)


def test_clipping_leaves_alone_what_is_allowed_and_moves_the_rest_inside():
    """Oracle: the limits themselves."""
    rng = np.random.default_rng(1)
    reference = np.concatenate((FOOT.p_WF[:2], [0.01, 0.0]))
    for _ in range(200):
        wanted = rng.normal(scale=0.06, size=4)
        clipped = LIMITS.clipped(wanted, reference)
        total, before = reference + clipped, reference + wanted
        assert contains(total[:2], LIMITS.polygon, tolerance=1e-12)
        assert np.all(np.abs(LIMITS.axes @ total[2:]) <= 0.05 + 1e-12)
        if allowed(before[:2], before[2:]):
            assert clipped == pytest.approx(wanted, abs=1e-15)


def test_refuses_a_polygon_that_the_safe_distance_uses_up():
    """Oracle: half of the width."""
    with pytest.raises(ValueError, match="nothing is left"):
        feedback_limits(SOLE, 0.0, 0.06, 0.05)
    assert math.isfinite(feedback_limits(SOLE, 0.0, 0.059, 0.05).lower[-1])
