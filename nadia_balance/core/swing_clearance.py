"""The edges of uneven ground on the way of the swing foot."""

import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.ground import Ground, Region
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.polygon import convex_hull, intersection
from nadia_balance.core.walking import (
    Array,
    ContactSchedule,
    FootPose,
    Immutable,
    Phase,
)

_PARTS = 40  # of the way, at whose ends the ground is looked at
_BESIDE = 0.01  # the foot may be beside its way by so much [m]
_RISE = 0.005  # above the straight line from start to goal, it is an edge [m]
_AHEAD = 0.06  # the foot waits so far before an edge that is too high [m]
_DESCENT = 0.1  # so far before the goal the clearance shrinks, to none [m]
_SHORTEST = 0.02  # a way that is shorter leads over no edge [m]


@dataclass(frozen=True, eq=False)
class SwingEdges(Immutable):
    """Where the way from `start` to `goal` (3,) [m] leads over edges.

    `heights` (n,) [m] are those that the centre of the sole must have there,
    at equal distances; minus infinity where there is no edge.
    """

    start: Array
    goal: Array
    heights: Array
    clearance: float  # that there is in these heights [m]

    @property
    def top(self) -> float:
        """Height [m] of the highest edge, or of the goal."""
        highest = float(self.heights.max()) - self.clearance
        return max(highest, float(self.goal[2]))

    @property
    def drop(self) -> float:
        """How far [m] the foot descends behind the last edge."""
        nearby = self.heights[-1 - _PARTS // 5 :].max()
        return max(float(nearby - self.goal[2]), 0.0)

    def needed(self, points: Array) -> Array:
        """Heights (k,) [m] that the sole must have at `points` (k, 2) [m]."""
        s = self._progress(points)
        below, above = np.floor(s).astype(int), np.ceil(s).astype(int)
        return np.asarray(np.maximum(self.heights[below], self.heights[above]))

    def are_in_the_way(self, p_WF: Array) -> bool:
        """True if a sole at `p_WF` (3,) [m] must rise before it goes on."""
        s = float(self._progress(p_WF[None, :2])[0])
        ahead = math.ceil(s + _PARTS * _AHEAD / self._length)
        highest = self.heights[math.floor(s) : ahead + 1].max()
        return bool(p_WF[2] < highest - 0.5 * self.clearance)

    @property
    def _length(self) -> float:
        return math.dist(self.start[:2], self.goal[:2])

    def _progress(self, points: Array) -> Array:
        """How many parts of the way there are behind `points` (k, 2)."""
        way = self.goal[:2] - self.start[:2]
        share = (points - self.start[:2]) @ way / (way @ way)
        return np.asarray(_PARTS * np.minimum(np.maximum(share, 0.0), 1.0))


def edges_on_way(
    schedule: ContactSchedule, model: PointMassModel, clearance: float
) -> SwingEdges | None:
    """Returns what the swing of `schedule` leads over; None: over no edge.

    An edge is where the ground is higher than the straight line from the
    sole that was lifted to the one that lands.
    """
    if schedule.phase is not Phase.SWING or not model.is_uneven:
        return None
    step = schedule.footsteps[0]
    start, goal = schedule.feet[step.side], step.pose
    length = math.dist(start.p_WF[:2], goal.p_WF[:2])
    if length < _SHORTEST:
        return None
    assert model.ground is not None  # it is uneven
    size = 1.0 + _BESIDE / np.abs(model.sole)
    found = touching_heights(model.ground, model.sole * size, start, goal)
    s = np.linspace(0.0, 1.0, _PARTS + 1)
    line = (1.0 - s) * start.p_WF[2] + s * goal.p_WF[2]
    above = clearance * np.minimum((1.0 - s) * length / _DESCENT, 1.0)
    heights = np.where(found > line + _RISE, found + above, -np.inf)
    if not np.any(heights > -np.inf):
        return None
    return SwingEdges(start.p_WF, goal.p_WF, heights, clearance)


def touching_heights(
    ground: Ground, sole: Array, start: FootPose, goal: FootPose
) -> Array:
    """Returns the heights (n,) [m] at which a sole on its way would touch.

    Those of the centre of the `sole` (m, 2) [m], at equal distances on the
    straight way from `start` to `goal`, while it turns and tilts as evenly;
    minus infinity over nothing.
    """
    turn = math.remainder(goal.yaw - start.yaw, math.tau)
    ends = [start.outline(sole), goal.outline(sole)]
    below = convex_hull(np.vstack(ends))
    regions = [
        region
        for region in ground.regions
        if len(intersection(region.polygon, below))
    ]
    heights = []
    for s in np.linspace(0.0, 1.0, _PARTS + 1).tolist():
        n = start.normal + s * (goal.normal - start.normal)
        n = n / math.hypot(*n.tolist())
        p_WF = start.p_WF + s * (goal.p_WF - start.p_WF)
        foot = FootPose(p_WF, start.yaw + s * turn, n)
        heights.append(_touching_height(regions, foot, foot.outline(sole)))
    return np.array(heights)


def _touching_height(
    regions: list[Region], foot: FootPose, outline: Array
) -> float:
    """Of the centre of the sole: both are planes, so it touches at a corner."""
    x, y, z = foot.normal.tolist()
    highest = -math.inf
    for region in regions:
        corners = intersection(region.polygon, outline)
        if len(corners):
            offsets = corners - foot.p_WF[:2]
            above = region.heights(corners) + offsets @ [x / z, y / z]
            highest = max(highest, float(above.max()))
    return highest
