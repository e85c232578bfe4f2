"""Oracles: the core functions; a count of the plans made."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.plan.atlas_icp_plan import (
    AtlasIcpPlanParams,
    plan_atlas_icp,
)
from nadia_balance.core.plan.icp_plan import (
    IcpPlanParams,
    plan_icp,
    reference_of,
)
from nadia_balance.core.walking.vocabulary import Phase, WalkingState
from nadia_balance.systems import icp_planner
from nadia_balance.systems.icp_planner import IcpPlanner
from nadia_balance.systems.signals import IcpReference
from tests.blocks import answer, asked, fix
from tests.example_walks import MODEL, successor, walk

PARAMS, PERIOD = IcpPlanParams(), 0.002


@pytest.fixture
def planner():
    return IcpPlanner(PARAMS, MODEL, PERIOD)


@pytest.fixture
def planned(monkeypatch):
    """The schedules that were planned, in order."""
    schedules = []

    def counting(schedule, *args):
        schedules.append(schedule)
        return plan_icp(schedule, *args)

    monkeypatch.setattr(icp_planner.icp_plan, "plan_icp", counting)
    return schedules


def plan(planner, context):
    return answer(planner, context, "icp_plan")


def reference(planner, context):
    return answer(planner, context, "icp_reference")


def states():
    """In a transfer, in the swing after it, standing; and waiting in each."""
    transfer = walk()
    swing = successor(transfer, plan_icp(transfer, PARAMS, MODEL))
    standing = replace(transfer, phase=Phase.STANDING)
    for schedule in transfer, swing, standing:
        yield WalkingState(schedule, 0.1)
        yield WalkingState(schedule, schedule.duration, waiting=True)


@pytest.mark.parametrize(
    ("params", "by_core"),
    [(PARAMS, plan_icp), (AtlasIcpPlanParams(), plan_atlas_icp)],
)
def test_outputs_are_those_of_the_core(params, by_core):
    """Oracle: the plan of either paper, and reference_of()."""
    planner = IcpPlanner(params, MODEL, PERIOD)
    for state in states():
        context = asked(planner, walking_state=state)
        expected = by_core(state.schedule, params, MODEL)
        found, now = plan(planner, context), reference_of(expected, state)
        np.testing.assert_array_equal(found.coefficients, expected.coefficients)
        view = IcpReference(reference(planner, context))
        for name in "icp", "icp_velocity", "cop", "ecmp":
            assert np.array_equal(getattr(view, name), getattr(now, name))
    alone = IcpPlanner(params, MODEL, PERIOD, has_reference=False)
    assert not alone.HasOutputPort("icp_reference")


def test_plans_a_schedule_once_whatever_the_clock_says(planner, planned):
    """Oracle: the count of plans, over ticks and phases."""
    context, schedule, found = asked(planner), walk(), []
    for t in 0.0, 0.1, 0.2, 0.3:
        fix(planner, context, walking_state=WalkingState(schedule, t))
        reference(planner, context)
        found.append(plan(planner, context))
    assert len(planned) == 1
    assert all(p is found[0] for p in found)
    swing = successor(schedule, found[0])
    fix(planner, context, walking_state=WalkingState(swing))
    assert plan(planner, context) is not found[0]
    assert [id(s) for s in planned] == [id(schedule), id(swing)]
