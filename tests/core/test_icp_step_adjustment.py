"""Oracles: finite differences and the ICP plan, brute force, Eq. 18."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.cop_waypoints import CopWaypointParams
from nadia_balance.core.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.icp_step_adjustment import (
    footholds,
    may_move,
    propose_by_qp,
    step_plan,
)
from nadia_balance.core.icp_step_qp import IcpStepQp, IcpStepQpParams
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import FootPose, Phase, Side, WalkingState
from tests.example_walks import OMEGA, SOLE, walk

PARAMS = IcpStepQpParams()
REACH = ReachabilityParams()
COP = CopWaypointParams()
WALKS = [{"length": 0.0}, {"length": 0.3}, {"length": 0.1, "turn": 0.26}]
PHASES = [Phase.SWING, Phase.TRANSFER]
MIDDLE = 0.35  # of the swing [s]


def in_phase(phase, **gait):
    schedule = walk(**gait)
    if phase is Phase.TRANSFER:
        return schedule
    duration = schedule.footsteps[0].swing_duration
    return replace(schedule, phase=Phase.SWING, duration=duration)


def swing(**gait):
    return in_phase(Phase.SWING, **gait)


def with_foothold(schedule, shift):
    """The same, the first foothold moved by `shift` (2,) [m] in W."""
    step, *later = schedule.footsteps
    pose = FootPose(step.pose.p_WF + [*shift, 0.0], step.pose.yaw)
    steps = (replace(step, pose=pose), *later)
    return replace(schedule, footsteps=steps)


def icp_of(schedule, t):
    """Of the plan by Eq. 4 of the Nadia paper, which ends in the same."""
    params = IcpPlanParams(continuous=False)
    return plan_icp(schedule, SOLE, params, OMEGA).at(t).icp


def plan_of(schedule, nominal=None, params=PARAMS):
    nominal = nominal or schedule.footsteps[0]
    return step_plan(schedule, nominal, SOLE, COP, REACH, params, OMEGA)


def proposed(icp, schedule, adjustment=None, params=PARAMS):
    state = WalkingState(schedule, MIDDLE, MIDDLE, adjustment=adjustment)
    nominal = adjustment.nominal if adjustment else schedule.footsteps[0]
    plan = plan_of(schedule, nominal, params)
    return propose_by_qp(state, plan, icp, IcpStepQp(params))


@pytest.mark.parametrize("gait", WALKS)
@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("t", [0.0, 0.12, 0.3])
def test_the_reference_is_that_of_the_icp_plan(gait, phase, t):
    """Oracle: plan_icp, ICP and eCMP."""
    schedule = in_phase(phase, **gait)
    icp, cmp, _ = plan_of(schedule).at(t)
    params = IcpPlanParams(continuous=False)
    expected = plan_icp(schedule, SOLE, params, OMEGA).at(t)
    assert icp == pytest.approx(expected.icp, abs=1e-9)
    assert cmp == pytest.approx(expected.ecmp, abs=1e-9)


@pytest.mark.parametrize("gait", WALKS[:2])
@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("t", [0.0, 0.2])
def test_the_reference_moves_with_the_foothold(gait, phase, t):
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


def test_the_sensitivity_grows_as_the_swing_goes_on():
    """Oracle: Eq. 18: e^(w t), while the CoP stays in one foot."""
    plan = plan_of(swing())
    early, late = (plan.at(t)[2] for t in (0.1, 0.6))
    assert late == pytest.approx(early * np.exp(OMEGA * 0.5), rel=1e-12)


@pytest.mark.parametrize("side", Side)
def test_a_foothold_is_within_reach_and_clear_of_the_stance_foot(side):
    """Oracle: the reach and the width of the soles, point by point."""
    stance = FootPose([0.3, -0.2, 0.0], 0.4)
    A, b = footholds(stance, side, SOLE, REACH, clearance=0.01)
    rng = np.random.default_rng(3)
    points = rng.uniform(-1.2, 1.2, (2000, 2))
    inside = (points @ A.T <= b).all(axis=1)
    assert np.sum(inside) > 100
    for x, y in stance.to_sole(points[inside]):
        assert REACH.in_base_region(x, side.sign * y)
        assert side.sign * y >= 0.12 + 0.01


@pytest.mark.parametrize("way", [[0.15, 0.0], [-0.1, -0.1], [0.05, -0.2]])
def test_steps_where_the_icp_belongs_to(way):
    """Oracle: Eq. 18; a sole as small as a point leaves it all to the step."""
    schedule = swing(length=0.0)
    icp, cmp, gamma = plan_of(schedule).at(MIDDLE)
    params = replace(PARAMS, cop_safe_distance=0.0599)
    stance = schedule.feet.left.p_WF[:2]
    # What feedback on the CMP there is left brings it to the sole's middle.
    share = (stance - cmp) / PARAMS.feedback_gain
    found = proposed(
        icp + gamma * np.array(way) + share, schedule, params=params
    )
    foothold = schedule.footsteps[0].pose.p_WF[:2] + way
    # The CMP has 65 mm to go along the sole, and the slack is not for nothing.
    away = 0.065 / PARAMS.feedback_gain / gamma
    assert abs(found.pose.p_WF[0] - foothold[0]) < away + 0.005
    assert found.pose.p_WF[1] == pytest.approx(foothold[1], abs=5e-3)


def test_the_way_counts_from_the_foothold_that_was_to_be():
    """Oracle: asked again with the new foothold, the answer is the same."""
    schedule = swing(length=0.0)
    icp = icp_of(schedule, MIDDLE) + [0.1, 0.0]
    first = proposed(icp, schedule)
    way = first.pose.p_WF - schedule.footsteps[0].pose.p_WF
    assert way[0] > 0.1
    again = proposed(icp, with_foothold(schedule, way[:2]), first)
    assert again.pose is first.pose
    assert again.nominal is schedule.footsteps[0]


def test_goes_back_when_the_error_is_gone():
    """Oracle: the very pose of the nominal foothold."""
    schedule = swing(length=0.0)
    icp = icp_of(schedule, MIDDLE)
    first = proposed(icp + [0.1, 0.0], schedule)
    way = first.pose.p_WF - schedule.footsteps[0].pose.p_WF
    back = proposed(icp, with_foothold(schedule, way[:2]), first)
    assert back.pose is schedule.footsteps[0].pose


def test_a_small_error_is_left_to_the_ankles():
    """Oracle: 2 cm, for which a CoP 6 cm off does."""
    schedule = swing(length=0.0)
    found = proposed(icp_of(schedule, MIDDLE) + [0.02, 0.0], schedule)
    assert found.pose is schedule.footsteps[0].pose


def test_a_small_change_is_not_worth_the_swing_foot_s_while():
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
