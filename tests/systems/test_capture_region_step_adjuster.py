"""Oracles: the core functions; a count of the geometries made."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.steps import capture_region
from nadia_balance.core.steps import foothold_adjustment as footholds
from nadia_balance.core.walking import state as walking
from nadia_balance.systems.ports import NOTHING
from nadia_balance.systems.steps import CaptureRegionStepAdjuster
from tests.blocks import answer, asked, fix
from tests.example_walks import ALL, MODEL, standing, walk
from tests.systems.test_icp_step_controller import IN_AIR, IN_PLACE, OUT

PARAMS = capture_region.CaptureRegionStepAdjusterParams()
PERIOD = 0.002  # [s]
NEAR = walking.FootPose([0.03, -0.15, 0.0])
ADJUSTER = CaptureRegionStepAdjuster(PARAMS, MODEL, PERIOD)


def adjustment(context):
    return answer(ADJUSTER, context, "adjustment")


def drawn(context):
    return answer(ADJUSTER, context, "capture_regions")


def landing(icp, gain=0.0, on=ALL):
    geometry = capture_region.SwingGeometry(IN_PLACE, PARAMS, MODEL, on)
    times = footholds.touchdown_interval(IN_AIR, gain, PARAMS)
    return footholds.Landing(geometry, icp, times)


def expected(icp=OUT, gain=0.0, on=ALL):
    return proposed(landing(icp, gain, on))


def proposed(case):
    return footholds.propose_adjustment(IN_AIR, case, PARAMS, PERIOD)


@pytest.mark.parametrize("gain", [None, 0.15])
def test_proposes_and_draws_what_the_core_does(gain):
    """Oracle: propose_adjustment() and capture_regions().

    If the time is not connected, the clock keeps its pace.
    """
    context = asked(ADJUSTER, walking_state=IN_AIR, alip_icp=OUT)
    if gain is not None:
        fix(ADJUSTER, context, time_adjustment=[0.1, gain])
    found, wanted = adjustment(context), expected(gain=gain or 0.0)
    assert found == wanted and found.moved
    ours = drawn(context)
    theirs = footholds.capture_regions(landing(OUT, gain or 0.0), wanted)
    for one, other in zip(ours.regions, theirs.regions, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(ours.reach, theirs.reach)
    assert (ours.nominal, ours.adjusted) == (theirs.nominal, theirs.adjusted)


def test_sees_the_way_of_the_foot_while_a_swing_may_be_faster():
    """Oracle: the core, with the place of the swing foot, or with none."""
    icp, feet = np.array([0.1, 0.6]), IN_PLACE.feet
    wanted = proposed(replace(landing(icp), foot=feet.right.p_WF[:2]))
    context = asked(
        ADJUSTER, walking_state=IN_AIR, alip_icp=icp, foot_poses=feet
    )
    assert adjustment(context) == wanted
    unhurried = expected(icp)
    assert (wanted.region, unhurried.region) == ("base", "forward")
    fix(ADJUSTER, context, mechanisms=replace(ALL, swing=False).as_vector())
    assert adjustment(context) == unhurried


def test_proposes_nothing_and_draws_what_stays_while_it_is_off():
    """Oracle: NOTHING; the foothold that stays, its region without cross-over.

    The first of the mechanisms is the switch.
    """
    context = asked(ADJUSTER, walking_state=IN_AIR, alip_icp=OUT)
    for on in True, False, True:
        fix(ADJUSTER, context, mechanisms=[on, 0, 0, 1])
        assert ((found := adjustment(context)) is not NOTHING) is on
    assert found == expected()
    before = walking.Adjustment(IN_PLACE.footsteps[0], NEAR, "forward")
    state = replace(IN_AIR, adjustment=before)
    fix(ADJUSTER, context, mechanisms=[0, 0, 0, 0], walking_state=state)
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
        ADJUSTER, walking_state=walking.WalkingState(schedule), alip_icp=OUT
    )
    assert adjustment(context) == footholds.unadjusted(schedule)
    found = drawn(context)
    assert (found.regions, found.nominal, found.adjusted) == ((), None, None)
