"""Oracles: all CoPs, times and footholds of a grid, one after the other.

The brute force knows the ICP's flow (Eq. 3), and by shapely where a foot can
be put; no capture region, no Minkowski sum.
"""

import functools
import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
import shapely

from nadia_balance.core.capturability import (
    LOST,
    least_steps,
    time_to_polygon,
)
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.next_step import next_step, usable_support
from nadia_balance.core.polygon import contains, convex_hull
from nadia_balance.core.reachability import ReachabilityParams, step_regions
from nadia_balance.core.swing_detour import (
    SwingDetourParams,
    shortest_time,
    way_round,
)
from nadia_balance.core.time_adjustment import TimingAdapterParams
from nadia_balance.core.walking import Phase, Side, WalkingState
from tests.example_walks import OMEGA, SOLE, mirrored, moved, walk

HALF_WIDTH = 0.125
# The usable soles [x_min, y_min, x_max, y_max], the right foot in the air.
LEFT_FOOT = np.array([-0.075, 0.085, 0.105, 0.155])
BOTH_FEET = np.array([-0.075, -0.155, 0.105, 0.155])
# Of the foot that would hit the other one; beyond it is out of reach, too.
BLOCKED = shapely.box(-0.255, 0.0, 0.255, 9.0)
# No way round the stance foot, but for its centre.
STRAIGHT = SwingDetourParams(ahead=0.0, beside=0.0)
QUICK = SwingDetourParams(ahead=0.0, beside=0.0, max_acceleration=1e3)


@dataclass
class Case:
    """Steps in place; the right foot is in the air, or will be next."""

    phase: Phase = Phase.SWING
    time: float = 0.3
    enabled: bool = True
    crossing: bool = False
    hurry: bool = False
    transfer: float = 0.1
    num_steps: int = 2  # N
    detour: SwingDetourParams = field(default_factory=lambda: STRAIGHT)

    @property
    def params(self):
        return CaptureRegionStepAdjusterParams(
            enabled=self.enabled,
            num_steps=self.num_steps,
            waiting_time=0.2,
            reachability=ReachabilityParams(cross_over=self.crossing),
        )

    @property
    def state(self):
        schedule = walk(0.0, num_steps=4, transfer=self.transfer, swing=0.5)
        if self.phase is Phase.SWING:
            schedule = replace(schedule, phase=self.phase, duration=0.5)
        return WalkingState(schedule, time_in_phase=self.time)

    def least_steps(self, icp, state=None, foot=(0.0, -HALF_WIDTH)):
        state, params = state or self.state, self.params
        timing = TimingAdapterParams(
            swing=self.hurry, transfer=self.hurry, min_swing_duration=0.35
        )
        foot, at_rest = np.array(foot), np.zeros(2)
        support = usable_support(state.schedule, SOLE, params)
        return least_steps(
            np.array(icp),
            support,
            lambda: next_step(
                state, foot, at_rest, SOLE, OMEGA, params, timing
            ),
            OMEGA,
            self.detour,
        )

    def times(self):
        """(lift-off, earliest, latest) [s]; touchdowns from the lift-off."""
        if self.phase is Phase.SWING:
            left = 0.5 - self.time
            earliest = max(0.35, 0.08, 0.5 / 3.0) if self.hurry else left
            return [(0.0, min(earliest, left), left + 0.2)]
        left = self.transfer - self.time
        if not self.hurry:
            return [(left, 0.5, 0.7)]
        return [(min(0.05, left), 0.35, 0.7), (left, 0.35, 0.7)]

    def within_reach(self, points, slack):
        """True for footholds that there are, or `slack` [m] beside them."""
        if not self.enabled:
            return np.linalg.norm(points - [0.0, -HALF_WIDTH], axis=1) <= slack
        return shapely.contains_xy(free_region(self.crossing, slack), points)

    def next_vectors(self, number):
        """Where the step after this one can go, from the right foot."""
        if not self.enabled:
            return np.array([[0.0, 2.0 * HALF_WIDTH]])
        regions = step_regions(self.params.reachability).values()
        hull = shapely.MultiPoint(
            np.vstack([*regions, [[0.0, 0.0]]])
        ).convex_hull
        x, y = np.meshgrid(
            np.linspace(-1.0, 1.0, number), np.linspace(-0.1, 0.8, number)
        )
        grid = np.column_stack([x.ravel(), y.ravel()])
        inside = grid[shapely.contains_xy(hull, grid)]
        return np.vstack([inside, np.array(hull.exterior.coords)])


@functools.cache
def free_region(crossing, slack):
    """Where the right foot can be put, from a left stance at (0, 0.125)."""
    mirror, left = np.array([1.0, -1.0]), np.array([0.0, HALF_WIDTH])
    params = ReachabilityParams(cross_over=crossing)
    regions = [
        shapely.Polygon(region * mirror + left)
        for region in step_regions(params).values()
    ]
    free = shapely.union_all(regions).difference(BLOCKED).buffer(slack)
    shapely.prepare(free)
    return free


