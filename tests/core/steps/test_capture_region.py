"""Oracles: the ICP's dynamics, linear programs, Koolen's discs, shapely.

To our knowledge nobody has published numeric tests of N-step capture regions.
"""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from scipy.optimize import linprog

from nadia_balance.core.body import reachability
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.math.arrays import rectangle
from nadia_balance.core.math.lipm import icp_after
from nadia_balance.core.math.polygon import (
    centroid,
    contains,
    convex_hull,
    project,
)
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
    capture_region,
    geometry_key,
    later_steps,
    one_step_region,
)
from nadia_balance.core.walking.state import FootPose, Side
from tests.core.body.test_ground import square
from tests.example_walks import ALL, MODEL, OMEGA, SOLE, UNCROSSED, moved, swing

FOOT = convex_hull(rectangle(0.22, 0.11))
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
        end = np.array(icp)
        for cop, t in zip(random_points(rng, FOOT, 5), times, strict=True):
            end = icp_after(end, cop, OMEGA, t)
        assert contains(end, region, 1e-12)


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


PARAMS = CaptureRegionStepAdjusterParams()


def geometry(schedule, params=PARAMS, on=ALL):
    return SwingGeometry(schedule, params, MODEL, on)


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
    program = linprog(
        np.zeros(len(columns)),
        A_eq=np.vstack([columns.T, sums[0]]),
        b_eq=np.append(foothold, 1.0),
        A_ub=sums[1:] - E * sums[:-1] if reaches else None,
        b_ub=np.zeros(len(reaches)) if reaches else None,
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10},
    )
    assert program.status in (0, 2)  # solved, or infeasible
    return program.status == 0


@pytest.mark.parametrize("num_steps", [1, 2, 3, 4])
def test_recoverable_in_n_steps_if_and_only_if_inside(num_steps):
    """Oracle: a linear program over the steps and their times.

    For 400 random points in all, and at 0.1 % from the boundary, seen from
    the middle.  The reach of each step turns with the foot that stands; two of
    the steps are quicker than the others.
    """
    rng = np.random.default_rng(num_steps)
    steps = list(swing(turn=0.4, num_steps=num_steps).footsteps)
    for k, T in enumerate((0.7, 0.6, 0.2, 0.15)[:num_steps]):
        steps[k] = replace(steps[k], swing_duration=T)
    schedule = replace(swing(), footsteps=tuple(steps))
    polygons = geometry(schedule, replace(PARAMS, num_steps=num_steps))
    reach, reaches = reachability.total_region(MODEL.reach, True), []
    for step in steps[:-1]:
        stance = FootPose(yaw=step.pose.yaw)
        reaches.append(reachability.in_world(reach, stance, step.side.other))
    periods = [step.transfer_duration + step.swing_duration for step in steps]
    contractions = [math.exp(-OMEGA * T) for T in periods[1:]]
    one_step = polygons.one_step_region(np.array([0.1, 0.06]), (0.3, 0.32))
    region = capture_region(one_step, polygons.offsets[-1])
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


def by_choice(period):
    """D_3 of each choice of regions for the two later steps, by shapely."""
    E, regions = math.exp(-OMEGA * period), reachability.step_regions
    choices = [*regions(MODEL.reach, cross_over=True).values()]

    def captured(reach, later):
        sums = (reach[:, None] + later[None]).reshape(-1, 2)
        points = shapely.MultiPoint([[0.0, 0.0], *(E * sums)])
        return np.array(points.convex_hull.exterior.coords)

    return [
        captured(left, captured(right * [1.0, -1.0], np.zeros((1, 2))))
        for left in choices
        for right in choices
    ]


@pytest.mark.parametrize(
    ("period", "excess"), [(1.0, 0.0028), (0.5, 0.0322), (0.38, 0.0460)]
)
def test_the_hull_of_crossing_later_steps_is_too_large_by_this(period, excess):
    """Oracle: shapely: the union of what each choice of their regions captures.

    C_3 = C_1 + (-D_3) goes beyond it no farther than D_3 does, whatever C_1 is.
    """
    schedule = swing(transfer=0.3 * period, swing=0.7 * period)
    ours = shapely.Polygon(geometry(schedule).offsets[-1])
    union = shapely.union_all([shapely.Polygon(p) for p in by_choice(period)])
    assert ours.buffer(1e-9).covers(union)
    for part, covers in (0.98, False), (1.02, True):
        larger = union.buffer(part * excess, quad_segs=64)
        assert larger.covers(ours) is covers


