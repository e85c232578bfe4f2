"""Oracles: the paper's linear system, dense search, shapely, symmetry."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.plan import icp_plan
from nadia_balance.core.plan.cop_waypoints import CopPoints, cop_waypoints
from nadia_balance.core.plan.gait import within_reach
from nadia_balance.core.walking.state import (
    FootPose,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from tests.example_walks import (
    FEET,
    MODEL,
    OMEGA,
    SOLE,
    at_rest,
    standing,
    successor,
    walk,
)


def rows_with_rates(t, durations):
    """Rows (n, 6) for CoM, its velocity, eCMP and its velocity at t (n,)."""
    zero, one, w = 0.0 * t, 1.0 + 0.0 * t, OMEGA
    grow, decay = np.exp(w * (t - durations)), np.exp(-w * t)
    com = [grow, decay, t**3, t**2, t, one]
    velocity = [w * grow, -w * decay, 3.0 * t**2, 2.0 * t, one, zero]
    acceleration = [w**2 * grow, w**2 * decay, 6.0 * t, 2.0 * one, zero, zero]
    jerk = [w**3 * grow, -(w**3) * decay, 6.0 * one, zero, zero, zero]
    com, velocity, acceleration, jerk = (
        np.stack(rows, axis=1) for rows in (com, velocity, acceleration, jerk)
    )
    return com, velocity, com - acceleration / w**2, velocity - jerk / w**2


def paper_system(durations, ecmp, com_start, icp_end, velocity):
    """The 6N x 6N system below Eq. 4 and its right-hand side (6N, k)."""
    n = len(durations)
    com_0, velocity_0, ecmp_0, slope_0 = rows_with_rates(
        0.0 * durations, durations
    )
    com_T, velocity_T, ecmp_T, slope_T = rows_with_rates(durations, durations)
    system, values = np.zeros((n, 6, n, 6)), np.zeros((n, 6, ecmp.shape[2]))
    i, j = np.arange(n), np.arange(n - 1)
    system[i, 0, i], system[i, 1, i] = ecmp_0, slope_0
    system[i, 2, i], system[i, 3, i] = ecmp_T, slope_T
    system[j, 4, j], system[j, 4, j + 1] = com_T[:-1], -com_0[1:]
    system[j, 5, j], system[j, 5, j + 1] = velocity_T[:-1], -velocity_0[1:]
    system[-1, 4, -1] = com_T[-1] + velocity_T[-1] / OMEGA
    system[-1, 5, 0] = com_0[0]
    values[:, 0], values[:, 1] = ecmp[0], velocity[0]
    values[:, 2], values[:, 3] = ecmp[1], velocity[1]
    values[-1, 4], values[-1, 5] = icp_end, com_start
    return system.reshape(6 * n, 6 * n), values.reshape(6 * n, -1)


def linear(ecmp):
    """The ends (2, N, k) of segments between the points (N + 1, k)."""
    return np.stack([ecmp[:-1], ecmp[1:]])


def backward_icp(durations, ecmp, omega):
    """The ICP at all knots, from the last one back: Eq. 3, a linear eCMP."""
    icp = [ecmp[-1]]
    for i in reversed(range(len(durations))):
        a, b, T = ecmp[i], ecmp[i + 1], durations[i]
        lead = (b - a) / (T * omega)
        icp.append(a + lead + np.exp(-omega * T) * (icp[-1] - b - lead))
    return np.array(icp[::-1])


@given(st.integers(1, 20), st.booleans(), st.integers(0, 10**6))
def test_is_the_solution_of_the_papers_system(n, straight, seed):
    """Oracle: numpy's solution of the 6N equations, by the rows of Eq. 4.

    The eCMP may be cubic and jump, and the ICP may end anywhere.
    """
    random = np.random.default_rng(seed)
    durations = random.uniform(0.01, 2.0, n)
    ecmp, velocity = random.uniform(-1, 1, (2, 2, n, 2))
    com, icp_end = random.uniform(-1, 1, (2, 2))
    if straight:
        velocity[:] = (ecmp[1] - ecmp[0]) / durations[:, None]
    system, values = paper_system(durations, ecmp, com, icp_end, velocity)
    expected = np.linalg.solve(system, values).reshape(-1, 6, 2)
    given = None if straight else velocity
    result = icp_plan.solve_segments(
        durations, ecmp, com, icp_end, OMEGA, given
    )
    for share in 0.0, 0.3, 1.0:
        t = share * durations
        com, velocity, ecmp, _ = rows_with_rates(t, durations)
        theirs = np.stack([com, com + velocity / OMEGA, ecmp], axis=1)
        ours = [
            icp_plan.rows_at(*each, OMEGA)
            for each in zip(t, durations, strict=True)
        ]
        np.testing.assert_allclose(ours @ result, theirs @ expected, atol=1e-8)


@pytest.mark.parametrize("duration", [1e-5, 1.0, 100.0])
def test_very_short_and_very_long_segments_cost_little_accuracy(duration):
    """Oracle: the recursion, to the 1e-8 that planning needs."""
    durations = np.array([0.3, duration, 0.3, duration, 10.0])
    ecmp = np.array([0.0, 0.1, 0.3, 0.2, 0.4, 0.4])[:, None]
    solution = icp_plan.solve_segments(
        durations, linear(ecmp), np.zeros(1), ecmp[-1], OMEGA
    )
    expected = backward_icp(durations, ecmp, OMEGA)
    for i, T in enumerate(durations):
        for t, icp in (0.0, expected[i]), (T, expected[i + 1]):
            result = icp_plan.rows_at(t, T, OMEGA)[1] @ solution[i]
            np.testing.assert_allclose(result, icp, atol=1e-8)


PARAMS = icp_plan.IcpPlanParams()
WALKS = [
    pytest.param({"length": 0.3}, id="forward"),
    pytest.param({"length": 0.0, "sideways": 0.1}, id="sideways"),
    pytest.param({"length": 0.1, "turn": 0.26}, id="turning"),
]


def plan_of(schedule, params=PARAMS):
    return icp_plan.plan_icp(schedule, params, MODEL)


def test_the_end_of_the_last_transfer_can_be_planned():
    """Oracle: by hand: it stands midway, and what is left of the ICP fades."""
    start = standing(FEET)
    point = replace(start.start, com_velocity=np.array([0.1, 0.0]))
    last = replace(
        start, phase=Phase.TRANSFER, duration=0.8, start=point, start_time=0.6
    )
    plan = plan_of(last)
    middle = 0.5 * (FEET.left.p_WF + FEET.right.p_WF)[:2]
    assert plan.at(0.8).ecmp == pytest.approx(middle)
    assert plan.at(0.6).icp == pytest.approx(
        point.com + point.com_velocity / OMEGA
    )


def as_printed(schedule):
    """The plan whose ICP starts where the waypoints lead it."""
    path = cop_waypoints(schedule, CopPoints(PARAMS, SOLE))
    points = path.points
    result = icp_plan.solve_segments(
        path.durations, linear(points), schedule.start.com, points[-1], OMEGA
    )
    return replace(plan_of(schedule), coefficients=result, offset=np.zeros(2))


def test_a_small_bend_is_shared():
    """Oracle: numpy's least squares, with the ICP that each waypoint makes.

    A waypoint counts ten times as much as the one before it.
    """
    schedule = walk()
    swing = successor(schedule, plan_of(schedule))
    path = cop_waypoints(swing, CopPoints(PARAMS, SOLE))
    bent = range(1, 6)  # of the swing, and of the transfer after it
    unit = np.eye(len(path.points))[:, bent]
    start = np.zeros(len(bent))
    made = icp_plan.solve_segments(
        path.durations, linear(unit), start, unit[-1], OMEGA
    )[0]
    row = icp_plan.rows_at(0.0, path.durations[0], OMEGA)[1] @ made
    shift = np.array([-0.002, 0.001])
    root = np.sqrt(0.1 ** np.arange(5.0))
    expected = np.linalg.lstsq((row * root)[None], shift[None])[0]
    expected *= root[:, None]
    icp = as_printed(swing).at(0.0).icp + shift
    moved = replace(at_rest(icp), cop=swing.start.cop)
    plan = plan_of(replace(swing, start=moved))
    ecmp = np.array([plan.at(t).ecmp for t in plan.knots])
    bends = (ecmp - plan.cop_waypoints)[bent]
    np.testing.assert_allclose(bends, expected, atol=1e-10)


def test_what_the_feet_cannot_do_fades():
    """Oracle: the ICP of its eCMP by the recursion, and e^-wt by hand."""
    far = ReferencePoint(np.array([0.5, 0.4]), np.zeros(2), np.zeros(2))
    plan = plan_of(replace(walk(), start=far))
    ecmp = np.array([plan.at(t).ecmp for t in plan.knots])
    assert in_support(ecmp[:3], walk())
    possible = backward_icp(np.diff(plan.knots), ecmp, OMEGA)
    offset = far.com - possible[0]
    assert np.linalg.norm(offset) > 0.1
    for t, icp in zip(plan.knots, possible, strict=True):
        result = plan.at(t)
        expected = icp + np.exp(-OMEGA * t) * offset
        np.testing.assert_allclose(result.icp, expected, atol=1e-8)
    for t, h in (0.1, 1e-5), (0.5, 1e-5):
        before, now, after = plan.at(t - h), plan.at(t), plan.at(t + h)
        for name in "icp", "com":
            rate = (getattr(after, name) - getattr(before, name)) / (2.0 * h)
            result = getattr(now, f"{name}_velocity")
            np.testing.assert_allclose(rate, result, atol=1e-5)


def in_support(points, schedule):
    """Whether the `points` are in the hull of the soles that stand."""
    standing = filter(schedule.in_contact, Side)
    soles = [schedule.feet[side].to_world(SOLE) for side in standing]
    hull = shapely.MultiPoint(np.concatenate(soles)).convex_hull
    return all(hull.distance(shapely.Point(p)) < 1e-9 for p in points)


def random_re_plans(seed):
    """(schedule, plan, t, icp, schedule then, t then) of a random walk.

    Steps within reach, footholds that move by up to 0.3 m in each direction
    whatever the measured `icp` is, feet land up to 0.25 s early, 3 cm aside.
    """
    random = np.random.default_rng(seed)
    length, aside, turn = random.uniform(-1, 1, 3) * [0.35, 0.1, 0.3]
    times = random.uniform([0.1, 0.5], [0.6, 1.2])
    schedule = walk(length, aside, turn, 4, *times)
    while schedule.phase is not Phase.STANDING:
        t, plan = schedule.duration, plan_of(schedule)
        if schedule.phase is Phase.SWING:
            t -= random.choice([0.0, random.uniform(0.0, 0.25)])
            for now in random.uniform(0.0, t, 2) * [0.5, 1.0]:
                if now < schedule.start_time:
                    continue
                steps = aimed(schedule, random.uniform(-0.3, 0.3, 2))
                icp = plan.at(now).icp + random.uniform(-0.1, 0.1, 2)
                new = plan.moved(schedule, steps, now, icp)
                yield schedule, plan, now, icp, new, now
                schedule, plan = new, plan_of(new)
            landed = aimed(schedule, random.uniform(-0.03, 0.03, 2))
            schedule = replace(schedule, footsteps=landed)
        new = successor(schedule, plan, t)
        steps = within_reach(new.footsteps, new.feet, MODEL.reach)
        new = replace(new, footsteps=steps)
        yield schedule, plan, t, plan.at(t).icp, new, 0.0
        schedule = new


def aimed(schedule, shift):
    """The footsteps, the next one by `shift` elsewhere, but within reach."""
    step, *later = schedule.footsteps
    pose = FootPose(step.pose.p_WF + [*shift, 0.0], step.pose.yaw)
    moved = (replace(step, pose=pose),)
    return *within_reach(moved, schedule.feet, MODEL.reach), *later


@pytest.mark.parametrize("seed", range(12))
def test_no_re_plan_asks_for_what_the_feet_cannot_do(seed):
    """Oracle: the ICP before, the measured ICP, shapely's hull of the soles."""
    for old, before, t, icp, new, then in random_re_plans(seed):
        plan = plan_of(new)
        was, now = before.at(t), plan.at(then)
        np.testing.assert_allclose(now.ecmp, was.ecmp, rtol=0.0, atol=1e-9)
        if new.phase is not old.phase:
            for name in "icp", "com", "com_velocity", "cop":
                value, before_it = getattr(now, name), getattr(was, name)
                assert value == pytest.approx(before_it, abs=1e-9)
        worse = math.dist(now.icp, icp) - math.dist(was.icp, icp)
        assert worse < 1e-9
        knots = plan.knots[plan.knots <= new.duration + 1e-9]
        assert in_support([plan.at(k).ecmp for k in knots], new)