def grid_of(box, number):
    x, y = np.meshgrid(
        np.linspace(box[0], box[2], number), np.linspace(box[1], box[3], number)
    )
    return np.column_stack([x.ravel(), y.ravel()])


def flow(icps, cops, time):
    """All ICPs after `time` [s], for each of the CoPs."""
    grown = cops[None] + math.exp(OMEGA * time) * (icps[:, None] - cops[None])
    return grown.reshape(-1, 2)


def brute_force(case, icp, slack, number=4, times=9):
    """Least steps by trying everything; footholds `slack` [m] off count."""
    icps = np.array([icp])
    support = LEFT_FOOT if case.phase is Phase.SWING else BOTH_FEET
    if np.all((icps[0] >= support[:2]) & (icps[0] <= support[2:])):
        return 0
    acceleration = case.detour.max_acceleration
    landings, moments = [], []
    for lift_off, earliest, latest in case.times():
        lifted = flow(icps, grid_of(support, number), lift_off)
        lifted = icps if lift_off == 0.0 else lifted
        for time in np.linspace(earliest, latest, times):
            landed = flow(lifted, grid_of(LEFT_FOOT, number), time)
            landings.append(landed)
            moments.append(np.full(len(landed), time))
    landings, moments = np.concatenate(landings), np.concatenate(moments)
    ways = 0.25 * acceleration * moments**2 + slack

    def lands(footholds):
        far = np.linalg.norm(footholds - [0.0, -HALF_WIDTH], axis=1)
        near = far <= ways
        return np.any(case.within_reach(footholds[near], slack))

    if lands(landings):
        return 1
    decay = math.exp(-OMEGA * (case.transfer + 0.5))
    vectors = case.next_vectors(3 * number)
    if any(lands(landings - decay * vector) for vector in vectors):
        return 2
    return LOST


CASES = {
    "swing": Case(),
    "cross-over": Case(crossing=True),
    "hurried swing": Case(time=0.05, hurry=True, crossing=True),
    "slow foot": Case(
        hurry=True,
        time=0.05,
        detour=SwingDetourParams(ahead=0.0, beside=0.0, max_acceleration=12.0),
    ),
    "planned footholds": Case(enabled=False, time=0.2),
    "transfer": Case(Phase.TRANSFER, time=0.0),
    "hurried transfer": Case(Phase.TRANSFER, time=0.02, hurry=True),
}


@pytest.mark.parametrize("name", CASES)
def test_as_many_steps_as_brute_force_needs(name):
    """Oracle: brute force, which finds no more steps; nor fewer, but for 4 cm.

    Between the points of its grid there are better footholds than those on
    it, by up to the slack.
    """
    case, rng = CASES[name], np.random.default_rng(11)
    icps = rng.uniform([-0.5, -0.35], [0.5, 0.45], (20, 2))
    near = rng.uniform([-0.1, 0.0], [0.15, 0.2], (10, 2))
    found, sharp = set(), 0
    for icp in [*icps, *near]:
        steps = case.least_steps(icp)
        most = brute_force(case, icp, 1e-9)
        least = brute_force(case, icp, 0.04)
        assert rank(least) <= rank(steps) <= rank(most), (icp, least, steps)
        found.add(steps)
        sharp += least == most
    assert {0, 1, LOST} <= found
    assert sharp > 20  # the bounds are no loophole


def rank(steps):
    return math.inf if steps == LOST else steps


@pytest.mark.parametrize("time", [0.2, 0.35])
def test_the_farthest_icp_of_one_step_is_a_closed_form(time):
    """Oracle: 1-D, by hand: e^wt (x - toes) + toes = the region's tip.

    The base region ends 1 m ahead and 0.25 m to the side of the stance foot.
    There the ICP of the largest x lands, with the CoP in the middle of the
    toes.  At 3 mm from it, as the sides of the region meet there in an angle.
    """
    case = Case(time=time, num_steps=1, detour=QUICK)
    growth = math.exp(OMEGA * (0.5 - time))
    toes, tip = np.array([0.105, 0.12]), np.array([1.0, -HALF_WIDTH])
    farthest = toes + (tip - toes) / growth
    assert case.least_steps(farthest - [0.003, 0.0]) == 1
    assert case.least_steps(farthest + [0.003, 0.0]) == LOST


@pytest.mark.parametrize("phase", [Phase.SWING, Phase.TRANSFER])
def test_no_step_is_needed_above_what_stands(phase):
    """Oracle: the rectangle, at 1 um from each side."""
    case = Case(phase, time=0.05)
    box = LEFT_FOOT if phase is Phase.SWING else BOTH_FEET
    middle = 0.5 * (box[:2] + box[2:])
    for axis in (0, 1):
        for side, sign in (box[axis], 1.0), (box[axis + 2], -1.0):
            inside, outside = middle.copy(), middle.copy()
            inside[axis] = side + sign * 1e-6
            outside[axis] = side - sign * 1e-6
            assert case.least_steps(inside) == 0
            assert case.least_steps(outside) != 0


