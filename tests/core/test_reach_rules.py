"""Oracles: a truth table; shapely's distances; the same choice under noise."""

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.polygon import convex_hull
from nadia_balance.core.reach_rules import (
    ReachRulesParams,
    choose_region,
    closest_point,
)
from nadia_balance.core.reachability import BACKWARD, BASE, FORWARD
from nadia_balance.core.walking import rectangle

PARAMS = ReachRulesParams(
    area_margin=2.0, hysteresis=1.5, distance_hysteresis=0.1
)
# Towers of unit width on the x axis: a capture region below them of depth 10
# shares with each tower as much as the tower reaches down.
ABOVE = convex_hull(rectangle(20.0, 10.0) - [0.0, 5.0])


def tower(x, depth):
    """A unit-wide region at `x` that shares the area `depth` with ABOVE."""
    return convex_hull(
        np.array([[x, -depth], [x + 1, -depth], [x, 5], [x + 1, 5]])
    )


def towers(base, forward, backward):
    """Three regions that share so much with ABOVE; less than 0 is apart."""
    return {
        BASE: tower(0.0, base),
        FORWARD: tower(2.0, forward),
        BACKWARD: tower(-2.0, backward),
    }


@pytest.mark.parametrize(
    ("shared", "expected"),
    [
        # Rule 1: base, if it shares anything ...
        ((1.0, 0.0, 0.0), BASE),
        ((1.0, 1.9, 0.5), BASE),
        ((1.0, 1.9, 1.9), BASE),
        ((0.1, -1.0, -1.0), BASE),
        # ... but not if a cross-over region shares more than twice that.
        ((1.0, 2.1, 0.5), FORWARD),
        ((1.0, 0.5, 2.1), BACKWARD),
        ((0.01, 0.5, 0.4), FORWARD),
        # Rule 2: the cross-over region that shares more.
        ((-1.0, 0.5, 0.4), FORWARD),
        ((-0.01, 0.4, 0.5), BACKWARD),
        ((0.0, 0.01, -1.0), FORWARD),
        # Rule 3: the closest.
        ((-1.0, -2.0, -3.0), BASE),
        ((-2.0, -1.0, -3.0), FORWARD),
        ((-3.0, -2.0, -1.0), BACKWARD),
    ],
)
def test_the_three_rules(shared, expected):
    """Oracle: the truth table of Fig. 9, with the area margin of 2."""
    assert (
        choose_region(towers(*shared), ABOVE, None, PARAMS).region == expected
    )


@pytest.mark.parametrize("before", [BASE, FORWARD, BACKWARD])
@pytest.mark.parametrize(
    ("shared", "expected"),
    [
        # Preferences of base : forward, doubled for base, are 1 : 1.4.
        ((0.5, 1.4, 0.0), {BASE: BASE, FORWARD: FORWARD, BACKWARD: FORWARD}),
        # 1.4 : 1.
        ((0.7, 1.0, 0.0), {BASE: BASE, FORWARD: FORWARD, BACKWARD: BASE}),
        # 1 : 1.6, which is more than the hysteresis of 1.5.
        ((0.5, 1.6, 0.0), dict.fromkeys((BASE, FORWARD, BACKWARD), FORWARD)),
        ((0.8, 1.0, 0.0), dict.fromkeys((BASE, FORWARD, BACKWARD), BASE)),
        # Apart by 1 and 1.05 m, and by 1 and 1.15 m.
        ((-1.0, -1.05, -3.0), {BASE: BASE, FORWARD: FORWARD, BACKWARD: BASE}),
        ((-1.0, -1.15, -3.0), dict.fromkeys((BASE, FORWARD, BACKWARD), BASE)),
    ],
)
def test_the_last_region_is_kept_unless_another_is_clearly_better(
    before, shared, expected
):
    """Oracle: by hand, hysteresis 1.5 and 0.1 m."""
    choice = choose_region(towers(*shared), ABOVE, before, PARAMS)
    assert choice.region == expected[before]


def test_without_cross_over_it_is_always_base():
    """Oracle: there is no other."""
    for depth in 1.0, -1.0:
        regions = {BASE: tower(0.0, depth)}
        assert choose_region(regions, ABOVE, None, PARAMS).region == BASE


def test_noise_does_not_flip_the_choice():
    """Oracle: one choice in 500, though the areas trade places all the time.

    The noise of 5 % is below the hysteresis; without that, it does flip.
    """
    rng = np.random.default_rng(4)
    loose = ReachRulesParams(hysteresis=1.0, distance_hysteresis=0.0)
    for shared in (0.5, 1.0, 0.2), (-1.0, 0.5, 0.5), (-1.0, -1.0, -1.0):
        found = {"kept": set(), "loose": set()}
        kept = None
        for _ in range(500):
            noisy = shared * (1.0 + 0.05 * rng.uniform(-0.9, 0.9, 3))
            regions = towers(*noisy)
            kept = choose_region(regions, ABOVE, kept, PARAMS).region
            found["kept"].add(kept)
            other = choose_region(regions, ABOVE, None, loose).region
            found["loose"].add(other)
        assert len(found["kept"]) == 1
        assert len(found["loose"]) > 1


