"""Oracles: boundary values, the integral of the jerk, the soles' distance."""

import math
from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.steps.swing_foot import (
    SwingFoot,
    SwingFootParams,
    as_reference,
    at_rest,
    end_beyond,
    quintic,
)
from nadia_balance.core.walking.state import (
    FootPose,
    FootPoses,
    Side,
    WalkingState,
)
from tests.example_walks import IDEAL_DETOUR, MODEL, stepping

HORIZON = 0.6
TIMES = np.array([HORIZON])
# From and to anywhere, at any rate, and a point far from the straight way.
BEGIN = np.array([[0.0, 0.25], [0.3, -0.2], [2.0, 1.0]])
FINISH = np.array([[0.35, -0.1], [0.1, 0.0], [0.0, -1.0]])
VIA, AT = np.array([0.28, 0.15]), 0.34


def jerk(start, end, duration):
    """Integral of the squared jerk, all axes.

    Exact but for rounding: of a cubic acceleration, a difference of four points
    is the derivative, and three Gauss points integrate its square.
    """
    nodes, weights = np.polynomial.legendre.leggauss(3)
    t = 0.5 * duration * (1.0 + nodes)
    d = 0.04 * duration

    def acceleration(t):
        return quintic(start, end, np.array([duration]), t[:, None])[2]

    far = acceleration(t + 2.0 * d) - acceleration(t - 2.0 * d)
    near = acceleration(t + d) - acceleration(t - d)
    squared = np.sum(((8.0 * near - far) / (12.0 * d)) ** 2, axis=1)
    return 0.5 * duration * weights @ squared


def jerk_through(rates):
    """The cost of passing VIA at AT with the `rates` v, a, shape (2, 2)."""
    middle = np.vstack([VIA, rates])
    return jerk(BEGIN, middle, AT) + jerk(middle, FINISH, HORIZON - AT)


def test_meets_both_ends():
    """Oracle: the boundary values."""
    rng = np.random.default_rng(0)
    start, end = rng.normal(size=(2, 3, 4))
    horizon = np.array([0.3, 0.5, 0.7, 0.9])
    for column, h in enumerate(horizon):
        arrived = quintic(start, end, horizon, h)[:, column]
        assert arrived == pytest.approx(end[:, column], abs=1e-9)
    begun = quintic(start, end, horizon, 0.0)
    assert begun == pytest.approx(start, abs=1e-12)


def test_passes_the_point_with_the_least_jerk():
    """Oracle: the cost does not change with the rates there, to first order.

    It is quadratic in the rates, so that central differences are exact; the
    changes are compared with those that a unit off the optimum would make.
    """
    aimed = end_beyond(BEGIN, FINISH, HORIZON, VIA, AT)
    passing = quintic(BEGIN, aimed, TIMES, AT)
    assert passing[0] == pytest.approx(VIA, abs=1e-12)
    best = jerk_through(passing[1:])
    for unit in np.eye(4).reshape(4, 2, 2):
        up, down = (jerk_through(passing[1:] + s * unit) for s in (1, -1))
        curvature = up + down - 2.0 * best
        assert curvature > 0.0
        assert up - down == pytest.approx(0.0, abs=1e-9 * curvature)


PERIOD = 0.002
PARAMS = SwingFootParams()
DETOUR = IDEAL_DETOUR
NOMINAL = (0.0, -0.25)  # beside the stance foot


GOAL, START, STANCE = (0.4, -0.15), (-0.3, -0.12), (0.0, 0.12)


def swing_state(
    t, goal=GOAL, yaw=0.2, duration=0.7, start=START, stance=STANCE, gained=0.0
):
    """The right foot swings from `start` to `goal`."""
    feet = FootPoses(FootPose([*stance, 0.0]), FootPose([*start, 0.0]))
    pose, late = FootPose([*goal, 0.0], yaw), t >= duration
    schedule = stepping(feet, pose, duration=duration)
    return WalkingState(schedule, t, t - gained, waiting=late)


def crossing(t, goal, start=NOMINAL, **kwargs):
    """The right foot swings past the left one, which stands in the origin."""
    origin = (0.0, 0.0)
    return swing_state(t, goal, 0.0, start=start, stance=origin, **kwargs)


def follow(states, start=None):
    """All references along `states`, shape (n, 3, 4); else begins at rest."""
    feet = states[0].schedule.feet
    motion = at_rest(feet[Side.RIGHT]) if start is None else start
    foot, path = SwingFoot(PARAMS, replace(MODEL, detour=DETOUR), PERIOD), []
    for state in states:
        motion, _ = foot.motion(motion, state)
        path.append(motion)
    return np.array(path)


def times(duration=0.7):
    """The walking clock of one swing."""
    return np.minimum(np.arange(0.0, duration + PERIOD / 2, PERIOD), duration)