def test_without_a_step_there_is_only_what_stands():
    """Oracle: by hand; far away nothing helps."""
    case = Case(Phase.TRANSFER)
    support = usable_support(case.state.schedule, SOLE, case.params)
    for icp, expected in ([0.1, 0.1], 0), ([0.2, 0.1], LOST):
        found = least_steps(
            np.array(icp), support, lambda: None, OMEGA, STRAIGHT
        )
        assert found == expected


def test_the_way_round_the_stance_foot_takes_its_time():
    """Oracle: the time for the two straight parts of the way, by hand.

    Lands across, in front: the CoP has no choice to speak of, and the swing
    is hurried.  It takes between 2 sqrt(l / a) of the air line and of the way
    round, or longer.
    """
    goal, corner = np.array([0.5, 0.16]), np.array([0.28, -0.025])
    foot = np.array([-0.2, -HALF_WIDTH])
    air_line = math.dist(foot, goal)
    way = math.dist(foot, corner) + math.dist(corner, goal)
    assert way > 1.02 * air_line
    case = Case(time=0.0, hurry=True, crossing=True)
    step = next_step(
        case.state,
        foot,
        np.zeros(2),
        SOLE,
        OMEGA,
        replace(case.params, num_steps=1, waiting_time=1e-3),
        TimingAdapterParams(min_swing_duration=0.499),
    )
    hold = goal + 1e-4 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    step = replace(step, footholds=(hold,))
    assert contains(goal, step.geometry.regions["forward"])
    # All that the CoP does is to stay in the middle of the foot.
    middle = 0.5 * (LEFT_FOOT[:2] + LEFT_FOOT[2:])
    icp = middle + (goal - middle) / math.exp(OMEGA * 0.5)
    support = usable_support(case.state.schedule, SOLE, case.params)
    for length, expected in (air_line, LOST), (way, 1):
        # The very acceleration that takes 0.5 s for it.
        detour = SwingDetourParams(max_acceleration=length / 0.25**2)
        found = least_steps(icp, support, lambda: step, OMEGA, detour)
        assert found == expected


def test_no_foothold_of_a_polygon_is_reached_sooner():
    """Oracle: the way round to each of 1300 points of the polygon.

    The foot moves or not, the polygon is in front, behind or beside; where
    `ahead` counts in full, so that a corner is where it is.
    """
    rng, detour = np.random.default_rng(5), SwingDetourParams()
    state, round_a_corner = Case(crossing=True).state, 0
    for k in range(40):
        foot = rng.uniform([-0.25, -0.45], [0.25, -0.1])
        velocity = rng.uniform(-1.5, 1.5, 2) * (k % 2)
        middle = rng.uniform([-0.7, -0.5], [0.7, 0.25])
        if k % 4 < 2:  # across, in front or behind
            middle = np.array([rng.choice([-0.6, 0.6]), 0.2])
        elif abs(middle[0]) < 0.5:
            middle[1] = -0.35
        polygon = convex_hull(middle + rng.uniform(-0.2, 0.2, (5, 2)))
        step = next_step(
            state,
            foot,
            velocity,
            SOLE,
            OMEGA,
            Case().params,
            TimingAdapterParams(),
        )
        if contains(foot, polygon, 0.01):
            continue  # it is there
        stance = state.schedule.feet.left
        inside = rng.dirichlet(np.ones(len(polygon)), 800) @ polygon
        along = np.linspace(0.0, 1.0, 100)[:, None, None]
        edges = along * polygon + (1.0 - along) * np.roll(polygon, 1, axis=0)
        ways = [
            way_round(foot, p, stance, Side.RIGHT, detour)
            for p in [*inside, *edges.reshape(-1, 2)]
        ]
        times = [shortest_time(way, detour, velocity) for way in ways]
        best = int(np.argmin(times))
        found = time_to_polygon(polygon, step, detour)
        # Of a foot that moves, a longer way may take a little less time.
        allowed = 1e-9 if k % 2 == 0 else 0.015
        assert times[best] - 2e-3 <= found <= times[best] + allowed
        round_a_corner += len(ways[best]) > 2
    assert round_a_corner > 5


def test_the_mirror_and_a_turned_world_change_nothing():
    """Oracle: symmetry."""
    case = Case(time=0.1, crossing=True, hurry=True)
    rng = np.random.default_rng(3)
    angle, shift = 0.7, np.array([1.0, -2.0])
    c, s = math.cos(angle), math.sin(angle)
    R = np.array([[c, -s], [s, c]])
    foot = np.array([0.05, -HALF_WIDTH])
    flip, seen = np.array([1.0, -1.0]), set()
    for _ in range(30):
        icp = rng.uniform([-0.4, -0.3], [0.4, 0.35])
        expected = case.least_steps(icp, foot=foot)
        state = case.state
        there = replace(state, schedule=moved(state.schedule, angle, shift))
        assert expected == case.least_steps(
            R @ icp + shift, there, R @ foot + shift
        )
        there = replace(state, schedule=mirrored(state.schedule))
        assert expected == case.least_steps(flip * icp, there, flip * foot)
        seen.add(expected)
    assert seen == {1, 2, LOST}
