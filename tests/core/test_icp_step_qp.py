"""Oracles: quadprog, closed forms with and without limits."""

from dataclasses import replace

import numpy as np
import pytest
import quadprog
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.icp_step_qp import IcpStepQp, IcpStepQpParams
from nadia_balance.core.polygon import halfspaces
from nadia_balance.core.walking import rectangle

PARAMS = IcpStepQpParams()
GAMMA = 0.15
CMP_ROOM = halfspaces(rectangle(0.24, 0.11))
STEP_ROOM = halfspaces(rectangle(1.6, 0.7) + [0.1, 0.2])
ANYWHERE = halfspaces(rectangle(100.0, 100.0))

errors = st.tuples(
    st.floats(-0.2, 0.2, allow_subnormal=False),
    st.floats(-0.2, 0.2, allow_subnormal=False),
).map(np.array)


def solve(error, gamma=GAMMA, params=PARAMS, cmp=CMP_ROOM, step=STEP_ROOM):
    return IcpStepQp(params).solve(np.array(error, float), gamma, cmp, step)


@given(errors, st.floats(0.01, 0.6))
def test_finds_what_another_solver_finds(error, gamma):
    """Oracle: quadprog, of Eqs. 20 to 22 with delta eliminated."""
    found = solve(error, gamma)
    assert found.result.solved
    k, p = PARAMS.feedback_gain, PARAMS
    # delta = k (error - G x) with x = (step, eta).
    G = np.hstack([gamma * np.eye(2), np.eye(2)])
    weights = np.diag([p.step_weight] * 2 + [p.slack_weight] * 2)
    H = weights + p.feedback_weight * k**2 * G.T @ G
    g = -p.feedback_weight * k**2 * G.T @ error
    (A_c, b_c), (A_s, b_s) = CMP_ROOM, STEP_ROOM
    rows = np.vstack([-k * A_c @ G, np.hstack([A_s, 0.0 * A_s])])
    bounds = np.concatenate([b_c - k * A_c @ error, b_s])
    x = quadprog.solve_qp(H, -g, -rows.T, -bounds)[0]
    assert found.step == pytest.approx(x[:2], abs=1e-6)
    assert found.slack == pytest.approx(x[2:], abs=1e-6)


def test_the_ankles_take_what_they_can():
    """Oracle: the least squares between both, by hand."""
    found = solve([0.02, 0.01], cmp=ANYWHERE, step=ANYWHERE)
    k, p = PARAMS.feedback_gain, PARAMS
    # Stationary in step: Q_f s = lambda k Gamma; R delta = lambda;
    # Q_eta eta = lambda k.
    pull = 1.0 / p.feedback_weight + k**2 * (
        GAMMA**2 / p.step_weight + 1.0 / p.slack_weight
    )
    multiplier = k * np.array([0.02, 0.01]) / pull
    assert found.delta == pytest.approx(multiplier / p.feedback_weight)
    assert found.step == pytest.approx(multiplier * k * GAMMA / p.step_weight)
    assert np.linalg.norm(found.step) < 0.01  # half of the dead-band


def test_the_foothold_takes_the_rest():
    """Oracle: Eq. 18: the reference ICP moves by Gamma times the step."""
    found = solve([0.12, 0.0])
    assert found.delta[0] == pytest.approx(0.12)  # at the sole's edge
    rest = 0.12 - 0.12 / PARAMS.feedback_gain
    assert GAMMA * found.step[0] == pytest.approx(rest, rel=0.01)


def test_what_neither_takes_is_left_over():
    """Oracle: both at their limits; what is missing in Eq. 19."""
    found = solve([0.5, 0.0])
    assert found.step[0] == pytest.approx(0.9)
    assert found.delta[0] == pytest.approx(0.12)
    rest = 0.5 - 0.12 / PARAMS.feedback_gain - GAMMA * 0.9
    assert found.slack == pytest.approx([rest, 0.0], abs=1e-9)


def test_without_room_for_the_cmp_she_walks_on_points():
    """Oracle: Sec. IV-B: delta = 0, balance by stepping alone."""
    nowhere = halfspaces(rectangle(1e-9, 1e-9))
    found = solve([0.03, -0.02], cmp=nowhere)
    assert np.abs(found.delta).max() < 1e-8
    assert GAMMA * found.step == pytest.approx([0.03, -0.02], rel=0.01)


@pytest.mark.parametrize(
    "field, value",
    [
        ("feedback_gain", 1.0),
        ("feedback_gain", np.nan),
        ("step_weight", 0.0),
        ("feedback_weight", -1.0),
        ("slack_weight", np.inf),
        ("cop_safe_distance", -0.01),
        ("sole_clearance", np.nan),
        ("dead_band", -0.1),
        ("freeze_time", np.inf),
        ("settling_time", -0.1),
        ("solver", "magic"),
    ],
)
def test_refuses_what_is_out_of_range(field, value):
    """Oracle: the message names the field and the value."""
    with pytest.raises(ValueError, match=f"{field} = .*{value}"):
        IcpStepQp(replace(PARAMS, **{field: value}))


def test_refuses_what_is_not_finite():
    """Oracle: the message."""
    with pytest.raises(ValueError, match="must be finite"):
        solve([np.nan, 0.0], params=replace(PARAMS, solver="clarabel"))
