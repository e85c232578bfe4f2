"""Oracles: KKT by numpy, quadprog, geometry of Fig. 3, the exact LIPM."""

import math

import numpy as np
import pytest
import quadprog
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.feedback_limits import FeedbackLimits, feedback_limits
from nadia_balance.core.lipm import com_after, icp_after
from nadia_balance.core.momentum_qp import (
    IcpFeedbackQp,
    MomentumQpParams,
    momentum_rate,
)
from nadia_balance.core.polygon import contains, project
from nadia_balance.core.walking import FootPose, rectangle

SOLE = rectangle(0.25, 0.12)
ZERO, NOTHING = np.zeros(2), np.zeros(4)
OMEGA, PERIOD = 3.15, 0.002
DEFAULTS = MomentumQpParams()
# The solver's rows hold to 1e-9 m.
ROUNDING = 2e-9


def limits_of(params, support=SOLE, heading=0.0) -> FeedbackLimits:
    return feedback_limits(
        support, heading, params.cop_safe_distance, params.max_kappa
    )


def feedback(
    error,
    params=DEFAULTS,
    *,
    cop_r=ZERO,
    kappa_r=ZERO,
    previous=NOTHING,
    limits=None,
):
    return IcpFeedbackQp(params).solve(
        np.array(error, dtype=float),
        np.array(cop_r, dtype=float),
        np.array(kappa_r, dtype=float),
        np.array(previous, dtype=float),
        limits or limits_of(params),
    )


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


def angle_to(error, found) -> float:
    """Angle [rad] between the feedback and the error."""
    total = found.increments[:2] + found.increments[2:]
    cross = error[0] * total[1] - error[1] * total[0]
    return abs(math.atan2(cross, total @ np.array(error)))


vectors = st.tuples(
    st.floats(-0.3, 0.3, allow_subnormal=False),
    st.floats(-0.3, 0.3, allow_subnormal=False),
)


@pytest.mark.parametrize("error", [(0.004, 0.003), (0.0, -0.009)])
def test_without_active_limits_solves_the_normal_equations(error):
    """Oracle: KKT by numpy.linalg.solve of the sum of squared terms."""
    previous = np.array([0.01, -0.004, 0.002, 0.001])
    A, b = cost_rows(error, previous, DEFAULTS)
    expected = np.linalg.solve(A.T @ A, A.T @ b)
    found = feedback(error, previous=previous)
    assert not found.result.active.any()
    # Condition number 1e6 times rounding, on 1e-2 m.
    assert found.increments == pytest.approx(expected, abs=1e-11)


@given(error=vectors, previous=vectors, cop_r=vectors, kappa_r=vectors)
def test_agrees_with_quadprog(error, previous, cop_r, kappa_r):
    """Oracle: quadprog, which shares no code with us; 1e-7 m."""
    if math.hypot(*error) < 1e-3:
        error = (0.02, 0.1)
    previous = np.array([*previous, 0.0, 0.0])
    limits = limits_of(DEFAULTS)
    found = feedback(
        error, cop_r=cop_r, kappa_r=kappa_r, previous=previous, limits=limits
    )
    A, b = cost_rows(error, previous, DEFAULTS)
    shift = limits.C @ np.concatenate((cop_r, kappa_r))
    C = np.vstack((-limits.C, limits.C))
    d = np.concatenate((shift - limits.upper, limits.lower - shift))
    real = np.isfinite(d)
    expected, *_ = quadprog.solve_qp(A.T @ A, A.T @ b, C[real].T, d[real])
    assert found.result.solved
    assert not found.result.fallback
    assert found.increments == pytest.approx(expected, abs=1e-7)


