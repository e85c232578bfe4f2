"""Oracles: core.plan.time_adjustment, called with the same values; Eq. 16."""

import numpy as np
import pytest

from nadia_balance.core.plan.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.plan.time_adjustment import Timing, TimingAdapterParams
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.vocabulary import WalkingState
from nadia_balance.systems.timing_adapter import TimingAdapter
from tests.blocks import answer, asked, fix
from tests.example_walks import ALL, MODEL, successor, walk

PERIOD = 0.002  # [s]
PARAMS = TimingAdapterParams()
NOW = 0.1  # in the phase [s]


def inputs(ahead=0.5, transfer=False):
    """The values of the ports; the ICP is `ahead` [s] of the plan.

    In the first swing, or in the first `transfer`.
    """
    schedule = walk(length=0.0)
    plan = plan_icp(schedule, IcpPlanParams(), MODEL)
    if not transfer:
        schedule = successor(schedule, plan)
        plan = plan_icp(schedule, IcpPlanParams(), MODEL)
    return {
        "icp": plan.at(NOW + ahead).icp,
        "icp_plan": plan,
        "walking_state": WalkingState(schedule, NOW, NOW),
        "foot_poses": schedule.feet,
    }


def gain(values, params=PARAMS, period=PERIOD):
    adapter = TimingAdapter(params, MODEL, period)
    return answer(adapter, asked(adapter, **values), "time_adjustment")


@pytest.mark.parametrize("ahead", [0.0, 0.4, 0.5])
def test_proposes_what_the_core_says(ahead):
    """Oracle: the core function, to the last bit."""
    values = inputs(ahead)
    icp, plan, state, feet = values.values()
    timing = Timing(PARAMS, MODEL, PERIOD)
    expected = timing.adjustment(state, plan, icp, feet, ALL)
    np.testing.assert_array_equal(gain(values), expected)
    assert (expected.now > 0.0) is (ahead > 0.0)


@pytest.mark.parametrize("transfer", [False, True])
def test_can_be_switched_for_swings_and_for_transfers(transfer):
    """Oracle: 0 while the switch of the phase is off; the other has no say."""
    values, adapter = (
        inputs(0.15 if transfer else 0.5, transfer),
        TimingAdapter(PARAMS, MODEL, PERIOD),
    )
    context = asked(adapter, **values)
    always = answer(adapter, context, "time_adjustment").copy()
    assert always[0] > 0.0
    for on in (True, False) * 2:
        switches = Mechanisms(False, on, not on, False)
        fix(adapter, context, mechanisms=switches.as_vector())
        found = answer(adapter, context, "time_adjustment")
        np.testing.assert_array_equal(found, always * (on is not transfer))
