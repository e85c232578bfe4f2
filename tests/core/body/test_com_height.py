"""Oracles: Pythagoras, finite differences, closed loops by RK45."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nadia_balance.core.body.com_height import (
    ComHeight,
    ComHeightParams,
    ComHeightPlan,
)
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.walking.state import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    Side,
)
from tests import example_walks
from tests.core.body.test_ground import square

PARAMS = ComHeightParams()
NOMINAL = 0.94
MODEL = replace(example_walks.MODEL, com_height=NOMINAL)
LEGS = MODEL.legs
CONTROL = ComHeight(PARAMS, MODEL)
GROUND = 0.3


def schedule(phase, apart=0.0, step=0.0, yaw=0.0) -> ContactSchedule:
    """Left stance; right foot `apart` behind, to step `step` ahead, turned."""
    left = FootPose([0.0, 0.125, GROUND])
    right = FootPose([-apart, -0.125, GROUND])
    ahead = FootPose([step, -0.125, GROUND], yaw)
    return example_walks.stepping(FootPoses(left, right), ahead, phase)


def plan(*args, **kwargs) -> ComHeightPlan:
    return CONTROL.plan(schedule(*args, **kwargs))


def test_feet_that_no_height_reaches_give_the_lowest_height():
    """Oracle: min_height_ratio."""
    high = plan(Phase.TRANSFER, apart=3.0)
    assert high.start == GROUND + PARAMS.min_height_ratio * NOMINAL


@pytest.mark.parametrize("end", [0.7, 1.1])
def test_a_phase_without_duration_is_at_its_end(end):
    """Oracle: by hand: at the end, at rest."""
    assert ComHeightPlan(start=0.9, end=end, duration=0.0).at(0.0) == (end, 0.0)


@pytest.mark.parametrize("yaw", [0.0, 0.4, -0.4])
def test_the_height_is_continuous_over_a_walk(yaw):
    """Oracle: one phase ends where the next one begins, at rest."""
    first = plan(Phase.SWING, apart=0.0, step=0.5, yaw=yaw)
    # Landed: the right foot, now 0.5 m ahead of the left, takes the weight.
    landed = schedule(Phase.SWING, step=0.5, yaw=yaw)
    feet = landed.feet.with_foot(Side.RIGHT, landed.footsteps[0].pose)
    swings = replace(landed, support_side=Side.RIGHT, feet=feet)
    second = CONTROL.plan(replace(swings, phase=Phase.TRANSFER))
    third = CONTROL.plan(swings)
    assert first.at(0.7) == pytest.approx(second.at(0.0), abs=1e-12)
    assert second.at(0.3) == pytest.approx(third.at(0.0), abs=1e-12)
    assert second.start < GROUND + NOMINAL


@pytest.mark.parametrize("rise", [0.18, -0.18])
def test_on_stairs_both_legs_reach_at_both_ends_of_a_step(rise):
    """Oracle: Pythagoras on each leg; the lower one is at its longest."""
    steps = [square(name, height=h) for name, h in (("a", 0.0), ("b", rise))]
    model = replace(MODEL, ground=Ground(tuple(steps), MODEL.sole))
    going = schedule(Phase.SWING, apart=0.4, step=0.4)

    def moved(pose, up):
        return FootPose(pose.p_WF + [0.0, 0.0, up], pose.yaw)

    (step,), lifted = going.footsteps, going.feet.right
    feet = going.feet.with_foot(Side.RIGHT, moved(lifted, -rise))
    step = replace(step, pose=moved(step.pose, rise))
    going = replace(going, feet=feet, footsteps=(step,))
    found = ComHeight(PARAMS, model).plan(going)
    for height, other in (found.start, -rise), (found.end, rise):
        hip = height - GROUND - LEGS.com_above_hip - LEGS.ankle_height
        lower = hip - min(0.0, other)
        leg = math.hypot(lower, PARAMS.reach_ratio * 0.4)
        longest = PARAMS.max_stretch * LEGS.length
        assert leg == pytest.approx(longest, abs=1e-12)


def test_the_rate_is_the_derivative_of_the_height():
    """Oracle: central differences; truncation h^2 times 0.05 / 0.7^3."""
    course, h = plan(Phase.SWING, step=0.6), 1e-5
    for t in (0.05, 0.2, 0.5, 0.69):
        slope = (course.at(t + h)[0] - course.at(t - h)[0]) / (2.0 * h)
        assert slope != 0.0
        assert course.at(t)[1] == pytest.approx(slope, abs=1e-9)
    assert course.at(1.0) == (course.end, 0.0)


def test_the_com_falls_at_the_touchdown_and_rises_to_rest():
    """Oracles: twice the mean rate of the descent; none of the rise."""
    going = schedule(Phase.SWING, step=0.6)
    down = CONTROL.plan(going)
    fall = 2.0 * (down.end - down.start) / 0.7
    assert down.at(0.7 - 1e-9)[1] == pytest.approx(fall, abs=1e-6)
    up = plan(Phase.SWING, apart=0.6)
    assert up.end > up.start
    assert up.at(0.7 - 1e-9)[1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_sinking_slows_the_icp_of_a_pendulum(turn):
    """Oracle: the pendulum of variable height, by RK45.

    To first order the ICP gains omega (z_dot(t) - z_dot(0)) / (2 g) in the
    exponent; the height that is lost takes (omega t)^2 / 6 of it back.
    """
    omega, time = MODEL.omega, 0.2
    way = np.array([math.cos(turn), math.sin(turn)])
    ecmp = np.array([0.3, -0.2])

    def flow(_, state, sunk):
        x, v, z, _ = state
        com, icp = ecmp + x * way, ecmp + (x + v / omega) * way
        fall = sunk * CONTROL.sinking(com, icp, ecmp, z)
        return v, (9.81 - fall) / z * x, state[3], -fall

    start, gained = (0.1, 0.1 * omega, NOMINAL, 0.0), []
    for sunk in (0.0, 1.0):
        run = solve_ivp(
            flow, (0.0, time), start, args=(sunk,), rtol=1e-9, atol=1e-11
        )
        x, v, _, v_z = run.y[:, -1]
        gained.append(math.log((x + v / omega) / 0.2))
    assert gained[0] == pytest.approx(omega * time, abs=1e-6)
    first = omega * v_z / (2.0 * 9.81)
    assert first < -0.01
    gain = first * (1.0 - (omega * time) ** 2 / 6.0)
    assert gained[1] - gained[0] == pytest.approx(gain, rel=0.1)


def test_it_sinks_only_where_that_helps():
    """Oracles: by hand; nothing near, behind the eCMP, or at its lowest."""
    com, icp, ecmp = np.array([[0.1, 0.1], [0.4, 0.3], [0.0, 0.0]])
    expected = PARAMS.sink_gain * 9.81 / NOMINAL * (0.5 - PARAMS.sink_distance)
    assert CONTROL.sinking(com, icp, ecmp, 0.9) == pytest.approx(expected)
    assert CONTROL.sinking(com, 0.29 * icp, ecmp, 0.9) == 0.0
    assert CONTROL.sinking(-com, icp, ecmp, 0.9) == 0.0
    assert CONTROL.sinking(com, icp, ecmp, 0.8 * NOMINAL) == 0.0
    for velocity, fall in (0.0, -PARAMS.max_acceleration), (-0.7, 0.0):
        found = CONTROL.acceleration(1.0, velocity, 1.0, 0.0, sinking=100.0)
        assert found == pytest.approx(fall, abs=1e-12)


def test_near_the_goal_it_is_a_pd_law():
    """Oracle: k_p e - k_d v, by hand."""
    k_d = 2.0 * 0.9 * math.sqrt(50.0)
    found = CONTROL.acceleration(0.99, 0.01, 1.0, 0.02)
    assert found == pytest.approx(50.0 * 0.01 + k_d * (0.02 - 0.01))


@pytest.mark.parametrize("drop", [-0.6, 0.1])
def test_approaches_the_height_within_the_limits_and_settles(drop):
    """Oracle: the motion integrated by RK45."""

    def flow(_, state):
        return state[1], CONTROL.acceleration(*state, 1.0, 0.0)

    run = solve_ivp(flow, (0.0, 6.0), (1.0 + drop, 0.0), rtol=1e-8, atol=1e-10)
    height, velocity = run.y
    assert np.abs(velocity).max() <= PARAMS.max_velocity + 1e-8
    assert np.abs([height[-1] - 1.0, velocity[-1]]).max() < 1e-4
    overshoot = -np.sign(drop) * (height - 1.0)
    assert overshoot.max() < 0.01 * abs(drop)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_the_stance_leg_allows_a_height_and_its_rate(side, yaw):
    """Oracles: hip and ankle, put together again; a central difference.

    The hip is beside the CoM on the side of the stance foot and before it, the
    ankle behind the middle of its sole, as the yaw of the foot.
    """
    legs = replace(LEGS, hip_ahead=0.05)
    control = ComHeight(PARAMS, replace(MODEL, legs=legs))
    stance = FootPose([0.4, 0.2, GROUND], yaw)
    feet = schedule(Phase.SWING).feet.with_foot(side, stance)
    going = replace(schedule(Phase.SWING), support_side=side, feet=feet)
    com = stance.to_world(np.array([0.3, -0.05 * side.sign]))
    velocity, h = np.array([0.7, -0.4]), 1e-6

    def limit(at):
        return control.stance_limit(at, velocity, going)

    height, rate = limit(com)
    ahead, left = stance.rotation.T
    hip = com + 0.01 * ahead + 0.5 * side.sign * LEGS.hip_width * left
    ankle = stance.p_WF[:2] - 0.04 * ahead
    hip = np.array([*hip, height - LEGS.com_above_hip])
    ankle = np.array([*ankle, GROUND + LEGS.ankle_height])
    leg = math.dist(hip, ankle)
    assert leg == pytest.approx(PARAMS.max_stretch * LEGS.length, abs=1e-12)
    after, before = (limit(com + s * h * velocity)[0] for s in (1.0, -1.0))
    slope = (after - before) / (2.0 * h)
    assert abs(slope) > 0.05
    assert rate == pytest.approx(slope, abs=1e-8)


def test_the_stance_leg_allows_the_lowest_height_at_least():
    """Oracle: min_height_ratio, at rest; 0.05 m before the leg is too short."""
    going = schedule(Phase.SWING)
    lowest = GROUND + PARAMS.min_height_ratio * NOMINAL
    above = lowest - GROUND - LEGS.ankle_height - LEGS.com_above_hip
    reach = math.sqrt((PARAMS.max_stretch * LEGS.length) ** 2 - above**2)
    beside = going.feet.left.p_WF[:2] - [0.0, 0.5 * LEGS.hip_width]
    for short, least in (-0.001, True), (0.001, False):
        com = beside + [reach - short, 0.0]
        found = CONTROL.stance_limit(com, np.array([1.0, 0.0]), going)
        assert (found == (lowest, 0.0)) is least
        assert found[0] == pytest.approx(lowest, abs=0.002)