def test_a_moved_foothold_takes_up_the_error_towards_it():
    """Oracle: the ICPs of both footholds by the paper's system; half a way."""
    schedule = walk()
    schedule = successor(schedule, plan_of(schedule))
    t, plan, new = 0.3, plan_of(schedule), aimed(schedule, [0.1, -0.05])
    icps = []
    for steps in schedule.footsteps, new:
        other = as_printed(replace(schedule, footsteps=steps))
        icps.append(other.at(t).icp)
    move, was = icps[1] - icps[0], plan.at(t).icp
    normal = np.array([-move[1], move[0]])
    for ahead, part in (-1.0, 0.0), (0.5, 0.5), (2.0, 1.0):
        icp = was + ahead * move + 0.7 * normal
        moved = plan_of(plan.moved(schedule, new, t, icp))
        assert moved.at(t).icp == pytest.approx(was + part * move, abs=1e-6)


@pytest.mark.parametrize("kwargs", WALKS)
def test_finds_the_time_at_which_the_plan_is_nearest(kwargs):
    """Oracle: a dense search, and the times of the ICPs on the plan."""
    random, schedule = np.random.default_rng(0), walk(**kwargs)
    while schedule.phase is not Phase.STANDING:
        plan = plan_of(schedule)
        times = np.linspace(0.0, schedule.duration, 1001)
        path = np.array([plan.at(t).icp for t in times])
        for _ in range(20):
            now, then = np.sort(random.uniform(0.0, schedule.duration, 2))
            icp = plan.at(then).icp + random.uniform(-0.08, 0.08, 2)
            result = plan.time_to(icp, now)
            assert 0.0 <= result <= schedule.duration - now + 1e-12
            later = np.vstack([plan.at(now).icp, path[times > now]])
            least = np.linalg.norm(later - icp, axis=1).min()
            distance = math.dist(plan.at(now + result).icp, icp)
            assert distance < least + 1e-5
        schedule = successor(schedule, plan)


@pytest.mark.parametrize("phase", list(Phase))
def test_a_waiting_reference_holds_the_icp(phase):
    """Oracle: the contract: at rest on two feet; the last eCMP on one."""
    schedule = replace(walk(), phase=phase, duration=0.4)
    plan = plan_of(schedule)
    end = plan.at(0.4)
    held = icp_plan.reference_of(
        plan, WalkingState(schedule, 0.4, waiting=True)
    )
    np.testing.assert_array_equal(held.icp, end.icp)
    np.testing.assert_array_equal(held.icp_velocity, [0.0, 0.0])
    ecmp = end.ecmp if phase is Phase.SWING else end.icp
    np.testing.assert_array_equal(held.ecmp, ecmp)
    np.testing.assert_array_equal(held.cop, ecmp)
    point = held.point()
    icp = point.com + point.com_velocity / OMEGA
    assert icp == pytest.approx(end.icp, abs=1e-15)
