"""Oracles: roll-outs of the ICP's dynamics, linear programs, Koolen's discs.

To our knowledge nobody has published numeric tests of N-step capture regions.
"""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from nadia_balance.core.body.reachability import base_region, circle, in_world
from nadia_balance.core.math.arrays import rectangle
from nadia_balance.core.math.lipm import icp_after
from nadia_balance.core.math.polygon import (
    centroid,
    contains,
    convex_hull,
    project,
)
from nadia_balance.core.steps.capture_region import (
    capture_region,
    later_steps,
    one_step_region,
)
from nadia_balance.core.walking.vocabulary import FootPose, Side
from tests.example_walks import MODEL, OMEGA

FOOT = convex_hull(rectangle(0.22, 0.11))
REACH = MODEL.reach
ICPS = [[0.22, -0.02], [0.0, 0.04], [-0.1, 0.09], [0.03, -0.2]]


def random_points(rng, polygon, count):
    """Points (count, 2) within the polygon, its corners among them."""
    weights = rng.dirichlet(np.full(len(polygon), 0.3), count)
    return np.concatenate([polygon, weights @ polygon])[-count:]


# One step.


@pytest.mark.parametrize("icp", ICPS)
@pytest.mark.parametrize("earliest", [0.0, 0.4])
def test_whatever_the_cop_does_the_foot_lands_in_the_one_step_region(
    icp, earliest
):
    """Oracle: roll-outs with a CoP that jumps about the foot five times."""
    rng = np.random.default_rng(1)
    latest = earliest + 0.3
    region = one_step_region(np.array(icp), FOOT, OMEGA, (earliest, latest))
    for _ in range(300):
        landing = rng.uniform(earliest, latest)
        times = np.diff([0.0, *np.sort(rng.uniform(0, landing, 4)), landing])
        found = np.array(icp)
        for cop, t in zip(random_points(rng, FOOT, 5), times, strict=True):
            found = icp_after(found, cop, OMEGA, t)
        assert contains(found, region, 1e-12)


@pytest.mark.parametrize("icp", ICPS)
def test_every_corner_of_the_one_step_region_is_reached(icp):
    """Oracle: a CoP at rest in a corner, until the first or last moment."""
    icp, times = np.array(icp), (0.2, 0.5)
    region = one_step_region(icp, FOOT, OMEGA, times)
    reached = np.array(
        [icp_after(icp, q, OMEGA, t) for q in FOOT for t in times]
    )
    for vertex in region:
        assert np.min(np.linalg.norm(reached - vertex, axis=1)) < 1e-12


# More steps.


def mirrored_reaches(reach, count):
    """R_2, R_3, ...: alternately to the right and to the left side."""
    sides = [Side.RIGHT, Side.LEFT] * count
    return [in_world(reach, FootPose(), side) for side in sides[:count]]


def can_recover(foothold, one_step, reaches, contractions):
    """True if a linear program finds steps and times that capture it.

    Step k lasts as planned or longer, for ever if the robot stops.  It makes
    the ICP's offset e, seen from the foot, to e_k = e^wT e - s_k.  With w_k =
    e^-w(T_2 + ... + T_k) <= E_k w_k-1, w_1 = 1, this adds up to e = sum of
    w_k s_k.  Variables: the weights of the corners of C_1 (where the ICP is at
    touchdown) and of each reach R_k, whose sums are w_k.
    """
    polygons = [one_step, *(-r for r in reaches)]
    columns = np.vstack(polygons)
    first = np.cumsum([0] + [len(p) for p in polygons])
    sums = np.zeros((len(polygons), len(columns)))
    for k in range(len(polygons)):
        sums[k, first[k] : first[k + 1]] = 1.0
    E = np.array(contractions)[:, None]
    found = linprog(
        np.zeros(len(columns)),
        A_eq=np.vstack([columns.T, sums[0]]),
        b_eq=np.append(foothold, 1.0),
        A_ub=sums[1:] - E * sums[:-1] if reaches else None,
        b_ub=np.zeros(len(reaches)) if reaches else None,
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10},
    )
    assert found.status in (0, 2)  # solved, or infeasible
    return found.status == 0


@pytest.mark.parametrize("num_steps", [1, 2, 3, 4])
def test_recoverable_in_n_steps_if_and_only_if_inside(num_steps):
    """Oracle: a linear program over the steps and their times.

    For 400 random points in all, and at 0.1 % from the boundary, seen from
    the middle; two of the steps are quicker than the others.
    """
    rng = np.random.default_rng(num_steps)
    reaches = mirrored_reaches(base_region(REACH), num_steps - 1)
    durations = [0.9, 0.5, 0.45][: num_steps - 1]
    contractions = [math.exp(-OMEGA * T) for T in durations]
    one_step = one_step_region(np.array([0.1, 0.06]), FOOT, OMEGA, (0.3, 0.32))
    region = capture_region(one_step, later_steps(reaches, contractions)[-1])
    middle = centroid(region)
    far = 10.0 * np.array([[math.cos(a), math.sin(a)] for a in range(25)])
    edge = np.vstack([[project(p, region) for p in middle + far], region])
    spread = rng.uniform(region.min(axis=0), region.max(axis=0), (100, 2))
    for point in np.vstack(
        [middle + s * (edge - middle) for s in (0.999, 1.001)] + [spread]
    ):
        assert contains(point, region) == can_recover(
            point, one_step, reaches, contractions
        )


def test_discs_grow_as_koolen_says():
    """Oracle: d_N = (d_N-1 + l_max) e^-wT, by Koolen et al."""
    length, E, expected = 0.7, math.exp(-3.0 * 0.6), 0.0
    for offsets in later_steps([circle(length, 256)] * 4, [E] * 4):
        distances = np.linalg.norm(offsets, axis=1)
        assert distances == pytest.approx(expected, rel=1e-12)
        expected = (expected + length) * E
    assert expected == pytest.approx(length * E / (1.0 - E), rel=1e-3)
