"""Oracles: Algorithm 1 of the Atlas paper, differences, symmetry."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.math.lipm import icp
from nadia_balance.core.plan import atlas_icp_plan
from nadia_balance.core.plan.icp_plan import reference_of
from nadia_balance.core.walking.state import WalkingState
from tests.example_walks import (
    MODEL,
    OMEGA,
    at_rest,
    random_walks,
    standing,
    successor,
    swing,
    walk,
)

PARAMS = atlas_icp_plan.AtlasIcpPlanParams()
JUMPS = replace(PARAMS, smooth=False)


def plan_of(schedule, params=PARAMS):
    return atlas_icp_plan.plan_atlas_icp(schedule, params, MODEL)


def algorithm_1(toe, heel, num_steps, omega, swinging):
    """gamma_H,0, gamma_T,0, gamma_H,1, ..., gamma_f as printed."""

    def decay(t):
        return math.exp(-omega * t)

    whole, shift = toe + heel, 0.0 if swinging else heel
    before = toe if swinging else whole  # until the first step
    gammas = [0.0 if swinging else 1.0 - decay(heel)]
    gammas.append(decay(shift) * (1.0 - decay(toe)))
    for i in range(num_steps):
        start = before + i * whole
        gammas.append(decay(start) * (1.0 - decay(heel)))
        gammas.append(decay(start + heel) * (1.0 - decay(toe)))
    return [*gammas, decay(before + num_steps * whole)]


def with_footholds(schedule, shifts):
    """The same, the first footholds moved by `shifts` (n, 2) in W."""
    steps = list(schedule.footsteps)
    for i, (shift, step) in enumerate(zip(shifts, steps, strict=False)):
        pose = replace(step.pose, p_WF=step.pose.p_WF + [*shift, 0.0])
        steps[i] = replace(step, pose=pose)
    return replace(schedule, footsteps=tuple(steps))


STAYS = st.floats(0.05, 1.0)


@given(STAYS, STAYS, st.integers(0, 4), st.floats(2.0, 4.0), st.booleans())
def test_the_multipliers_are_those_of_algorithm_1(toe, heel, n, omega, swing):
    """Oracle: Algorithm 1 as printed, of any N in either branch."""
    stays = [heel, toe] * (n + 1)
    corners = [0.0, *np.cumsum(stays[swing:])]
    # The CMP before the first corner does not count: in a swing, the heel.
    points = np.eye(len(corners) + 1)
    multipliers = atlas_icp_plan.corner_points(corners, points, omega)[0]
    multipliers = multipliers if swing else multipliers[1:]
    expected = algorithm_1(toe, heel, n, omega, swing)
    assert multipliers == pytest.approx(expected, abs=1e-14)
    assert sum(multipliers) == pytest.approx(1.0)


def test_corner_points_and_knots_are_those_of_equation_5():
    """Oracle: Eqs. 4 and 5 by hand, of the last transfer and the last swing."""
    schedule = swing(length=0.3, num_steps=1, transfer=0.3, swing=0.7)
    plan = plan_of(schedule)
    heel, toe, rest = plan.cop_waypoints
    assert heel == pytest.approx([-0.02, 0.125])
    assert toe == pytest.approx([0.03, 0.105])
    assert rest == pytest.approx([0.15, 0.0])
    # At rest at 40 % of 0.8 s; half of 0.15 + 0.7 + 0.4 s is on the toe.
    ini = toe + math.exp(-OMEGA * 0.4) * (rest - toe)
    assert plan.at(0.7).icp == pytest.approx(ini, abs=1e-12)
    assert plan.at(1.5).icp == pytest.approx(rest, abs=1e-12)
    corner = toe + math.exp(-OMEGA * 0.625) * (rest - toe)
    start = heel + math.exp(-OMEGA * 0.475) * (corner - heel)
    assert plan.at(0.0).icp == pytest.approx(start, abs=1e-12)
    jumping = plan_of(schedule, JUMPS)
    assert jumping.at(0.475).icp == pytest.approx(corner, abs=1e-12)


@given(random_walks(), st.floats(0.1, 0.9))
def test_moves_as_the_pendulum_does(schedule, share):
    """Oracle: central differences of CoM and ICP in each segment, Eq. 2."""
    plan, h = plan_of(schedule), 1e-5
    for begin, end in itertools.pairwise(plan.knots[:-1]):
        t = begin + share * (end - begin)
        before, now, after = (plan.at(t + d) for d in (-h, 0.0, h))
        for name, goal in ("com", now.com), ("icp", now.ecmp):
            rate = (getattr(after, name) - getattr(before, name)) / (2.0 * h)
            away = now.icp - goal
            assert rate == pytest.approx(OMEGA * away, abs=1e-6)


@pytest.mark.parametrize("params", [PARAMS, JUMPS], ids=["smooth", "jumps"])
@given(random_walks(), st.floats(0.0, 2.0), st.integers(0, 10**6))
def test_is_linear_in_the_footholds(params, schedule, t, seed):
    """Oracle: the plan of other footholds, decimetres away."""
    plan = plan_of(schedule, params)
    count = min(len(schedule.footsteps), PARAMS.num_previewed_steps)
    shifts = np.random.default_rng(seed).uniform(-0.3, 0.3, (count, 2))
    other = plan_of(with_footholds(schedule, shifts), params)
    for waiting in False, True:
        time = schedule.duration if waiting else min(t, schedule.duration)
        state = WalkingState(schedule, time, waiting=waiting)
        before, after = reference_of(plan, state), reference_of(other, state)
        dcm, cmp = plan.moves_of(state) @ shifts
        assert after.icp - before.icp == pytest.approx(dcm, abs=1e-12)
        assert after.ecmp - before.ecmp == pytest.approx(cmp, abs=1e-12)


def test_a_transfer_starts_with_the_icp_that_was_even_if_it_is_early():
    """Oracle: schedule.start; Eq. 5, from the last CMP, is elsewhere."""
    first = swing(length=0.3)
    early = successor(first, plan_of(first), 0.6)
    expected = icp(early.start.com, early.start.com_velocity, OMEGA)
    now = plan_of(early).at(0.0)
    assert now.icp == pytest.approx(expected, abs=1e-12)
    assert now.com == pytest.approx(early.start.com, abs=1e-12)
    assert now.ecmp == pytest.approx(early.start.cop, abs=1e-12)
    plan = plan_of(early, JUMPS)
    heel = plan.cop_waypoints[1]
    end = plan.at(early.duration).icp
    corner = heel + math.exp(-OMEGA * 0.15) * (end - heel)
    cmp = early.start.cop
    ini = cmp + math.exp(-OMEGA * 0.15) * (corner - cmp)
    assert plan.at(0.0).icp == pytest.approx(ini, abs=1e-12)
    assert math.dist(ini, expected) > 0.01


def test_sees_no_steps_while_it_stands():
    """Oracle: the same without footsteps."""
    now = standing(start=at_rest([0.1, 0.1]))
    later = replace(now, footsteps=walk().footsteps)
    assert plan_of(later).knots.tolist() == plan_of(now).knots.tolist()
