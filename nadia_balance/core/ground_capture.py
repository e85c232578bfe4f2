"""Capture regions over sequences of ground regions.

The first `ground_steps` footholds p_1, ..., p_n are each in a region of the
ground and within reach of the previous one; steps last as planned, and the
robot may stop after any of them.  Later steps, up to N, ignore the ground.
With E_k as in `later_steps`, the ICP at touchdown is then

    sum of a_k p_k + rest,  a_k = E_2 ... E_k (1 - E_k+1),  a_n = E_2 ... E_n,

and the foothold captures if this ICP can be in C_1.  For one sequence of
regions the conditions are linear: eliminating p_2, ..., p_n leaves a convex
polygon of p_1.  The set of all capturing footholds is the union of these
polygons.
"""

import functools
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.capture_region import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
    later_feet,
    later_reaches,
    later_steps,
    step_contractions,
)
from nadia_balance.core.ground import Ground, Region
from nadia_balance.core.mechanisms import Mechanisms
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.polygon import (
    clip_all,
    contains,
    convex_hull,
    halfspaces,
    intersection,
    minkowski_sum,
)
from nadia_balance.core.walking import Array, ContactSchedule, Immutable

Rows = tuple[Array, Array]  # A (m, 2 n), b (m,): A (p_1, ..., p_n) <= b

_PARALLEL = 1e-14  # sine of an angle that counts as 0 [-]
_LINE = 1e-6  # sum of sines below which three normals are collinear [-]
_ORIGIN = np.zeros((1, 2))


@dataclass(frozen=True, eq=False)
class Sequence(Immutable):
    """A sequence of regions, one for each foothold.

    `polygons` bound the footholds 1, ..., n; `rows` are the constraints of the
    steps k = 2, ..., n on p_1, ..., p_k.
    """

    polygons: tuple[Array, ...]
    rows: tuple[Rows, ...]


@dataclass(frozen=True, eq=False)
class Place(Immutable):
    """A convex part of one region for the next foothold.

    `polygon` (n, 2) [m] in W is within the reachability region `reach`, and
    clear of the stance foot; `region` is the index of the ground region.
    """

    reach: str
    region: int
    polygon: Array
    sequences: tuple[Sequence, ...]


@dataclass(frozen=True, eq=False)
class Footing(Immutable):
    """The places of the ground for one swing; constant during the swing.

    `weights[n - 1]` are a_1, a_1, ..., a_n, a_n [-], for x and y;
    `rests[n - 1]` is the rest for n regions, a polygon (k, 2) [m].
    """

    ground: Ground
    places: tuple[Place, ...]
    weights: tuple[Array, ...]
    rests: tuple[Array, ...]

    def parts(
        self, place: Place, one_step: Array, margin: float
    ) -> Iterator[Array]:
        """Yields the convex parts (n, 2) [m] of `place` that capture the ICP.

        `one_step` (k, 2) [m] is C_1.  The ICP at touchdown is at least `margin`
        [m] inside the captured set.
        """
        couplings: dict[int, Rows] = {}
        for sequence in (Sequence((place.polygon,), ()), *place.sequences):
            n = len(sequence.polygons)
            if n not in couplings:
                rest = self.rests[n - 1]
                A, b = halfspaces(minkowski_sum(one_step, -rest))
                couplings[n] = np.tile(A, n) * self.weights[n - 1], b - margin
            part = place.polygon
            A, b = first_foothold(sequence, couplings[n])
            if len(part := clip_all(part, A, b) if len(b) else part):
                yield part


def first_foothold(sequence: Sequence, coupling: Rows) -> Rows:
    """Returns the constraints on p_1: rows A (m, 2), b (m,) [m].

    `coupling` are rows on all footholds together.
    """
    derived = coupling
    for k in range(len(sequence.rows), 0, -1):
        A, b = sequence.rows[k - 1]
        own = np.concatenate([A, derived[0]]), np.concatenate([b, derived[1]])
        derived = _needed(*without_last(*own), sequence.polygons[:k])
    return derived


