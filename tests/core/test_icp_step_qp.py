"""Oracles: Algorithm 1 of the Atlas paper, quadprog, formulas, the ICP plan."""

import math
from dataclasses import replace

import numpy as np
import pytest
import quadprog
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.cop_waypoints import CopWaypointParams
from nadia_balance.core.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.icp_step_qp import (
    IcpStepQp,
    IcpStepQpParams,
    footholds,
    may_move,
    propose_by_qp,
    recursive_multipliers,
    step_plan,
)
from nadia_balance.core.polygon import halfspaces
from nadia_balance.core.walking import (
    FootPose,
    Phase,
    Side,
    WalkingState,
    rectangle,
)
from tests.example_walks import MODEL, OMEGA, random_walks, swing, walk

PARAMS = IcpStepQpParams()
AT_ONCE = 1e-9  # [s], from heel to toe: the paper's CMP jumps


def knots_of_jumps(durations):
    """The CMP stays for each of these durations [s], and jumps."""
    knots = [0.0]
    for duration in durations:
        knots += [knots[-1] + duration - AT_ONCE, knots[-1] + duration]
    return np.array(knots)


def algorithm_1(toe, heel, num_steps, omega, swing):
    """gamma_H,0, gamma_T,0, gamma_H,1, ..., gamma_f as printed.

    In a swing only `toe` [s] is left of the present foot.
    """
    whole = toe + heel
    before = toe if swing else whole  # until the first step
    gammas = [] if swing else [1.0 - math.exp(-omega * heel)]
    shift = 0.0 if swing else heel
    gammas.append(math.exp(-omega * shift) * (1.0 - math.exp(-omega * toe)))
    for i in range(num_steps):
        start = before + i * whole
        gammas.append(math.exp(-omega * start) * (1 - math.exp(-omega * heel)))
        start += heel
        gammas.append(math.exp(-omega * start) * (1 - math.exp(-omega * toe)))
    return [*gammas, math.exp(-omega * (before + num_steps * whole))]


@pytest.mark.parametrize("swing", [True, False])
def test_multipliers_of_a_cmp_that_jumps_are_those_of_algorithm_1(swing):
    """Oracle: Algorithm 1 as printed, both branches."""
    toe, heel, omega = 0.4, 0.45, 3.0
    stays = [toe, heel, toe, heel, toe] if swing else [heel, toe] * 3
    found = recursive_multipliers(knots_of_jumps(stays), 0.0, omega)
    summed = [*found[:-1].reshape(-1, 2).sum(axis=1), found[-1]]
    expected = algorithm_1(toe, heel, 2, omega, swing)
    assert summed == pytest.approx(expected, abs=1e-8)


times = st.floats(0.0, 3.0)


@given(random_walks(), times)
def test_multipliers_add_up_to_the_reference_icp(schedule, t):
    """Oracle: plan_icp, by Eq. 4 of the Nadia paper, which ends in the same."""
    params = IcpPlanParams(continuous=False)
    plan = plan_icp(schedule, params, MODEL)
    found = recursive_multipliers(plan.knots, t, OMEGA) @ plan.cop_waypoints
    assert found == pytest.approx(plan.at(t).icp, abs=1e-9)


def test_what_has_been_passed_counts_no_more():
    """Oracle: the ICP depends on the future alone."""
    knots = np.array([0.0, 0.2, 0.5, 1.0])
    found = recursive_multipliers(knots, 0.6, OMEGA)
    assert found[:2].tolist() == [0.0, 0.0]
    assert recursive_multipliers(knots, 2.0, OMEGA).tolist() == [0, 0, 0, 1]


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


def test_what_neither_takes_is_left_over():
    """Oracle: both at their limits; what is missing in Eq. 19."""
    found = solve([0.5, 0.0])
    assert found.step[0] == pytest.approx(0.9)
    assert found.delta[0] == pytest.approx(0.12)
    rest = 0.5 - 0.12 / PARAMS.feedback_gain - GAMMA * 0.9
    assert found.slack == pytest.approx([rest, 0.0], abs=1e-9)


COP = CopWaypointParams()
WALKS = [{"length": 0.0}, {"length": 0.3}, {"length": 0.1, "turn": 0.26}]
PHASES = [Phase.SWING, Phase.TRANSFER]
MIDDLE = 0.35  # of the swing [s]


def in_phase(phase, **gait):
    return walk(**gait) if phase is Phase.TRANSFER else swing(**gait)


def with_foothold(schedule, shift):
    """The same, the first foothold moved by `shift` (2,) [m] in W."""
    step, *later = schedule.footsteps
    pose = FootPose(step.pose.p_WF + [*shift, 0.0], step.pose.yaw)
    steps = (replace(step, pose=pose), *later)
    return replace(schedule, footsteps=steps)


def icp_of(schedule, t):
    """Of the plan by Eq. 4 of the Nadia paper, which ends in the same."""
    params = IcpPlanParams(continuous=False)
    return plan_icp(schedule, params, MODEL).at(t).icp


