"""Oracles: Eq. 3, the limits by hand, plans that are ahead."""

import math
from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.math.lipm import icp_after
from nadia_balance.core.plan.icp_plan import IcpReference
from nadia_balance.core.plan.time_adjustment import (
    Timing,
    TimingAdapterParams,
    gamma,
    is_leaving,
)
from nadia_balance.core.walking.state import (
    Adjustment,
    FootPose,
    Side,
    WalkingState,
)
from tests import example_walks as walks

PERIOD = 0.002
PARAMS = TimingAdapterParams(min_swing_duration=0.4, min_transfer_duration=0.05)
DETOUR = replace(walks.IDEAL_DETOUR, max_acceleration=30.0)
# Nothing but Eq. 15: almost no threshold, and little that limits 1 s of swing.
FREE = TimingAdapterParams(
    icp_error_threshold=1e-5,
    min_swing_duration=0.35,
    min_transfer_duration=0.03,
    max_speed_up=100.0,
)


def transfer(**gait):
    """A transfer in the middle of a walk, and its plan."""
    schedule, plan = swing(**gait)
    schedule = walks.successor(schedule, plan)
    return schedule, walks.planned(schedule)


def swing(**gait):
    """The first swing, of the right foot, and its plan."""
    first = walks.walk(**gait)
    schedule = walks.successor(first, walks.planned(first))
    return schedule, walks.planned(schedule)


def timing_of(params=PARAMS, detour=DETOUR):
    return Timing(params, replace(walks.MODEL, detour=detour), PERIOD)


def adjusted(
    icp, plan, state, params=PARAMS, feet=None, detour=DETOUR, alip_icp=None
):
    feet = feet or state.schedule.feet
    timing, icp = timing_of(params, detour), np.array(icp)
    alip_icp = icp if alip_icp is None else np.array(alip_icp)
    return timing.adjustment(state, plan, icp, alip_icp, feet, walks.ALL)


def adjustment(*args, **options):
    return adjusted(*args, **options).now


def test_an_icp_that_no_ecmp_can_hold_is_leaving():
    """Oracle: by hand, for one sole with the reference eCMP at its centre."""
    still = np.zeros(2)
    for icp, icp_r, leaving in (
        ((0.30, 0.0), (0.0, 0.0), True),  # far in front
        ((0.13, 0.0), (0.12, 0.0), False),  # an eCMP 1 cm ahead holds it
        ((0.11, 0.0), (0.0, 0.0), False),  # held error or not, it is inside
        ((0.0, -0.20), (0.0, -0.30), False),  # lags behind a swing outward
        ((0.0, 0.09), (0.0, -0.05), True),  # past the outer edge
        ((0.2, -0.1), (0.0, -0.1), True),  # in front and beside
    ):
        icp_r = np.array(icp_r)
        reference = IcpReference(icp_r, still, still, still, still, still)
        assert is_leaving(np.array(icp), reference, walks.SOLE, 0.02) is leaving


@pytest.mark.parametrize(
    ("elapsed", "distance", "lifted", "height", "expected"),
    [
        (0.1, 0.0, 0.0, 0.0, 0.3),  # the shortest swing of 0.4 s
        (0.3, 0.0, 0.0, 0.0, 0.7 / 3.0),  # sigma
        (0.9, 0.0, 0.0, 0.0, 0.08),  # the least of all
        # 0.6 m forth and 0.6 m back in 0.2 s each; then down, and 0.03 s.
        (0.1, 1.2, 0.15, 0.20, 0.65),  # from the brink: 0.15 m at 0.6 m/s
        (0.1, 1.2, 0.15, 0.06, 0.50),  # below it already
        (0.1, 1.2, 0.0, 0.10, 0.43),  # on level ground it only settles
        (0.1, 1.2, -0.15, 0.10, 0.43),  # up a step
    ],
)
def test_the_swing_foot_gets_the_time_that_it_needs(
    elapsed, distance, lifted, height, expected
):
    """Oracle: by hand, each limit in turn; a swing of 1 s, without error."""
    detour = replace(DETOUR, max_descent=0.6, settling=0.03)
    schedule, plan = swing(swing=1.0)
    stood = schedule.feet.right
    stood = replace(stood, p_WF=stood.p_WF + [0.0, 0.0, lifted])
    feet = schedule.feet.with_foot(Side.RIGHT, stood)
    state = WalkingState(replace(schedule, feet=feet), elapsed, elapsed)
    target = schedule.footsteps[0].pose.p_WF
    foot = FootPose(target + [-distance, 0.0, height])
    timing = timing_of(detour=detour)
    landing = timing.time_to_foothold(state, foot)
    result = timing.least_remaining_time(state, foot, np.zeros(2), landing)
    assert result == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("size", [0.05, 0.15])
