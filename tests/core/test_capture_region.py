"""Oracles: roll-outs of the ICP's dynamics, linear programs, Koolen's discs.

To our knowledge nobody has published numeric tests of N-step capture regions.
"""

import math

import numpy as np
import pytest
import shapely
from scipy.integrate import solve_ivp
from scipy.optimize import linprog

from nadia_balance.core.capture_region import (
    capture_region,
    later_steps,
    one_step_region,
    one_step_region_in_disc,
    transfer_factor,
)
from nadia_balance.core.lipm import icp_after
from nadia_balance.core.polygon import (
    area,
    centroid,
    contains,
    convex_hull,
    intersection,
    project,
)
from nadia_balance.core.reachability import (
    BACKWARD,
    BASE,
    FORWARD,
    ReachabilityParams,
    base_region,
    circle,
    in_world,
    step_regions,
    total_region,
)
from nadia_balance.core.walking import FootPose, Side, rectangle

OMEGA = 3.15  # of the numbers in algorithms.md, section 5
FOOT = convex_hull(rectangle(0.22, 0.11))
CROSSING = ReachabilityParams(cross_over=True)
ICPS = [[0.22, -0.02], [0.0, 0.04], [-0.1, 0.09], [0.03, -0.2]]


def random_points(rng, polygon, count):
    """Points (count, 2) within the polygon, its corners among them."""
    weights = rng.dirichlet(np.full(len(polygon), 0.3), count)
    return np.concatenate([polygon, weights @ polygon])[-count:]


# One step.


@pytest.mark.parametrize("icp", ICPS)
@pytest.mark.parametrize("earliest", [0.0, 0.2, 0.6])
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


def hausdorff_distance(first, second):
    """Exact for convex polygons: the farthest point is a vertex."""
    return max(
        math.dist(vertex, project(vertex, other))
        for polygon, other in ((first, second), (second, first))
        for vertex in polygon
    )


def test_the_one_step_region_does_not_jump_at_the_edge_of_the_foot():
    """Oracle: moving the ICP by d moves no point by more than e^wt d.

    The region with the circle of the paper jumps from a half-plane.
    """
    disc = circle(1.5, 200)
    jumps = {"bounded": 0.0, "disc": 0.0}
    regions = {}
    for x in np.arange(0.1095, 0.1106, 1e-4):  # the edge is at 0.11 m
        icp = np.array([x, 0.01])
        now = {
            "bounded": one_step_region(icp, FOOT, OMEGA, (0.3, 0.8)),
            "disc": one_step_region_in_disc(icp, FOOT, OMEGA, 0.3, disc),
        }
        for name, region in now.items():
            if name in regions:
                moved = hausdorff_distance(region, regions[name])
                jumps[name] = max(jumps[name], moved)
        regions = now
    assert jumps["bounded"] < 1e-4 * math.exp(OMEGA * 0.8) * 1.01
    assert jumps["disc"] > 1.0


def test_a_transfer_that_takes_no_time_costs_nothing():
    """Oracle: the limit; the notes' numbers for omega = 3."""
    assert transfer_factor(3.0, 0.0) == 1.0
    assert transfer_factor(3.0, 1e-9) == pytest.approx(1.0, abs=1e-8)
    for duration, factor in (0.03, 1.046), (0.1, 1.157), (0.3, 1.517):
        assert transfer_factor(3.0, duration) == pytest.approx(factor, abs=5e-4)


def shifted(icp, start, end, duration):
    """The ICP after a linear shift of the CoP, by numeric integration."""

    def rate(t, xi):
        return OMEGA * (xi - start - t / duration * (end - start))

    found = solve_ivp(rate, (0.0, duration), icp, rtol=1e-11, atol=1e-13)
    return found.y[:, -1]


@pytest.mark.parametrize("transfer", [0.05, 0.3])
def test_after_a_transfer_the_icp_is_on_the_new_foot(transfer):
    """Oracle: numeric integration of swing and transfer.

    The foothold is the point of the region that belongs to the CoP q of the
    swing, from where the transfer starts.
    """
    rng = np.random.default_rng(2)
    icp, swing = np.array([0.05, 0.1]), 0.3
    factor = transfer_factor(OMEGA, transfer)
    region = one_step_region(icp, FOOT, OMEGA, (swing, swing), factor)
    for q in random_points(rng, FOOT, 30):
        landing = icp_after(icp, q, OMEGA, swing)
        foothold = q + factor * (landing - q)
        assert shifted(landing, q, foothold, transfer) == pytest.approx(
            foothold, abs=1e-8
        )
        assert contains(foothold, region, 1e-12)


def test_the_disc_cuts_the_rays_of_the_visible_corners():
    """Oracle: shapely: all ICPs at any later time, as many sums, cut."""
    icp, disc = np.array([0.2, 0.15]), circle(1.0, 360)
    region = one_step_region_in_disc(icp, FOOT, OMEGA, 0.2, disc)
    landings = [
        icp_after(icp, q, OMEGA, t) for q in FOOT for t in (0.2, 1.0, 5.0)
    ]
    wedge = shapely.MultiPoint(landings).convex_hull
    expected = wedge.intersection(shapely.Polygon(disc))
    difference = shapely.Polygon(region).symmetric_difference(expected)
    assert difference.area < 1e-6
    assert expected.area > 0.1


