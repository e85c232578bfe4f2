"""Oracle: by hand."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.next_step import (
    lift_off_times,
    next_step,
    swing_times,
    usable_support,
)
from nadia_balance.core.polygon import contains
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.time_adjustment import TimingAdapterParams
from nadia_balance.core.walking import (
    Adjustment,
    FootPose,
    Phase,
    WalkingState,
)
from tests.example_walks import OMEGA, SOLE, walk

PARAMS = CaptureRegionStepAdjusterParams()
HURRIED = TimingAdapterParams(
    min_swing_duration=0.4, min_transfer_duration=0.05
)
AS_PLANNED = TimingAdapterParams(swing=False, transfer=False)
LEFT_Y, RIGHT_Y = 0.125, -0.125


def state_in(phase, time=0.0, elapsed=None, **gait):
    """A walk's first step, so long [s] in this phase."""
    schedule = walk(**{"length": 0.0, **gait})
    step = schedule.footsteps[0]
    duration = {
        Phase.STANDING: 0.5,
        Phase.TRANSFER: step.transfer_duration,
        Phase.SWING: step.swing_duration,
    }[phase]
    schedule = replace(schedule, phase=phase, duration=duration)
    elapsed = time if elapsed is None else elapsed
    return WalkingState(schedule, time_in_phase=time, elapsed=elapsed)


def step_of(state, adjuster=PARAMS, timing=HURRIED):
    foot, at_rest = np.array([0.0, RIGHT_Y]), np.zeros(2)
    return next_step(state, foot, at_rest, SOLE, OMEGA, adjuster, timing)


@pytest.mark.parametrize(
    ("phase", "time", "elapsed", "planned", "hurried"),
    [
        (Phase.SWING, 0.3, 0.3, (0.0,), (0.0,)),
        (Phase.TRANSFER, 0.0, 0.0, (0.3,), (0.05, 0.3)),
        (Phase.TRANSFER, 0.2, 0.2, (0.1,), (0.0, 0.1)),
        (Phase.TRANSFER, 0.28, 0.03, (0.02,), (0.02,)),  # too late to hurry
        (Phase.STANDING, 0.1, 0.1, (0.7,), (0.45, 0.7)),
    ],
)
def test_the_foot_is_lifted_as_planned_or_in_a_hurry(
    phase, time, elapsed, planned, hurried
):
    """Oracle: by hand; a transfer takes 0.3 s, 0.05 s at least."""
    state = state_in(phase, time, elapsed)
    assert lift_off_times(state, AS_PLANNED) == pytest.approx(planned)
    assert lift_off_times(state, HURRIED) == pytest.approx(hurried)


@pytest.mark.parametrize(
    ("time", "elapsed", "earliest"),
    [
        (0.0, 0.0, 0.4),  # of the shortest swing
        (0.275, 0.275, (0.7 - 0.275) / 3.0),  # of the largest speed-up
        (0.55, 0.55, 0.08),  # that a foot always needs
        (0.65, 0.65, 0.05),  # as planned, that is sooner
        (0.6, 0.2, 0.1),  # it was hurried before
    ],
)
def test_a_swing_ends_as_planned_or_in_a_hurry(time, elapsed, earliest):
    """Oracle: by hand; 0.7 s, 0.5 s of waiting for the load."""
    state = state_in(Phase.SWING, time, elapsed)
    latest = 0.7 - time + 0.5
    found = swing_times(state, 0.5, AS_PLANNED)
    assert found == pytest.approx((0.7 - time, latest))
    found = swing_times(state, 0.5, HURRIED)
    assert found == pytest.approx((earliest, latest))


def test_a_swing_that_has_not_begun_is_a_whole_one():
    """Oracle: by hand."""
    for phase in Phase.TRANSFER, Phase.STANDING:
        state = state_in(phase, 0.1)
        assert swing_times(state, 0.5, AS_PLANNED) == pytest.approx((0.7, 1.2))
        assert swing_times(state, 0.5, HURRIED) == pytest.approx((0.4, 1.2))


def test_what_stands_is_one_foot_or_the_hull_of_both():
    """Oracle: by hand: 2, 5, 2 and 3 cm off front, back, inside, outside."""
    one = usable_support(state_in(Phase.SWING).schedule, SOLE, PARAMS)
    np.testing.assert_allclose(one.min(axis=0), [-0.075, 0.085], atol=1e-12)
    np.testing.assert_allclose(one.max(axis=0), [0.105, 0.155], atol=1e-12)
    for phase in Phase.TRANSFER, Phase.STANDING:
        both = usable_support(state_in(phase).schedule, SOLE, PARAMS)
        np.testing.assert_allclose(both.min(axis=0), [-0.075, -0.155])
        np.testing.assert_allclose(both.max(axis=0), [0.105, 0.155])
        assert shapely.Polygon(both).area == pytest.approx(0.18 * 0.31)


def test_an_unadjusted_foot_lands_where_it_is_told():
    """Oracle: the foothold, and D_n of no area: there is no choice at all."""
    step = step_of(state_in(Phase.SWING), replace(PARAMS, enabled=False))
    (foothold,) = step.footholds
    np.testing.assert_array_equal(foothold, [[0.0, RIGHT_Y]])
    assert [len(offsets) for offsets in step.offsets] == [1, 1, 1]


def test_shortly_before_it_lands_a_foot_goes_on_to_where_it_was_sent():
    """Oracle: the adjusted foothold; the nominal one until then."""
    sent = FootPose([0.3, -0.4, 0.0])
    for time, number, expected in (0.6, 2, RIGHT_Y), (0.66, 1, -0.4):
        state = state_in(Phase.SWING, time)
        nominal, *later = state.schedule.footsteps
        steps = (replace(nominal, pose=sent), *later)
        state = replace(
            state,
            schedule=replace(state.schedule, footsteps=steps),
            adjustment=Adjustment(nominal, sent),
        )
        footholds = step_of(state).footholds
        assert (len(footholds) >= number) and footholds[0][0, 1] == expected


def test_crossing_the_legs_adds_footholds():
    """Oracle: a point in front of the stance foot, beyond its centre line."""
    crossing = replace(PARAMS, reachability=ReachabilityParams(cross_over=True))
    across, on_it = np.array([0.5, 0.15]), np.array([0.1, 0.1])
    for adjuster, expected in (PARAMS, False), (crossing, True):
        polygons = step_of(state_in(Phase.TRANSFER), adjuster).footholds[1:]
        assert any(contains(across, p) for p in polygons) == expected
        assert not any(contains(on_it, p) for p in polygons)
