"""Oracles: roll-outs of the ICP's dynamics, linear programs, Koolen's discs.

To our knowledge nobody has published numeric tests of N-step capture regions.
"""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from scipy.integrate import solve_ivp
from scipy.optimize import linprog

from nadia_balance.core.capture_region import (
    CaptureRegionStepAdjusterParams,
    capture_region,
    geometry_key,
    later_steps,
    one_step_region,
    swing_geometry,
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
    FORWARD,
    base_region,
    circle,
    in_world,
    step_regions,
    total_region,
)
from nadia_balance.core.walking import FootPose, Side, rectangle
from tests.example_walks import ALL, MODEL, OMEGA, SOLE, UNCROSSED, moved, swing

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


def test_the_one_step_region_does_not_jump_at_the_edge_of_the_foot():
    """Oracle: moving the ICP by d moves no corner by more than e^wt d.

    The region with the circle of the paper jumps from a half-plane.
    """
    inside, outside = np.array([0.1099, 0.01]), np.array([0.1101, 0.01])
    regions = [
        one_step_region(icp, FOOT, OMEGA, (0.3, 0.8))
        for icp in (inside, outside)
    ]
    most = 2.02e-4 * math.exp(OMEGA * 0.8)
    for first, second in regions, regions[::-1]:
        assert all(contains(p, second, most) for p in first)
    disc = circle(1.5)
    areas = [
        area(intersection(one_step_region(icp, FOOT, OMEGA, (0.3, 9.0)), disc))
        for icp in (inside, outside)
    ]
    assert areas[0] > 2.0 * areas[1]


def test_a_transfer_that_takes_no_time_costs_nothing():
    """Oracle: the limit of wT / (1 - e^-wT)."""
    assert transfer_factor(3.0, 0.0) == 1.0
    assert transfer_factor(3.0, 1e-9) == pytest.approx(1.0, abs=1e-8)


# More steps.


def mirrored_reaches(reach, count):
    """R_2, R_3, ...: alternately to the right and to the left side."""
    sides = [Side.RIGHT, Side.LEFT] * count
    return [in_world(reach, FootPose(), side) for side in sides[:count]]


def can_recover(foothold, one_step, reaches, contractions, feet):
    """True if a linear program finds steps, CoPs and times that capture it.

    Step k lasts as planned or longer, for ever if the robot stops.  It makes
    the ICP's offset e, seen from the foot, to e_k = g + e^wT (e - g) - s_k.
    With w_k = e^-w(T_2 + ... + T_k) <= E_k w_k-1, w_1 = 1, this adds up to
    e = sum of (w_k-1 - w_k) g_k-1 + w_k s_k, plus w_N g_N.  Variables: the
    weights of the corners of C_1 (where the ICP is at touchdown), of each foot
    G_k and of each reach R_k, whose sums are the factors of g_k and s_k.
    """
    polygons = [one_step, *(-f for f in feet), *(-r for r in reaches)]
    columns = np.vstack(polygons)
    first = np.cumsum([0] + [len(p) for p in polygons])
    sums = np.zeros((len(polygons), len(columns)))
    for k in range(len(polygons)):
        sums[k, first[k] : first[k + 1]] = 1.0
    cops, steps = sums[1 : len(feet) + 1], sums[len(feet) + 1 :]
    # The factors of the CoPs to come and of the steps to come make up w_k-1.
    left = np.array([cops[k:].sum(axis=0) for k in range(len(feet))])
    E = np.array(contractions)[:, None]
    found = linprog(
        np.zeros(len(columns)),
        A_eq=np.vstack([columns.T, sums[0], left[0], left[1:] - steps]),
        b_eq=np.concatenate([foothold, [1.0, 1.0], np.zeros(len(steps))]),
        A_ub=steps - E * left[:-1] if len(steps) else None,
        b_ub=np.zeros(len(steps)) if len(steps) else None,
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10},
    )
    assert found.status in (0, 2)  # solved, or infeasible
    return found.status == 0