def test_what_is_asked_ahead_is_what_comes():
    """Oracle: the motion itself, so much later; at the end, the end."""
    path = follow([swing_state(t) for t in times()])
    ticks = 5
    model = replace(MODEL, detour=DETOUR)
    foot = SwingFoot(PARAMS, model, PERIOD, ticks * PERIOD)
    for k in (50, 200, len(path) - 2):
        motion, ahead = foot.motion(path[k - 1], swing_state(times()[k]))
        assert motion == pytest.approx(path[k], abs=1e-12)
        expected = path[min(k + ticks, len(path) - 1)]
        assert ahead[0] == pytest.approx(expected[0], abs=1e-4)
    assert ahead[0] == pytest.approx([*GOAL, 0.0, 0.2], abs=1e-3)


@pytest.mark.parametrize("y", [-0.01, 0.01])
def test_a_leg_that_uncrosses_is_not_lifted_so_high(y):
    """Oracle: the parameter; the left foot stands in the origin."""
    states = [crossing(t, NOMINAL, start=(-0.34, y)) for t in times()]
    height = PARAMS.uncrossing_height if y > 0.0 else PARAMS.height
    z = follow(states)[:, 0, 2]
    assert z.max() == pytest.approx(height, abs=2e-3)


@pytest.mark.parametrize(
    ("rate", "reactive", "slow"),
    [
        (0.0, False, PARAMS.touchdown_velocity),
        (0.15, False, PARAMS.touchdown_velocity),
        (0.0, True, PARAMS.recovery_touchdown_velocity),
    ],
)
def test_a_foot_that_hangs_over_its_foothold_sinks_without_a_jump(
    rate, reactive, slow
):
    """Oracle: the trapezoidal rule, exact up to (third derivative) T^3 / 12.

    It rises at `rate` when the clock has run out; at first it jumped to the
    touchdown velocity in one tick.  A `reactive` step catches the robot.
    """
    pva = np.zeros((3, 4))
    pva[0], pva[1, 2] = (0.4, -0.15, 0.02, 0.2), rate
    state = swing_state(0.7)
    step = replace(state.schedule.footsteps[0], reactive=reactive)
    schedule = replace(state.schedule, footsteps=(step,))
    state = replace(state, schedule=schedule)
    path = np.array([pva, *follow(100 * [state], pva)])
    _, v, a = path[:, :, 2].T
    mean = 0.5 * (a[1:] + a[:-1])
    assert np.diff(v) == pytest.approx(mean * PERIOD, abs=1e-4)
    assert v[-1] == pytest.approx(-slow, rel=0.05)
    assert v.min() > -1.5 * slow


@pytest.mark.parametrize(("descent", "left"), [(0.3, 0.0), (0.7, 0.04)])
def test_a_landing_foot_brakes_no_harder_than_it_can(descent, left):
    """Oracle: 30 m/s^2, which is enough; twice that for the quintic's peak."""
    model = replace(MODEL, detour=replace(DETOUR, max_braking=30.0))
    for period in (0.002, 0.004):
        foot, now, t = SwingFoot(PARAMS, model, period), np.zeros((3, 4)), 0.0
        now[0], now[1, 2] = (*GOAL, 0.0125, 0.2), -descent
        while now[0, 2] > 0.0:
            now, _ = foot.motion(now, swing_state(0.7 - max(left - t, 0.0)))
            assert abs(now[2, 2]) < 2.0 * 30.0
            t += period


def gap(points):
    """Between soles without yaw, the other one in the origin, (n,) [m]."""
    apart = np.abs(points) - [0.25, 0.12]
    return np.hypot(*np.maximum(apart, 0.0).T)


# What is kept free, less what the way cuts off the corners.
FREE = min(DETOUR.ahead - 0.25, DETOUR.beside - 0.12) - 2e-3


def retargeted(rng):
    """A swing that is sent across in its middle, perhaps with less time."""
    duration = rng.uniform(0.5, 0.8)
    t = rng.uniform(0.05, duration - 0.35)
    gained = rng.choice([0.0, rng.uniform(0.0, duration - 0.35 - t)])
    forward = rng.random() < 0.5
    goal = (0.33, rng.uniform(-0.1, 0.1)) if forward else (-0.4, -0.1)
    before = rng.uniform([-0.3, -0.35], [0.3, -0.2])
    clock = times(duration)
    return [crossing(s, before, duration=duration) for s in clock if s <= t] + [
        crossing(s, goal, duration=duration, gained=gained)
        for s in clock
        if s > t + gained
    ]


