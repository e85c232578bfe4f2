"""Oracles: RK4 of the ICP dynamics, closed recursions, symmetry."""

import copy
import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.com_trajectory import rows_at
from nadia_balance.core.icp_plan import (
    IcpPlanParams,
    IcpReference,
    plan_icp,
    reference_of,
)
from nadia_balance.core.walking import (
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    WalkingState,
)
from tests.example_walks import (
    OMEGA,
    SOLE,
    at_rest,
    mirrored,
    moved,
    phases,
    random_walks,
    standing,
    successor,
    walk,
)

PARAMS = IcpPlanParams()
AS_PRINTED = IcpPlanParams(continuous=False)
WALKS = [
    pytest.param({"length": 0.0}, id="in place"),
    pytest.param({"length": 0.3}, id="forward"),
    pytest.param({"length": -0.2}, id="backward"),
    pytest.param({"length": 0.0, "sideways": 0.1}, id="sideways"),
    pytest.param({"length": 0.1, "turn": 0.26}, id="turning"),
]


def plan_of(schedule, params=PARAMS):
    return plan_icp(schedule, SOLE, params, OMEGA)


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
def test_nothing_jumps_at_the_knots(schedule):
    """Oracle: both segments that meet there, evaluated on their own."""
    plan = plan_of(schedule)
    durations = np.diff(plan.knots)
    for i in range(len(durations) - 1):
        before = rows_at(durations[i], durations[i], OMEGA)
        after = rows_at(0.0, durations[i + 1], OMEGA)
        np.testing.assert_allclose(
            before @ plan.coefficients[i],
            after @ plan.coefficients[i + 1],
            atol=1e-11,
        )


@given(random_walks(), st.floats(0.02, 0.98))
def test_velocities_are_the_slopes(schedule, fraction):
    """Oracle: central differences; at h = 1e-5 good to 1e-16 / h."""
    plan, h = plan_of(schedule), 1e-5
    for start, end in zip(plan.knots[:-2], plan.knots[1:-1], strict=True):
        t = start + fraction * (end - start)
        now, before, after = plan.at(t), plan.at(t - h), plan.at(t + h)
        for name in "icp", "com":
            slope = (getattr(after, name) - getattr(before, name)) / (2.0 * h)
            velocity = getattr(now, f"{name}_velocity")
            np.testing.assert_allclose(velocity, slope, atol=1e-7)


@given(random_walks())
def test_the_cop_goes_through_its_waypoints(schedule):
    """Oracle: the waypoints, if none is bent; linear in between."""
    plan = plan_of(schedule, AS_PRINTED)
    for t, point in zip(plan.knots, plan.cop_waypoints, strict=True):
        np.testing.assert_allclose(plan.at(t).cop, point, atol=1e-11)
    for i in range(len(plan.knots) - 1):
        middle = plan.at(0.5 * (plan.knots[i] + plan.knots[i + 1]))
        expected = 0.5 * (plan.cop_waypoints[i] + plan.cop_waypoints[i + 1])
        np.testing.assert_allclose(middle.cop, expected, atol=1e-11)


@given(random_walks())
def test_is_the_backward_recursion_before_it_is_bent(schedule):
    """Oracle: the closed recursion of algorithms.md 1.2, to 1e-8."""
    plan = plan_of(schedule, AS_PRINTED)
    icp = plan.cop_waypoints[-1]
    for i in reversed(range(len(plan.knots) - 1)):
        a, b = plan.cop_waypoints[i : i + 2]
        T = plan.knots[i + 1] - plan.knots[i]
        lead = (b - a) / (T * OMEGA)
        icp = a + lead + math.exp(-OMEGA * T) * (icp - b - lead)
        np.testing.assert_allclose(plan.at(plan.knots[i]).icp, icp, atol=1e-8)


@given(random_walks())
def test_starts_with_the_reference_it_takes_over_from(schedule):
    """Oracle: schedule.start, and Eq. 1 for its ICP."""
    start, found = schedule.start, plan_of(schedule).at(0.0)
    exact = {"rtol": 0.0, "atol": 1e-10}
    np.testing.assert_allclose(found.com, start.com, **exact)
    np.testing.assert_allclose(found.com_velocity, start.com_velocity, **exact)
    np.testing.assert_allclose(found.cop, start.cop, **exact)
    icp = start.com + start.com_velocity / OMEGA
    np.testing.assert_allclose(found.icp, icp, **exact)