@pytest.mark.parametrize("finite", [False, True])
@pytest.mark.parametrize("num_steps", [1, 2, 3, 4])
def test_recoverable_in_n_steps_if_and_only_if_inside(num_steps, finite):
    """Oracle: a linear program over the steps and their times.

    For 1000 random points in all, and at 0.1 % from the boundary, seen from
    the middle; two of the steps are quicker than the others.
    """
    rng = np.random.default_rng(num_steps)
    reaches = mirrored_reaches(base_region(REACH), num_steps - 1)
    durations = [0.9, 0.5, 0.45][: num_steps - 1]
    contractions = [math.exp(-OMEGA * T) for T in durations]
    foot = FOOT + [0.0, 0.005]
    feet = [foot * [1.0, (-1.0) ** n] for n in range(num_steps)]
    feet = [convex_hull(f) for f in feet] if finite else ()
    at_rest = [np.zeros((1, 2))] * num_steps
    one_step = one_step_region(np.array([0.1, 0.06]), FOOT, OMEGA, (0.3, 0.32))
    offsets = later_steps(reaches, contractions, feet)
    region = capture_region(one_step, offsets[-1])
    middle = centroid(region)
    far = 10.0 * np.array([[math.cos(a), math.sin(a)] for a in range(25)])
    edge = np.vstack([[project(p, region) for p in middle + far], region])
    spread = rng.uniform(region.min(axis=0), region.max(axis=0), (125, 2))
    for point in np.vstack(
        [middle + s * (edge - middle) for s in (0.999, 1.001)] + [spread]
    ):
        assert contains(point, region) == can_recover(
            point, one_step, reaches, contractions, feet or at_rest
        )


# CoM at 1 m; steps of T [s], transfer included.
@pytest.mark.parametrize(
    ("T", "beyond"), [(1.0, 0.0), (0.5, 8.8e-3), (0.38, 36.0e-3)]
)
def test_the_other_foot_s_turn_is_not_left_out(T, beyond):
    """Oracle: by hand: one step of w_min inward, then one of w_max back.

    If a step could be left out, 1.5, 34.9 and 74.0 mm.
    """
    E = math.exp(-math.sqrt(9.81) * T)
    assert max(E * (0.8 * E - 0.125), 0.0) == pytest.approx(beyond, abs=5e-5)
    reaches = mirrored_reaches(base_region(REACH), 2)
    one_step = one_step_region(np.array([0.1, 0.06]), FOOT, OMEGA, (0.3, 0.6))
    three = capture_region(one_step, later_steps(reaches, [E, E])[-1])
    inside = three[:, 1].min() - one_step[:, 1].min()
    assert -inside == pytest.approx(max(E * (0.8 * E - 0.125), 0.0), abs=1e-12)


@pytest.mark.parametrize(
    ("T", "excess"),
    [(1.0, (1.4, 2.4)), (0.5, (7.3, 30.6)), (0.38, (10.8, 44.3))],
)
def test_the_hull_with_cross_over_is_too_generous_by_so_much(T, excess):
    """Oracle: shapely's union over number and region of each step.

    [mm], for N = 2 and 3, with Nadia's omega.
    """
    E = math.exp(-math.sqrt(9.81 / 0.888) * T)
    parts = [
        mirrored_reaches(region, 2)
        for region in step_regions(REACH, True).values()
    ]
    hulls = mirrored_reaches(total_region(REACH, True), 2)
    offsets = later_steps(hulls, [E, E])
    for n, most in zip((1, 2), excess, strict=True):
        ours = shapely.Polygon(offsets[n])
        chosen = []
        for regions in itertools.product(parts, repeat=n):
            ends = [np.zeros((1, 2))]  # after 0, 1, 2 steps
            for k in range(n):
                step = E ** (k + 1) * regions[k][k]
                ends.append((ends[-1][:, None] + step).reshape(-1, 2))
            # Of longer steps, all that is in between.
            chosen.append(shapely.MultiPoint(np.vstack(ends)).convex_hull)
        true = shapely.union_all(chosen)
        assert ours.buffer(1e-9).covers(true)
        edge = ours.exterior.segmentize(2e-4)
        gaps = [true.distance(shapely.Point(p)) for p in edge.coords]
        assert 1e3 * max(gaps) == pytest.approx(most, abs=0.06)


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


def test_without_the_stance_foot_the_paper_s_regions_do_not_nest():
    """Oracles: w_min times E is lost on the inner side; shapely."""
    reach = convex_hull(in_world(base_region(REACH), FootPose(), Side.RIGHT))
    one_step = one_step_region(np.array([0.1, 0.06]), FOOT, OMEGA, (0.3, 0.6))
    printed = capture_region(one_step, 0.2 * reach)
    ours = capture_region(one_step, later_steps([reach], [0.2])[1])
    lost = printed[:, 1].min() - one_step[:, 1].min()
    assert lost == pytest.approx(0.2 * 0.125)
    within = shapely.Polygon(printed).covers
    assert not all(within(shapely.Point(vertex)) for vertex in one_step)
    within = shapely.Polygon(ours).buffer(1e-12).covers
    assert all(within(shapely.Point(vertex)) for vertex in one_step)


