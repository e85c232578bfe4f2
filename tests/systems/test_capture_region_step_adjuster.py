"""Oracles: the core functions; a count of the geometries made."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
)
from nadia_balance.core.steps.foothold_adjustment import (
    Landing,
    capture_regions,
    propose_adjustment,
    touchdown_interval,
    unadjusted,
)
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import Adjustment, FootPose, WalkingState
from nadia_balance.systems.ports import NOTHING
from nadia_balance.systems.steps import CaptureRegionStepAdjuster
from tests.blocks import answer, asked, fix
from tests.example_walks import ALL, MODEL, standing, walk
from tests.systems.test_icp_step_controller import IN_AIR, IN_PLACE, OFF, OUT

PARAMS = CaptureRegionStepAdjusterParams()
PERIOD = 0.002  # [s]
NEAR = FootPose([0.03, -0.15, 0.0])
ADJUSTER = CaptureRegionStepAdjuster(PARAMS, MODEL, PERIOD)


def adjustment(context):
    return answer(ADJUSTER, context, "adjustment")


def drawn(context):
    return answer(ADJUSTER, context, "capture_regions")


def landing(icp, gain=0.0, on=ALL):
    geometry = SwingGeometry(IN_PLACE, PARAMS, MODEL, on)
    times = touchdown_interval(IN_AIR, gain, PARAMS)
    return Landing(geometry, icp, times)


def expected(icp=OUT, gain=0.0, on=ALL):
    return proposed(landing(icp, gain, on))


def proposed(case):
    return propose_adjustment(IN_AIR, case, PARAMS, PERIOD)


@pytest.mark.parametrize("gain", [None, 0.15])
def test_proposes_and_draws_what_the_core_does(gain):
    """Oracle: propose_adjustment() and capture_regions().

    If the time is not connected, the clock keeps its pace.
    """
    context = asked(ADJUSTER, walking_state=IN_AIR, alip_icp=OUT)
    if gain is not None:
        fix(ADJUSTER, context, time_adjustment=[0.1, gain])
    proposal = expected(gain=gain or 0.0)
    assert adjustment(context) == proposal
    assert proposal.moved
    ours = drawn(context)
    theirs = capture_regions(landing(OUT, gain or 0.0), proposal)
    for one, other in zip(ours.regions, theirs.regions, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(ours.reach, theirs.reach)
    assert (ours.nominal, ours.adjusted) == (theirs.nominal, theirs.adjusted)


def test_sees_the_way_of_the_foot_while_a_swing_may_be_faster():
    """Oracle: the core, with the place of the swing foot, or with none."""
    icp, feet = np.array([0.1, 0.6]), IN_PLACE.feet
    hurried = proposed(replace(landing(icp), foot=feet.right.p_WF[:2]))
    context = asked(
        ADJUSTER, walking_state=IN_AIR, alip_icp=icp, foot_poses=feet
    )
    assert adjustment(context) == hurried
    unhurried = expected(icp)
    assert (hurried.region, unhurried.region) == ("base", "forward")
    fix(ADJUSTER, context, mechanisms=replace(ALL, swing=False).as_vector())
    assert adjustment(context) == unhurried


def test_proposes_nothing_and_draws_what_stays_while_it_is_off():
    """Oracle: NOTHING; the foothold that stays, its region without crossing."""
    context = asked(ADJUSTER, walking_state=IN_AIR, alip_icp=OUT)
    for on in True, False, True:
        mechanisms = Mechanisms(step=on, cross_over=True)
        fix(ADJUSTER, context, mechanisms=mechanisms.as_vector())
        assert (adjustment(context) is not NOTHING) is on
    assert adjustment(context) == expected()
    before = Adjustment(IN_PLACE.footsteps[0], NEAR, "forward")
    state = replace(IN_AIR, adjustment=before)
    fix(ADJUSTER, context, mechanisms=OFF, walking_state=state)
    off = drawn(context)
    assert (off.adjusted, off.nominal) == (NEAR, IN_PLACE.footsteps[0].pose)
    assert len(off.regions) == 3
    fix(ADJUSTER, context, walking_state=IN_AIR)
    never = drawn(context)
    assert never.adjusted == never.nominal == IN_PLACE.footsteps[0].pose
    np.testing.assert_array_equal(off.reach, never.reach)


@pytest.mark.parametrize(
    "schedule", [walk(), replace(walk(), footsteps=()), standing()]
)
def test_outside_of_a_swing_nothing_is_adjusted_or_drawn(schedule):
    """Oracle: unadjusted(), and no regions; no foothold is needed."""
    context = asked(
        ADJUSTER, walking_state=WalkingState(schedule), alip_icp=OUT
    )
    assert adjustment(context) == unadjusted(schedule)
    drawing = drawn(context)
    assert drawing.regions == ()
    assert drawing.nominal is drawing.adjusted is None