def two_segment_matrix(T0, T1):
    """Eq. 4 as printed (e^(w t)) with the 12 conditions of the re-solve."""
    w = OMEGA

    def rows(t):
        e, d = math.exp(w * t), math.exp(-w * t)
        com = np.array([e, d, t**3, t**2, t, 1.0])
        velocity = np.array([w * e, -w * d, 3 * t**2, 2 * t, 1.0, 0.0])
        ecmp = np.array([0, 0, t**3 - 6 * t / w**2, t**2 - 2 / w**2, t, 1.0])
        slope = np.array([0, 0, 3 * t**2 - 6 / w**2, 2 * t, 1.0, 0.0])
        return com, velocity, ecmp, slope

    c0, v0, r0, s0 = rows(0.0)
    cT, vT, rT, sT = rows(T0)
    cU, vU, rU, sU = rows(T1)
    none = np.zeros(6)
    return np.array(
        [
            [*c0, *none],  # CoM and its velocity at the start
            [*v0, *none],
            [*r0, *none],  # eCMP at the start
            [*cT, *-c0],  # continuous at the junction
            [*vT, *-v0],
            [*rT, *-r0],
            [*(rT - r0 - T0 * s0), *none],  # linear: the chord, both ends
            [*(rT - r0 - T0 * sT), *none],
            [*none, *(rU - r0 - T1 * s0)],
            [*none, *(rU - r0 - T1 * sU)],
            [*none, *rU],  # eCMP at the end
            [*none, *(cU + vU / w)],  # ICP at the end
        ]
    )


@given(random_walks())
def test_the_bend_is_that_of_the_two_segment_solution(schedule):
    """Oracle: 12 conditions for the first two segments (algorithms.md 1.3)."""
    params = replace(PARAMS, min_bend_time=0.0)
    plan, printed = plan_of(schedule, params), plan_of(schedule, AS_PRINTED)
    T0, T1 = np.diff(plan.knots[:3])
    values = np.zeros((12, 2))
    values[:3] = (
        schedule.start.com,
        schedule.start.com_velocity,
        schedule.start.cop,
    )
    end = printed.at(plan.knots[2])
    values[10:] = end.ecmp, end.icp
    c = np.linalg.solve(two_segment_matrix(T0, T1), values)[:6]
    for t in np.linspace(0.0, T0, 4):
        powers = np.array([t**3, t**2, t, 1.0])
        basis = [math.exp(OMEGA * t), math.exp(-OMEGA * t), *powers]
        np.testing.assert_allclose(plan.at(t).com, basis @ c, atol=1e-8)


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
def test_the_next_plan_continues_this_one_if_nothing_changed(kwargs):
    """Oracle: the first plan, as long as it previews all steps."""
    sequence = phases(walk(**kwargs), plan_of)
    _, first = sequence[0]
    begin = 0.0
    for schedule, plan in sequence[:-1]:
        for t in np.linspace(0.0, schedule.duration, 30):
            np.testing.assert_allclose(
                rows_of(plan.at(t)), rows_of(first.at(begin + t)), atol=1e-9
            )
        begin += schedule.duration


@pytest.mark.parametrize("kwargs", WALKS)
@pytest.mark.parametrize("share", [0.9, 1.0])
def test_no_reference_jumps_in_a_walk(kwargs, share):
    """Oracle: the plan before, also if the feet land early, on a long walk."""
    schedule = walk(num_steps=7, **kwargs)
    while schedule.phase is not Phase.STANDING:
        plan = plan_of(schedule)
        early = share if schedule.phase is Phase.SWING else 1.0
        t = early * schedule.duration
        schedule = successor(schedule, plan, t)
        np.testing.assert_allclose(
            rows_of(plan_of(schedule).at(0.0)), rows_of(plan.at(t)), atol=1e-10
        )


def test_beyond_the_preview_steps_hardly_matter():
    """Oracle: e^(-omega t) of the 3.7 s and 0.25 m to the first unseen."""
    long, short = plan_of(walk(num_steps=6)), plan_of(walk(num_steps=4))
    np.testing.assert_array_equal(long.coefficients, short.coefficients)
    more = replace(PARAMS, cop=replace(PARAMS.cop, num_previewed_steps=6))
    best = plan_of(walk(num_steps=6), replace(more, continuous=False))
    ours = plan_of(walk(num_steps=6), AS_PRINTED)
    assert math.dist(ours.at(0.0).icp, best.at(0.0).icp) < 1e-5


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


