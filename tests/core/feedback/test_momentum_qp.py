"""Oracles: quadprog, the exact LIPM, geometry by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.feedback.momentum_qp import (
    IcpFeedbackQp,
    MomentumQpParams,
    feedback_limits,
    momentum_rate,
)
from nadia_balance.core.math.lipm import com_after, icp_after
from nadia_balance.core.math.qp import QpProblem
from nadia_balance.core.walking.state import FootPose
from nadia_balance.parameters.bounds import check
from tests.example_walks import MODEL, OMEGA, SOLE
from tests.qp_examples import by_quadprog

ZERO, NOTHING = np.zeros(2), np.zeros(4)
PERIOD = 0.002
DEFAULTS = MomentumQpParams()


def feedback(error, cop_r=ZERO, kappa_r=ZERO, previous=NOTHING, limits=None):
    vectors = (
        np.array(vector, dtype=float)
        for vector in (error, cop_r, kappa_r, previous)
    )
    limits = limits or feedback_limits(SOLE, 0.0, DEFAULTS)
    return IcpFeedbackQp(DEFAULTS).solve(*vectors, limits)


def cost_rows(error, previous, params):
    """A, b with the cost |A x - b|^2, one weighted term after the other."""
    error = np.array(error)
    total = np.hstack((np.eye(2), np.eye(2)))
    n = np.array([-error[1], error[0]]) / np.linalg.norm(error)
    terms = [
        (params.error_weight, total, params.feedback_gain * error),
        (params.perpendicular_weight, n[None] @ total, np.zeros(1)),
        (params.cop_weight, np.eye(4)[:2], np.zeros(2)),
        (params.ecmp_weight, np.eye(4)[2:], np.zeros(2)),
        (params.rate_weight, total, total @ previous),
    ]
    A = np.vstack([math.sqrt(w) * A_i for w, A_i, _ in terms])
    b = np.concatenate([math.sqrt(w) * b_i for w, _, b_i in terms])
    return A, b


vectors = st.tuples(*[st.floats(-0.3, 0.3, allow_subnormal=False)] * 2)


@given(error=vectors, previous=vectors, cop_r=vectors, kappa_r=vectors)
def test_agrees_with_quadprog(error, previous, cop_r, kappa_r):
    """Oracle: quadprog, which shares no code with us."""
    if math.hypot(*error) < 1e-3:
        error = (0.02, 0.1)
    previous = np.array([*previous, 0.0, 0.0])
    limits = feedback_limits(SOLE, 0.0, DEFAULTS)
    actual = feedback(error, cop_r, kappa_r, previous, limits)
    A, b = cost_rows(error, previous, DEFAULTS)
    shift = limits.C @ np.concatenate((cop_r, kappa_r))
    expected = by_quadprog(
        QpProblem(
            A.T @ A,
            -A.T @ b,
            limits.C,
            limits.lower - shift,
            limits.upper - shift,
        )
    )
    assert actual.result.solved
    assert actual.increments == pytest.approx(expected, abs=1e-9)


def test_an_axis_at_the_soles_edge_leaves_the_other_its_feedback():
    """Oracle: least 10 (x - k e)^2 + 5 (x - y)^2 + x^2, without the effort."""
    y = 0.06 - 0.005 + 0.05  # half a sole less its margin, kappa
    long = feedback_limits(SOLE * [9.0, 1.0], 0.0, DEFAULTS)
    x = (10.0 * 3.0 * 0.04 + 5.0 * y) / 16.0
    actual = feedback((0.04, 0.04), limits=long).ecmp
    assert actual == pytest.approx([x, y], rel=2e-3)


def test_a_tiny_error_does_not_make_the_feedback_jump():
    """Oracle: continuity at zero, where the error has no direction."""
    previous = [0.02, 0.01, 0.0, 0.0]
    at_zero = feedback(ZERO, previous=previous).increments
    for direction in ((1e-7, 0.0), (0.0, 1e-7), (-1e-7, 1e-7)):
        near = feedback(direction, previous=previous).increments
        assert near == pytest.approx(at_zero, abs=1e-6)


def test_if_there_is_no_solution_repeats_the_last_feedback():
    """Oracle: that feedback; a polygon that nothing is inside of."""
    good = feedback_limits(SOLE, 0.0, DEFAULTS)
    upper = good.upper.copy()
    upper[:4] = -1.0  # one metre inside of every edge
    none = good._replace(upper=upper)
    previous = np.array([0.03, 0.0, 0.01, 0.0])
    actual = feedback((0.01, 0.0), (0.1, 0.0), previous=previous, limits=none)
    assert not actual.result.solved
    assert actual.cop == pytest.approx([0.13, 0.0])
    assert actual.ecmp == pytest.approx([0.14, 0.0])


def test_the_icp_error_of_a_pendulum_decays_as_the_gain_says():
    """Oracle: e+ = (e^{wT} - (e^{wT} - 1) K) e for an eCMP that is held."""
    params = MomentumQpParams(rate_weight=0.0)
    qp, limits = IcpFeedbackQp(params), feedback_limits(SOLE, 0.0, params)
    growth = math.exp(OMEGA * PERIOD)
    decay = growth - (growth - 1.0) * params.effective_gain
    icp, start = np.array([0.03, -0.01]), np.array([0.03, -0.01])
    for _ in range(500):
        actual = qp.solve(icp, ZERO, ZERO, NOTHING, limits)
        icp = icp_after(icp, actual.ecmp, OMEGA, PERIOD)
    assert icp == pytest.approx(start * decay**500, rel=1e-8)
    assert np.linalg.norm(icp) < 0.05 * np.linalg.norm(start)


def test_momentum_rate_moves_the_mass_as_the_pendulum():
    """Oracle: second difference of the LIPM's closed form."""
    com, velocity = np.array([0.1, -0.05]), np.array([0.3, 0.2])
    ecmp, h = np.array([0.02, 0.01]), 1e-3
    back, ahead = (com_after(com, velocity, ecmp, OMEGA, t)[0] for t in (-h, h))
    acceleration = (back - 2.0 * com + ahead) / h**2
    actual = momentum_rate(com, ecmp, 0.7, MODEL)
    # Truncation (w h)^2 / 12 = 8e-7 of it, rounding 1e-16 / h^2.
    assert actual[:2] == pytest.approx(90.9 * acceleration, rel=2e-6)
    assert actual[2] == pytest.approx(90.9 * 0.7)


def test_refuses_weights_that_leave_a_gain_below_one():
    """Oracle: K Q_e / (Q_e + effort) < 1; the largest of three is to blame."""
    params = MomentumQpParams(cop_weight=9e4, ecmp_weight=9e4)
    with pytest.raises(ValueError, match="1000.* beside cop_weight = 90000.*0"):
        check(params)


FOOT = FootPose([0.3, -0.2, 0.0], 0.7)
LIMITS = feedback_limits(FOOT.to_world(SOLE), FOOT.yaw, DEFAULTS)


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
