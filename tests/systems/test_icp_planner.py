"""Oracle: the core functions."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.plan.atlas_icp_plan import (
    AtlasIcpPlanParams,
    plan_atlas_icp,
)
from nadia_balance.core.plan.cop_waypoints import IcpPlanParams
from nadia_balance.core.plan.icp_plan import plan_icp, reference_of
from nadia_balance.core.walking.state import Phase, WalkingState
from nadia_balance.systems.plan import IcpPlanner
from nadia_balance.systems.signals import IcpReference
from tests.blocks import answer, asked
from tests.example_walks import MODEL, planned, successor, walk

PERIOD = 0.002


def states():
    """In a transfer, in the swing after it, standing; and waiting in each."""
    transfer = walk()
    swing = successor(transfer, planned(transfer))
    standing = replace(transfer, phase=Phase.STANDING)
    for schedule in transfer, swing, standing:
        yield WalkingState(schedule, 0.1)
        yield WalkingState(schedule, schedule.duration, waiting=True)


def assert_tells(system, context, expected):
    """The output port icp_reference says what the ReferencePoint does."""
    view = IcpReference(answer(system, context, "icp_reference"))
    for name in "icp", "icp_velocity", "cop", "ecmp":
        assert np.array_equal(getattr(view, name), getattr(expected, name))


@pytest.mark.parametrize(
    ("params", "by_core"),
    [(IcpPlanParams(), plan_icp), (AtlasIcpPlanParams(), plan_atlas_icp)],
)
def test_outputs_are_those_of_the_core(params, by_core):
    """Oracle: the plan of either paper, and reference_of()."""
    planner = IcpPlanner(params, MODEL, PERIOD)
    for state in states():
        context = asked(planner, walking_state=state)
        expected = by_core(state.schedule, params, MODEL)
        planned = answer(planner, context, "icp_plan")
        np.testing.assert_array_equal(
            planned.coefficients, expected.coefficients
        )
        assert_tells(planner, context, reference_of(expected, state))
    alone = IcpPlanner(params, MODEL, PERIOD, has_reference=False)
    assert not alone.HasOutputPort("icp_reference")
