"""Oracles: the core functions; a count of the plans made."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from nadia_balance.core.icp_plan import IcpPlanParams, plan_icp, reference_of
from nadia_balance.core.walking import Phase, WalkingState
from nadia_balance.systems import icp_planner
from nadia_balance.systems.icp_planner import IcpPlanner
from tests.example_walks import OMEGA, SOLE, successor, walk

PARAMS = IcpPlanParams()


@pytest.fixture
def planner():
    return IcpPlanner(PARAMS, SOLE, OMEGA)


@pytest.fixture
def planned(monkeypatch):
    """The schedules that were planned, in order; not that of the example."""
    schedules = []

    def counting(schedule, *args):
        schedules.append(schedule)
        return plan_icp(schedule, *args)

    monkeypatch.setattr(icp_planner, "plan_icp", counting)
    return schedules


def fix(planner, context, state):
    planner.GetInputPort("walking_state").FixValue(context, state)


def plan(planner, context):
    return planner.GetOutputPort("icp_plan").Eval(context)


def reference(planner, context):
    return planner.GetOutputPort("icp_reference").Eval(context)


def expected_reference(state):
    """The port's vector, from the core functions."""
    now = reference_of(plan_icp(state.schedule, SOLE, PARAMS, OMEGA), state)
    return [*now.icp, *now.icp_velocity, *now.cop, *now.ecmp]


def states():
    """In a transfer, in the swing after it, and waiting in both."""
    transfer = walk()
    plan = plan_icp(transfer, SOLE, PARAMS, OMEGA)
    swing = successor(transfer, plan)
    standing = replace(transfer, phase=Phase.STANDING)
    for schedule in transfer, swing, standing:
        yield WalkingState(schedule, 0.1)
        yield WalkingState(schedule, schedule.duration, waiting=True)


@pytest.mark.parametrize("state", list(states()))
def test_outputs_are_those_of_the_core(planner, state):
    """Oracle: plan_icp() and reference_of()."""
    context = planner.CreateDefaultContext()
    fix(planner, context, state)
    np.testing.assert_array_equal(
        reference(planner, context), expected_reference(state)
    )
    np.testing.assert_array_equal(
        plan(planner, context).coefficients,
        plan_icp(state.schedule, SOLE, PARAMS, OMEGA).coefficients,
    )


def test_plans_a_schedule_once_whatever_the_clock_says(planner, planned):
    """Oracle: the count of plans, over ticks and phases."""
    context = planner.CreateDefaultContext()
    schedule = walk()
    found = []
    for t in 0.0, 0.1, 0.2, 0.3:
        fix(planner, context, WalkingState(schedule, t))
        reference(planner, context)
        found.append(plan(planner, context))
    assert len(planned) == 1
    assert all(p is found[0] for p in found)
    swing = successor(schedule, found[0])
    fix(planner, context, WalkingState(swing))
    assert plan(planner, context) is not found[0]
    assert [id(s) for s in planned] == [id(schedule), id(swing)]


def test_plans_again_for_an_equal_but_other_schedule(planner, planned):
    """Oracle: object identity is what counts."""
    context = planner.CreateDefaultContext()
    for _ in range(2):
        fix(planner, context, WalkingState(walk()))
        plan(planner, context)
    assert len(planned) == 2


def test_contexts_do_not_share_their_memory(planner, planned):
    """Oracle: the core, for two contexts that are used in turns."""
    both = [planner.CreateDefaultContext() for _ in range(2)]
    two = [WalkingState(walk(length), 0.2) for length in (0.1, 0.3)]
    for _ in range(3):
        for context, state in zip(both, two, strict=True):
            fix(planner, context, state)
            np.testing.assert_array_equal(
                reference(planner, context), expected_reference(state)
            )
    assert len(planned) == 2


def test_a_cloned_context_goes_on_by_itself(planner, planned):
    """Oracle: the original is not disturbed, and nothing is planned twice."""
    context = planner.CreateDefaultContext()
    state = WalkingState(walk(), 0.1)
    fix(planner, context, state)
    original = plan(planner, context)
    clone = context.Clone()
    fix(planner, clone, replace(state, time_in_phase=0.2))
    assert plan(planner, clone) is original
    fix(planner, clone, WalkingState(walk(0.1)))
    assert plan(planner, clone) is not original
    fix(planner, context, replace(state, time_in_phase=0.2))
    assert plan(planner, context) is original
    assert len(planned) == 2


def test_the_memory_changes_no_output(planner):
    """Oracle: a context that has planned nothing else before."""
    context = planner.CreateDefaultContext()
    for state in [*states(), *reversed(list(states()))]:
        fresh = planner.CreateDefaultContext()
        fix(planner, fresh, state)
        fix(planner, context, state)
        np.testing.assert_array_equal(
            reference(planner, context), reference(planner, fresh)
        )


@pytest.mark.parametrize("port", ["icp_plan", "icp_reference"])
def test_a_wrong_type_raises(planner, port):
    """Oracle: the message names the port and both types."""
    context = planner.CreateDefaultContext()
    fix(planner, context, walk())
    with pytest.raises(
        TypeError, match="'walking_state' got a ContactSchedule, needs a Walk"
    ):
        planner.GetOutputPort(port).Eval(context)


@pytest.mark.parametrize("port", ["icp_plan", "icp_reference"])
def test_a_missing_input_raises(planner, port):
    """Oracle: Drake's own message."""
    context = planner.CreateDefaultContext()
    with pytest.raises(RuntimeError, match=r"walking_state.*is not connected"):
        planner.GetOutputPort(port).Eval(context)


def test_refuses_bad_params():
    """Oracle: the validation of the params."""
    with pytest.raises(ValueError, match=r"min_bend_time = -1\.0"):
        IcpPlanner(IcpPlanParams(min_bend_time=-1.0), SOLE, OMEGA)


def test_params_survive_yaml():
    """Oracle: what was dumped; a partial override keeps the other defaults."""
    text = yaml_dump_typed(PARAMS)
    assert yaml_load_typed(schema=IcpPlanParams, data=text) == PARAMS
    loaded = yaml_load_typed(
        schema=IcpPlanParams,
        data="cop: {exit: {max_x: 0.05}, num_previewed_steps: 2}",
        defaults=IcpPlanParams(),
    )
    expected = IcpPlanParams()
    expected.cop.exit.max_x = 0.05
    expected.cop.num_previewed_steps = 2
    assert loaded == expected
