"""Oracles: the Atlas paper's Algorithm 1, the ICP plan, a partition of 1."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.recursive_multipliers import recursive_multipliers
from tests.example_walks import OMEGA, SOLE, random_walks

AT_ONCE = 1e-9  # [s], from heel to toe: the paper's CMP jumps


def knots_of_jumps(durations):
    """The CMP stays for each of these durations [s], and jumps."""
    knots = [0.0]
    for duration in durations:
        knots += [knots[-1] + duration - AT_ONCE, knots[-1] + duration]
    return np.array(knots)


def algorithm_1(toe, heel, num_steps, omega, swing):
    """gamma_H,0, gamma_T,0, gamma_H,1, ..., gamma_f as printed.

    In a swing only `toe` [s] is left of the present foot.
    """
    whole = toe + heel
    before = toe if swing else whole  # until the first step
    gammas = [] if swing else [1.0 - math.exp(-omega * heel)]
    shift = 0.0 if swing else heel
    gammas.append(math.exp(-omega * shift) * (1.0 - math.exp(-omega * toe)))
    for i in range(num_steps):
        start = before + i * whole
        gammas.append(math.exp(-omega * start) * (1 - math.exp(-omega * heel)))
        start += heel
        gammas.append(math.exp(-omega * start) * (1 - math.exp(-omega * toe)))
    return [*gammas, math.exp(-omega * (before + num_steps * whole))]


@pytest.mark.parametrize("swing", [True, False])
def test_of_a_cmp_that_jumps_they_are_those_of_algorithm_1(swing):
    """Oracle: Algorithm 1 as printed, both branches; numbers of the notes."""
    toe, heel, omega = 0.4, 0.45, 3.0
    stays = [toe, heel, toe, heel, toe] if swing else [heel, toe] * 3
    found = recursive_multipliers(knots_of_jumps(stays), 0.0, omega)
    summed = [*found[:-1].reshape(-1, 2).sum(axis=1), found[-1]]
    expected = algorithm_1(toe, heel, 2, omega, swing)
    assert summed == pytest.approx(expected, abs=1e-8)
    assert summed[-1] == pytest.approx(
        0.00183630 if swing else 0.00047604, abs=1e-8
    )


times = st.floats(0.0, 3.0)


@given(random_walks(), times)
def test_are_shares(schedule, t):
    """Oracle: none is negative, and their sum is 1."""
    plan = plan_icp(schedule, SOLE, IcpPlanParams(), OMEGA)
    found = recursive_multipliers(plan.knots, t, OMEGA)
    assert found.min() >= -1e-15
    assert found.sum() == pytest.approx(1.0, abs=1e-12)


@given(random_walks(), times)
def test_add_up_to_the_reference_icp(schedule, t):
    """Oracle: plan_icp, by Eq. 4 of the Nadia paper, which ends in the same."""
    params = IcpPlanParams(continuous=False)
    plan = plan_icp(schedule, SOLE, params, OMEGA)
    found = recursive_multipliers(plan.knots, t, OMEGA) @ plan.cop_waypoints
    assert found == pytest.approx(plan.at(t).icp, abs=1e-9)


def test_what_has_been_passed_counts_no_more():
    """Oracle: the ICP depends on the future alone."""
    knots = np.array([0.0, 0.2, 0.5, 1.0])
    found = recursive_multipliers(knots, 0.6, OMEGA)
    assert found[:2].tolist() == [0.0, 0.0]
    assert recursive_multipliers(knots, 2.0, OMEGA).tolist() == [0, 0, 0, 1]
