"""Oracles: the core functions; a count of the plans made."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.icp_step_qp import (
    IcpStepQp,
    IcpStepQpParams,
    propose_by_qp,
    step_plan,
)
from nadia_balance.core.reachability import (
    ReachabilityParams,
    base_region,
    in_world,
)
from nadia_balance.core.walking import Phase, Side, WalkingState
from nadia_balance.systems import icp_step_adjuster
from nadia_balance.systems.icp_step_adjuster import IcpStepAdjuster
from tests.blocks import answer, asked, fix
from tests.example_walks import MODEL, walk

PARAMS, PERIOD = IcpStepQpParams(), 0.002
OUT = np.array([0.25, 0.05])  # an ICP that needs a step forward
IN_PLACE = replace(walk(length=0.0), phase=Phase.SWING, duration=0.7)
PLAN = plan_icp(IN_PLACE, IcpPlanParams(), MODEL)
IN_AIR = WalkingState(IN_PLACE, time_in_phase=0.3, elapsed=0.3)
ON_TWO_FEET = WalkingState(walk(length=0.0), time_in_phase=0.1, elapsed=0.1)


@pytest.fixture
def adjuster():
    return IcpStepAdjuster(PARAMS, MODEL, PERIOD)


def context_of(adjuster, state=IN_AIR):
    return asked(adjuster, walking_state=state, icp=OUT, icp_plan=PLAN)


def outputs(adjuster, context):
    """The adjustment, and what is to be drawn."""
    names = "adjustment", "capture_regions"
    return [answer(adjuster, context, name) for name in names]


def test_proposes_what_the_core_proposes(adjuster):
    """Oracle: propose_by_qp()."""
    found, _ = outputs(adjuster, context_of(adjuster))
    nominal = IN_PLACE.footsteps[0]
    plan = step_plan(IN_PLACE, nominal, PLAN.cop, PARAMS, MODEL)
    expected = propose_by_qp(IN_AIR, plan, OUT, IcpStepQp(PARAMS))
    assert found.nominal is nominal
    assert found.pose is not nominal.pose
    np.testing.assert_array_equal(found.pose.p_WF, expected.pose.p_WF)


@pytest.mark.parametrize(
    "state", [ON_TWO_FEET, replace(IN_AIR, elapsed=0.0)], ids=["two", "early"]
)
def test_leaves_the_foothold_while_it_may_not_move(adjuster, state):
    """Oracle: the very pose that was commanded."""
    found, _ = outputs(adjuster, context_of(adjuster, state))
    assert found.pose is state.schedule.footsteps[0].pose


def test_makes_the_plan_once_a_phase(adjuster, monkeypatch):
    """Oracle: a count; an adjusted foothold does not change the plan."""
    made = []
    monkeypatch.setattr(
        icp_step_adjuster,
        "step_plan",
        lambda *args: made.append(args) or step_plan(*args),
    )
    context = context_of(adjuster)
    found, _ = outputs(adjuster, context)
    step = replace(IN_PLACE.footsteps[0], pose=found.pose)
    steps = (step, *IN_PLACE.footsteps[1:])
    moved = replace(IN_PLACE, footsteps=steps)
    later = WalkingState(moved, 0.31, 0.31, adjustment=found)
    fix(adjuster, context, walking_state=later)
    outputs(adjuster, context)
    assert len(made) == 1
    next_phase = replace(IN_PLACE, start=walk(length=0.1).start)
    state = replace(IN_AIR, schedule=next_phase)
    fix(adjuster, context, walking_state=state)
    outputs(adjuster, context)
    assert len(made) == 2


def test_draws_reach_and_footholds_of_a_swing(adjuster):
    """Oracle: the base region; the capture regions are not of this paper."""
    found, drawn = outputs(adjuster, context_of(adjuster))
    reach = in_world(base_region(MODEL.reach), IN_PLACE.feet.left, Side.RIGHT)
    np.testing.assert_array_equal(drawn.reach, reach)
    assert drawn.regions == ()
    assert drawn.nominal is found.nominal.pose
    assert drawn.adjusted is found.pose
    _, drawn = outputs(adjuster, context_of(adjuster, ON_TWO_FEET))
    assert drawn.nominal is CaptureRegions().nominal is None
    assert not len(drawn.reach)


def test_can_be_switched_off_and_on(adjuster):
    """Oracle: off, it proposes None, and what is drawn stays."""
    context = context_of(adjuster)
    fix(adjuster, context, mechanisms=[1, 0, 0, 0])
    found, _ = outputs(adjuster, context)
    state = replace(IN_AIR, adjustment=found)
    fix(adjuster, context, mechanisms=[0, 0, 0, 0], walking_state=state)
    nothing, drawn = outputs(adjuster, context)
    assert nothing is None
    assert drawn.adjusted is found.pose
    fix(adjuster, context, mechanisms=[1, 0, 0, 0], walking_state=IN_AIR)
    again, _ = outputs(adjuster, context)
    np.testing.assert_array_equal(again.pose.p_WF, found.pose.p_WF)


def test_takes_a_reach_of_any_polygon():
    """Oracle: 60 corners in a circle; it steps as far as that allows."""
    angles = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    circle = 0.3 * np.column_stack([np.cos(angles), np.sin(angles)])
    corners = [0.0, 0.45] + circle
    reach = ReachabilityParams(base_polygon=corners.tolist())
    adjuster = IcpStepAdjuster(PARAMS, replace(MODEL, reach=reach), PERIOD)
    found, _ = outputs(adjuster, context_of(adjuster))
    x, y = IN_PLACE.feet.left.to_sole(found.pose.p_WF[None, :2])[0]
    assert np.hypot(x, -y - 0.45) == pytest.approx(0.3, rel=2e-3)


@pytest.mark.parametrize(
    "field, value", [("step_weight", 0.0), ("cop_safe_distance", 0.06)]
)
def test_refuses_parameters_that_are_out_of_range(field, value):
    """Oracle: the message; the sole is 0.12 m wide."""
    params = replace(PARAMS, **{field: value})
    with pytest.raises(ValueError, match=f"{field} = {value}: must"):
        IcpStepAdjuster(params, MODEL, PERIOD)