PARAMS = CaptureRegionStepAdjusterParams()


def geometry(schedule, params=PARAMS, on=ALL):
    return swing_geometry(schedule, params, MODEL, on)


def test_n_is_no_more_than_the_steps_in_the_queue():
    """Oracle: three, or fewer if there are fewer."""
    for queued, expected in (1, 1), (2, 2), (5, 3):
        assert len(geometry(swing(num_steps=queued)).offsets) == expected


@pytest.mark.parametrize("finite_foot", [False, True])
@pytest.mark.parametrize("transfer_aware", [False, True])
def test_random_turning_steps_that_recover_start_in_the_region(
    transfer_aware, finite_foot
):
    """Oracle: the ICP's flow, with transfers by numeric integration.

    The CoP rests at q of the stance foot, then at the point g_n of each new
    foot, where it comes to at once, or in a straight line that takes all of
    the transfer.  The steps are in the reach of the foot that stands, with
    its own yaw, and the ICP has to be above the point g_3 in the end.
    """
    rng, icp = np.random.default_rng(3), np.array([0.1, 0.05])
    params = replace(
        PARAMS, transfer_aware=transfer_aware, finite_foot=finite_foot
    )
    schedule = swing(length=0.2, turn=0.4, num_steps=4, transfer=0.2, swing=0.5)
    # The third step is quicker: not all contractions are alike.
    steps = list(schedule.footsteps)
    steps[2] = replace(steps[2], transfer_duration=0.1, swing_duration=0.4)
    schedule = replace(schedule, footsteps=tuple(steps))
    found = geometry(schedule, params)
    reach, foot = total_region(REACH, True), params.usable_foot(SOLE)
    transfers = [step.transfer_duration for step in steps[1:4]]
    swings = [step.swing_duration for step in steps[1:3]]

    def transferred(icp, start, end, duration):
        if not transfer_aware:
            return icp_after(icp, end, OMEGA, duration)
        flow = solve_ivp(
            lambda t, xi: OMEGA * (xi - start - t / duration * (end - start)),
            (0.0, duration),
            icp,
            rtol=1e-10,
            atol=1e-12,
        )
        return flow.y[:, -1]

    for _ in range(15):
        abouts = [FootPose(yaw=step.pose.yaw) for step in steps[:3]]
        cops = np.zeros((3, 2))
        if finite_foot:
            cops = [
                random_points(rng, in_world(foot, about, step.side.other), 1)[0]
                for about, step in zip(abouts, steps, strict=False)
            ]
        moves = [
            random_points(rng, in_world(reach, about, step.side.other), 1)[0]
            for about, step in zip(abouts[:2], steps, strict=False)
        ]
        q = random_points(rng, found.foot, 1)[0]

        def outcome(foothold, q=q, moves=moves, cops=cops):
            """How far the ICP is from the last foot's CoP in the end."""
            xi, cop = icp_after(icp, q, OMEGA, 0.3), q
            for n in range(3):
                xi = transferred(xi, cop, foothold + cops[n], transfers[n])
                cop = foothold + cops[n]
                if n < 2:
                    xi = icp_after(xi, cop, OMEGA, swings[n])
                    foothold = foothold + moves[n]
            return xi - cop

        # The outcome is linear in the first foothold: find its zero.
        rates = [outcome(np.eye(2)[k]) - outcome(np.zeros(2)) for k in (0, 1)]
        foothold = np.linalg.solve(np.array(rates).T, -outcome(np.zeros(2)))
        one_step = found.one_step_region(icp, (0.3, 0.3))
        assert contains(foothold, found.capture_region(one_step), 1e-6)


def test_quicker_steps_capture_more():
    """Oracle: e^-wT of the shorter times."""
    schedule = swing(num_steps=2)
    hurried = replace(PARAMS, shortest_transfer=0.05, shortest_swing=0.4)
    slow, quick = (
        geometry(schedule, params).offsets[1] for params in (PARAMS, hurried)
    )
    ratio = math.exp(OMEGA * (1.0 - 0.45))
    np.testing.assert_allclose(quick, ratio * slow, atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.4, -0.7])