def test_the_swing_foot_gets_the_time_to_where_the_icp_takes_its_foothold(size):
    """Oracle: the foothold moved by the ICP error as Eq. 3 lets it grow.

    The one that the adjustment has moved already does not count twice.
    """
    schedule, plan = swing(swing=1.0)
    step, foot = schedule.footsteps[0], schedule.feet.right
    schedule = replace(schedule, footsteps=(replace(step, pose=foot),))
    adjusted = Adjustment(step, foot)
    state = WalkingState(schedule, 0.3, 0.3, adjustment=adjusted)
    error = np.array([size, 0.0])
    timing = timing_of()
    landing = timing.time_to_foothold(state, foot)
    result = timing.least_remaining_time(state, foot, error, landing)
    direction = step.pose.p_WF[:2] - foot.p_WF[:2]

    def in_time(t):
        moved = icp_after(error, np.zeros(2), walks.OMEGA, t)
        half_way = 0.5 * np.linalg.norm(direction + moved)
        return half_way <= 0.5 * 30.0 * (0.5 * t) ** 2 + 1e-12

    times = np.linspace(0.7 / 3.0, 0.7, 16, endpoint=False)
    first = [t for t in times if in_time(t)]
    assert result == pytest.approx(first[0] if first else times[0], abs=1e-12)


# From rest 0.4 s at 30 m/s^2, under way sqrt(1/2) of that; 0.03 s are let be.
NEEDED = 0.4 * math.sqrt(0.5) - 0.03


def test_a_foot_near_its_foothold_lands():
    """Oracle: the clock runs to the end though the foot gets no nearer.

    It once stood still there, and the foot in the air, with 13 ms left.
    """
    schedule, _ = swing(swing=1.0)
    state = WalkingState(schedule, 0.99, 0.6)
    target = schedule.footsteps[0].pose.p_WF
    slow = replace(DETOUR, settling=0.1)
    for distance, lands in ((0.075, True), (0.085, False)):
        foot = FootPose(target - [distance, 0.0, 0.0])
        timing = timing_of(detour=slow)
        landing = timing.time_to_foothold(state, foot)
        late = timing.time_to_return(state, foot, landing)
        assert (late == 0.0) is lands


@pytest.mark.parametrize(
    ("distance", "gained", "more", "expected"),
    [
        (1.2, 0.3, 0.0, NEEDED - 0.1),  # 0.1 s left
        (1.2, 0.05, 0.0, 0.05),  # no more than was gained
        (1.2, 0.05, 0.04, 0.09),  # and than the swing may last longer
        (1.2, -0.03, 0.05, 0.02),  # some of that has passed
        (1.2, 0.0, 0.0, 0.0),
        (0.2, 0.3, 0.1, 0.0),  # in time
    ],
)
def test_time_is_given_back_if_the_foothold_moves_away(
    distance, gained, more, expected
):
    """Oracle: by hand."""
    schedule, plan = swing(swing=1.0)
    step = schedule.footsteps[0]
    target = step.pose
    longer = Adjustment(step, target, prolonged=more)
    state = WalkingState(
        schedule, 0.9, 0.9 - gained, adjustment=longer if more else None
    )
    foot = FootPose(target.p_WF - [distance, 0.0, 0.0])
    feet = schedule.feet.with_foot(Side.RIGHT, foot)
    timing = timing_of()
    landing = timing.time_to_foothold(state, foot)
    result = timing.time_to_return(state, foot, landing)
    assert result == pytest.approx(expected, abs=1e-12)
    proposed = adjustment(plan.at(0.9).icp, plan, state, feet=feet)
    assert proposed == pytest.approx(-expected, abs=1e-12)


def with_gamma(gamma):
    """FREE with this gamma at PERIOD: the time constant by hand."""
    time = -PERIOD / math.log(1.0 - gamma)
    return replace(FREE, swing_time_constant=time, transfer_time_constant=time)