@given(error=vectors, previous=vectors, cop_r=vectors, kappa_r=vectors)
def test_keeps_the_limits_wherever_the_reference_is(
    error, previous, cop_r, kappa_r
):
    """Oracle: point in polygon; the box of kappa; eCMP = CoP + kappa."""
    params = MomentumQpParams(max_kappa=0.04)
    foot = FootPose([0.1, 0.0, 0.0], 0.5)
    limits = limits_of(params, foot.to_world(SOLE), foot.yaw)
    found = feedback(
        error,
        params,
        cop_r=cop_r,
        kappa_r=kappa_r,
        previous=[*previous, 0.0, 0.0],
        limits=limits,
    )
    kappa_F = foot.rotation.T @ (found.ecmp - found.cop)
    assert found.result.solved
    assert contains(found.cop, limits.polygon, tolerance=ROUNDING)
    assert np.abs(kappa_F).max() <= 0.04 + ROUNDING
    assert found.result.violation <= ROUNDING


@pytest.mark.parametrize("cop_r", [(0.0, 0.0), (0.1, 0.04)])
@pytest.mark.parametrize("error", [(0.1, 0.05), (0.02, -0.1)])
def test_fig_3_right_feedback_points_along_the_error(cop_r, error):
    """Oracle: the angle falls like 1 / Q_perp, at active limits too."""
    angles = []
    for weight in (1e4, 1e5, 1e6, 1e7):
        params = MomentumQpParams(perpendicular_weight=weight)
        found = feedback(error, params, cop_r=cop_r)
        assert found.result.active[:8].any()
        angles.append(angle_to(error, found))
    assert all(b < 0.2 * a for a, b in zip(angles, angles[1:], strict=False))
    assert angles[-1] < 1e-3


def test_fig_3_right_the_cop_is_where_the_ray_leaves_the_sole():
    """Oracle: intersection of the ray with the front edge, by hand."""
    params = MomentumQpParams(
        perpendicular_weight=1e9, max_kappa=0.0, cop_safe_distance=0.0
    )
    found = feedback((0.1, 0.03), params)
    # x = 0.125 at the toes; with Q_perp / Q_e = 1e6 the angle is 1e-6.
    assert found.cop == pytest.approx([0.125, 0.0375], abs=1e-6)
    assert found.ecmp == pytest.approx(found.cop, abs=ROUNDING)


def test_fig_3_left_without_q_perp_the_cop_is_the_orthogonal_projection():
    """Oracle: the closest point of the sole to the unlimited eCMP."""
    params = MomentumQpParams(
        perpendicular_weight=0.0,
        max_kappa=0.0,
        rate_weight=0.0,
        cop_weight=1e-4,
    )
    error = np.array([0.06, 0.01])
    wanted = params.feedback_gain * error
    found = feedback(error, params)
    expected = project(wanted, limits_of(params).polygon)
    # The regularisation of delta takes 1e-4 / 1e3 of it.
    assert found.cop == pytest.approx(expected, abs=1e-7)
    assert angle_to(error, found) > 0.05


def test_default_q_perp_looks_like_fig_3():
    """Oracle: the paper's picture: parallel to the eye, 2 degrees."""
    for degrees in range(0, 360, 15):
        angle = math.radians(degrees)
        error = 0.1 * np.array([math.cos(angle), math.sin(angle)])
        found = feedback(error)
        assert found.result.active.any()
        assert math.degrees(angle_to(error, found)) < 2.0


def test_the_ankles_act_before_the_hips():
    """Oracle: delta carries R_kappa / R_delta as much as kappa."""
    found = feedback((0.01, 0.0))
    ratio = DEFAULTS.ecmp_weight / DEFAULTS.cop_weight
    delta_x, _, kappa_x, _ = found.increments
    assert delta_x / kappa_x == pytest.approx(ratio)
    beyond = feedback((0.06, 0.0))
    assert beyond.cop[0] == pytest.approx(0.125 - DEFAULTS.cop_safe_distance)
    assert beyond.increments[2] > 0.01