def test_a_foothold_is_blocked_where_the_soles_would_meet(yaw):
    """Oracle: shapely's distance of the soles, in front, behind, inside."""
    rng = np.random.default_rng(5)
    schedule = moved(swing(num_steps=1), 0.3, [1.0, 2.0])
    step = schedule.footsteps[0]
    step = replace(step, pose=FootPose(step.pose.p_WF, 0.3 + yaw))
    schedule = replace(schedule, footsteps=(step,))
    clearance = 0.01
    found = geometry(schedule, replace(PARAMS, sole_clearance=clearance))
    stance = schedule.feet.left
    sole = shapely.Polygon(stance.to_world(SOLE))
    blocked = 0
    for _ in range(500):
        p = stance.to_world(rng.uniform([-0.4, -0.4], [0.4, 0.05], (1, 2)))[0]
        foot = FootPose([*p, 0.0], 0.3 + yaw)
        gap = shapely.Polygon(foot.to_world(SOLE)).distance(sole)
        if gap < clearance * (1.0 - 1e-9):
            assert found.blocked(p)
        elif found.blocked(p):  # near a corner, or to the outer side
            outside = stance.to_sole(p)[1] > 0.0
            assert outside or gap < clearance * math.sqrt(2.0) * 1.01
        blocked += found.blocked(p)
    assert 50 < blocked < 300


def test_the_foot_that_lands_is_cut_on_its_proper_sides():
    """Oracle: by hand: the right foot's inner side is then its left one."""
    found = geometry(swing(num_steps=1), replace(PARAMS, finite_foot=True))
    (foot,) = found.offsets
    np.testing.assert_allclose(foot.max(axis=0), [0.105, 0.04], atol=1e-12)
    np.testing.assert_allclose(foot.min(axis=0), [-0.075, -0.03], atol=1e-12)


def test_the_free_parts_are_what_is_not_blocked():
    """Oracle: shapely: the polygon without the blocked footholds."""
    found = geometry(swing(length=0.0, num_steps=1))
    region = found.regions[FORWARD]
    parts = [shapely.Polygon(part) for part in found.free_parts(region)]
    # Blocked: |x| < 0.255 and y > 0 (the swing side is below 0).
    strip = shapely.box(-0.255, -0.0, 0.255, 9.0)
    expected = shapely.Polygon(region).difference(strip)
    assert shapely.union_all(parts).symmetric_difference(
        expected
    ).area == pytest.approx(0.0, abs=1e-9)
    assert len(parts) == 2  # nothing is behind the foot


def test_the_key_changes_with_all_that_the_geometry_depends_on():
    """Oracle: by hand; an adjusted foothold of the same yaw is no change."""
    schedule = swing()
    step, *later = schedule.footsteps

    def same(other, on=ALL):
        return geometry_key(schedule, ALL) == geometry_key(other, on)

    pose = FootPose([0.5, -0.3, 0.0], step.pose.yaw)
    adjusted = (replace(step, pose=pose), *later)
    assert same(replace(schedule, footsteps=adjusted))
    turned = (replace(step, pose=replace(pose, yaw=0.3)), *later)
    assert not same(replace(schedule, footsteps=turned))
    quicker = (step, replace(later[0], swing_duration=0.4), *later[1:])
    assert not same(replace(schedule, footsteps=quicker))
    feet = schedule.feet.with_foot(Side.LEFT, FootPose([0.1, 0.1, 0.0]))
    assert not same(replace(schedule, feet=feet))
    assert not same(replace(schedule, footsteps=(step,)))
    assert not same(schedule, UNCROSSED)


def test_the_foot_is_cut_on_its_proper_sides():
    """Oracle: by hand: x -0.125..0.125, y -0.06 (outside)..0.06 (inside)."""
    params = CaptureRegionStepAdjusterParams(
        foot_front=0.01, foot_back=0.02, foot_inside=0.03, foot_outside=0.04
    )
    foot = convex_hull(params.usable_foot(rectangle(0.25, 0.12)))
    corners = [[-0.105, -0.02], [0.115, -0.02], [0.115, 0.03], [-0.105, 0.03]]
    np.testing.assert_allclose(foot, corners, atol=1e-15)


def test_some_of_the_sole_must_be_left():
    """Oracle: 0.06 + 0.06 is all of 0.12 m."""
    params = CaptureRegionStepAdjusterParams(
        foot_inside=0.06, foot_outside=0.06
    )
    with pytest.raises(ValueError, match=r"foot_outside = 0\.06"):
        params.usable_foot(rectangle(0.25, 0.12))
