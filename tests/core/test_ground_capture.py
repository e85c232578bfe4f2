"""Oracle: every sequence of regions, one linear program for each.

Its variables are all footholds, the weights of the corners of C_1 and of the
feet and, where later steps find ground everywhere, these steps with their
times; nothing is eliminated.
"""

import itertools
import math
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

from nadia_balance.core.capture_region import (
    CaptureRegionStepAdjusterParams,
    swing_geometry,
)
from nadia_balance.core.ground import Ground, Region
from nadia_balance.core.ground_capture import footing, without_last
from nadia_balance.core.polygon import contains, convex_hull, halfspaces
from nadia_balance.core.reachability import in_world, total_region
from nadia_balance.core.walking import FootPose, rectangle
from tests import run_cache
from tests.example_walks import ALL, MODEL, OMEGA, SOLE, UNCROSSED, swing

PARAMS = CaptureRegionStepAdjusterParams()
EYE = np.eye(2)


def random_ground(rng):
    """Stones about the stance foot: rectangles, whose edges are parallel, or
    polygons of up to six corners."""
    regions, squares = [], rng.integers(2)
    for middle in itertools.product((-0.6, 0.0, 0.6), (-0.4, 0.3)):
        corners = rectangle(*rng.uniform(0.3, 0.6, 2))
        if not squares:
            angles = np.sort(rng.uniform(0.0, math.tau, 6))
            corners = np.column_stack([np.cos(angles), np.sin(angles)])
            corners = rng.uniform(0.25, 0.45) * corners
        corners = middle + rng.uniform(-0.1, 0.1, 2) + corners
        region = Region(vertices=convex_hull(corners).tolist())
        if len(region.footholds(SOLE, 0.0, 0.0)):
            regions.append(region)
    return Ground(tuple(regions), SOLE, margin=0.0)


class Case:
    """A swing above a ground, its C_1, and what is to be tested of it."""

    def __init__(self, rng):
        self.params = replace(
            PARAMS,
            ground_steps=int(rng.integers(1, 4)),
            finite_foot=bool(rng.integers(2)),
        )
        self.on = ALL if rng.integers(2) else UNCROSSED
        schedule = swing(
            num_steps=int(rng.integers(1, 5)),
            transfer=0.1,
            swing=rng.uniform(0.35, 0.7),
            turn=rng.uniform(-0.2, 0.2),
        )
        places = ()
        while not places:
            self.model = replace(MODEL, ground=random_ground(rng))
            of = schedule, self.params, self.model, self.on
            geometry = swing_geometry(*of)
            self.footing = footing(*of, geometry)
            places = self.footing.places
        self.steps = schedule.footsteps[: self.params.num_steps]
        time = rng.uniform(0.05, 0.4)
        # An ICP that comes near to one of the places.
        goal = places[rng.integers(len(places))].polygon.mean(axis=0)
        goal = goal + rng.uniform(-0.1, 0.1, 2)
        stance = geometry.foot.mean(axis=0)
        icp = stance + math.exp(-OMEGA * time) * (goal - stance)
        self.one_step = geometry.one_step_region(icp, (time, time + 0.05))

    def captures(self, foothold):
        """True if the linear program of any sequence has a solution."""
        steps = self.steps[: self.params.ground_steps]
        holds = [
            list(filter(len, self.model.ground.footholds(step.pose.yaw)))
            for step in steps
        ]
        return any(
            self.solves(foothold, chosen, len(chosen) + 1 == len(steps))
            for n in range(1, len(steps) + 1)
            for chosen in itertools.product(*holds[1:n])
        )

    def solves(self, foothold, chosen, goes_on):
        """True if steps 2, 3, ... onto the `chosen` polygons capture."""
        total = total_region(self.model.reach, self.on.cross_over)
        foot = np.zeros((1, 2))
        if self.params.finite_foot:
            foot = self.params.usable_foot(SOLE)
        abouts = [(FootPose(yaw=s.pose.yaw), s.side.other) for s in self.steps]
        feet = [in_world(foot, *about) for about in abouts]
        reaches = [in_world(total, *about) for about in abouts]
        E = [
            math.exp(-OMEGA * (s.transfer_duration + s.swing_duration))
            for s in self.steps[1:]
        ]
        n, program = len(chosen) + 1, Program()
        places = [program.free() for _ in range(n)]
        program.equal([(places[0], EYE)], foothold)
        for k, hold in enumerate(chosen, start=1):
            A, b = halfspaces(hold)
            program.below([(places[k], A)], b)
            A, b = halfspaces(convex_hull(reaches[k - 1]))
            program.below([(places[k], A), (places[k - 1], -A)], b)
        icp, left = program.weights(self.one_step), 1.0
        program.sums_to([icp], 1.0)
        balance = [(icp, self.one_step.T)]
        for k in range(n):
            share = left * (1.0 - E[k]) if k < n - 1 else left
            balance.append((places[k], -share * EYE))
            if k < n - 1:
                cop = program.weights(feet[k])
                program.sums_to([cop], 1.0)
                balance.append((cop, -share * feet[k].T))
                left *= E[k]
        # From the last region on as in test_capture_region: weights of the
        # feet, which make up 1, and of steps of any longer time.
        last = len(self.steps) if goes_on else n
        cops = [program.weights(feet[k]) for k in range(n - 1, last)]
        program.sums_to(cops, 1.0)
        for k, cop in enumerate(cops):
            balance.append((cop, -left * feet[n - 1 + k].T))
        for k in range(n - 1, last - 1):
            before, after = cops[k - n + 1 :], cops[k - n + 2 :]
            program.below(
                [(c, np.ones((1, len(c)))) for c in after]
                + [(c, np.full((1, len(c)), -E[k])) for c in before],
                [0.0],
            )
            step = program.weights(reaches[k])
            program.sums_to([step], 0.0, after)
            balance.append((step, -left * reaches[k].T))
        program.equal(balance, np.zeros(2))
        return program.has_solution()


