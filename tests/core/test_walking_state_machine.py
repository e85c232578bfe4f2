"""Oracles: the sequence of phases by hand; the plan asked at known times."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from nadia_balance.core.gait import Gait, make_footsteps
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import (
    Adjustment,
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
    rectangle,
)
from nadia_balance.core.walking_state_machine import (
    KEEP,
    Measurement,
    Proposal,
    WalkingStateMachineParams,
    advance,
)

PERIOD = 0.002
WEIGHT = 1000.0  # [N]
SOLE = rectangle(0.25, 0.12)
PARAMS = WalkingStateMachineParams()
REACH = ReachabilityParams()
FEET = FootPoses(FootPose([0.0, 0.125, 0.0]), FootPose([0.0, -0.125, 0.0]))


@dataclass
class Sample:
    """A reference at rest over the origin, marked with its time."""

    icp: np.ndarray
    com: np.ndarray
    com_velocity: np.ndarray
    cop: np.ndarray

    def point(self):
        """The start of the next plan."""
        return ReferencePoint(self.com, self.com_velocity, self.cop)


class FakePlan:
    """Returns the time it is asked for as the reference CoM."""

    omega = 3.2

    def at(self, t):
        """A reference whose CoM says `t`."""
        return Sample(np.zeros(2), np.array([t, 0.0]), np.zeros(2), np.zeros(2))


def standing(num_steps):
    """Stands about to take `num_steps` steps in place."""
    steps = make_footsteps(
        Gait(num_steps=num_steps), FEET, ReachabilityParams()
    )
    start = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
    schedule = ContactSchedule(
        Phase.STANDING, Side.LEFT, 0.5, FEET, steps, start
    )
    return WalkingState(schedule, commanded=steps)


def step(
    state,
    forces=(400.0, 400.0),
    icp=(0.0, 0.0),
    feet=FEET,
    proposal=KEEP,
    period=PERIOD,
):
    """One period later."""
    shares = np.array(forces) / WEIGHT
    measured = Measurement(lambda: feet, shares, np.array(icp))
    return advance(
        state, FakePlan(), measured, period, SOLE, REACH, PARAMS, proposal
    )


def until(state, phase, **measured):
    """Advances until `phase` begins; returns the state and the ticks."""
    for ticks in range(1, 5000):
        state = step(state, **measured)
        if state.schedule.phase is phase:
            return state, ticks
    raise AssertionError(f"{phase} never began")


def swinging(num_steps=3):
    """At the start of the first swing."""
    state, _ = until(standing(num_steps), Phase.TRANSFER)
    return until(state, Phase.SWING)[0]


def test_a_walk_of_two_steps_goes_through_all_phases():
    """Oracle: the sequence and the durations by hand."""
    state, story = standing(2), []
    for _ in range(5000):
        in_swing = state.schedule.phase is Phase.SWING
        landed = in_swing and state.time_in_phase > 0.69
        new = step(state, forces=(400, 400) if landed else (0, 0))
        if new.schedule is not state.schedule:
            story.append((new.schedule.phase, new.schedule.support_side))
        state = new
    left, right = Side.LEFT, Side.RIGHT
    assert story == [
        (Phase.TRANSFER, left),
        (Phase.SWING, left),
        (Phase.TRANSFER, right),
        (Phase.SWING, right),
        (Phase.TRANSFER, left),
        (Phase.STANDING, left),
    ]
    assert state.steps_taken == 2
    assert state.schedule.duration == math.inf


def test_phases_last_as_planned():
    """Oracle: durations over the period."""
    state, ticks = until(standing(3), Phase.TRANSFER)
    assert ticks == 250
    state, ticks = until(state, Phase.SWING)
    assert ticks == 400
    assert state.time_in_phase == 0.0


def test_a_foot_that_touches_in_the_first_half_has_not_landed():
    """Oracle: earliest_touchdown of the swing, then 0.8 N s in one tick."""
    state, ticks = until(swinging(), Phase.TRANSFER)
    # Touches from the first tick on.
    assert ticks == 175


def test_a_glitch_of_the_force_is_no_touchdown():
    """Oracle: 0.28 N s each time, and 33 N for ever, are too little."""
    state = swinging()
    for k in range(340):
        force = 70.0 if k % 3 else 0.0
        state = step(state, forces=(400.0, force))
    assert state.schedule.phase is Phase.SWING
    for _ in range(100):
        state = step(state, forces=(400.0, 33.0))
    assert state.schedule.phase is Phase.SWING


@pytest.mark.parametrize(
    ("force", "period", "ticks"),
    [
        (125.0, 0.0005, 6),
        (125.0, 0.001, 3),
        (125.0, 0.002, 2),
        (125.0, 0.01, 1),
        (40.0, 0.002, 5),
        (180.0, 0.002, 1),  # hit hard, it may have left the ground again
    ],
)
def test_a_foot_has_landed_after_an_impulse(force, period, ticks):
    """Oracle: 0.34 ms of the weight over force and period."""
    state = step(swinging(), forces=(800.0, 0.0))
    state = replace(state, time_in_phase=0.6, elapsed=0.6)
    for _ in range(ticks):
        assert state.schedule.phase is Phase.SWING
        state = step(state, forces=(400.0, force), period=period)
    assert state.schedule.phase is Phase.TRANSFER


def test_a_late_foot_stops_the_clock():
    """Oracle: the clock is held at the duration."""
    state = swinging()
    for _ in range(500):
        state = step(state, forces=(800.0, 0.0))
    assert state.time_in_phase == state.schedule.duration
    assert state.waiting


def test_the_next_plan_starts_where_the_reference_is_now():
    """Oracle: the plan, asked for the time of the touchdown."""
    state = swinging()
    for _ in range(200):
        state = step(state, forces=(800.0, 0.0))
    landed, ticks = until(state, Phase.TRANSFER)
    t = (200 + ticks) * PERIOD
    assert landed.schedule.start.com == pytest.approx([t, 0.0])


def test_the_plan_takes_the_feet_as_they_landed():
    """Oracle: the measured pose."""
    landed = FEET.with_foot(Side.RIGHT, FootPose([0.02, -0.13, 0.0], 0.01))
    state, _ = until(swinging(), Phase.TRANSFER, feet=landed)
    assert state.schedule.feet == landed
    assert len(state.schedule.footsteps) == 2
    assert state.steps_taken == 1


@pytest.mark.parametrize(
    ("icp", "lifts"),
    [
        ((0.0, 0.0), True),
        ((0.03, 0.0), True),
        ((0.04, 0.0), False),
        ((0.0, -0.014), True),  # inward of the left foot
        ((0.0, 0.014), False),  # outward is narrower
        ((0.0, 0.25), True),  # 6.5 cm outside: waiting makes it worse
    ],
)
def test_a_foot_lifts_when_the_icp_is_near_or_leaving(icp, lifts):
    """Oracle: the ellipse and the support polygon by hand."""
    state, _ = until(standing(2), Phase.TRANSFER, icp=icp)
    for _ in range(405):
        state = step(state, icp=icp)
    assert (state.schedule.phase is Phase.SWING) is lifts
    assert state.waiting is not lifts


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("contact_force", -1.0),
        ("contact_force", 30.0),
        ("earliest_touchdown", 1.0),
        ("standing_duration", math.nan),
        ("contact_impulse", -0.001),
    ],
)
def test_refuses_bad_parameters(field, value):
    """Oracle: the message names the field and the value."""
    with pytest.raises(ValueError, match=f"{field} = {value}"):
        WalkingStateMachineParams(**{field: value}).validate()


def test_the_clock_runs_faster_by_what_is_proposed():
    """Oracle: by hand; the elapsed time is the real one."""
    state = swinging()
    for _ in range(10):
        state = step(state, proposal=Proposal(time_gain=0.01))
    assert state.time_in_phase == pytest.approx(10 * (PERIOD + 0.01))
    assert state.elapsed == pytest.approx(10 * PERIOD)


def test_the_clock_may_be_held_but_never_runs_back():
    """Oracle: by hand."""
    state = step(swinging())
    held = step(state, proposal=Proposal(time_gain=-1.0))
    assert held.time_in_phase == state.time_in_phase == PERIOD
    slow = step(state, proposal=Proposal(time_gain=-0.5 * PERIOD))
    assert slow.time_in_phase == pytest.approx(1.5 * PERIOD)


def test_patience_ends_a_wait_for_the_icp():
    """Oracle: by hand; the ICP stays where no foot would be lifted."""
    state, _ = until(standing(2), Phase.TRANSFER)
    _, ticks = until(state, Phase.SWING, icp=(0.04, 0.0))
    wait = ticks * PERIOD - state.schedule.duration
    patience = PARAMS.lift_off.held_patience  # it is well inside the support
    assert 0.8 * patience < wait < patience + 1.5 * PERIOD


def test_an_adjusted_step_replaces_the_one_in_the_air():
    """Oracle: the pose; the command and the later steps stay."""
    state = swinging()
    pose = FootPose([0.2, -0.3, 0.0])
    nominal = state.schedule.footsteps[0]
    adjustment = Adjustment(nominal, pose, "base")
    moved = step(state, proposal=Proposal(adjustment=adjustment))
    assert moved.schedule.footsteps[0].pose is pose
    assert moved.schedule.footsteps[1:] == state.schedule.footsteps[1:]
    assert moved.commanded == state.commanded
    assert moved.adjustment is adjustment
    again = step(moved, proposal=Proposal(adjustment=adjustment))
    assert again.schedule is moved.schedule  # nothing to plan anew


def test_a_foot_that_is_down_is_not_moved():
    """Oracle: identity of the schedule in a transfer."""
    state, _ = until(standing(3), Phase.TRANSFER)
    pose = FootPose([0.2, -0.3, 0.0])
    adjustment = Adjustment(state.schedule.footsteps[0], pose, "base")
    moved = step(state, proposal=Proposal(adjustment=adjustment))
    assert moved.schedule is state.schedule


def test_after_a_crossed_step_the_legs_uncross():
    """Oracle: the base region of where the foot has landed, by hand."""
    landed = FEET.with_foot(Side.RIGHT, FootPose([0.3, 0.3, 0.0]))
    state, _ = until(swinging(), Phase.TRANSFER, feet=landed)
    left = state.schedule.footsteps[0]
    assert left.side is Side.LEFT
    assert left.pose.p_WF[1] >= 0.3 + 0.125 - 1e-9
    assert state.schedule.footsteps[1].pose == state.commanded[1].pose


def test_a_hurried_foot_lands_in_the_second_half_of_its_own_swing():
    """Oracle: by hand, 0.4 s are gained at lift-off: 0.3 s are left."""
    state = step(swinging(), proposal=Proposal(time_gain=0.4))
    _, ticks = until(state, Phase.TRANSFER)
    landed = (1 + ticks) * PERIOD
    assert landed == pytest.approx(0.15, abs=3 * PERIOD)