def test_in_the_disc_there_may_be_nothing_or_everything():
    """Oracle: an ICP that is gone by touchdown; one above the foot."""
    disc = circle(1.0)
    gone = one_step_region_in_disc(np.array([0.9, 0.0]), FOOT, OMEGA, 1, disc)
    assert len(gone) == 0
    held = one_step_region_in_disc(np.array([0.1, 0.0]), FOOT, OMEGA, 1, disc)
    np.testing.assert_array_equal(held, disc)


# More steps.


def mirrored_reaches(reach, count):
    """R_2, R_3, ...: alternately to the right and to the left side."""
    sides = [Side.RIGHT, Side.LEFT] * count
    return [in_world(reach, FootPose(), side) for side in sides[:count]]


def can_recover(foothold, one_step, reaches, contractions, feet):
    """True if a linear program finds steps and CoPs that capture the ICP.

    Variables: weights of the corners of C_1 (where the ICP is at touchdown),
    of each foot (where the CoP rests until the next touchdown; in the end,
    where the ICP stays), and of the stance foot and the corners of each reach.
    Equations: the ICP map e_n = g_n + e^wT (e_n-1 - g_n) - s_n, offsets from
    the feet, and the weights' sums.
    """
    polygons = [one_step]
    for n, reach in enumerate(reaches):
        polygons += [feet[n], np.vstack([[0.0, 0.0], reach])]
    polygons.append(feet[len(reaches)])
    columns = np.vstack(polygons).T  # (2, variables)
    first = np.cumsum([0] + [len(p) for p in polygons])

    def part(k):
        block = np.zeros_like(columns)
        block[:, first[k] : first[k + 1]] = columns[:, first[k] : first[k + 1]]
        return block

    offset, constant = part(0), -np.asarray(foothold)
    for n, E in enumerate(contractions):
        cop, step = part(2 * n + 1), part(2 * n + 2)
        offset = cop + (offset - cop) / E - step
        constant = constant / E
    sums = np.zeros((len(polygons), columns.shape[1]))
    for k in range(len(polygons)):
        sums[k, first[k] : first[k + 1]] = 1.0
    found = linprog(
        np.zeros(columns.shape[1]),
        A_eq=np.vstack([offset - part(len(polygons) - 1), sums]),
        b_eq=np.concatenate([-constant, np.ones(len(polygons))]),
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10},
    )
    assert found.status in (0, 2)  # solved, or infeasible
    return found.status == 0


POINT = np.zeros((1, 2))


@pytest.mark.parametrize("finite", [False, True])
@pytest.mark.parametrize("crossing", [False, True])
@pytest.mark.parametrize("num_steps", [1, 2, 3, 4])
def test_recoverable_in_n_steps_if_and_only_if_inside(
    num_steps, crossing, finite
):
    """Oracle: a linear program over the steps, for points on both sides.

    At 0.1 % from the boundary, seen from the middle; two of the steps are
    quicker than the others.
    """
    rng = np.random.default_rng(num_steps)
    params = ReachabilityParams(cross_over=crossing)
    reaches = mirrored_reaches(total_region(params), num_steps - 1)
    durations = [0.9, 0.5, 0.45][: num_steps - 1]
    contractions = [math.exp(-OMEGA * T) for T in durations]
    foot = FOOT + [0.0, 0.005]
    feet = [foot * [1.0, (-1.0) ** n] for n in range(num_steps)]
    feet = [convex_hull(f) for f in feet] if finite else ()
    one_step = one_step_region(np.array([0.1, 0.06]), FOOT, OMEGA, (0.3, 0.6))
    offsets = later_steps(reaches, contractions, feet)
    region = capture_region(one_step, offsets[-1])
    middle = centroid(region)
    far = 10.0 * np.array([[math.cos(a), math.sin(a)] for a in range(25)])
    edge = [project(point, region) for point in middle + far]
    edge += list(region[rng.permutation(len(region))[:8]])
    for point in edge:
        for scale, expected in (0.999, True), (1.001, False):
            foothold = middle + scale * (point - middle)
            assert contains(foothold, region) == expected
            assert expected == can_recover(
                foothold, one_step, reaches, contractions, feet or [POINT] * 9
            )


def test_random_steps_that_end_above_the_foot_started_inside():
    """Oracle: the ICP's flow, step after step, in absolute positions."""
    rng = np.random.default_rng(7)
    reach = total_region(CROSSING)
    reaches, T = mirrored_reaches(reach, 2), 0.6
    E = math.exp(-OMEGA * T)
    one_step = one_step_region(np.array([0.1, 0.06]), FOOT, OMEGA, (0.3, 0.6))
    region = capture_region(one_step, later_steps(reaches, [E, E])[-1])
    for _ in range(300):
        icp = random_points(rng, one_step, 1)[0]
        steps = [random_points(rng, r, 1)[0] for r in reaches]
        foothold = icp - E * steps[0] - E * E * steps[1]
        stance = foothold
        for step in steps:
            icp = icp_after(icp, stance, OMEGA, T)
            stance = stance + step
        assert icp == pytest.approx(stance, abs=1e-9)
        assert contains(foothold, region, 1e-12)