def without_last(A: Array, b: Array) -> Rows:
    """Returns the rows A (m, 2 n), b (m,) [m] with p_n eliminated.

    The rows are half-planes of p_n, which share a point if any three of them do
    (Helly's theorem).  Three half-planes are disjoint only if a positive
    combination of their normals is 0 while the same combination of their other
    terms exceeds that of b: these combinations replace the rows.
    """
    normals = A[:, -2:]
    size = np.hypot(normals[:, 0], normals[:, 1])
    about = size > _PARALLEL
    free, free_b = A[~about, :-2], b[~about]
    A, b = A[about] / size[about, None], b[about] / size[about]
    i, j, k = _triples(len(A))
    x, y = A[:, -2], A[:, -1]
    cross = np.outer(x, y) - np.outer(y, x)
    weights = np.stack([cross[j, k], cross[k, i], cross[i, j]])
    positive = (weights > -_PARALLEL).all(axis=0)
    positive |= (weights < _PARALLEL).all(axis=0)
    weights = np.abs(weights)
    total = weights.sum(axis=0)
    positive &= total > _LINE
    i, j, k = i[positive], j[positive], k[positive]
    u, v, w = (weights[:, positive] / total[positive])[..., None]
    joint = np.column_stack([A[:, :-2], b])
    joint = u * joint[i] + v * joint[j] + w * joint[k]
    return (
        np.concatenate([free, joint[:, :-1]]),
        np.concatenate([free_b, joint[:, -1]]),
    )


@functools.cache
def _triples(count: int) -> NDArray[np.intp]:
    """Returns all indices i < j < k < count, (3, m)."""
    return np.array(
        list(itertools.combinations(range(count), 3)), dtype=np.intp
    ).T.reshape(3, -1)


def _needed(A: Array, b: Array, polygons: tuple[Array, ...]) -> Rows:
    """Returns the rows that are not redundant in these polygons."""
    most = sum(
        (A[:, 2 * k : 2 * k + 2] @ polygon.T).max(axis=1)
        for k, polygon in enumerate(polygons)
    )
    needed = most > b
    return A[needed], b[needed]


def footing(
    schedule: ContactSchedule,
    params: CaptureRegionStepAdjusterParams,
    model: PointMassModel,
    on: Mechanisms,
    geometry: SwingGeometry,
) -> Footing | None:
    """Returns the footing of the swing of `geometry`.

    None if one region covers all reachable footholds.
    """
    ground = model.ground
    if ground is None:
        return None
    steps = schedule.footsteps[: params.num_steps]
    count = min(params.ground_steps, len(steps))
    reaches = later_reaches(steps, model, on)
    holds = [ground.footholds(step.pose.yaw) for step in steps[:count]]
    if _is_everywhere(holds, geometry, reaches):
        return None
    planes = [_plane(region) for region in ground.regions]
    at_stance = np.array([0.0, 0.0, geometry.stance.p_WF[2]])
    rise = model.reach.rise_max
    places = []
    for name, reach in geometry.regions.items():
        for region, hold in enumerate(holds[0]):
            part = intersection(reach, hold) if len(hold) else hold
            A, b = _rise_rows(at_stance, planes[region], rise)
            part = _clipped(part, A[:, 2:], b)
            for free in _clear_of_stance(part, geometry):
                of = holds[1:], reaches, planes, rise
                sequences = _sequences((free,), (), region, *of)
                places.append(Place(name, region, free, tuple(sequences)))
    contractions = step_contractions(schedule.footsteps, params, model.omega)
    feet = later_feet(schedule.footsteps, params, model.sole)
    feet = feet or [_ORIGIN] * len(steps)
    weights, rests = [], []
    for n in range(1, count + 1):
        left = np.cumprod([1.0, *contractions[: n - 1]])
        weight = left - np.append(left[1:], 0.0)
        rest = feet[n - 1]
        if n == count:
            later = reaches[n - 1 :], contractions[n - 1 :], feet[n - 1 :]
            rest = later_steps(*later)[-1]
        rest = weight[-1] * rest
        for share, foot in zip(weight[:-1], feet, strict=False):
            rest = minkowski_sum(rest, share * foot)
        weights.append(weight.repeat(2))
        rests.append(rest)
    return Footing(ground, tuple(places), tuple(weights), tuple(rests))


