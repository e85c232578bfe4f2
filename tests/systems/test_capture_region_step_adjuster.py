"""Oracles: the core functions; a count of the geometries made."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.foothold_adjustment import (
    CaptureRegions,
    Landing,
    capture_regions,
    propose_adjustment,
    touchdown_interval,
    unadjusted,
)
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.swing_geometry import swing_geometry
from nadia_balance.core.walking import (
    Adjustment,
    FootPose,
    Phase,
    WalkingState,
)
from nadia_balance.systems import capture_region_step_adjuster
from nadia_balance.systems.capture_region_step_adjuster import (
    CaptureRegionStepAdjuster,
)
from tests.example_walks import OMEGA, SOLE, standing, walk

PARAMS = CaptureRegionStepAdjusterParams(
    reachability=ReachabilityParams(cross_over=True)
)
PERIOD = 0.002  # [s]
OUT = np.array([0.25, 0.05])  # an ICP that needs a step forward


def swing(**gait):
    schedule = walk(**gait)
    duration = schedule.footsteps[0].swing_duration
    return replace(schedule, phase=Phase.SWING, duration=duration)


IN_PLACE = swing(length=0.0)
IN_AIR = WalkingState(IN_PLACE, time_in_phase=0.3, elapsed=0.3)


@pytest.fixture
def adjuster():
    return CaptureRegionStepAdjuster(PARAMS, SOLE, OMEGA, PERIOD)


@pytest.fixture
def made(monkeypatch):
    """The schedules whose geometry was made, in order."""
    schedules = []

    def counting(schedule, *args):
        schedules.append(schedule)
        return swing_geometry(schedule, *args)

    monkeypatch.setattr(
        capture_region_step_adjuster, "swing_geometry", counting
    )
    return schedules


def fix(adjuster, context, state, icp=OUT, time_adjustment=None):
    adjuster.GetInputPort("walking_state").FixValue(context, state)
    adjuster.GetInputPort("icp").FixValue(context, icp)
    if time_adjustment is not None:
        port = adjuster.GetInputPort("time_adjustment")
        port.FixValue(context, [time_adjustment])


def adjustment(adjuster, context):
    return adjuster.GetOutputPort("adjustment").Eval(context)


def drawn(adjuster, context):
    return adjuster.GetOutputPort("capture_regions").Eval(context)


def landing(state, icp, time_adjustment):
    geometry = swing_geometry(state.schedule, SOLE, PARAMS, OMEGA)
    touchdown = touchdown_interval(state, time_adjustment, PARAMS)
    return Landing(geometry, icp, OMEGA, touchdown)


def expected(state, icp=OUT, time_adjustment=0.0):
    return propose_adjustment(
        state, landing(state, icp, time_adjustment), PARAMS, PERIOD
    )


def assert_same(found, wanted):
    np.testing.assert_array_equal(found.pose.p_WF, wanted.pose.p_WF)
    assert found.pose.yaw == wanted.pose.yaw
    assert found.nominal.side is wanted.nominal.side
    assert found.nominal.pose is wanted.nominal.pose
    assert found.region == wanted.region
    assert found.covered_ticks == wanted.covered_ticks


@pytest.mark.parametrize("time_adjustment", [None, 0.0, 0.15])
def test_proposes_what_the_core_proposes(adjuster, time_adjustment):
    """Oracle: propose_adjustment(); unconnected, the clock keeps its pace."""
    context = adjuster.CreateDefaultContext()
    fix(adjuster, context, IN_AIR, OUT, time_adjustment)
    found = adjustment(adjuster, context)
    assert_same(found, expected(IN_AIR, OUT, time_adjustment or 0.0))
    assert found.pose is not IN_PLACE.footsteps[0].pose


def switch(adjuster, context, *, step=1, cross_over=1):
    port = adjuster.GetInputPort("mechanisms")
    port.FixValue(context, [step, 0, 0, cross_over])


ACROSS = np.array([0.1, 0.35])  # an ICP that no uncrossed step captures


@pytest.mark.parametrize("built_with", [False, True])
def test_the_switch_of_cross_over_does_what_the_parameter_would(built_with):
    """Oracle: adjusters that were made with or without it, on, off, on."""
    reach = ReachabilityParams(cross_over=built_with)
    params = replace(PARAMS, reachability=reach)
    adjuster = CaptureRegionStepAdjuster(params, SOLE, OMEGA, PERIOD)
    context = adjuster.CreateDefaultContext()
    fix(adjuster, context, IN_AIR, ACROSS)
    regions = []
    for on in True, False, True:
        reach = ReachabilityParams(cross_over=on)
        other = CaptureRegionStepAdjuster(
            replace(PARAMS, reachability=reach), SOLE, OMEGA, PERIOD
        )
        made = other.CreateDefaultContext()
        fix(other, made, IN_AIR, ACROSS)
        switch(adjuster, context, cross_over=on)
        found = adjustment(adjuster, context)
        assert_same(found, adjustment(other, made))
        np.testing.assert_array_equal(
            drawn(adjuster, context).reach, drawn(other, made).reach
        )
        regions.append(found.region)
    assert regions == ["forward", "base", "forward"]


def test_switched_off_it_proposes_nothing():
    """Oracle: None, by the parameter or the switch; the switch comes first."""
    for enabled in False, True:
        params = replace(PARAMS, enabled=enabled)
        adjuster = CaptureRegionStepAdjuster(params, SOLE, OMEGA, PERIOD)
        context = adjuster.CreateDefaultContext()
        fix(adjuster, context, IN_AIR)
        assert (adjustment(adjuster, context) is not None) is enabled
        for on in True, False, True:
            switch(adjuster, context, step=on)
            found = adjustment(adjuster, context)
            assert (found is not None) is on
        assert_same(found, expected(IN_AIR))


def test_switched_off_it_draws_what_there_is(adjuster):
    """Oracle: the foothold that stays; its region is gone with cross-over."""
    context = adjuster.CreateDefaultContext()
    near = FootPose([0.03, -0.15, 0.0])
    before = Adjustment(IN_PLACE.footsteps[0], near, "forward")
    fix(adjuster, context, replace(IN_AIR, adjustment=before))
    on = drawn(adjuster, context)
    switch(adjuster, context, step=0, cross_over=0)
    off = drawn(adjuster, context)
    assert (off.adjusted, off.nominal) == (near, IN_PLACE.footsteps[0].pose)
    assert len(off.regions) == len(on.regions) == 3
    fix(adjuster, context, IN_AIR)
    never = drawn(adjuster, context)
    assert never.adjusted is never.nominal is IN_PLACE.footsteps[0].pose
    np.testing.assert_array_equal(off.reach, never.reach)


def test_reads_its_memory_back_from_the_walking_state(adjuster):
    """Oracle: the count of covered ticks goes on where the state has it."""
    context = adjuster.CreateDefaultContext()
    near = FootPose([0.03, -0.15, 0.0])
    for ticks in 0, 7:
        before = Adjustment(IN_PLACE.footsteps[0], near, "forward", ticks)
        state = replace(IN_AIR, adjustment=before)
        fix(adjuster, context, state, np.array([0.0, 0.07]))
        found = adjustment(adjuster, context)
        assert found.pose is near
        assert (found.region, found.covered_ticks) == ("forward", ticks + 1)


def test_draws_what_the_core_draws(adjuster):
    """Oracle: capture_regions()."""
    context = adjuster.CreateDefaultContext()
    fix(adjuster, context, IN_AIR, OUT, 0.1)
    found = drawn(adjuster, context)
    wanted = capture_regions(
        landing(IN_AIR, OUT, 0.1), expected(IN_AIR, OUT, 0.1)
    )
    for ours, theirs in zip(found.regions, wanted.regions, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(found.reach, wanted.reach)
    assert found.nominal is wanted.nominal
    np.testing.assert_array_equal(found.adjusted.p_WF, wanted.adjusted.p_WF)


@pytest.mark.parametrize(
    "schedule",
    [walk(), replace(walk(), footsteps=()), standing()],
    ids=["transfer", "last transfer", "standing"],
)
def test_outside_of_a_swing_nothing_is_adjusted_or_drawn(adjuster, schedule):
    """Oracle: unadjusted(), and no regions; no foothold is needed."""
    context = adjuster.CreateDefaultContext()
    fix(adjuster, context, WalkingState(schedule))
    assert_same(adjustment(adjuster, context), unadjusted(schedule))
    found = drawn(adjuster, context)
    assert isinstance(found, CaptureRegions)
    assert (found.regions, found.nominal, found.adjusted) == ((), None, None)


def test_makes_the_geometry_of_a_swing_once(adjuster, made):
    """Oracle: the count, while clock, ICP and adjusted foothold change."""
    context = adjuster.CreateDefaultContext()
    state = IN_AIR
    for k in range(5):
        fix(adjuster, context, state, OUT - [0.03 * k, 0.0])
        found = adjustment(adjuster, context)
        drawn(adjuster, context)
        assert found.pose is not state.schedule.footsteps[0].pose
        step, *later = state.schedule.footsteps
        steps = (replace(step, pose=found.pose), *later)
        schedule = replace(state.schedule, footsteps=steps)
        state = replace(
            state,
            schedule=schedule,
            adjustment=found,
            time_in_phase=state.time_in_phase + 0.002,
        )
    assert len(made) == 1
    fix(adjuster, context, replace(IN_AIR, schedule=swing(length=0.2)))
    adjustment(adjuster, context)
    assert len(made) == 2


def test_the_memory_changes_no_output(adjuster, made):
    """Oracle: a context that has seen nothing else before."""
    context = adjuster.CreateDefaultContext()
    states = [
        IN_AIR,
        replace(IN_AIR, schedule=swing(length=0.3)),
        replace(IN_AIR, schedule=swing(length=0.3, num_steps=1)),
        WalkingState(walk()),
        replace(IN_AIR, schedule=swing(length=0.3, turn=0.3)),
    ]
    for state in [*states, *reversed(states)]:
        fresh = adjuster.CreateDefaultContext()
        fix(adjuster, fresh, state)
        fix(adjuster, context, state)
        assert_same(adjustment(adjuster, context), adjustment(adjuster, fresh))


def test_a_cloned_context_goes_on_by_itself(adjuster, made):
    """Oracle: the original's output stays; the clone makes its own."""
    context = adjuster.CreateDefaultContext()
    fix(adjuster, context, IN_AIR)
    original = adjustment(adjuster, context)
    clone = context.Clone()
    fix(adjuster, clone, replace(IN_AIR, schedule=swing(length=0.3)))
    other = adjustment(adjuster, clone)
    assert other.nominal is not original.nominal
    assert adjustment(adjuster, context) is original
    assert len(made) == 2


@pytest.mark.parametrize("port", ["adjustment", "capture_regions"])
def test_a_wrong_type_raises(adjuster, port):
    """Oracle: the message names the port and both types."""
    context = adjuster.CreateDefaultContext()
    fix(adjuster, context, IN_PLACE)
    with pytest.raises(
        TypeError, match="'walking_state' got a ContactSchedule, needs a Walk"
    ):
        adjuster.GetOutputPort(port).Eval(context)


@pytest.mark.parametrize(
    ("bad", "message"),
    [({"margin": -1.0}, "margin = -1.0"), ({"foot_front": 0.3}, "foot_front")],
)
def test_bad_parameters_are_refused_at_once(bad, message):
    """Oracle: the message names the field."""
    with pytest.raises(ValueError, match=message):
        CaptureRegionStepAdjuster(replace(PARAMS, **bad), SOLE, OMEGA, PERIOD)


def test_the_ports_have_examples_of_their_types(adjuster):
    """Oracle: the types."""
    for name, kind in (
        ("adjustment", Adjustment),
        ("capture_regions", CaptureRegions),
    ):
        assert isinstance(
            adjuster.GetOutputPort(name).Allocate().get_value(), kind
        )