def plan_of(schedule, nominal=None, params=PARAMS):
    nominal = nominal or schedule.footsteps[0]
    return step_plan(schedule, nominal, COP, params, MODEL)


def proposed(icp, schedule, adjustment=None, params=PARAMS):
    state = WalkingState(schedule, MIDDLE, MIDDLE, adjustment=adjustment)
    nominal = adjustment.nominal if adjustment else schedule.footsteps[0]
    plan = plan_of(schedule, nominal, params)
    return propose_by_qp(state, plan, icp, IcpStepQp(params))


@pytest.mark.parametrize("gait", WALKS)
@pytest.mark.parametrize("phase", PHASES)
def test_the_reference_is_that_of_the_icp_plan(gait, phase):
    """Oracle: plan_icp, ICP and eCMP."""
    schedule = in_phase(phase, **gait)
    expected = plan_icp(schedule, IcpPlanParams(continuous=False), MODEL)
    for t in 0.0, 0.12, 0.3:
        icp, cmp, _ = plan_of(schedule).at(t)
        assert icp == pytest.approx(expected.at(t).icp, abs=1e-9)
        assert cmp == pytest.approx(expected.at(t).ecmp, abs=1e-9)


@pytest.mark.parametrize("gait", WALKS[:2])
@pytest.mark.parametrize("phase", PHASES)
def test_the_reference_moves_with_the_foothold(gait, phase, t=0.2):
    """Oracle: central differences of plan_icp, sideways.

    If a step gets longer, its CoP also moves within the sole.
    """
    schedule = in_phase(phase, **gait)
    ahead, behind = (
        icp_of(with_foothold(schedule, [0.0, y]), t) for y in (1e-3, -1e-3)
    )
    _, _, gamma = plan_of(schedule).at(t)
    found = (ahead - behind) / 2e-3
    assert found == pytest.approx([0.0, gamma], abs=1e-9)
    assert 0.005 < gamma < 0.3


@pytest.mark.parametrize("side", Side)
def test_a_foothold_is_within_reach_and_clear_of_the_stance_foot(side):
    """Oracle: the reach and the width of the soles, point by point."""
    stance = FootPose([0.3, -0.2, 0.0], 0.4)
    A, b = footholds(stance, side, replace(PARAMS, sole_clearance=0.01), MODEL)
    rng = np.random.default_rng(3)
    points = rng.uniform(-1.2, 1.2, (2000, 2))
    inside = (points @ A.T <= b).all(axis=1)
    assert np.sum(inside) > 100
    for x, y in stance.to_sole(points[inside]):
        assert MODEL.reach.in_base_region(x, side.sign * y)
        assert side.sign * y >= 0.12 + 0.01


def test_the_shift_counts_from_the_nominal_foothold():
    """Oracle: the same answer with the new foothold; back without error."""
    schedule = swing(length=0.0)
    icp = icp_of(schedule, MIDDLE) + [0.1, 0.0]
    first = proposed(icp, schedule)
    way = first.pose.p_WF - schedule.footsteps[0].pose.p_WF
    assert way[0] > 0.1
    moved = with_foothold(schedule, way[:2])
    again = proposed(icp, moved, first)
    assert again.pose is first.pose
    assert again.nominal is schedule.footsteps[0]
    back = proposed(icp_of(schedule, MIDDLE), moved, first)
    assert back.pose is schedule.footsteps[0].pose


def test_a_change_within_the_dead_band_moves_no_foothold():
    """Oracle: the dead-band; by Eq. 18, 1 mm of ICP is 1 mm / Gamma."""
    schedule = swing(length=0.0)
    icp = icp_of(schedule, MIDDLE) + [0.1, 0.0]
    gamma = plan_of(schedule).at(MIDDLE)[2]
    first = proposed(icp, schedule)
    near, far = (
        proposed(icp + [gamma * way, 0.0], schedule, first)
        for way in (0.5 * PARAMS.dead_band, 2.0 * PARAMS.dead_band)
    )
    assert near.pose is first.pose
    way = far.pose.p_WF[0] - first.pose.p_WF[0]
    assert way == pytest.approx(2.0 * PARAMS.dead_band, rel=0.02)


@pytest.mark.parametrize(
    "phase, t, elapsed, may",
    [
        (Phase.SWING, 0.35, 0.35, True),
        (Phase.SWING, 0.002, 0.002, False),  # just lifted
        (Phase.SWING, 0.35, 0.005, False),  # the clock was advanced
        (Phase.SWING, 0.66, 0.66, False),  # about to land
        (Phase.TRANSFER, 0.1, 0.1, False),
    ],
)
def test_a_foothold_moves_only_while_the_foot_can_follow(
    phase, t, elapsed, may
):
    """Oracle: settling and freeze time, by hand."""
    state = WalkingState(in_phase(phase, length=0.0), t, elapsed)
    assert may_move(state, PARAMS) is may
