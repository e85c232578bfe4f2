"""Oracles: core.plan.time_adjustment, called with the same values."""

import numpy as np
import pytest

from nadia_balance.core.plan.time_adjustment import Timing, TimingAdapterParams
from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.core.walking.state import WalkingState
from nadia_balance.systems.plan import TimingAdapter
from tests.blocks import answer, asked, fix
from tests.example_walks import ALL, MODEL, UNCROSSED, planned, successor, walk

PERIOD = 0.002  # [s]
PARAMS = TimingAdapterParams()
NOW = 0.1  # in the phase [s]


@pytest.mark.parametrize("on", [None, UNCROSSED, MECHANISMS["step"]])
def test_proposes_what_the_core_says(on):
    """Oracle: the core function, to the last bit; all mechanisms, if open."""
    first = walk(length=0.0)
    schedule = successor(first, planned(first))
    plan, state = planned(schedule), WalkingState(schedule, NOW, NOW)
    icp, ahead = plan.at(NOW).icp, plan.at(NOW + 0.5).icp
    feet = schedule.feet
    adapter = TimingAdapter(PARAMS, MODEL, PERIOD)
    context = asked(
        adapter,
        icp=icp,
        alip_icp=ahead,
        icp_plan=plan,
        walking_state=state,
        foot_poses=feet,
    )
    if on is not None:
        fix(adapter, context, mechanisms=on.as_vector())
    timing = Timing(PARAMS, MODEL, PERIOD)
    expected = timing.adjustment(state, plan, icp, ahead, feet, on or ALL)
    adjustment = answer(adapter, context, "time_adjustment")
    np.testing.assert_array_equal(adjustment, expected)
    assert (expected.now > 0.0) is (on is None or on.swing)
