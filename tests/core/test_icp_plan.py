"""Oracles: the paper's linear system, RK4 of the ICP dynamics, symmetry."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.cop_waypoints import CopWaypointParams
from nadia_balance.core.icp_plan import (
    IcpPlanParams,
    IcpReference,
    plan_icp,
    reference_of,
    rows_at,
    solve_segments,
)
from nadia_balance.core.walking import (
    FootPose,
    Phase,
    ReferencePoint,
    WalkingState,
)
from tests.example_walks import (
    MODEL,
    OMEGA,
    at_rest,
    moved,
    random_walks,
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


def paper_system(durations, ecmp, com_start):
    """The 6N x 6N system below Eq. 4 and its right-hand side (6N, k)."""
    n = len(durations)
    com_0, velocity_0, ecmp_0, slope_0 = rows_with_rates(
        0.0 * durations, durations
    )
    com_T, velocity_T, ecmp_T, slope_T = rows_with_rates(durations, durations)
    system, values = np.zeros((n, 6, n, 6)), np.zeros((n, 6, ecmp.shape[1]))
    i, j = np.arange(n), np.arange(n - 1)
    system[i, 0, i], system[i, 1, i] = ecmp_0, slope_0
    system[i, 2, i], system[i, 3, i] = ecmp_T, slope_T
    system[j, 4, j], system[j, 4, j + 1] = com_T[:-1], -com_0[1:]
    system[j, 5, j], system[j, 5, j + 1] = velocity_T[:-1], -velocity_0[1:]
    system[-1, 4, -1] = com_T[-1] + velocity_T[-1] / OMEGA
    system[-1, 5, 0] = com_0[0]
    slope = (ecmp[1:] - ecmp[:-1]) / durations[:, None]
    values[:, 0], values[:, 1] = ecmp[:-1], slope
    values[:, 2], values[:, 3] = ecmp[1:], slope
    values[-1, 4], values[-1, 5] = ecmp[-1], com_start
    return system.reshape(6 * n, 6 * n), values.reshape(6 * n, -1)


def backward_icp(durations, ecmp, omega):
    """The ICP at all knots, from the last one back: Eq. 3, a linear eCMP."""
    icp = [ecmp[-1]]
    for i in reversed(range(len(durations))):
        a, b, T = ecmp[i], ecmp[i + 1], durations[i]
        lead = (b - a) / (T * omega)
        icp.append(a + lead + np.exp(-omega * T) * (icp[-1] - b - lead))
    return np.array(icp[::-1])


@st.composite
def problems(draw):
    """Durations of 1 to 20 segments, an eCMP path, and a CoM."""
    n = draw(st.integers(1, 20))
    duration = st.floats(0.01, 2.0)
    random = np.random.default_rng(draw(st.integers(0, 10**6)))
    durations = np.array(draw(st.lists(duration, min_size=n, max_size=n)))
    return (
        durations,
        random.uniform(-1, 1, (n + 1, 2)),
        random.uniform(-1, 1, 2),
    )


@given(problems())
def test_is_the_solution_of_the_papers_system(problem):
    """Oracle: what is left of its 6N equations; some 1e-16 times 1e2.

    The matrix is regular, so that there is no other solution.
    """
    durations, ecmp, com = problem
    system, values = paper_system(durations, ecmp, com)
    found = solve_segments(durations, ecmp, com, OMEGA).reshape(len(system), 2)
    np.testing.assert_allclose(system @ found, values, rtol=0.0, atol=1e-12)
    assert np.linalg.cond(system) < 1e10


@pytest.mark.parametrize("duration", [1e-5, 1.0, 100.0])
def test_very_short_and_very_long_segments_cost_little_accuracy(duration):
    """Oracle: the recursion, to the 1e-8 that planning needs."""
    durations = np.array([0.3, duration, 0.3, duration, 10.0])
    ecmp = np.array([0.0, 0.1, 0.3, 0.2, 0.4, 0.4])[:, None]
    solution = solve_segments(durations, ecmp, np.zeros(1), OMEGA)
    expected = backward_icp(durations, ecmp, OMEGA)
    for i, T in enumerate(durations):
        for t, icp in (0.0, expected[i]), (T, expected[i + 1]):
            found = rows_at(t, T, OMEGA)[1] @ solution[i]
            np.testing.assert_allclose(found, icp, atol=1e-8)


PARAMS = IcpPlanParams()
AS_PRINTED = IcpPlanParams(continuous=False)
WALKS = [
    pytest.param({"length": 0.3}, id="forward"),
    pytest.param({"length": 0.0, "sideways": 0.1}, id="sideways"),
    pytest.param({"length": 0.1, "turn": 0.26}, id="turning"),
]


def plan_of(schedule, params=PARAMS):
    return plan_icp(schedule, params, MODEL)


def rows_of(reference):
    """All fields of a reference, as one array."""
    return np.array([getattr(reference, f.name) for f in fields(IcpReference)])


def rk4(rate, state, start, end, steps=200):
    """Integrates state' = rate(t, state) from `start` to `end`."""
    h = (end - start) / steps
    for t in start + h * np.arange(steps):
        k1 = rate(t, state)
        k2 = rate(t + 0.5 * h, state + 0.5 * h * k1)
        k3 = rate(t + 0.5 * h, state + 0.5 * h * k2)
        k4 = rate(t + h, state + h * k3)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


