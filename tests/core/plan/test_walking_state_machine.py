"""Oracles: ticks and ellipses by hand; Eq. 3 integrated with the best eCMP."""

import functools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.math.lipm import icp_after
from nadia_balance.core.plan.gait import Gait, walking_start
from nadia_balance.core.plan.walking_state_machine import (
    LiftOffParams,
    StateMachine,
    WalkingStateMachineParams,
)
from nadia_balance.core.walking.state import (
    Adjustment,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
    support_polygon,
)
from tests import example_walks as walks
from tests.core.body.test_ground import square
from tests.example_walks import FEET, MODEL, OMEGA, SOLE

PERIOD = 0.002
WEIGHT = 1000.0  # [N]
PARAMS = WalkingStateMachineParams()


class FakePlan:
    """Its ICP rests over the origin; its CoM says when it was asked for."""

    def moved(self, schedule, steps, t, icp):
        return replace(schedule, footsteps=steps, start_time=t)

    def at(self, t):
        zero = np.zeros(2)
        point = ReferencePoint(np.array([t, 0.0]), zero, zero)
        return SimpleNamespace(
            **{"icp": zero, "com": point.com, "com_velocity": zero},
            **{"cop": zero, "point": lambda: point},
        )


def standing(num_steps):
    """Stands about to take `num_steps` steps in place."""
    return walking_start(Gait(num_steps=num_steps), MODEL)


