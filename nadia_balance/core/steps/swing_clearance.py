"""The edges of uneven ground on the path of the swing foot."""

import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.body.ground import Ground, Region
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import convex_hull, intersection
from nadia_balance.core.walking import vocabulary as walking

_PARTS = 40  # intervals of the path, at whose ends the ground is evaluated
_BESIDE = 0.01  # lateral tolerance of the foot on its path [m]
_RISE = 0.005  # least height of an edge above the line start to goal [m]
_AHEAD = 0.06  # distance at which the foot waits before a higher edge [m]
_DESCENT = 0.1  # last distance in which the clearance falls to 0 [m]
_SHORTEST = 0.02  # shorter paths have no edges [m]


@dataclass(frozen=True, eq=False)
class SwingEdges(walking.Immutable):
    """The edges on the straight path from `start` to `goal` (3,) [m].

    `heights` (n,) [m] are the least heights of the sole's centre at equal
    distances on the path; minus infinity without an edge.
    """

    start: Array
    goal: Array
    heights: Array
    clearance: float  # included in `heights` [m]

    @property
    def top(self) -> float:
        """Height [m] of the highest edge, or of the goal."""
        highest = float(self.heights.max()) - self.clearance
        return max(highest, float(self.goal[2]))

    @property
    def drop(self) -> float:
        """Height [m] of descent after the last edge."""
        nearby = self.heights[-1 - _PARTS // 5 :].max()
        return max(float(nearby - self.goal[2]), 0.0)

    def needed(self, points: Array) -> Array:
        """Returns the least heights (k,) [m] of the sole at `points` (k, 2)."""
        s = self._progress(points)
        below, above = np.floor(s).astype(int), np.ceil(s).astype(int)
        return np.asarray(np.maximum(self.heights[below], self.heights[above]))

    def are_in_the_way(self, p_WF: Array) -> bool:
        """True if a sole at `p_WF` (3,) [m] must rise before it moves on."""
        s = float(self._progress(p_WF[None, :2])[0])
        ahead = math.ceil(s + _PARTS * _AHEAD / self._length)
        highest = self.heights[math.floor(s) : ahead + 1].max()
        return bool(p_WF[2] < highest - 0.5 * self.clearance)

    @property
    def _length(self) -> float:
        return math.dist(self.start[:2], self.goal[:2])

    def _progress(self, points: Array) -> Array:
        """Returns the passed path intervals (k,) [-] at `points` (k, 2)."""
        way = self.goal[:2] - self.start[:2]
        share = (points - self.start[:2]) @ way / (way @ way)
        return np.asarray(_PARTS * np.minimum(np.maximum(share, 0.0), 1.0))


def edges_on_way(
    schedule: walking.ContactSchedule, model: PointMassModel, clearance: float
) -> SwingEdges | None:
    """Returns the edges on the path of the swing of `schedule`, or None.

    An edge is ground above the straight line from lift-off to the foothold.
    """
    if schedule.phase is not walking.Phase.SWING or not model.is_uneven:
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
    ground: Ground, sole: Array, start: walking.FootPose, goal: walking.FootPose
) -> Array:
    """Returns the contact heights (n,) [m] of a sole along its path.

    They are those of the centre of the `sole` (m, 2) [m], at equal distances on
    the straight path from `start` to `goal`, while it turns and tilts evenly;
    minus infinity without ground.
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
        foot = walking.FootPose(p_WF, start.yaw + s * turn, n)
        heights.append(_touching_height(regions, foot, foot.outline(sole)))
    return np.array(heights)


def _touching_height(
    regions: list[Region], foot: walking.FootPose, outline: Array
) -> float:
    """Returns the contact height [m] of the centre of the sole.

    Sole and region are planes, so that they touch at a corner.
    """
    x, y, z = foot.normal.tolist()
    highest = -math.inf
    for region in regions:
        corners = intersection(region.polygon, outline)
        if len(corners):
            offsets = corners - foot.p_WF[:2]
            above = region.heights(corners) + offsets @ [x / z, y / z]
            highest = max(highest, float(above.max()))
    return highest
