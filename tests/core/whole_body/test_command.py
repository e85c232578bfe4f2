"""Oracles: by hand; finite differences along a swing, mirror images."""

import math
from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import (
    FootPose,
    FootPoses,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.core.whole_body.command import (
    WholeBodyModel,
    crossing_turn,
    whole_body_command,
)
from nadia_balance.core.whole_body.params import (
    CrossingTurnParams,
    WholeBodyQpParams,
)
from tests.example_walks import stepping

MASS = 900.0 / GRAVITY
MODEL = WholeBodyModel(
    mass=MASS,
    sole_length=0.25,
    sole_width=0.12,
    ankles=np.zeros((2, 3)),
    posture=np.zeros(0),
    position_lower=np.zeros(0),
    position_upper=np.zeros(0),
    max_torque=np.zeros(0),
    max_speed=np.zeros(0),
    corner_speed=np.zeros(0),
    inertia=np.zeros(0),
    is_leg_joint=np.zeros(0, dtype=bool),
    is_knee=np.zeros(0, dtype=bool),
)


def state(phase, support=Side.LEFT, yaws=(0.0, 0.0), **kwargs):
    """A phase of 1 s; `yaws` of the left and the right foot."""
    feet = FootPoses(
        FootPose([0.0, 0.1, 0.0], yaws[0]), FootPose([0.0, -0.1, 0.0], yaws[1])
    )
    swing = support.other
    schedule = stepping(feet, feet[swing], phase, swing, duration=1.0)
    return WalkingState(schedule, **kwargs)


def command(walking_state, swing=None, **params):
    return whole_body_command(
        walking_state,
        np.zeros(3),
        np.zeros(12) if swing is None else swing,
        0.6,
        WholeBodyQpParams(**params),
        MODEL,
    )


def test_a_swing_sole_turns_from_its_ground_to_the_next_one():
    """Oracle: by hand; half-way, the bisector of the two normals."""
    tilted = [math.sin(0.2), 0.0, math.cos(0.2)]
    now = state(Phase.SWING, time_in_phase=0.5)
    (step,) = now.schedule.footsteps
    step = replace(step, pose=replace(step.pose, normal=tilted))
    schedule = replace(now.schedule, footsteps=(step,))
    for time, angle in (0.0, 0.0), (0.5, 0.1), (1.0, 0.2):
        then = WalkingState(schedule, time_in_phase=time)
        left, right = command(then).normals
        assert left == pytest.approx([0.0, 0.0, 1.0])
        assert right == pytest.approx([math.sin(angle), 0.0, math.cos(angle)])


@pytest.mark.parametrize(
    "time, expected", [(0.0, 0.2), (0.6, 0.2), (0.8, 0.6), (1.0, 1.0)]
)
def test_a_swing_sole_is_flat_only_when_it_lands(time, expected):
    """Oracle: by hand; half-way through the last 0.4 s, the mean share."""
    swing = state(Phase.SWING, time_in_phase=time)
    wish = command(swing, swing_early_share=0.2, swing_flat_time=0.4)
    assert wish.flatness == pytest.approx(expected)


def test_looks_ahead_between_the_feet():
    """Oracle: the mean, also across the cut of the circle at pi.

    Half of the swing foot's yaw counts, and of its derivatives.
    """
    ahead = command(state(Phase.TRANSFER, yaws=(0.1, 0.5))).heading
    assert ahead == pytest.approx([0.3, 0.0, 0.0])
    ahead = command(state(Phase.TRANSFER, yaws=(3.1, -3.1))).heading
    assert math.remainder(ahead[0] - math.pi, math.tau) == pytest.approx(0.0)
    swing = np.array([*np.zeros(9), 0.5, 1.0, 2.0])
    ahead = command(state(Phase.SWING, yaws=(0.1, 0.0)), swing).heading
    assert ahead == pytest.approx([0.3, 0.5, 1.0])


@pytest.mark.parametrize(
    ("time", "expected"),
    [(0.0, math.inf), (0.79, math.inf), (0.9, 475.0), (1.0, 50.0)],
)
def test_the_trailing_foot_unloads_at_the_end_of_a_transfer(time, expected):
    """Oracle: linear from the weight to 50 N, in the last 0.2 s."""
    now = state(Phase.TRANSFER, time_in_phase=time)
    wish = command(now, unloading_fraction=0.2, unloaded_force=50.0)
    assert wish.max_normal_forces == pytest.approx((math.inf, expected))
    waits = command(
        replace(now, waiting=True), unloading_fraction=0.2, unloaded_force=50.0
    )
    assert waits.max_normal_forces == (math.inf, math.inf)


@pytest.mark.parametrize(
    ("contact", "expected", "sinks"),
    [(0.0, 50.0, 0.3), (0.004, 390.0, 0.0), (0.01, math.inf, 0.0)],
)
def test_a_foot_that_has_landed_is_loaded_when_it_measures_a_force(
    contact, expected, sinks
):
    """Oracle: linear in the time of contact, to the weight in 10 ms."""
    landed = state(
        Phase.TRANSFER, steps_taken=1, elapsed=0.1, contact_time=contact
    )
    wish = command(
        landed, loading_time=0.01, unloaded_force=50.0, sinking_velocity=0.3
    )
    assert wish.max_normal_forces == pytest.approx((expected, math.inf))
    assert wish.sinking == (sinks, 0.0)
    schedule = replace(landed.schedule, support_side=Side.RIGHT)
    other = command(replace(landed, schedule=schedule), sinking_velocity=0.3)
    assert other.sinking == (0.0, sinks)


@pytest.mark.parametrize(
    ("ahead", "yaw", "edge"),
    [(0.65, 0.0, 0.115), (-0.65, 0.0, -0.115), (0.55, 0.0, 0.0),
     (0.65, math.pi, -0.115)],
)  # fmt: skip
def test_the_trailing_foot_of_a_long_step_may_roll(ahead, yaw, edge):
    """Oracle: by hand: half of 0.25 m less 2 x 5 mm, towards the other foot."""
    now = state(Phase.TRANSFER, yaws=(0.0, yaw))
    foot = now.schedule.feet.left
    feet = now.schedule.feet.with_foot(
        Side.LEFT, replace(foot, p_WF=foot.p_WF + [ahead, 0.0, 0.0])
    )
    now = replace(now, schedule=replace(now.schedule, feet=feet), steps_taken=1)
    assert command(now).edges == pytest.approx((0.0, edge))
    swings = replace(now, schedule=replace(now.schedule, phase=Phase.SWING))
    last = replace(now, schedule=replace(now.schedule, footsteps=()))
    for flat in swings, last, replace(now, steps_taken=0):
        assert command(flat).edges == (0.0, 0.0)


PARAMS = CrossingTurnParams()


def turn_of(
    offset, side=Side.RIGHT, yaw=0.0, v=(0, 0), a=(0, 0), phase=Phase.SWING
):
    """The turn for a sole of `side` at `offset` from the stance sole."""
    stance = FootPose(np.array([0.7, -0.4, 0.0]), yaw)
    offset, v, a = (stance.rotation @ np.array(e) for e in (offset, v, a))
    other = FootPose(np.append(stance.p_WF[:2] + offset, 0.0), yaw)
    feet = FootPoses(stance, other)
    if side is Side.LEFT:
        feet = FootPoses(other, stance)
    schedule, swing = stepping(feet, other, phase, side), np.zeros(12)
    swing[:2], swing[3:5], swing[6:8] = other.p_WF[:2], v, a
    return crossing_turn(WalkingState(schedule), swing, PARAMS)


def test_rates_are_the_derivatives_of_the_turn():
    """Oracle: central differences of a sole on a parabola that crosses."""
    p, v, a = (np.array(e) for e in ([0.2, 0.0], [1.0, 1.5], [-3.0, 2.0]))

    def at(t):
        return turn_of(p + v * t + 0.5 * a * t * t, v=v + a * t, a=a)

    h = 1e-5
    for t in (0.0, 0.05, 0.1):
        (before, *rates), (after, *later) = at(t - h), at(t + h)
        _, rate, acceleration = at(t)
        assert rate == pytest.approx((after - before) / (2 * h), rel=1e-6)
        slope = (later[0] - rates[0]) / (2 * h)
        assert acceleration == pytest.approx(slope, rel=1e-6)


def test_the_hip_of_the_crossing_leg_goes_ahead():
    """Oracle: by hand; a right leg in front turns to the left."""
    assert turn_of((0.3, 0.1))[0] > math.radians(15.0)
    assert turn_of((-0.4, 0.0))[0] < -math.radians(10.0)
    assert turn_of((0.3, -0.05))[0] < 0.5 * turn_of((0.3, 0.1))[0]
    assert turn_of((5.0, 5.0))[0] == pytest.approx(math.radians(30.0))
    # Feet that are apart do not turn it: side by side, or in a long step.
    for offset in (0.0, -0.25), (0.5, -0.25), (-0.5, -0.4):
        assert turn_of(offset, v=(2.0, 1.0)) == (0.0, 0.0, 0.0)


def test_does_not_depend_on_which_foot_supports_nor_on_the_heading():
    """Oracle: the same two soles, so that a landing changes nothing."""
    swing = turn_of((0.3, 0.1))
    transfer = turn_of((0.3, 0.1), phase=Phase.TRANSFER, v=(9.0, 9.0))
    other = turn_of((-0.3, -0.1), Side.LEFT)
    turned = turn_of((0.3, 0.1), yaw=2.0)
    for same in transfer, other, turned:
        assert same == pytest.approx(swing, abs=1e-12)
