"""Oracle: every sequence of regions, one linear program for each.

Its variables are all footholds, the weights of the corners of C_1 and, where
later steps find ground everywhere, these steps; nothing is eliminated.
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
from nadia_balance.core.ground_capture import footing
from nadia_balance.core.polygon import contains, convex_hull, halfspaces
from nadia_balance.core.reachability import in_world, total_region
from nadia_balance.core.walking import FootPose
from tests.example_walks import ALL, MODEL, OMEGA, SOLE, UNCROSSED, swing

PARAMS = CaptureRegionStepAdjusterParams()


def random_ground(rng):
    """Some stones about the stance foot: convex polygons, some of them bent."""
    regions = []
    for i, (x, y) in enumerate(
        itertools.product((-0.6, 0.0, 0.6), (-0.4, 0.3))
    ):
        middle = [x, y] + rng.uniform(-0.1, 0.1, 2)
        angles = np.sort(rng.uniform(0.0, math.tau, 6))
        corners = np.column_stack([np.cos(angles), np.sin(angles)])
        corners = middle + rng.uniform(0.25, 0.45) * corners
        polygon = convex_hull(corners)
        region = Region(name=f"{i}", vertices=polygon.tolist())
        if len(region.footholds(SOLE, 0.0, 0.0)):
            regions.append(region)
    return Ground(tuple(regions), SOLE, margin=0.0)


def random_case(rng):
    """A swing of three or more steps above a ground, and its C_1."""
    params = replace(
        PARAMS,
        ground_steps=int(rng.integers(1, 4)),
        finite_foot=bool(rng.integers(2)),
    )
    on = ALL if rng.integers(2) else UNCROSSED
    schedule = swing(
        num_steps=int(rng.integers(1, 5)),
        transfer=0.1,
        swing=rng.uniform(0.35, 0.7),
        turn=rng.uniform(-0.2, 0.2),
    )
    model = replace(MODEL, ground=random_ground(rng))
    geometry = swing_geometry(schedule, params, model, on)
    found = footing(schedule, params, model, on, geometry)
    start = rng.uniform(0.05, 0.4)
    # An ICP that comes near to one of the places.
    place = found.places[rng.integers(len(found.places))]
    stance, goal = geometry.foot.mean(axis=0), place.polygon.mean(axis=0)
    goal = goal + rng.uniform(-0.1, 0.1, 2)
    icp = stance + math.exp(-OMEGA * start) * (goal - stance)
    one_step = geometry.one_step_region(icp, (start, start + 0.05))
    return schedule, params, model, on, found, one_step


def captures(foothold, schedule, params, model, on, one_step, margin):
    """True if a linear program of any sequence has a solution."""
    steps = schedule.footsteps[: params.num_steps]
    count = min(params.ground_steps, len(steps))
    holds = [model.ground.footholds(step.pose.yaw) for step in steps[:count]]
    for n in range(1, count + 1):
        for chosen in itertools.product(*(filter(len, h) for h in holds[1:n])):
            if solves(
                foothold,
                chosen,
                n == count,
                schedule,
                params,
                model,
                on,
                one_step,
                margin,
            ):
                return True
    return False


def solves(
    foothold, chosen, goes_on, schedule, params, model, on, one_step, margin
):
    """True if these regions of the steps from the second on capture."""
    steps = schedule.footsteps[: params.num_steps]
    total = total_region(model.reach, on.cross_over)
    E = [
        math.exp(-OMEGA * (s.transfer_duration + s.swing_duration))
        for s in steps[1:]
    ]
    reaches = [
        in_world(total, FootPose(yaw=s.pose.yaw), s.side.other)
        for s in steps[:-1]
    ]
    foot = params.usable_foot(SOLE) if params.finite_foot else np.zeros((1, 2))
    feet = [
        convex_hull(in_world(foot, FootPose(yaw=s.pose.yaw), s.side.other))
        for s in steps
    ]
    n = len(chosen) + 1
    size, rows, bounds, equal, right = 0, [], [], [], []

    def variables(count):
        nonlocal size
        size += count
        return range(size - count, size)

    def add(terms, b, into, outof):
        rows = np.zeros((len(b), 60))
        for columns, matrix in terms:
            rows[:, list(columns)] += matrix
        into.append(rows)
        outof.append(b)

    positive = []

    def weights(polygon):
        """The weights of its corners; their sum is not fixed yet."""
        positive.extend(found := variables(len(polygon)))
        return found

    places = [variables(2) for _ in range(n)]
    eye = np.eye(2)
    add([(places[0], eye)], foothold, equal, right)
    for k in range(1, n):
        A, b = halfspaces(chosen[k - 1])
        add([(places[k], A)], b, rows, bounds)
        A, b = halfspaces(reaches[k - 1])
        add([(places[k], A), (places[k - 1], -A)], b, rows, bounds)
    # Where the ICP is at touchdown, minus all that captures it: 0.
    balance = []
    left = 1.0
    for k in range(n):
        last = k == n - 1
        share = left if last else left * (1.0 - E[k])
        balance.append((places[k], -share * eye))
        if not last:
            w = weights(feet[k])
            add([(w, np.ones((1, len(w))))], [1.0], equal, right)
            balance.append((w, -share * feet[k].T))
            left *= E[k]
    later = len(steps) - n if goes_on else 0
    # Of the rest: each foot's share in the end, and the scaled steps.
    before = None
    for k in range(n - 1, n + later):
        w = weights(feet[k])
        balance.append((w, -left * feet[k].T))
        if before is None:
            total_left = [(w, np.ones((1, len(w))))]
            remaining = [w]
        else:
            remaining.append(w)
        before = w
    shares = [(w, np.ones((1, len(w)))) for w in remaining]
    add(shares, [1.0], equal, right)
    for j in range(later):
        # What is left after the step is at most E of what was before it.
        tail, whole = shares[j + 1 :], shares[j:]
        e = E[n - 1 + j]
        add(
            [(c, m) for c, m in tail] + [(c, -e * m) for c, m in whole],
            [0.0],
            rows,
            bounds,
        )
        w = weights(reaches[n - 1 + j])
        add(
            [(w, np.ones((1, len(w))))] + [(c, -m) for c, m in tail],
            [0.0],
            equal,
            right,
        )
        balance.append((w, -left * reaches[n - 1 + j].T))
    point = variables(2)
    add([*balance, (point, eye)], np.zeros(2), equal, right)
    # Of ICPs `margin` inside what remains of C_1 when all else is added.
    w = weights(one_step)
    add([(w, np.ones((1, len(w))))], [1.0], equal, right)
    add([(w, one_step.T), (point, -eye)], np.zeros(2), equal, right)
    solved = linprog(
        np.zeros(size),
        A_ub=np.vstack(rows)[:, :size] if rows else None,
        b_ub=np.concatenate(bounds) if rows else None,
        A_eq=np.vstack(equal)[:, :size],
        b_eq=np.concatenate(right),
        bounds=[(0 if i in set(positive) else None, None) for i in range(size)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10},
    )
    assert solved.status in (0, 2)
    return solved.status == 0


def points_about(parts, place, rng):
    """In the place at random, and 1 mm in and out of the parts' corners."""
    for part in parts:
        middle = part.mean(axis=0)
        for corner in part:
            out = (corner - middle) / np.linalg.norm(corner - middle)
            yield from (corner - 1e-3 * out, corner + 1e-3 * out)
    for _ in range(4):
        yield rng.dirichlet(np.full(len(place.polygon), 0.5)) @ place.polygon


def compared(seed, count):
    """How many points were compared, are inside, and are told otherwise."""
    rng = np.random.default_rng(seed)
    tried = inside = wrong = only_later = 0
    while tried < count:
        *case, found, one_step = random_case(rng)
        for place in found.places:
            parts = list(found.parts(place, one_step, 0.0))
            for p in points_about(parts, place, rng):
                if not contains(p, place.polygon, -1e-6):
                    continue
                ours = any(contains(p, part) for part in parts)
                theirs = captures(p, *case, one_step, 0.0)
                tried, inside = tried + 1, inside + theirs
                wrong += ours != theirs
    return tried, inside, wrong


if __name__ == "__main__":
    import sys

    print(compared(int(sys.argv[1]), int(sys.argv[2])))
