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
    footholds,
    least_steps,
    lift_off_time,
    swing_times,
)
from nadia_balance.core.mechanisms import MECHANISMS, Mechanisms
from nadia_balance.core.reachability import step_regions
from nadia_balance.core.swing_geometry import (
    CaptureRegionStepAdjusterParams,
    swing_geometry,
)
from nadia_balance.core.time_adjustment import TimingAdapterParams
from nadia_balance.core.walking import Adjustment, FootPose, Phase, WalkingState
from tests.example_walks import (
    ALL,
    IDEAL_DETOUR,
    MODEL,
    OMEGA,
    UNCROSSED,
    walk,
)

HALF_WIDTH = 0.125
# The usable soles [x_min, y_min, x_max, y_max], the right foot in the air.
LEFT_FOOT = np.array([-0.075, 0.085, 0.105, 0.155])
BOTH_FEET = np.array([-0.075, -0.155, 0.105, 0.155])
# Of the foot that would hit the other one; beyond it is out of reach, too.
BLOCKED = shapely.box(-0.255, 0.0, 0.255, 9.0)
# No way round the stance foot, but for its centre.
STRAIGHT = replace(IDEAL_DETOUR, ahead=0.0, beside=0.0)
QUICK = replace(IDEAL_DETOUR, ahead=0.0, beside=0.0, max_acceleration=1e3)


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
    detour: object = field(default_factory=lambda: STRAIGHT)

    @property
    def params(self):
        return CaptureRegionStepAdjusterParams(
            num_steps=self.num_steps, waiting_time=0.2
        )

    @property
    def on(self):
        return Mechanisms(self.enabled, self.hurry, self.hurry, self.crossing)

    @property
    def model(self):
        return replace(MODEL, detour=self.detour)

    @property
    def state(self):
        schedule = walk(0.0, num_steps=4, transfer=self.transfer, swing=0.5)
        if self.phase is Phase.SWING:
            schedule = replace(schedule, phase=self.phase, duration=0.5)
        return WalkingState(schedule, time_in_phase=self.time)

    def least_steps(self, icp, state=None, foot=(0.0, -HALF_WIDTH)):
        state, params = state or self.state, self.params
        swing = np.zeros(12)
        swing[:2] = foot
        return least_steps(
            state,
            np.array(icp),
            swing,
            params,
            TimingAdapterParams(min_swing_duration=0.35),
            self.model,
            self.on,
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
        return [(min(0.03 - self.time, left), 0.35, 0.7)]

    def within_reach(self, points, slack):
        """True for footholds that there are, or `slack` [m] beside them."""
        if not self.enabled:
            return np.linalg.norm(points - [0.0, -HALF_WIDTH], axis=1) <= slack
        return shapely.contains_xy(free_region(self.crossing, slack), points)

    def next_vectors(self, number):
        """Where the step after this one can go, from the right foot."""
        if not self.enabled:
            return np.array([[0.0, 2.0 * HALF_WIDTH]])
        regions = step_regions(MODEL.reach, self.crossing).values()
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
    regions = [
        shapely.Polygon(region * mirror + left)
        for region in step_regions(MODEL.reach, crossing).values()
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
        detour=replace(
            IDEAL_DETOUR, ahead=0.0, beside=0.0, max_acceleration=12.0
        ),
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


def test_without_a_step_there_is_only_what_stands():
    """Oracle: by hand; far away nothing helps."""
    case = Case(Phase.TRANSFER)
    schedule = replace(case.state.schedule, footsteps=())
    state = replace(case.state, schedule=schedule)
    assert case.least_steps([0.1, 0.1], state) == 0
    assert case.least_steps([0.2, 0.1], state) == LOST == -1


def test_the_way_round_the_stance_foot_takes_its_time():
    """Oracle: the same swing across, as if the stance foot were a point."""
    case = Case(time=0.0, hurry=True, crossing=True, num_steps=1)
    round_it = replace(IDEAL_DETOUR, max_acceleration=8.0)
    through_it = replace(round_it, ahead=0.0, beside=0.0)
    found = [
        replace(case, detour=detour).least_steps(
            np.array([0.08, 0.165]), foot=(-0.2, -HALF_WIDTH)
        )
        for detour in (through_it, round_it)
    ]
    assert found == [1, LOST]


PARAMS = CaptureRegionStepAdjusterParams()
TIMING = TimingAdapterParams(min_swing_duration=0.4, min_transfer_duration=0.05)
STEP = MECHANISMS["step"]


def state_in(phase, time=0.0, elapsed=None, **gait):
    """A walk's first step, so long [s] in this phase."""
    schedule = walk(**{"length": 0.0, **gait})
    step = schedule.footsteps[0]
    duration = {
        Phase.STANDING: 0.5,
        Phase.TRANSFER: step.transfer_duration,
        Phase.SWING: step.swing_duration,
    }[phase]
    schedule = replace(schedule, phase=phase, duration=duration)
    elapsed = time if elapsed is None else elapsed
    return WalkingState(schedule, time_in_phase=time, elapsed=elapsed)


def test_the_foot_is_lifted_as_planned_or_in_a_hurry():
    """Oracle: by hand; a transfer takes 0.3 s, 0.05 s at least."""
    for phase, time, elapsed, planned, hurried in (
        (Phase.SWING, 0.3, 0.3, 0.0, 0.0),
        (Phase.TRANSFER, 0.0, 0.0, 0.3, 0.05),
        (Phase.TRANSFER, 0.2, 0.2, 0.1, 0.0),
        (Phase.TRANSFER, 0.28, 0.03, 0.02, 0.02),  # too late to hurry
        (Phase.STANDING, 0.1, 0.1, 0.7, 0.45),
    ):
        state = state_in(phase, time, elapsed)
        assert lift_off_time(state, TIMING, STEP) == pytest.approx(planned)
        assert lift_off_time(state, TIMING, ALL) == pytest.approx(hurried)


def test_a_swing_ends_as_planned_or_in_a_hurry():
    """Oracle: by hand; 0.7 s, 0.5 s of waiting for the load."""
    for phase, time, elapsed, planned, hurried in (
        (Phase.SWING, 0.0, 0.0, 0.7, 0.4),  # of the shortest swing
        (Phase.SWING, 0.275, 0.275, 0.425, 0.425 / 3.0),  # largest speed-up
        (Phase.SWING, 0.55, 0.55, 0.15, 0.08),  # that a foot always needs
        (Phase.SWING, 0.65, 0.65, 0.05, 0.05),  # as planned, that is sooner
        (Phase.SWING, 0.6, 0.2, 0.1, 0.1),  # it was hurried before
        (Phase.TRANSFER, 0.1, 0.1, 0.7, 0.4),  # a whole one
    ):
        state = state_in(phase, time, elapsed)
        found = swing_times(state, PARAMS, TIMING, STEP)
        assert found == pytest.approx((planned, planned + 0.5))
        found = swing_times(state, PARAMS, TIMING, ALL)
        assert found == pytest.approx((hurried, planned + 0.5))


def holds_of(state, on=UNCROSSED):
    geometry = swing_geometry(state.schedule, PARAMS, MODEL, on)
    return footholds(state, geometry, PARAMS, on)


def test_shortly_before_it_lands_a_foot_goes_on_to_where_it_was_sent():
    """Oracle: the adjusted foothold; the nominal one until then."""
    sent = FootPose([0.3, -0.4, 0.0])
    for time, number, y in (0.6, 2, -HALF_WIDTH), (0.66, 1, -0.4):
        state = state_in(Phase.SWING, time)
        nominal, *later = state.schedule.footsteps
        steps = (replace(nominal, pose=sent), *later)
        state = replace(
            state,
            schedule=replace(state.schedule, footsteps=steps),
            adjustment=Adjustment(nominal, sent),
        )
        holds = holds_of(state)
        assert len(holds) >= number and holds[0][0, 1] == y