def test_discs_grow_as_koolen_says():
    """Oracle: d_N = (d_N-1 + l_max) e^-wT, by Koolen et al."""
    length, E, expected = 0.7, math.exp(-3.0 * 0.6), 0.0
    for offsets in later_steps([reachability.circle(length, 256)] * 4, [E] * 4):
        distances = np.linalg.norm(offsets, axis=1)
        assert distances == pytest.approx(expected, rel=1e-12)
        expected = (expected + length) * E
    assert expected == pytest.approx(length * E / (1.0 - E), rel=1e-3)


def test_n_is_no_more_than_the_steps_in_the_queue():
    """Oracle: three, or fewer if there are fewer."""
    for queued, expected in (1, 1), (2, 2), (5, 3):
        assert len(geometry(swing(num_steps=queued)).offsets) == expected


def test_later_steps_hurry_only_if_swings_adapt():
    """Oracle: steps that were planned to take 0.6 of the time, and C_N."""
    planned, quick = (
        swing(transfer=part * 0.2, swing=part * 0.5) for part in (1.0, 0.6)
    )
    one_step, slow = rectangle(0.2, 0.1), replace(ALL, swing=False)
    for polygons, expected in (
        (geometry(planned), geometry(quick, on=slow)),
        (geometry(planned, on=slow), geometry(planned)),
    ):
        hurried = polygons.hurried_region(one_step)
        expected = capture_region(one_step, expected.offsets[-1])
        np.testing.assert_allclose(hurried, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.4, -0.7])
def test_a_foothold_is_blocked_where_the_soles_would_meet(yaw):
    """Oracle: shapely's distance of the soles, in front, behind, inside."""
    rng = np.random.default_rng(5)
    schedule = moved(swing(num_steps=1), 0.3, [1.0, 2.0])
    step = schedule.footsteps[0]
    step = replace(step, pose=FootPose(step.pose.p_WF, 0.3 + yaw))
    schedule = replace(schedule, footsteps=(step,))
    clearance = 0.01
    polygons = geometry(schedule, replace(PARAMS, sole_clearance=clearance))
    stance = schedule.feet.left
    sole = shapely.Polygon(stance.to_world(SOLE))
    blocked = 0
    for _ in range(500):
        p = stance.to_world(rng.uniform([-0.4, -0.4], [0.4, 0.05], (1, 2)))[0]
        foot = FootPose([*p, 0.0], 0.3 + yaw)
        gap = shapely.Polygon(foot.to_world(SOLE)).distance(sole)
        if gap < clearance * (1.0 - 1e-9):
            assert polygons.blocked(p)
        elif polygons.blocked(p):  # near a corner, or to the outer side
            outside = stance.to_sole(p)[1] > 0.0
            assert outside or gap < clearance * math.sqrt(2.0) * 1.01
        blocked += polygons.blocked(p)
    assert 50 < blocked < 300


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
    assert not same(schedule, replace(ALL, swing=False))


def test_the_foot_is_cut_on_its_proper_sides():
    """Oracle: by hand: x -0.125..0.125, y -0.06 (outside)..0.06 (inside)."""
    params = CaptureRegionStepAdjusterParams(
        foot_front=0.01, foot_back=0.02, foot_inside=0.03, foot_outside=0.04
    )
    foot = convex_hull(params.usable_foot(rectangle(0.25, 0.12)))
    corners = [[-0.105, -0.02], [0.115, -0.02], [0.115, 0.03], [-0.105, 0.03]]
    np.testing.assert_allclose(foot, corners, atol=1e-15)