@pytest.mark.parametrize("kwargs", WALKS)
def test_icp_and_com_move_as_the_ecmp_makes_them(kwargs):
    """Oracle: RK4 of Eqs. 1 and 2 from knot to knot; its error is < 1e-10."""
    plan = plan_of(walk(**kwargs))

    def rate(t, state):
        icp, com = state
        return OMEGA * np.array([icp - plan.at(t).ecmp, icp - com])

    for start, end in zip(plan.knots[:-2], plan.knots[1:-1], strict=True):
        now, then = plan.at(start), plan.at(end)
        state = rk4(rate, np.array([now.icp, now.com]), start, end)
        np.testing.assert_allclose(state, [then.icp, then.com], atol=1e-10)


@given(random_walks())
def test_starts_with_the_reference_it_takes_over_from(schedule):
    """Oracle: schedule.start, and Eq. 1 for its ICP."""
    cop = CopWaypointParams(transfer_split=0.4, swing_split=0.3)
    params = replace(PARAMS, cop=cop)
    start, found = schedule.start, plan_of(schedule, params).at(0.0)
    exact = {"rtol": 0.0, "atol": 1e-10}
    np.testing.assert_allclose(found.com, start.com, **exact)
    np.testing.assert_allclose(found.com_velocity, start.com_velocity, **exact)
    np.testing.assert_allclose(found.cop, start.cop, **exact)
    icp = start.com + start.com_velocity / OMEGA
    np.testing.assert_allclose(found.icp, icp, **exact)


@given(random_walks())
def test_the_bend_leaves_the_icp_after_it_alone(schedule):
    """Oracle: the plan before it is bent, at the third knot and later."""
    params = replace(PARAMS, min_bend_time=0.0)
    bent, printed = plan_of(schedule, params), plan_of(schedule, AS_PRINTED)
    for t in bent.knots[2:]:
        np.testing.assert_allclose(
            bent.at(t).icp, printed.at(t).icp, atol=1e-10
        )


def test_a_short_transfer_is_not_bent_within_it():
    """Oracle: the waypoints of the transfer, and the sizes of both bends.

    The ICP is 3 cm from where the plan wants it.  Within the 0.03 s of the
    transfer that takes an eCMP half a metre away.
    """
    schedule = walk(transfer=0.03)
    icp = plan_of(schedule, AS_PRINTED).at(0.0).icp
    schedule = replace(schedule, start=at_rest(icp + [0.03, 0.0]))
    bends = []
    for min_bend_time in 0.0, 0.1:
        plan = plan_of(schedule, replace(PARAMS, min_bend_time=min_bend_time))
        cop = np.array([plan.at(t).cop for t in plan.knots])
        bends.append(np.abs(cop - plan.cop_waypoints).max(axis=1))
    late, early = bends[1], bends[0]
    np.testing.assert_allclose(late[:3], 0.0, atol=1e-12)
    assert max(early) > 0.5
    assert max(late) < 0.1


