"""Oracles: core.plan.footstep_plan, called with the same values."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.plan.footstep_plan import (
    FootstepPlan,
    FootstepPlannerParams,
    velocity_limits,
)
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.walking.state import WalkingState
from nadia_balance.systems.plan import FootstepPlanner
from tests.blocks import answer, fix, running, tick
from tests.example_walks import ALL, FEET, MODEL, planned, standing, swing, walk

PERIOD = 0.004  # [s]
PARAMS = FootstepPlannerParams()
PLAN = FootstepPlan(PARAMS, MODEL, CaptureRegionStepAdjusterParams())


def inputs(**changes):
    """A robot that stands, at rest."""
    schedule = standing()
    return {
        "walking_state": WalkingState(schedule),
        "velocity_command": np.zeros(3),
        "alip_icp": np.zeros(2),
        "icp_plan": planned(schedule),
        "foot_poses": FEET,
    } | changes


@pytest.mark.parametrize("icp", [(0.0, 0.0), (0.2, -0.05)])
@pytest.mark.parametrize("forward", [0.0, 0.3])
def test_plans_what_the_core_says_for_a_speed_that_follows(icp, forward):
    """Oracle: the core function; v + a t, by hand, after 50 ticks."""
    command, icp = np.array([forward, 0.0, 0.0]), np.array(icp)
    values = inputs(velocity_command=command, alip_icp=icp)
    planner = FootstepPlanner(PARAMS, MODEL, PERIOD)
    simulator, context = running(planner, **values)
    for ticks in 0, 50:
        simulator.AdvanceTo(ticks * PERIOD - 1e-6 if ticks else 0.0)
        speed = min(forward, ticks * PERIOD * PARAMS.acceleration)
        state = values["walking_state"]
        velocity = np.array([speed, 0.0, 0.0])
        expected = PLAN.footsteps(
            state, velocity, command, icp, np.zeros(2), FEET, ALL
        )
        steps = answer(planner, context, "footsteps")
        assert [step.side for step in steps] == [s.side for s in expected]
        for one, two in zip(steps, expected, strict=True):
            assert one.pose.p_WF == pytest.approx(two.pose.p_WF)


def test_a_command_beyond_the_limits_is_clipped():
    """Oracle: the limit of the core, reached at the acceleration."""
    fastest = velocity_limits(PARAMS, MODEL)[1]
    values = inputs(velocity_command=np.array([9.0, 0.0, 0.0]))
    planner = FootstepPlanner(PARAMS, MODEL, PERIOD)
    simulator, context = running(planner, **values)
    simulator.AdvanceTo(5.0)
    (state,) = [context.get_discrete_state(0).value()]
    assert state.tolist() == pytest.approx([fastest[0], 0.0, 0.0])


def test_follows_a_new_command_in_the_air_and_leaves_an_old_one():
    """Oracle: the core function; None while speed and command agree."""
    swings = WalkingState(swing(length=0.21), 0.1, 0.1)
    values = inputs(
        walking_state=swings,
        icp_plan=planned(swings.schedule),
        velocity_command=np.array([0.3, 0.0, 0.0]),
    )
    planner = FootstepPlanner(PARAMS, MODEL, PERIOD)
    simulator, context = running(planner, **values)
    simulator.AdvanceTo(1.0)
    assert not answer(planner, context, "revised_footsteps")
    fix(planner, context, velocity_command=np.zeros(3))
    (step,) = answer(planner, context, "revised_footsteps")
    assert step.pose.p_WF == pytest.approx([0.0, -0.125, 0.0])


def test_after_a_push_in_a_transfer_the_other_foot_may_step():
    """Oracle: the core function, for a foot that cannot go far aside."""
    model = replace(MODEL, reach=replace(MODEL.reach, width_max=0.4))
    state = WalkingState(walk(length=0.0), 0.1, 0.1)
    icp, plan = np.array([0.0, -0.24]), planned(state.schedule)
    values = inputs(walking_state=state, alip_icp=icp, icp_plan=plan)
    planner = FootstepPlanner(PARAMS, model, PERIOD)
    _, context = running(planner, **values)
    expected = FootstepPlan(PARAMS, model, PLAN.adjuster).other_foot(
        state, icp, plan.at(0.1).icp, FEET, ALL
    )
    steps = answer(planner, context, "revised_footsteps")
    assert [step.side for step in steps] == [step.side for step in expected]
    assert steps[0].side is state.schedule.support_side
    fix(planner, context, alip_icp=np.array([0.0, 0.0]))
    assert not answer(planner, context, "revised_footsteps")


def test_a_command_that_is_not_finite_is_refused_by_port_and_time():
    """Oracle: by hand."""
    values = inputs(velocity_command=np.array([0.1, np.nan, 0.0]))
    planner = FootstepPlanner(PARAMS, MODEL, PERIOD)
    simulator, context = running(planner, **values)
    message = "input port 'velocity_command' is not finite at 0.000 s"
    with pytest.raises(RuntimeError, match=message):
        tick(simulator, PERIOD)