def test_a_foot_sent_across_in_mid_swing_neither_jumps_nor_hits():
    """Oracle: the trapezoidal rule; the distance of two rectangles.

    Every tick follows one quintic, for which the rule, with the correction of
    Euler and Maclaurin, is exact up to (fifth derivative) T^5 / 720.
    """
    rng = np.random.default_rng(0)
    for _ in range(6):
        path = follow(retargeted(rng))[:-1]  # in the last tick it is there
        p, v, a = path[:, 0], path[:, 1], path[:, 2]
        mean = 0.5 * (v[1:] + v[:-1]) - PERIOD / 12.0 * np.diff(a, axis=0)
        # A jump of p by 10 nm or of v by 10 um/s would be seen.
        np.testing.assert_allclose(np.diff(p, axis=0), mean * PERIOD, atol=1e-8)
        assert np.abs(a).max() < 150.0
        assert gap(p[:, :2]).min() > FREE


@pytest.mark.parametrize(
    ("start", "goal"),
    [((-0.37, 0.13), (0.11, -0.61)), ((-0.33, 0.16), (0.19, -0.52))],
)
def test_a_hurried_leg_uncrosses_no_faster_than_it_can(start, goal):
    """Oracle: twice full thrust; the distance of two rectangles.

    It was asked for seven times full thrust by the quintic that it leaves at
    the corner, and for 2.3 times with via times on a grid of 10 ms.
    """
    clock = np.minimum(np.arange(0.0, 0.6, PERIOD), 0.24)
    path = follow([crossing(t, goal, start, duration=0.24) for t in clock])
    limit = 2.0 * DETOUR.max_acceleration
    assert np.hypot(*path[:, 2, :2].T).max() < 1.01 * limit
    assert gap(path[:, 0, :2]).min() > FREE
    assert path[-1, 0, :2] == pytest.approx(goal, abs=1e-3)


def test_turns_the_short_way_round():
    """Oracle: yaw 2 pi + 0.2 is the same direction as 0.2."""
    near = follow([swing_state(t, yaw=0.2) for t in times()])
    far = follow([swing_state(t, yaw=0.2 + 2 * math.pi) for t in times()])
    assert far == pytest.approx(near, abs=1e-9)


def test_a_foot_that_is_sent_away_too_late_comes_later():
    """Oracle: the time that full thrust takes; the last centimetre is slow.

    Half a metre with 0.1 s left: it does not land on the way, nor is hurried.
    """
    goal, clock = (-0.1, -0.4), np.minimum(np.arange(0.0, 1.0, PERIOD), 0.7)
    path = follow([swing_state(t, goal if t >= 0.6 else GOAL) for t in clock])
    late = path[clock >= 0.7]
    there = np.hypot(*(late[:, 0, :2] - goal).T) < 0.01
    arrival, distance = np.flatnonzero(there)[0], math.dist(goal, GOAL)
    least = 2.0 * math.sqrt(distance / DETOUR.max_acceleration)
    assert 0.1 + arrival * PERIOD == pytest.approx(least, abs=0.04)
    assert late[:arrival, 0, 2].min() > 0.0
    assert late[-1, 0, 2] < 0.0
    # Twice full thrust: a quintic peaks at 1.44 times it, and it turns round.
    limit = 2.0 * DETOUR.max_acceleration
    assert np.hypot(*path[:, 2, :2].T).max() < limit


@pytest.mark.parametrize(
    ("left", "goal", "lifted"), [(0.05, GOAL, False), (0.3, (0.3, -0.2), True)]
)
def test_a_foot_that_sinks_long_before_it_may_land_is_lifted(
    left, goal, lifted
):
    """Oracle: the quintic without a way point dips below the ground.

    The foot is 2 cm high, sinks at 0.6 m/s, and is sent away.
    """
    start = np.zeros((3, 4))
    start[0], start[1, 2] = (0.4, -0.15, 0.02, 0.2), -0.6
    end = np.array([[0.0], [-PARAMS.touchdown_velocity], [0.0]])
    t = np.linspace(0.05, 0.95, 19)[:, None] * left
    plain = quintic(start[:, 2:3], end, np.full(1, left), t)[0]
    assert (plain.min() < -0.005) == lifted
    clock = np.arange(0.7 - left, 0.7, PERIOD)
    path = follow([swing_state(t, goal) for t in clock], start)[:, 0, 2]
    assert min(path) > -1e-3
    assert (max(path) > 0.03) == lifted
    assert path[-1] < 0.01


def test_velocities_now_of_a_reference_ahead():
    """Oracle: a motion of constant acceleration, its velocities in closed form.

    All axes differ, the yaw, too.
    """
    lead, acceleration = 0.02, np.array([1.0, -2.0, 3.0, -4.0])
    velocity = np.array([0.1, 0.2, -0.3, 0.5])
    late = np.array([np.zeros(4), velocity + lead * acceleration, acceleration])
    reference = as_reference(late, lead)
    (*v, yaw_rate), (*a, yaw_acceleration) = velocity, acceleration
    now = [0.0, 0.0, 0.0, *v, *a, 0.0, yaw_rate, yaw_acceleration]
    assert reference == pytest.approx(now, abs=1e-15)