def test_the_cop_stays_where_the_ankle_holds_it():
    """Oracle: the ICP's dynamics, by hand for each corner, in a turned world.

    The ankle holds the CoP in 0.16 m x 0.07 m, the swing is the right one's.
    """
    schedule = moved(swing(num_steps=1), 0.3, [1.0, 2.0])
    model = replace(MODEL, held=rectangle(0.16, 0.07) + [0.01, 0.0])
    polygons = SwingGeometry(schedule, PARAMS, model, ALL)
    front, back = 0.09 - PARAMS.foot_front, -0.07 + PARAMS.foot_back
    inner, outer = -0.035 + PARAMS.foot_inside, 0.035 - PARAMS.foot_outside
    corners = itertools.product((front, back), (inner, outer))
    cops = schedule.feet.left.to_world(np.array([*corners]))
    icp, times = np.array([1.1, 1.9]), (0.2, 0.5)
    reached = [icp_after(icp, cop, OMEGA, t) for cop in cops for t in times]
    expected = shapely.MultiPoint(reached).convex_hull
    region = shapely.Polygon(polygons.one_step_region(icp, times))
    assert region.symmetric_difference(expected).area < 1e-12


# The ground.


def on_ground(regions, schedule, on=ALL, model=MODEL):
    model = replace(model, ground=Ground(regions, SOLE))
    return SwingGeometry(schedule, PARAMS, model, on)


def raised(schedule, height):
    """The schedule, its stance foot at this height [m]."""
    foot = schedule.feet[schedule.support_side]
    pose = FootPose([*foot.p_WF[:2], height], foot.yaw)
    feet = schedule.feet.with_foot(schedule.support_side, pose)
    return replace(schedule, feet=feet)


def test_a_place_is_where_the_sole_is_on_the_region_and_in_reach():
    """Oracle: shapely: the margin, the turned sole, the reach, the rise.

    A stone is tilted by 15 degrees about an axis askew, seen from a foot that
    stands 0.3 m high: only a part of it is within 0.25 m of that height.
    """
    rng, yaw = np.random.default_rng(5), 0.4
    normal = [0.25, -0.1, 1.0]
    regions = (
        square("near", -0.45, -0.25, height=0.3),
        square("tilted", 0.3, -0.5, side=0.9, height=0.3, normal=normal),
    )
    schedule = raised(swing(length=0.1, turn=yaw), 0.3)
    model = replace(MODEL, reach=replace(MODEL.reach, rise_max=0.05))
    polygons = on_ground(regions, schedule, UNCROSSED, model)
    (reach,) = polygons.regions.values()
    stones = [
        shapely.Polygon(r.polygon).buffer(-0.02, join_style="mitre")
        for r in regions
    ]
    inside = [0, 0]
    for p in rng.uniform([-0.7, -0.9], [0.7, 0.0], (800, 2)):
        for k, (region, stone) in enumerate(zip(regions, stones, strict=True)):
            foot = FootPose([*p, 0.0], yaw, region.unit_normal)
            sole = shapely.Polygon(foot.outline(SOLE))
            x, y, z = region.normal  # the plane passes the middle at 0.3 m
            rise = -((p - region.polygon.mean(axis=0)) @ [x, y]) / z
            good = stone.covers(sole) and abs(rise) <= 0.05
            ours = [
                contains(p, place.polygon)
                for place in polygons.places
                if place.ground == k
            ]
            assert any(ours) == (good and contains(p, reach))
            inside[k] += any(ours)
    assert min(inside) > 20


def test_allows_feet_on_the_ground_side_by_side():
    """Oracle: by hand: on a stone, across its edge, on the stance foot."""
    polygons = on_ground((square("stone", 0.0, -0.1),), swing(length=0.0))
    for x, y, good in (0.0, -0.125, 1), (0.2, -0.125, 0), (0.0, 0.05, 0):
        assert polygons.allows(FootPose([x, y, 0.0])) == good
    assert polygons.place_at(np.array([0.0, -0.125])) == polygons.places[0]
    assert (
        polygons.place_at(np.array([0.0, 0.05])) is None
    )  # on the stance foot
    assert (
        polygons.place_at(np.array([0.3, -0.125])) is None
    )  # beside the stone
    assert polygons.places[0].reach == reachability.BASE