@pytest.mark.parametrize("radius", [0.0, 0.08])
def test_discs_grow_as_koolen_says(radius):
    """Oracle: d_N = r_max + (d_N-1 + l_max - r_max) e^-wT, by Koolen et al.

    The polygons with 256 corners are at most 1e-4 smaller than the discs.
    """
    length, E = 0.7, math.exp(-3.0 * 0.6)
    disc = circle(length, 256)
    feet = [circle(radius, 256)] * 5 if radius else ()
    expected = radius
    for offsets in later_steps([disc] * 4, [E] * 4, feet):
        distances = np.linalg.norm(offsets, axis=1)
        assert distances == pytest.approx(expected, rel=1e-12)
        expected = radius + (expected + length - radius) * E
    limit = radius + length * E / (1.0 - E)
    assert expected == pytest.approx(limit, rel=1e-3)


@pytest.mark.parametrize("crossing", [False, True])
def test_regions_nest(crossing):
    """Oracle: each vertex is within the next region."""
    params = ReachabilityParams(cross_over=crossing)
    reaches = mirrored_reaches(total_region(params), 4)
    one_step = one_step_region(np.array([0.1, 0.06]), FOOT, OMEGA, (0.3, 0.6))
    offsets = later_steps(reaches, [0.2] * 4)
    regions = [capture_region(one_step, d) for d in offsets]
    for inner, outer in zip(regions, regions[1:], strict=False):
        assert all(contains(vertex, outer, 1e-12) for vertex in inner)
        assert area(outer) > 1.001 * area(inner)


def test_without_the_stance_foot_the_paper_s_regions_do_not_nest():
    """Oracles: w_min times E is lost on the inner side (Errata 5); shapely."""
    reach = convex_hull(in_world(base_region(CROSSING), FootPose(), Side.RIGHT))
    one_step = one_step_region(np.array([0.1, 0.06]), FOOT, OMEGA, (0.3, 0.6))
    printed = capture_region(one_step, 0.2 * reach)
    ours = capture_region(one_step, later_steps([reach], [0.2])[1])
    lost = printed[:, 1].min() - one_step[:, 1].min()
    assert lost == pytest.approx(0.2 * 0.125)
    within = shapely.Polygon(printed).covers
    assert not all(within(shapely.Point(vertex)) for vertex in one_step)
    within = shapely.Polygon(ours).buffer(1e-12).covers
    assert all(within(shapely.Point(vertex)) for vertex in one_step)


# The numbers of algorithms.md, section 5, in the stance frame with y toward
# the swing side (there: y to the left, and the right foot swings).


def shared_with(icp, earliest, num_steps):
    """What the regions share with C_N, by name: F .22 x .11, R = 1.5 l_max."""
    one_step = one_step_region_in_disc(
        np.array(icp), FOOT, OMEGA, earliest, circle(1.5, 360)
    )
    E = math.exp(-OMEGA * (0.7 + 0.3))
    reaches = mirrored_reaches(total_region(CROSSING), num_steps - 1)
    offsets = later_steps(reaches, [E] * (num_steps - 1))
    region = capture_region(one_step, offsets[-1])
    return {
        name: intersection(reach, region)
        for name, reach in step_regions(CROSSING).items()
    }


@pytest.mark.parametrize(
    ("icp", "earliest", "num_steps", "region", "expected_area", "foothold"),
    [
        ([0.22, -0.02], 0.2, 2, BASE, 0.0042, [0.665, 0.159]),
        ([0.22, -0.02], 0.2, 2, FORWARD, 0.1081, None),
        ([0.22, -0.02], 0.2, 1, BASE, 0.0, None),
        ([0.22, -0.02], 0.2, 1, FORWARD, None, [0.3165, 0.0107]),
        ([-0.22, 0.0], 0.2, 1, BASE, 0.0346, [-0.524, 0.152]),
        ([-0.22, 0.0], 0.2, 1, BACKWARD, 0.0758, None),
        ([0.0, -0.065], 0.2, 1, FORWARD, None, [0.338, -0.096]),
        ([0.2, -0.1], 0.25, 3, BASE, 0.0, None),
        ([0.2, -0.1], 0.25, 3, FORWARD, 0.0, None),
        ([0.2, -0.1], 0.25, 3, BACKWARD, 0.0, None),
    ],
)
def test_the_numbers_of_the_notes(
    icp, earliest, num_steps, region, expected_area, foothold
):
    """Oracle: algorithms.md, section 5, to the digits that it prints."""
    shared = shared_with(icp, earliest, num_steps)[region]
    if expected_area is not None:
        assert area(shared) == pytest.approx(expected_area, abs=5.1e-5)
    if foothold is not None:
        found = project(np.array([0.0, 0.25]), shared)
        assert found == pytest.approx(foothold, abs=5.1e-4)