def step(state, forces=(4e2, 4e2), icp=(0, 0), feet=FEET, period=PERIOD, **new):
    """One period later."""
    machine = StateMachine(PARAMS, MODEL, period)
    return machine.advance(
        state,
        FakePlan(),
        feet=feet,
        forces=np.array(forces) / WEIGHT,
        icp=np.array(icp),
        **{"footsteps": lambda: None, **new},
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


def test_phases_last_as_planned_to_the_nearest_tick():
    """Oracle: durations over the period: 0.5 s, more or less, and 0.8 s."""
    for duration, expected in (0.5, 250), (0.5007, 250), (0.5013, 251):
        start = walking_start(
            Gait(num_steps=3, standing_duration=duration), MODEL
        )
        state, ticks = until(start, Phase.TRANSFER)
        assert ticks == expected
    state, ticks = until(state, Phase.SWING)
    assert ticks == 400
    assert state.time_in_phase == 0.0


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


def test_the_other_foot_is_lifted_when_the_one_that_landed_carries():
    """Oracle: by hand, 10 ms of contact without a gap; else the longest wait.

    It has been hit by 0.9 of the weight and has left the ground again.
    """
    swings = replace(swinging(), time_in_phase=0.6, elapsed=0.6)
    landed = step(swings, forces=(400.0, 900.0))
    first = landed.schedule.footsteps[0]
    adjustment = Adjustment(first, first.pose)
    assert landed.contact_time == PERIOD
    state = replace(landed, time_in_phase=landed.schedule.duration)
    for force, ticks in (0.0, 20), (200.0, 4), (0.0, 1), (200.0, 4):
        for k in range(1, ticks + 1):
            state = step(state, forces=(800.0, force), adjustment=adjustment)
            assert state.schedule.phase is Phase.TRANSFER
            contact = k * PERIOD if force else 0.0
            assert state.contact_time == pytest.approx(contact)
    state = step(state, forces=(800.0, 200.0), adjustment=adjustment)
    assert state.schedule.phase is Phase.SWING
    state = replace(landed, time_in_phase=landed.schedule.duration)
    _, ticks = until(
        state, Phase.SWING, forces=(800.0, 0.0), adjustment=adjustment
    )
    max_wait = PARAMS.lift_off.max_wait
    assert ticks * PERIOD == pytest.approx(max_wait, abs=1.5 * PERIOD)


def test_the_next_plan_has_the_feet_and_the_reference_of_the_touchdown():
    """Oracle: the measured pose; the plan, asked for this time."""
    landed = FEET.with_foot(Side.RIGHT, FootPose([0.02, -0.13, 0.0], 0.01))
    state, ticks = until(swinging(), Phase.TRANSFER, feet=landed)
    assert state.schedule.start.com == pytest.approx([ticks * PERIOD, 0.0])
    assert state.schedule.feet == landed
    assert len(state.schedule.footsteps) == 2
    assert state.steps_taken == 1


def test_a_foot_that_lands_elsewhere_has_the_slope_of_the_ground_there():
    """Oracle: the normal of the region under it; its foothold is level."""
    slope = square("slope", 0.5, -0.13, normal=[-0.2, 0.0, 1.0])
    ground = Ground((square("flat"), slope), SOLE)
    pose = FootPose([0.5, -0.13, 0.0])
    feet = FEET.with_foot(Side.RIGHT, pose)
    machine = StateMachine(PARAMS, replace(MODEL, ground=ground), PERIOD)
    state = swinging()
    while state.schedule.phase is Phase.SWING:
        state = machine.advance(
            state,
            FakePlan(),
            feet=feet,
            forces=np.array([0.4, 0.4]),
            icp=np.zeros(2),
            footsteps=lambda: None,
        )
    foot = state.schedule.feet.right
    expected = np.array([-0.2, 0.0, 1.0]) / math.sqrt(1.04)
    assert foot.normal == pytest.approx(expected)


def test_the_clock_is_advanced_or_held_but_never_runs_back():
    """Oracle: by hand; the elapsed time is the real one."""
    state = swinging()
    for _ in range(10):
        state = step(state, time_gain=0.01)
    assert state.time_in_phase == pytest.approx(10 * (PERIOD + 0.01))
    assert state.elapsed == pytest.approx(10 * PERIOD)
    state = step(swinging())
    held = step(state, time_gain=-1.0)
    assert held.time_in_phase == state.time_in_phase == PERIOD
    slow = step(state, time_gain=-0.5 * PERIOD)
    assert slow.time_in_phase == pytest.approx(1.5 * PERIOD)


def test_a_wait_for_the_icp_ends_if_footholds_can_be_adjusted():
    """Oracle: max_held_wait; the ICP stays where no foot would be lifted."""
    state, _ = until(standing(2), Phase.TRANSFER)
    first = state.schedule.footsteps[0]
    adjustment = Adjustment(first, first.pose)
    _, ticks = until(state, Phase.SWING, icp=(0.04, 0.0), adjustment=adjustment)
    wait = ticks * PERIOD - state.schedule.duration
    max_wait = PARAMS.lift_off.max_held_wait  # it is well inside the support
    assert 0.8 * max_wait < wait < max_wait + 1.5 * PERIOD
    for _ in range(2 * ticks):
        state = step(state, icp=(0.04, 0.0))
    assert state.schedule.phase is Phase.TRANSFER


def test_an_adjusted_step_replaces_the_one_in_the_air():
    """Oracle: the pose; the later steps stay."""
    state = step(swinging())
    pose = FootPose([0.2, -0.3, 0.0])
    nominal = state.schedule.footsteps[0]
    adjustment = Adjustment(nominal, pose, "base")
    moved = step(state, adjustment=adjustment)
    assert moved.schedule.footsteps[0].pose is pose
    assert moved.schedule.footsteps[1:] == state.schedule.footsteps[1:]
    assert moved.adjustment is adjustment
    again = step(moved, adjustment=adjustment)
    assert again.schedule is moved.schedule  # nothing to plan anew
    assert moved.schedule.start_time == state.time_in_phase
    landed, _ = until(again, Phase.TRANSFER)
    assert landed.schedule.start_time == 0.0  # of the next phase


@pytest.mark.parametrize("kicked", [0.04, 0.06])
@pytest.mark.parametrize("side", list(Side))
def test_a_kicked_foot_is_where_it_was_kicked_to(side, kicked):
    """Oracle: by hand: within 5 cm the transfer goes on; else from there."""
    schedule = walks.walk(length=0.3)
    state = WalkingState(schedule, 0.1, 0.1)
    pose = FEET[side].displaced(0.6 * kicked, 0.8 * kicked)
    feet = FEET.with_foot(side, pose)
    after = step(state, feet=feet)
    steps = schedule.footsteps[1:]
    asked = step(state, feet=feet, footsteps=lambda: steps)
    assert after.schedule.phase is asked.schedule.phase is Phase.TRANSFER
    if kicked < PARAMS.displaced:
        assert after.schedule.feet == asked.schedule.feet == FEET
        assert after.time_in_phase == pytest.approx(0.1 + PERIOD)
        return
    assert after.schedule.feet == asked.schedule.feet == feet
    assert after.time_in_phase == asked.time_in_phase == 0.0
    assert after.schedule.footsteps == schedule.footsteps
    assert asked.schedule.footsteps == steps
    assert step(after, feet=feet).time_in_phase > 0.0


def test_the_foot_that_was_to_stay_can_take_the_step():
    """Oracle: by hand: a transfer to the other foot, as long as it says."""
    schedule = walks.walk(length=0.3)
    state = WalkingState(schedule, 0.1, 0.1)
    assert schedule.support_side is Side.LEFT
    steps = schedule.footsteps[1:]
    after = step(state, revised=steps).schedule
    assert (after.phase, after.support_side) == (Phase.TRANSFER, Side.RIGHT)
    assert after.footsteps == steps
    assert after.duration == steps[0].transfer_duration


def test_a_hurried_foot_lands_in_the_second_half_of_its_own_swing():
    """Oracle: by hand, 0.4 s are gained at lift-off: 0.3 s are left."""
    state = step(swinging(), time_gain=0.4)
    _, ticks = until(state, Phase.TRANSFER)
    landed = (1 + ticks) * PERIOD
    assert landed == pytest.approx(0.15, abs=3 * PERIOD)


LIFT_OFF = LiftOffParams()
HASTY = LiftOffParams(max_held_wait=0.0)


@functools.cache
def transfer():
    """A transfer to the left foot, its plan, and where the ICP should end."""
    schedule = walks.swing(length=0.0)
    schedule = walks.successor(schedule, walks.planned(schedule))
    plan = walks.planned(schedule)
    return schedule, plan, plan.at(schedule.duration).icp


def lifts(offset, waited=0.0, params=LIFT_OFF, feet=None):
    """True if an ICP `offset` [m] from where it should be lets a foot lift."""
    schedule, plan, end = transfer()
    schedule = replace(schedule, feet=feet or schedule.feet)
    state = WalkingState(schedule, waited=waited)
    machine = StateMachine(replace(PARAMS, lift_off=params), MODEL, PERIOD)
    return machine.may_lift(state, plan, end + offset, params.max_wait)


def test_lifts_within_the_ellipse():
    """Oracle: by hand; it is narrower on the outside of the foot."""
    schedule, _, _ = transfer()
    out = schedule.support_side.sign
    for x in (0.034, -0.034, 0.0):
        assert lifts((x, 0.0))
    assert not lifts((0.036, 0.0))
    for y, good in (-0.0145, 1), (-0.0155, 0), (0.0115, 1), (0.0125, 0):
        assert lifts((0.0, out * y)) == good


@pytest.mark.parametrize(
    ("angle", "wait"), [(0.0, 0.3), (1.7, 0.1), (3.4, 0.3)]
)
def test_waits_only_as_long_as_the_icp_can_return(angle, wait):
    """Oracle: Eq. 3, to the ellipse, with the eCMP beyond the ICP.

    It is as far as it goes along the error, 3 cm outside of the support.
    """
    schedule, _, end = transfer()
    away = np.array([math.cos(angle), math.sin(angle)])
    support = support_polygon(schedule, SOLE)
    room = np.max((support - end) @ away) + 0.03
    inward = schedule.support_side.sign * away[1] < 0.0
    width = 0.015 if inward else 0.012
    edge = 1.0 / math.hypot(away[0] / 0.035, away[1] / width)
    params, seen = replace(HASTY, max_wait=wait), set()
    for length in np.linspace(edge + 1e-3, room, 60):
        icp, farthest = end + length * away, end + room * away
        left = (icp_after(icp, farthest, OMEGA, wait) - end) @ away
        assert lifts(length * away, params=params) == (left > edge)
        seen.add(bool(left > edge))
    assert len(seen) == 2


@pytest.mark.parametrize("angle", [0.0, 5.1])
def test_waits_longer_for_an_icp_that_is_held(angle):
    """Oracle: Eq. 3 by icp_after, the eCMP where the support ends.

    It moves the ICP back by room (e^wt - 1) in the time t.
    """
    schedule, _, end = transfer()
    away = np.array([math.cos(angle), math.sin(angle)])
    support = support_polygon(schedule, SOLE)
    reach, t = np.max((support - end) @ away), 0.1
    length = reach - LIFT_OFF.held_room
    for more, held in ((-1e-3, True), (1e-3, False)):
        icp = end + (length + more) * away
        moved = (icp - icp_after(icp, end + reach * away, OMEGA, t)) @ away
        least = LIFT_OFF.held_room * math.expm1(OMEGA * t)
        assert bool(moved > least) is held
        if np.linalg.norm(icp - end) < 0.04:  # near enough to lift anyway
            continue
        offset, max_wait = (length + more) * away, LIFT_OFF.max_held_wait
        assert lifts(offset, waited=0.9 * max_wait) is not held
        assert lifts(offset, waited=max_wait)


def test_does_not_wait_with_the_feet_far_apart_nor_if_they_cross():
    """Oracle: by hand, how far the left foot is to the left of the right."""
    right = transfer()[0].feet.right
    endless = replace(LIFT_OFF, max_wait=math.inf)
    for x, y, waits, offset, waited, params in (
        (0.0, 0.44, True, (0.04, 0.0), 0.5, LIFT_OFF),
        (0.0, 0.46, False, (0.04, 0.0), 0.0, LIFT_OFF),
        (0.0, 0.46, True, (0.04, 0.0), 0.0, endless),
        (0.3, 0.01, True, (0.04, 0.04), 0.0, endless),
        (0.3, -0.01, False, (0.04, 0.04), 0.0, endless),
    ):
        feet = FootPoses(FootPose(right.p_WF + [x, y, 0.0], right.yaw), right)
        assert lifts(offset, waited, params, feet) is not waits