def test_the_goal_is_as_deep_inside_as_asked():
    """Oracle: by hand: the tower's part at least 0.3 m below the edge."""
    goal = choose_region(towers(1.0, 0, 0), ABOVE, None, PARAMS, 0.3).goal
    np.testing.assert_allclose(
        convex_hull(goal), [[0, -1], [1, -1], [1, -0.3], [0, -0.3]], atol=1e-12
    )


def test_where_it_is_less_deep_the_goal_is_nearly_the_deepest():
    """Oracle: by hand: 0.2 m of the 0.3 m asked for, but for 0.3 / 16."""
    goal = choose_region(towers(0.2, -1, -1), ABOVE, None, PARAMS, 0.3).goal
    assert np.all(goal[:, 1] <= -0.2 + 0.3 / 16)
    assert np.min(goal[:, 1]) == pytest.approx(-0.2)


def test_a_region_with_a_deep_part_is_preferred_to_a_larger_shallow_one():
    """Oracle: by hand: 0.2 m deep against 0.15 m, 0.18 m asked for."""
    regions = towers(0.15, 0.2, -1.0)
    assert choose_region(regions, ABOVE, None, PARAMS).region == BASE
    choice = choose_region(regions, ABOVE, None, PARAMS, 0.18)
    assert choice.region == FORWARD


def test_by_rule_3_the_goal_is_the_closest_point():
    """Oracle: by hand: the tower's lower edge."""
    corner = convex_hull(np.array([[0.4, 1.0], [1.0, 3.0], [-1.0, 3.0]]))
    goal = choose_region({BASE: corner}, ABOVE, None, PARAMS, 0.1).goal
    np.testing.assert_allclose(goal, [[0.4, 1.0]], atol=1e-15)


GRID = st.tuples(st.integers(0, 20), st.integers(-20, 20))
POLYGON = (
    st.lists(GRID, min_size=3, max_size=10)
    .map(lambda points: convex_hull(0.1 * np.array(points)))
    .filter(lambda hull: len(hull) > 2)
)


@given(POLYGON, POLYGON, st.floats(0.01, 1.0), st.floats(0.0, 6.3))
def test_finds_the_closest_point_of_disjoint_polygons(left, right, gap, turn):
    """Oracle: shapely's distance between them, and from the point."""
    c, s = math.cos(turn), math.sin(turn)
    R = np.array([[c, -s], [s, c]])
    left = (left * [-1.0, 1.0])[::-1] @ R.T
    right = (right + [gap, 0.0]) @ R.T
    point, found = closest_point(left, right)
    expected = shapely.Polygon(left).distance(shapely.Polygon(right))
    assert found == pytest.approx(expected, abs=1e-12)
    point = shapely.Point(point)
    assert shapely.Polygon(left).distance(point) < 1e-12
    assert shapely.Polygon(right).distance(point) == pytest.approx(expected)


def test_the_choice_does_not_depend_on_the_frame():
    """Oracle: turned and moved regions give the same choice and goal."""
    c, s = math.cos(0.7), math.sin(0.7)
    R, shift = np.array([[c, -s], [s, c]]), np.array([3.0, -2.0])
    depths = (-1.0, 0.23, 0.5), (-0.9, 0.25, 0.45), (-0.8, 0.3, 0.42)
    for shared in itertools.product(*depths):  # no two alike
        here = towers(*shared)
        there = {name: p @ R.T + shift for name, p in here.items()}
        first = choose_region(here, ABOVE, None, PARAMS, 0.1)
        second = choose_region(there, ABOVE @ R.T + shift, None, PARAMS, 0.1)
        assert first.region == second.region
        back = shapely.MultiPoint((second.goal - shift) @ R).convex_hull
        goal = shapely.MultiPoint(first.goal).convex_hull
        if len(first.goal) > 1:
            assert back.symmetric_difference(goal).area < 1e-12
        else:  # any point of an edge that is parallel
            assert back.distance(shapely.Polygon(here[first.region])) < 1e-12


@pytest.mark.parametrize(
    "bad",
    [
        {"area_margin": 0.9},
        {"area_margin": math.inf},
        {"hysteresis": math.nan},
        {"distance_hysteresis": -0.1},
    ],
)
def test_refuses_bad_parameters(bad):
    """Oracle: the message names field and value."""
    (name, value), *_ = bad.items()
    with pytest.raises(ValueError, match=f"{name} = {value}: must be"):
        ReachRulesParams(**bad).validate()
