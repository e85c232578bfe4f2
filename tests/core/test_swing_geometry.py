"""Oracles: the ICP's flow through swings and transfers; shapely; by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from scipy.integrate import solve_ivp

from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.lipm import icp_after
from nadia_balance.core.polygon import contains, convex_hull
from nadia_balance.core.reachability import (
    BASE,
    FORWARD,
    ReachabilityParams,
    in_world,
    total_region,
)
from nadia_balance.core.swing_geometry import geometry_key, swing_geometry
from nadia_balance.core.walking import FootPose, Phase, Side
from tests.example_walks import OMEGA, SOLE, mirrored, moved, walk

CROSSING = ReachabilityParams(cross_over=True)
PARAMS = CaptureRegionStepAdjusterParams(reachability=CROSSING)


def swing(**gait):
    """The first swing of a walk: the right foot's."""
    schedule = walk(**gait)
    duration = schedule.footsteps[0].swing_duration
    return replace(schedule, phase=Phase.SWING, duration=duration)


def geometry(schedule, params=PARAMS):
    return swing_geometry(schedule, SOLE, params, OMEGA)


def random_point(rng, polygon):
    return rng.dirichlet(np.full(len(polygon), 0.3)) @ polygon


def test_the_foot_is_cut_on_the_proper_sides_of_either_stance_foot():
    """Oracle: by hand: 2, 5, 2 and 3 cm off front, back, inside, outside."""
    left = geometry(swing(length=0.0)).foot  # about (0, 0.125)
    np.testing.assert_allclose(left.max(axis=0), [0.105, 0.155], atol=1e-12)
    np.testing.assert_allclose(left.min(axis=0), [-0.075, 0.085], atol=1e-12)
    right = geometry(mirrored(swing(length=0.0))).foot
    np.testing.assert_allclose(right.max(axis=0), [0.105, -0.085], atol=1e-12)
    np.testing.assert_allclose(right.min(axis=0), [-0.075, -0.155], atol=1e-12)


def test_the_regions_are_those_of_the_swing_side():
    """Oracle: in place, the nominal foothold is the cross-over's tip."""
    regions = geometry(swing(length=0.0)).regions
    foothold = np.array([0.0, -0.125])
    assert contains(foothold, regions[BASE], -0.05)
    gaps = np.linalg.norm(regions[FORWARD] - foothold, axis=1)
    assert gaps.min() < 1e-12
    base_only = geometry(swing(), CaptureRegionStepAdjusterParams()).regions
    assert list(base_only) == [BASE]


@pytest.mark.parametrize(("queued", "expected"), [(1, 1), (2, 2), (5, 3)])
def test_n_is_no_more_than_the_steps_in_the_queue(queued, expected):
    """Oracle: three, or fewer if there are fewer."""
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
    reach, foot = total_region(CROSSING), params.usable_foot(SOLE)
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
                random_point(rng, in_world(foot, about, step.side.other))
                for about, step in zip(abouts, steps, strict=False)
            ]
        moves = [
            random_point(rng, in_world(reach, about, step.side.other))
            for about, step in zip(abouts[:2], steps, strict=False)
        ]
        q = random_point(rng, found.foot)

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
        one_step = found.one_step_region(icp, OMEGA, (0.3, 0.3))
        assert contains(foothold, found.capture_region(one_step), 1e-6)


def test_equal_transfers_cancel_but_for_the_last():
    """Oracle: by hand: E_n R_n times f_n-1 / f_n, and f = 1 in the end."""
    schedule = swing(num_steps=3, transfer=0.2, swing=0.5)
    aware, at_once = (
        geometry(schedule, replace(PARAMS, transfer_aware=flag))
        for flag in (True, False)
    )
    E = math.exp(-OMEGA * 0.7)
    reach = in_world(total_region(CROSSING), FootPose(), Side.LEFT)
    hull = convex_hull(np.vstack([E * reach, [[0.0, 0.0]]]))
    np.testing.assert_allclose(at_once.offsets[1], aware.offsets[1])
    assert shapely.Polygon(aware.offsets[1]).symmetric_difference(
        shapely.Polygon(hull)
    ).area == pytest.approx(0.0, abs=1e-12)
    assert aware.factor == pytest.approx(
        OMEGA * 0.2 / (1.0 - math.exp(-OMEGA * 0.2))
    )
    ratio = aware.factor  # f_2 / f_3, as f_3 = 1
    extent = np.ptp(aware.offsets[2], axis=0) - np.ptp(hull, axis=0)
    other = np.ptp(at_once.offsets[2], axis=0) - np.ptp(hull, axis=0)
    np.testing.assert_allclose(extent, ratio * other)


def test_quicker_steps_are_worth_more():
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


def test_the_far_side_of_the_stance_leg_is_blocked():
    """Oracle: by hand: 1 m to the left of the left foot; not 1 m ahead."""
    found = geometry(swing(length=0.0))
    assert found.blocked(np.array([0.0, 1.125]))
    assert not found.blocked(np.array([1.0, 1.125]))


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

    def same(other, params=PARAMS):
        return geometry_key(schedule, PARAMS) == geometry_key(other, params)

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
    assert same(schedule, replace(PARAMS, enabled=False))
    no_crossing = replace(CROSSING, cross_over=False)
    assert not same(schedule, replace(PARAMS, reachability=no_crossing))


def test_the_other_side_is_the_mirror_image():
    """Oracle: y changes sign."""
    params = replace(PARAMS, finite_foot=True)
    schedule = swing(length=0.2, turn=0.2)
    here, there = (geometry(s, params) for s in (schedule, mirrored(schedule)))
    pairs = list(zip(here.offsets, there.offsets, strict=True))
    pairs += [
        (here.regions[name], there.regions[name]) for name in here.regions
    ]
    for a, b in [*pairs, (here.foot, there.foot)]:
        np.testing.assert_allclose(
            convex_hull(a * [1.0, -1.0]), convex_hull(b), atol=1e-12
        )
