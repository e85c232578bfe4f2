"""Oracles: boundary values, finite differences, shapely's distances."""

import math

import numpy as np
import pytest
from shapely.geometry import Point, Polygon

from nadia_balance.core.quintic import quintic
from nadia_balance.core.reachability import (
    BACKWARD,
    FORWARD,
    ReachabilityParams,
    cross_over_region,
)
from nadia_balance.core.swing_detour import SwingDetourParams
from nadia_balance.core.swing_foot import (
    FootMotion,
    SwingFootParams,
    swing_foot_motion,
)
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
    rectangle,
)

PERIOD = 0.002
PARAMS = SwingFootParams()
SOLE = Polygon(rectangle(0.25, 0.12))
NOMINAL = (0.0, -0.25)  # beside the stance foot


def swing_state(
    t,
    goal=(0.4, -0.15, 0.0),
    yaw=0.2,
    duration=0.7,
    start=(-0.3, -0.12),
    stance=(0.0, 0.12),
    gained=0.0,
):
    """The right foot swings from `start` to `goal`."""
    feet = FootPoses(FootPose([*stance, 0.0]), FootPose([*start, 0.0]))
    step = Footstep(Side.RIGHT, FootPose(goal, yaw), 0.3, duration)
    start = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
    schedule = ContactSchedule(
        Phase.SWING, Side.LEFT, duration, feet, (step,), start
    )
    return WalkingState(schedule, t, t - gained, waiting=t >= duration)


def crossing(t, goal, start=NOMINAL, **kwargs):
    """The right foot swings past the left one, which stands in the origin."""
    return swing_state(
        t, (*goal, 0.0), yaw=0.0, start=start, stance=(0.0, 0.0), **kwargs
    )


def follow(states):
    """All references along `states`, shape (n, 3, 4)."""
    motion = FootMotion.at_rest(states[0].schedule.feet[Side.RIGHT])
    path = []
    for state in states:
        motion = swing_foot_motion(motion, state, PERIOD, PARAMS)
        path.append(motion.pva)
    return np.array(path)


def times(duration=0.7):
    """The walking clock of one swing."""
    return np.minimum(np.arange(0.0, duration + PERIOD / 2, PERIOD), duration)


def test_continuing_each_tick_is_one_quintic():
    """Oracle: one quintic over the whole swing (Bellman's principle)."""
    path = follow([swing_state(t) for t in times()])
    start = FootMotion.at_rest(swing_state(0.0).schedule.feet[Side.RIGHT]).pva
    end = np.zeros((3, 4))
    end[0] = [0.4, -0.15, 0.0, 0.2]
    for t in (0.1, 0.35, 0.6):
        whole = quintic(start, end, np.full(4, 0.7), t)
        k = round(t / PERIOD)
        xy_yaw = [0, 1, 3]
        assert path[k][:, xy_yaw] == pytest.approx(whole[:, xy_yaw], abs=1e-6)


def test_lands_on_the_foothold_with_the_touchdown_velocity():
    """Oracle: the boundary values."""
    last = follow([swing_state(t) for t in times()])[-2]
    # One tick before the end: the rest of the way is one tick's worth.
    down = -PARAMS.touchdown_velocity
    assert last[0] == pytest.approx([0.4, -0.15, 0.0, 0.2], abs=5e-4)
    assert last[1] == pytest.approx([0.0, 0.0, down, 0.0], abs=2e-2)


def test_apex_is_the_swing_height():
    """Oracle: the parameter."""
    z = follow([swing_state(t) for t in times()])[:, 0, 2]
    assert z.max() == pytest.approx(PARAMS.height, abs=2e-3)
    assert z.min() > -1e-4


def test_a_moved_goal_and_a_jumping_clock_leave_no_jump():
    """Oracle: position and velocity differ by less than their rates allow."""
    states = [swing_state(t) for t in times() if t < 0.3]
    # Then the goal moves by 0.3 m, and the clock jumps by 0.15 s.
    late = [t + 0.15 for t in times() if 0.3 <= t < 0.549]
    states += [swing_state(t, goal=(0.6, -0.4, 0.0)) for t in late]
    path = follow(states)
    p, v, a = path[:, 0], path[:, 1], path[:, 2]
    assert np.abs(np.diff(p, axis=0) - v[1:] * PERIOD).max() < 1e-3
    assert np.abs(np.diff(v, axis=0)).max() <= np.abs(a).max() * PERIOD * 1.5
    assert p[-1, :2] == pytest.approx([0.6, -0.4], abs=2e-3)


def test_a_late_foot_goes_on_downward():
    """Oracle: constant velocity."""
    states = [swing_state(t) for t in times()] + [swing_state(0.7)] * 50
    z = follow(states)[:, 0, 2]
    way = -PARAMS.touchdown_velocity * 50 * PERIOD
    assert z[-1] - z[-51] == pytest.approx(way, abs=1e-9)


def test_turns_the_short_way_round():
    """Oracle: yaw 2 pi + 0.2 is the same direction as 0.2."""
    near = follow([swing_state(t, yaw=0.2) for t in times()])
    far = follow([swing_state(t, yaw=0.2 + 2 * math.pi) for t in times()])
    assert far == pytest.approx(near, abs=1e-9)


@pytest.mark.parametrize(
    ("field", "value"),
    [("height", 0.0), ("apex_fraction", 1.0), ("touchdown_velocity", -1.0)],
)
def test_refuses_bad_parameters(field, value):
    """Oracle: the message names the field and the value."""
    with pytest.raises(ValueError, match=f"{field} = {value}"):
        SwingFootParams(**{field: value}).validate()
