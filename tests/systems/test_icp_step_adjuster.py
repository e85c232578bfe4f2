"""Oracles: the core functions; a count of the plans made."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.cop_waypoints import CopWaypointParams
from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.icp_step_adjustment import propose_by_qp, step_plan
from nadia_balance.core.icp_step_qp import IcpStepQp, IcpStepQpParams
from nadia_balance.core.reachability import (
    ReachabilityParams,
    base_region,
    in_world,
)
from nadia_balance.core.walking import Phase, Side, WalkingState
from nadia_balance.systems import icp_step_adjuster
from nadia_balance.systems.icp_step_adjuster import IcpStepAdjuster
from tests.example_walks import OMEGA, SOLE, walk

PARAMS, COP = IcpStepQpParams(), CopWaypointParams()
REACH = ReachabilityParams()
OUT = np.array([0.25, 0.05])  # an ICP that needs a step forward
IN_PLACE = replace(walk(length=0.0), phase=Phase.SWING, duration=0.7)
IN_AIR = WalkingState(IN_PLACE, time_in_phase=0.3, elapsed=0.3)
ON_TWO_FEET = WalkingState(walk(length=0.0), time_in_phase=0.1, elapsed=0.1)


@pytest.fixture
def adjuster():
    return IcpStepAdjuster(PARAMS, COP, REACH, SOLE, OMEGA)


def outputs(adjuster, context, state, icp=OUT, step=None):
    """The adjustment, and what is to be drawn."""
    adjuster.GetInputPort("walking_state").FixValue(context, state)
    adjuster.GetInputPort("icp").FixValue(context, icp)
    if step is not None:
        port = adjuster.GetInputPort("mechanisms")
        port.FixValue(context, [step, 0, 0, 0])
    return (
        adjuster.GetOutputPort("adjustment").Eval(context),
        adjuster.GetOutputPort("capture_regions").Eval(context),
    )


def expected(state, icp=OUT):
    nominal = IN_PLACE.footsteps[0]
    plan = step_plan(state.schedule, nominal, SOLE, COP, REACH, PARAMS, OMEGA)
    return propose_by_qp(state, plan, icp, IcpStepQp(PARAMS))


def test_proposes_what_the_core_proposes(adjuster):
    """Oracle: propose_by_qp()."""
    context = adjuster.CreateDefaultContext()
    found, _ = outputs(adjuster, context, IN_AIR)
    assert found.pose is not found.nominal.pose
    assert found.nominal is IN_PLACE.footsteps[0]
    np.testing.assert_array_equal(found.pose.p_WF, expected(IN_AIR).pose.p_WF)


@pytest.mark.parametrize(
    "state", [ON_TWO_FEET, replace(IN_AIR, elapsed=0.0)], ids=["two", "early"]
)
def test_leaves_the_foothold_while_it_may_not_move(adjuster, state):
    """Oracle: the very pose that was commanded."""
    context = adjuster.CreateDefaultContext()
    found, _ = outputs(adjuster, context, state)
    assert found.pose is state.schedule.footsteps[0].pose


def test_makes_the_plan_once_a_phase(adjuster, monkeypatch):
    """Oracle: a count; an adjusted foothold does not change the plan."""
    made = []
    monkeypatch.setattr(
        icp_step_adjuster,
        "step_plan",
        lambda *args: made.append(args) or step_plan(*args),
    )
    context = adjuster.CreateDefaultContext()
    found, _ = outputs(adjuster, context, IN_AIR)
    step = replace(IN_PLACE.footsteps[0], pose=found.pose)
    steps = (step, *IN_PLACE.footsteps[1:])
    moved = replace(IN_PLACE, footsteps=steps)
    later = WalkingState(moved, 0.31, 0.31, adjustment=found)
    outputs(adjuster, context, later)
    assert len(made) == 1
    next_phase = replace(IN_PLACE, start=walk(length=0.1).start)
    outputs(adjuster, context, replace(IN_AIR, schedule=next_phase))
    assert len(made) == 2


def test_draws_reach_and_footholds(adjuster):
    """Oracle: the base region; the capture regions are not of this paper."""
    context = adjuster.CreateDefaultContext()
    found, drawn = outputs(adjuster, context, IN_AIR)
    stance = IN_PLACE.feet.left
    reach = in_world(base_region(REACH), stance, Side.RIGHT)
    np.testing.assert_array_equal(drawn.reach, reach)
    assert drawn.regions == ()
    assert drawn.nominal is found.nominal.pose
    assert drawn.adjusted is found.pose


def test_draws_nothing_on_two_feet(adjuster):
    """Oracle: CaptureRegions() as it is made."""
    context = adjuster.CreateDefaultContext()
    _, drawn = outputs(adjuster, context, ON_TWO_FEET)
    assert drawn.nominal is CaptureRegions().nominal is None
    assert not len(drawn.reach)


def test_can_be_switched_off_and_on(adjuster):
    """Oracle: off, it proposes None, and what is drawn stays."""
    context = adjuster.CreateDefaultContext()
    found, _ = outputs(adjuster, context, IN_AIR, step=1)
    state = replace(IN_AIR, adjustment=found)
    nothing, drawn = outputs(adjuster, context, state, step=0)
    assert nothing is None
    assert drawn.adjusted is found.pose
    again, _ = outputs(adjuster, context, IN_AIR, step=1)
    np.testing.assert_array_equal(again.pose.p_WF, found.pose.p_WF)


def test_takes_a_reach_of_any_polygon():
    """Oracle: 60 corners in a circle; she steps as far as that allows."""
    angles = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    circle = 0.3 * np.column_stack([np.cos(angles), np.sin(angles)])
    corners = [0.0, 0.45] + circle
    reach = ReachabilityParams(base_polygon=corners.tolist())
    adjuster = IcpStepAdjuster(PARAMS, COP, reach, SOLE, OMEGA)
    context = adjuster.CreateDefaultContext()
    found, _ = outputs(adjuster, context, IN_AIR, np.array([0.25, 0.05]))
    stance = IN_PLACE.feet.left
    x, y = stance.to_sole(found.pose.p_WF[None, :2])[0]
    assert np.hypot(x, -y - 0.45) == pytest.approx(0.3, rel=2e-3)


@pytest.mark.parametrize(
    "field, value", [("step_weight", 0.0), ("cop_safe_distance", 0.06)]
)
def test_refuses_parameters_that_are_out_of_range(field, value):
    """Oracle: the message; the sole is 0.12 m wide."""
    params = replace(PARAMS, **{field: value})
    with pytest.raises(ValueError, match=f"{field} = {value}: must"):
        IcpStepAdjuster(params, COP, REACH, SOLE, OMEGA)