@pytest.mark.parametrize("x", [0.0, 12.5])
def test_who_rests_between_the_feet_stays_at_rest(x):
    """Oracle: the start itself; 1e-12 is rounding at 12 m."""
    feet = FootPoses(FootPose([x, 0.1, 0], 0.3), FootPose([x, -0.1, 0], 0.1))
    plan = plan_of(standing(feet))
    assert plan.duration == math.inf
    np.testing.assert_allclose(plan.icp_end, [x, 0.0], atol=1e-12)
    for t in 0.0, 0.3, 0.7, 5.0, 100.0:
        now = plan.at(t)
        for point in now.icp, now.com, now.cop:
            np.testing.assert_allclose(point, [x, 0.0], atol=1e-12)
        np.testing.assert_allclose(now.icp_velocity, 0.0, atol=1e-12)
        np.testing.assert_allclose(now.com_velocity, 0.0, atol=1e-12)


def test_standing_brings_a_moving_com_to_rest():
    """Oracle: the start, the middle of the feet, and no jump between."""
    start = ReferencePoint([0.03, 0.02], [0.1, -0.1], [0.03, 0.0])
    plan = plan_of(standing(start=start))
    np.testing.assert_allclose(plan.at(0).com_velocity, [0.1, -0.1])
    np.testing.assert_allclose(plan.at(8.0).com, 0.0, atol=1e-9)


@given(random_walks())
def test_knows_the_icp_at_the_end_of_the_phase(schedule):
    """Oracle: the reference then."""
    plan = plan_of(schedule)
    assert plan.duration == schedule.duration
    np.testing.assert_allclose(
        plan.icp_end, plan.at(schedule.duration).icp, atol=1e-11
    )


@given(random_walks())
def test_left_and_right_are_alike(schedule):
    """Oracle: the mirror image of the walk."""
    plan, image = plan_of(schedule), plan_of(mirrored(schedule))
    for t in np.linspace(0.0, plan.knots[-2], 9):
        np.testing.assert_allclose(
            rows_of(image.at(t)), rows_of(plan.at(t)) * [1, -1], atol=1e-9
        )


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
            there.icp_velocity,
            place.rotation @ here.icp_velocity,
            atol=1e-9,
        )


@pytest.mark.parametrize("duration", [0.0, 1e-6, 1e-3])
def test_a_phase_of_no_time_is_harmless(duration):
    """Oracle: the start, and bounded velocities throughout."""
    schedule = replace(walk(), duration=duration)
    plan = plan_of(schedule)
    np.testing.assert_allclose(plan.at(0.0).icp, 0.0, atol=1e-8)
    for t in np.linspace(0.0, 4.0, 200):
        assert np.abs(plan.at(t).icp_velocity).max() < 3.0


def test_holds_its_start_before_it_starts():
    """Oracle: the start."""
    plan = plan_of(walk())
    np.testing.assert_array_equal(rows_of(plan.at(-0.5)), rows_of(plan.at(0.0)))


def test_nobody_can_change_a_plan():
    """Oracle: numpy's own refusal, also after a deep copy."""
    plan = plan_of(walk())
    assert copy.deepcopy(plan) is plan
    for array in plan.icp_end, plan.knots, plan.cop_waypoints:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        plan.coefficients[0, 0] = 1.0


def test_the_reference_follows_the_clock():
    """Oracle: the plan at the time in the phase."""
    schedule = walk()
    plan = plan_of(schedule)
    found = reference_of(plan, WalkingState(schedule, 0.2))
    np.testing.assert_array_equal(rows_of(found), rows_of(plan.at(0.2)))


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


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_refuses_a_bad_bend_time(value):
    """Oracle: the message names field, value and what is allowed."""
    with pytest.raises(ValueError, match=f"min_bend_time = {value}: must be"):
        IcpPlanParams(min_bend_time=value).validate()


def test_validates_the_cop_params_too():
    """Oracle: a preview of no steps."""
    params = IcpPlanParams()
    params.validate()
    params.cop.num_previewed_steps = 0
    with pytest.raises(ValueError, match="num_previewed_steps = 0"):
        params.validate()