class Program:
    """A linear program that is put together piece by piece."""

    def __init__(self):
        self.bounds, self.equalities, self.inequalities = [], [], []

    def _variables(self, count, bound):
        first = len(self.bounds)
        self.bounds += [bound] * count
        return list(range(first, first + count))

    def free(self):
        return self._variables(2, (None, None))

    def weights(self, polygon):
        return self._variables(len(polygon), (0, None))

    def equal(self, terms, b):
        self.equalities.append((terms, b))

    def below(self, terms, b):
        self.inequalities.append((terms, b))

    def sums_to(self, plus, b, minus=()):
        ones = [(c, np.ones((1, len(c)))) for c in plus]
        self.equal(ones + [(c, -np.ones((1, len(c)))) for c in minus], [b])

    def _matrix(self, terms_and_b):
        rows = []
        for terms, b in terms_and_b:
            block = np.zeros((len(b), len(self.bounds)))
            for columns, matrix in terms:
                block[:, columns] += matrix
            rows.append(np.column_stack([block, b]))
        rows = np.vstack(rows) if rows else np.zeros((0, len(self.bounds) + 1))
        return rows[:, :-1], rows[:, -1]

    def has_solution(self):
        A_eq, b_eq = self._matrix(self.equalities)
        A_ub, b_ub = self._matrix(self.inequalities)
        solved = linprog(
            np.zeros(len(self.bounds)),
            A_ub=A_ub,
            b_ub=b_ub,
            A_eq=A_eq,
            b_eq=b_eq,
            bounds=self.bounds,
            options={"primal_feasibility_tolerance": 1e-10},
        )
        assert solved.status in (0, 2)  # solved, or infeasible
        return solved.status == 0


def points_about(parts, place, rng):
    """1 mm in and out of the parts' corners, and two at random."""
    for part in parts:
        middle = part.mean(axis=0)
        for corner in part[rng.permutation(len(part))[:2]]:
            out = (corner - middle) / np.linalg.norm(corner - middle)
            yield from (corner - 1e-3 * out, corner + 1e-3 * out)
    for _ in range(2):
        yield rng.dirichlet(np.full(len(place.polygon), 0.5)) @ place.polygon


def compared(seed, cases):
    """How many footholds of random cases capture, do not, and mismatch.

    And how many do only thanks to a later region, beyond C_1.
    """
    rng = np.random.default_rng(seed)
    counts = {"capture": 0, "fail": 0, "mismatch": 0, "later": 0}
    for _ in range(cases):
        case = Case(rng)
        places = case.footing.places
        place = places[rng.integers(len(places))]
        parts = list(case.footing.parts(place, case.one_step, 0.0))
        for p in points_about(parts, place, rng):
            if contains(p, place.polygon, -1e-6):
                ours = any(contains(p, part) for part in parts)
                theirs = case.captures(p)
                counts["capture" if theirs else "fail"] += 1
                counts["mismatch"] += ours != theirs
                counts["later"] += theirs and not contains(p, case.one_step)
    return counts


def test_a_foothold_captures_if_and_only_if_some_sequence_does():
    """Oracle: the enumeration, for 25 random swings; 1,000 had none either."""
    counts = run_cache.once((__name__,), "1, 25", lambda: compared(1, 25))
    assert counts["mismatch"] == 0
    assert min(counts["capture"], counts["fail"], counts["later"]) >= 10


def test_half_planes_of_one_direction_do_not_exclude_each_other():
    """Oracle: by hand, p < -1, p < -2, p < -3 of one direction share points."""
    A = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    rows, b = without_last(A, np.array([-1.0, -2.0, -3.0, 0.0]))
    assert rows.shape == (0, 0) and b.shape == (0,)
    opposite = np.vstack([A, [-1.0, 0.0]])  # and p > -2.5: none
    _, b = without_last(opposite, np.array([-1.0, -2.0, -3.0, 0.0, 2.5]))
    assert b.min() < 0.0


def test_one_region_everywhere_is_no_ground_at_all():
    """Oracle: None, with which the flat functions go on, bit for bit."""
    schedule = swing()
    for size, expected in (20.0, True), (3.0, False):
        region = Region(vertices=rectangle(size, size).tolist())
        model = replace(MODEL, ground=Ground((region,), SOLE))
        geometry = swing_geometry(schedule, PARAMS, model, ALL)
        found = footing(schedule, PARAMS, model, ALL, geometry)
        assert (found is None) == expected