@given(
    error=vectors,
    cop_r=vectors,
    kappa_r=vectors,
    yaw=st.floats(-3.1, 3.1),
    shift=vectors,
)
def test_a_turned_and_moved_world_gives_turned_and_moved_feedback(
    error, cop_r, kappa_r, yaw, shift
):
    """Oracle: the rigid motion, applied to the result; 1e-8 m."""
    move = FootPose([*shift, 0.0], yaw)
    previous = np.array([0.01, 0.02, 0.0, 0.005])
    turned = np.concatenate(
        [move.rotation @ v for v in (previous.reshape(2, 2))]
    )
    before = feedback(error, cop_r=cop_r, kappa_r=kappa_r, previous=previous)
    after = feedback(
        move.rotation @ error,
        cop_r=move.to_world(np.array(cop_r)),
        kappa_r=move.rotation @ kappa_r,
        previous=turned,
        limits=limits_of(DEFAULTS, move.to_world(SOLE), yaw),
    )
    for name in ("cop", "ecmp"):
        expected = move.to_world(getattr(before, name))
        assert getattr(after, name) == pytest.approx(expected, abs=1e-8)


def test_on_the_reference_commands_the_reference():
    """Oracle: no error, no increments, also if CoP and eCMP differ."""
    found = feedback(ZERO, cop_r=(0.03, 0.01), kappa_r=(0.02, -0.01))
    assert found.increments == pytest.approx(NOTHING, abs=1e-15)
    assert found.cop == pytest.approx([0.03, 0.01])
    assert found.ecmp == pytest.approx([0.05, 0.0])


def test_the_increments_add_up_to_the_feedback_for_any_kappa_r():
    """Oracle: Eq. 7 with the effective gain, ecmp_d - ecmp_r = K e."""
    params = MomentumQpParams(rate_weight=0.0)
    kappa_r, error = np.array([0.02, -0.01]), np.array([0.006, 0.004])
    found = feedback(error, params, kappa_r=kappa_r)
    assert found.ecmp - kappa_r == pytest.approx(
        params.effective_gain * error, abs=1e-12
    )


def test_a_tiny_error_does_not_make_the_feedback_jump():
    """Oracle: continuity at zero, where the error has no direction."""
    previous = [0.02, 0.01, 0.0, 0.0]
    at_zero = feedback(ZERO, previous=previous).increments
    for direction in ((1e-7, 0.0), (0.0, 1e-7), (-1e-7, 1e-7)):
        near = feedback(direction, previous=previous).increments
        assert near == pytest.approx(at_zero, abs=1e-6)


def test_the_rate_weight_holds_on_to_the_previous_feedback():
    """Oracle: monotone in R_p, between old and new."""
    previous = np.array([0.03, 0.0, 0.0, 0.0])
    totals = []
    for weight in (0.0, 100.0, 1e4, 1e7):
        found = feedback(
            (0.005, 0.0),
            MomentumQpParams(rate_weight=weight),
            previous=previous,
        )
        totals.append(found.increments[0] + found.increments[2])
    assert totals == sorted(totals)
    assert totals[0] == pytest.approx(DEFAULTS.effective_gain * 0.005)
    assert totals[-1] == pytest.approx(0.03, rel=2e-3)


def test_if_there_is_no_solution_repeats_the_last_feedback_within_limits():
    """Oracle: the clipped feedback; a polygon that nothing is inside of."""
    good = limits_of(DEFAULTS)
    upper = good.upper.copy()
    upper[:4] = -1.0  # one metre inside of every edge
    none = FeedbackLimits(
        good.polygon, good.axes, good.max_kappa, good.C, good.lower, upper
    )
    previous = np.array([0.03, 0.0, 0.01, 0.0])
    found = feedback(
        (0.01, 0.0), cop_r=(0.1, 0), previous=previous, limits=none
    )
    assert not found.result.solved
    assert found.cop == pytest.approx([0.12, 0.0])
    assert found.ecmp == pytest.approx([0.13, 0.0])


