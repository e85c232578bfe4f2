"""Oracles: dense search on the stones, the flat adjuster, figures by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.capture_region import (
    CaptureRegionStepAdjusterParams,
    swing_geometry,
)
from nadia_balance.core.foothold_adjustment import Landing, unadjusted
from nadia_balance.core.ground import Ground
from nadia_balance.core.ground_adjustment import GroundLanding
from nadia_balance.core.ground_capture import footing
from nadia_balance.core.polygon import contains, shrink
from tests.core.test_ground import square
from tests.example_walks import MODEL, OMEGA, SOLE, UNCROSSED, swing

PARAMS = CaptureRegionStepAdjusterParams(num_steps=1, dead_band=0.0)
STONES = (
    square("middle", 0.0, -0.2),
    square("ahead", 0.7, -0.2),
    square("out", 0.3, -0.7),
)
TOUCHDOWN = (0.2, 0.3)


def landing(icp, stones=STONES, params=PARAMS):
    """A swing of the right foot, planned to (0, -0.125), with this ICP."""
    schedule = swing(length=0.0)
    model = replace(MODEL, ground=Ground(stones, SOLE))
    of = schedule, params, model, UNCROSSED
    geometry = swing_geometry(*of)
    ground = footing(*of, geometry)
    return (
        GroundLanding(geometry, np.array(icp), TOUCHDOWN, footing=ground),
        unadjusted(schedule),
        model.ground,
    )


def icp_before(point):
    """The ICP that is at `point` in 0.25 s, the CoP in the stance foot."""
    stance = np.array([0.0, 0.125])
    return stance + math.exp(-OMEGA * 0.25) * (point - stance)


@pytest.mark.parametrize("to", [[0.2, -0.3], [0.6, -0.25], [0.3, -0.55]])
def test_steps_to_the_nearest_foothold_deep_enough_in_the_region(to):
    """Oracle: dense search: on a stone, in C_1 by the margin, in reach."""
    case, current, ground = landing(icp_before(np.array(to)))
    found = case.adjust(current, PARAMS, 0.002).pose
    deep = shrink(case.one_step, PARAMS.margin)
    grid = np.stack(
        np.meshgrid(np.arange(-0.3, 1.0, 0.004), np.arange(-1.1, 0.0, 0.004)),
        -1,
    ).reshape(-1, 2)
    nominal = current.nominal.pose.p_WF[:2]
    reach = case.geometry.regions["base"]
    good = [
        p
        for p in grid
        if contains(p, deep)
        and contains(p, reach)
        and any(contains(p, hold) for hold in ground.footholds(0.0))
    ]
    best = min(math.dist(p, nominal) for p in good)
    p = found.p_WF[:2]
    assert math.dist(p, nominal) == pytest.approx(best, abs=0.01)
    assert contains(p, deep, 1e-9) and ground.region_under(found) is not None


def test_wherever_the_icp_is_the_foot_lands_on_a_stone():
    """Oracle: the sole's corners; also if no foothold captures."""
    rng = np.random.default_rng(6)
    for icp in rng.uniform([-0.6, -0.6], [0.8, 0.6], (60, 2)):
        case, current, ground = landing(icp)
        found = case.adjust(current, PARAMS, 0.002)
        assert ground.region_under(found.pose) is not None


def test_a_foot_that_is_late_moves_on_along_a_stone_or_stays():
    """Oracle: the sole's corners, and the times of the ways by hand."""
    moved = 0
    for to in ([0.6, -0.25], [0.15, -0.3], [0.3, -0.6]):
        case, current, ground = landing(icp_before(np.array(to)))
        case = case.at(case.icp, TOUCHDOWN, np.array([0.0, -0.125]))
        wanted = case.adjust(current, PARAMS, 0.002)
        for time in np.arange(0.0, 0.3, 0.01):
            found = case.in_time(current, wanted, float(time)).pose
            assert ground.region_under(found) is not None
            way = math.hypot(*(found.p_WF[:2] - case.foot))
            least = 2.0 * math.sqrt(way / MODEL.detour.max_acceleration)
            least += MODEL.detour.settling
            assert (
                found is current.pose or math.sqrt(0.5) * least <= time + 1e-9
            )
            moved += found is not current.pose and found is not wanted.pose
    assert moved


def test_noise_does_not_move_the_foot_from_stone_to_stone():
    """Oracle: the stone of the tick before; without it, they change.

    By 2 mm, where an ICP that comes down farther ahead asks for the next one.
    """

    def step(x, last=None):
        case, current, ground = landing(icp_before(np.array([x, -0.2])))
        found = case.adjust(last or current, PARAMS, 0.002)
        return ground.region_under(found.pose).name, found

    xs = np.arange(0.2, 0.6, 0.002)
    names = [step(x)[0] for x in xs]
    first = names.index("ahead")
    assert names[first - 1] == "middle"
    _, last = step(xs[first])
    for i in (-1, 0, -1, 0):
        name, last = step(xs[first + i], last)
        assert name == "ahead"


def test_large_stones_give_what_flat_ground_gives():
    """Oracle: the flat adjuster; the far edges of the stone bind nothing."""
    params = replace(PARAMS, num_steps=2, ground_steps=1)
    stone = square("large", 0.0, -2.2, side=4.0)
    for to in ([0.3, -0.4], [-0.4, -0.5], [0.1, -0.7]):
        case, current, _ = landing(icp_before(np.array(to)), (stone,), params)
        flat = Landing(case.geometry, case.icp, TOUCHDOWN)
        expected = flat.adjust(current, params, 0.002).pose.p_WF
        found = case.adjust(current, params, 0.002).pose.p_WF
        assert found == pytest.approx(expected, abs=1e-9)


def test_without_a_stone_in_reach_the_foot_goes_on():
    """Oracle: the very same pose."""
    case, current, _ = landing([0.2, 0.0], (square("far", 5.0),))
    assert case.adjust(current, PARAMS, 0.002).pose is current.pose


@pytest.mark.parametrize("up", [-0.30, -0.20, 0.20, 0.30])
def test_a_step_rises_no_farther_than_the_legs_allow(up):
    """Oracle: by hand: 0.25 m up or down; both of the steps that count."""
    stones = (STONES[0], replace(STONES[1], height=up), STONES[2])
    params = replace(PARAMS, num_steps=2, ground_steps=2)
    case, current, ground = landing(icp_before([0.6, -0.25]), stones)
    name = ground.region_under(case.adjust(current, PARAMS, 0.002).pose).name
    assert (name == "ahead") == (abs(up) < 0.25)
    left = replace(square("left", 0.5, 0.3), height=up)
    case, _, _ = landing([0.0, 0.0], (STONES[0], left), params)
    onto_left = any(
        contains(sequence.polygons[-1].mean(axis=0), left.polygon)
        for place in case.footing.places
        for sequence in place.sequences
    )
    assert onto_left == (abs(up) < 0.25)