def _is_everywhere(
    holds: list[tuple[Array, ...]],
    geometry: SwingGeometry,
    reaches: list[Array],
) -> bool:
    """True if one region holds all footholds that the steps can reach."""
    extent = convex_hull(np.concatenate(list(geometry.regions.values())))
    for reach in reaches[: len(holds) - 1]:
        extent = minkowski_sum(extent, convex_hull(np.vstack([reach, _ORIGIN])))
    return any(
        all(len(hold) and contains(p, hold) for hold in same for p in extent)
        for same in zip(*holds, strict=True)
    )


def _plane(region: Region) -> Array:
    """Returns c (3,) such that the height at p is [p, 1] . c [m]."""
    z = region.heights(np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]))
    return np.asarray(z - [z[2], z[2], 0.0])


def _rise_rows(last: Array, plane: Array, rise: float) -> Rows:
    """Returns rows that limit the step up or down between planes to `rise`."""
    row = np.concatenate([-last[:2], plane[:2]])
    up = plane[2] - last[2]
    return np.array([row, -row]), np.array([rise - up, rise + up])


def _clipped(polygon: Array, A: Array, b: Array) -> Array:
    """Returns the polygon, clipped by the rows that are not redundant."""
    if not len(polygon):
        return polygon
    binds = (A @ polygon.T).max(axis=1) > b
    if ((A @ polygon.T).min(axis=1) > b).any():
        return np.empty((0, 2))
    return clip_all(polygon, A[binds], b[binds]) if binds.any() else polygon


def _clear_of_stance(part: Array, geometry: SwingGeometry) -> list[Array]:
    """Returns the convex parts that are not `blocked` by the stance foot."""
    if not len(part):
        return []
    if not len(clip_all(part, geometry.stance_A, geometry.stance_b)):
        return [part]
    return geometry.free_parts(part)


def _sequences(
    polygons: tuple[Array, ...],
    rows: tuple[Rows, ...],
    region: int,
    holds: list[tuple[Array, ...]],
    reaches: list[Array],
    planes: list[Array],
    rise: float,
) -> Iterator[Sequence]:
    """Yields all sequences that extend `polygons`, the last in `region`."""
    if not holds:
        return
    last, reach = polygons[-1], reaches[0]
    around = minkowski_sum(last, reach)
    for following, hold in enumerate(holds[0]):
        part = intersection(hold, around) if len(hold) else hold
        if not len(part):
            continue
        climb = _rise_rows(planes[region], planes[following], rise)
        step = _step_rows(last, hold, reach, climb, len(polygons) + 1)
        if step is None:
            continue
        now, then = (*polygons, part), (*rows, step)
        yield Sequence(now, then)
        of = holds[1:], reaches[1:], planes, rise
        yield from _sequences(now, then, following, *of)


def _step_rows(
    last: Array, hold: Array, reach: Array, climb: Rows, n: int
) -> Rows | None:
    """Returns the rows of step n: p_n in `hold`, p_n - p_n-1 in `reach`.

    The rows `climb` limit the rise; None if they are infeasible.
    """
    A, b = halfspaces(hold)
    R, r = halfspaces(reach)
    joint = np.concatenate([np.hstack([-R, R]), climb[0]])
    limit = np.concatenate([r, climb[1]])
    of_last, of_hold = joint[:, :2] @ last.T, joint[:, 2:] @ hold.T
    least = of_last.min(axis=1) + of_hold.min(axis=1)
    if (least[len(R) :] > climb[1]).any():
        return None
    binds = of_hold.max(axis=1) + of_last.max(axis=1) > limit
    joint, limit = joint[binds], limit[binds]
    both = np.zeros((len(A) + len(joint), 2 * n))
    both[: len(A), -2:] = A
    both[len(A) :, -4:] = joint
    return both, np.concatenate([b, limit])