def test_the_icp_error_of_a_pendulum_decays_as_the_gain_says():
    """Oracle: e+ = (e^{wT} - (e^{wT} - 1) K) e for an eCMP that is held."""
    params = MomentumQpParams(rate_weight=0.0)
    qp, limits = IcpFeedbackQp(params), limits_of(params)
    growth = math.exp(OMEGA * PERIOD)
    decay = growth - (growth - 1.0) * params.effective_gain
    icp, start = np.array([0.03, -0.01]), np.array([0.03, -0.01])
    for _ in range(500):
        found = qp.solve(icp, ZERO, ZERO, NOTHING, limits)
        icp = icp_after(icp, found.ecmp, OMEGA, PERIOD)
    assert icp == pytest.approx(start * decay**500, rel=1e-8)
    assert np.linalg.norm(icp) < 0.05 * np.linalg.norm(start)


@pytest.mark.parametrize(("start", "recovers"), [(0.155, True), (0.185, False)])
def test_recovers_exactly_while_the_icp_is_within_reach_of_the_ecmp(
    start, recovers
):
    """Oracle: toes less safe distance plus max_kappa = 0.17 m."""
    qp, limits = IcpFeedbackQp(DEFAULTS), limits_of(DEFAULTS)
    icp, previous, guess = np.array([start, 0.0]), NOTHING, None
    for _ in range(2000):
        found = qp.solve(icp, ZERO, ZERO, previous, limits, guess)
        previous, guess = found.increments, found.result.active
        icp = icp_after(icp, found.ecmp, OMEGA, PERIOD)
        if abs(icp[0]) > 1.0:
            break
    assert found.result.solved
    assert bool(np.linalg.norm(icp) < 1e-3) is recovers


def test_momentum_rate_moves_the_mass_as_the_pendulum():
    """Oracle: second difference of the LIPM's closed form."""
    com, velocity = np.array([0.1, -0.05]), np.array([0.3, 0.2])
    ecmp, h = np.array([0.02, 0.01]), 1e-3
    back, ahead = (com_after(com, velocity, ecmp, OMEGA, t)[0] for t in (-h, h))
    acceleration = (back - 2.0 * com + ahead) / h**2
    found = momentum_rate(90.9, OMEGA, com, ecmp, 0.7)
    # Truncation (w h)^2 / 12 = 8e-7 of it, rounding 1e-16 / h^2.
    assert found[:2] == pytest.approx(90.9 * acceleration, rel=2e-6)
    assert found[2] == pytest.approx(90.9 * 0.7)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("feedback_gain", 0.5),
        ("feedback_gain", 1.0),
        ("feedback_gain", math.nan),
        ("error_weight", 0.0),
        ("cop_weight", -1.0),
        ("ecmp_weight", math.inf),
        ("rate_weight", -1.0),
        ("perpendicular_weight", math.nan),
        ("max_kappa", -0.01),
        ("cop_safe_distance", math.nan),
    ],
)
def test_refuses_bad_parameters(field, value):
    """Oracle: the message names field, value and what is allowed."""
    with pytest.raises(ValueError, match=f"{field} = {value}: must be"):
        MomentumQpParams(**{field: value}).validate()


def test_refuses_weights_that_leave_a_gain_below_one():
    """Oracle: K Q_e / (Q_e + effort) < 1."""
    with pytest.raises(ValueError, match="error_weight = 0.1: must be larger"):
        MomentumQpParams(error_weight=0.1).validate()


def test_refuses_an_unknown_solver():
    """Oracle: the message lists the known ones."""
    with pytest.raises(ValueError, match="'gurobi': must be one of active"):
        IcpFeedbackQp(MomentumQpParams(solver="gurobi"))


@pytest.mark.parametrize("solver", ["active_set", "clarabel"])
def test_refuses_numbers_that_are_not_finite(solver):
    """Oracle: ValueError, never a silent command."""
    with pytest.raises(ValueError, match="must be finite"):
        feedback((math.nan, 0.0), MomentumQpParams(solver=solver))
    with pytest.raises(ValueError, match="must"):
        feedback(
            (0.01, 0.0), MomentumQpParams(solver=solver), cop_r=(math.nan, 0.0)
        )