def run_ahead(schedule, plan, lead, params, ticks):
    """The clock, tick by tick, while the ICP is `lead` [s] ahead of time."""
    state, clock = WalkingState(schedule), []
    for tick in range(ticks):
        state = replace(state, elapsed=tick * PERIOD)
        icp = plan.at(state.elapsed + lead).icp
        gain = adjustment(icp, plan, state, params)
        state = replace(state, time_in_phase=state.time_in_phase + gain)
        clock.append(state.time_in_phase)
        state = replace(state, time_in_phase=state.time_in_phase + PERIOD)
    return np.array(clock)


@pytest.mark.parametrize(
    ("phase", "lead", "gamma"), [(swing, 0.4, 0.1), (transfer, 0.1, 0.4)]
)
def test_the_clock_catches_up_with_an_icp_that_is_ahead(phase, lead, gamma):
    """Oracle: the plan itself, sampled ahead of time.

    The clock only goes forward.
    """
    schedule, plan = phase(swing=1.0, transfer=0.4)
    params = with_gamma(gamma)
    ticks = 100 if phase is swing else 60
    clock = run_ahead(schedule, plan, lead, params, ticks)
    assert np.diff(clock).min() >= PERIOD - 1e-12
    exact = lead + PERIOD * np.arange(ticks)
    assert clock[-1] == pytest.approx(exact[-1], abs=1e-4)
    assert np.max(clock - exact) < 1e-4  # not beyond the ICP at any time
    # Without a time constant all is made up at once: with one, a share of it.
    state, icp = WalkingState(schedule), plan.at(0.1).icp
    at_once = replace(FREE, swing_time_constant=0.0, transfer_time_constant=0.0)
    gain = adjustment(icp, plan, state, at_once)
    share = adjusted(icp, plan, state, params)
    assert gain > 0.05 and share == pytest.approx((gamma * gain, gain))


def test_an_icp_that_leaves_hurries_all_it_can_at_once():
    """Oracle: the shortest transfer and swing, by hand."""
    schedule, plan = transfer()
    state = WalkingState(schedule, 0.03, 0.03)
    gain = adjusted([9.0, 0.0], plan, state)
    assert gain == pytest.approx(2 * (schedule.duration - 0.05,), abs=1e-12)
    schedule, plan = swing(length=0.0)
    state = WalkingState(schedule, 0.1, 0.1)
    nimble = replace(walks.IDEAL_DETOUR, max_acceleration=1e6)
    gain = adjustment([9.0, 0.125], plan, state, detour=nimble)
    assert gain == pytest.approx(schedule.duration - 0.4, abs=1e-12)


def test_one_icp_that_leaves_alone_skips_nothing():
    """Oracle: gamma of what is ahead, for a leg whose momentum looks so."""
    schedule, plan = swing(length=0.0)
    state = WalkingState(schedule, 0.1, 0.1)
    still, gone = plan.at(0.1).icp, [9.0, 0.125]
    nimble = replace(walks.IDEAL_DETOUR, max_acceleration=1e6)
    options = {"plan": plan, "state": state, "detour": nimble}
    everything = adjusted(gone, **options)
    one = adjusted(still, alip_icp=gone, **options)
    ahead = plan.time_to(np.array(gone), 0.1)
    share = gamma(PARAMS.swing_time_constant, PERIOD)
    assert one.now == pytest.approx(min(share * ahead, everything.now))
    assert one.now < everything.now
    # The icp alone does not even hurry.
    assert adjusted(gone, alip_icp=still, **options).now == 0.0


@pytest.mark.parametrize("phase", [swing, transfer])
def test_small_errors_leave_the_clock_alone(phase):
    """Oracle: the threshold."""
    schedule, plan = phase()
    state = WalkingState(schedule)
    direction = plan.at(schedule.duration).icp - plan.at(0.0).icp
    direction /= np.linalg.norm(direction)
    for error, hurried in (0.99, False), (1.01, True):
        icp = plan.at(0.0).icp + error * PARAMS.icp_error_threshold * direction
        assert (adjustment(icp, plan, state) > 0.0) is hurried


def idle_states():
    """Standing, the last transfer, and phases whose clock has run out."""
    yield WalkingState(walks.standing(), 0.1, 0.1)
    last = replace(walks.walk(), footsteps=())
    yield WalkingState(last, 0.1, 0.1)
    for schedule, _ in swing(), transfer():
        t = schedule.duration
        yield WalkingState(schedule, t, t, waiting=True)


@pytest.mark.parametrize("state", list(idle_states()))
def test_where_nothing_can_be_hurried_the_clock_is_left_alone(state):
    """Oracle: zero, for an ICP that is far away."""
    assert adjustment([9.0, 9.0], walks.planned(state.schedule), state) == 0.0