def test_the_place_of_rest_is_never_bent():
    """Oracle: the waypoints of the end, though all others are too early."""
    params = replace(PARAMS, min_bend_time=99.0)
    start = ReferencePoint([0.03, 0.02], [0.1, -0.1], [0.03, 0.0])
    plan = plan_of(standing(start=start), params)
    np.testing.assert_allclose(plan.at(0.0).com_velocity, [0.1, -0.1])
    for t in plan.knots[-2:]:
        np.testing.assert_allclose(plan.at(t).cop, 0.0, atol=1e-12)


@pytest.mark.parametrize("kwargs", WALKS)
def test_no_reference_jumps_in_a_walk(kwargs):
    """Oracle: the plan before; the feet land early, on a long walk."""
    schedule = walk(num_steps=7, **kwargs)
    while schedule.phase is not Phase.STANDING:
        plan = plan_of(schedule)
        early = 0.9 if schedule.phase is Phase.SWING else 1.0
        t = early * schedule.duration
        schedule = successor(schedule, plan, t)
        np.testing.assert_allclose(
            rows_of(plan_of(schedule).at(0.0)), rows_of(plan.at(t)), atol=1e-10
        )


@given(random_walks())
def test_ends_at_rest_between_the_feet(schedule):
    """Oracle: the middle of the last two soles; held for ever."""
    feet = schedule.feet
    for step in schedule.footsteps[:3]:
        feet = feet.with_foot(step.side, step.pose)
    middle = 0.5 * (feet.left.p_WF + feet.right.p_WF)[:2]
    plan = plan_of(schedule)
    for t in plan.knots[-1], plan.knots[-1] + 1.0, 1e6:
        end = plan.at(t)
        for point in end.icp, end.com, end.cop, end.ecmp:
            np.testing.assert_allclose(point, middle, atol=1e-10)
        np.testing.assert_allclose(end.icp_velocity, 0.0, atol=1e-9)
        np.testing.assert_allclose(end.com_velocity, 0.0, atol=1e-9)


@given(random_walks(), st.floats(-4, 4), st.floats(-5, 5))
def test_all_places_and_directions_are_alike(schedule, angle, shift):
    """Oracle: the walk turned and moved as a whole."""
    place = FootPose([shift, 1.0, 0.0], angle)
    plan = plan_of(schedule)
    elsewhere = plan_of(moved(schedule, angle, np.array([shift, 1.0])))
    for t in np.linspace(0.0, plan.knots[-2], 9):
        here, there = plan.at(t), elsewhere.at(t)
        for name in "icp", "com", "cop":
            expected = place.to_world(getattr(here, name))
            np.testing.assert_allclose(
                getattr(there, name), expected, atol=1e-9
            )
        np.testing.assert_allclose(
            there.icp_velocity, place.rotation @ here.icp_velocity, atol=1e-9
        )


@pytest.mark.parametrize("duration", [0.0, 1e-3])
def test_a_phase_of_no_time_is_harmless(duration):
    """Oracle: the start, and bounded velocities throughout."""
    schedule = replace(walk(), duration=duration)
    plan = plan_of(schedule)
    np.testing.assert_allclose(plan.at(0.0).icp, 0.0, atol=1e-8)
    for t in np.linspace(0.0, 4.0, 200):
        assert np.abs(plan.at(t).icp_velocity).max() < 3.0


@pytest.mark.parametrize("phase", list(Phase))
def test_a_waiting_reference_holds_the_icp(phase):
    """Oracle: the contract: at rest on two feet; the last eCMP on one."""
    schedule = replace(walk(), phase=phase, duration=0.4)
    plan = plan_of(schedule)
    end = plan.at(0.4)
    held = reference_of(plan, WalkingState(schedule, 0.4, waiting=True))
    np.testing.assert_array_equal(held.icp, end.icp)
    np.testing.assert_array_equal(held.icp_velocity, [0.0, 0.0])
    ecmp = end.ecmp if phase is Phase.SWING else end.icp
    np.testing.assert_array_equal(held.ecmp, ecmp)
    np.testing.assert_array_equal(held.cop, ecmp)
    point = held.point()
    np.testing.assert_allclose(
        point.com + point.com_velocity / OMEGA, end.icp, atol=1e-15
    )
