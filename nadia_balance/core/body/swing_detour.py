"""The path of the swing foot past the stance leg and over uneven ground.

A foothold beside the stance foot or across it is reached past its front or
its back; the swing leg never passes the far side.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import Point, convex_hull, intersection
from nadia_balance.core.walking.state import (
    ContactSchedule,
    FootPose,
    Immutable,
    Phase,
    Side,
)
from nadia_balance.parameters.bounds import bounded, parameters

# Ratio of the largest braking to `max_acceleration` of a foot too fast to stop
# on its path.  A quintic from rest to rest peaks at 1.44 times bang-bang
# acceleration, but also has to correct lateral speed.
PEAK = 2.0

# Remaining time of a foot at full speed half-way, over the time from rest [-].
UNDER_WAY = math.sqrt(0.5)

_AT_REST = (0.0, 0.0)
_TINY = 1e-9  # a shorter path has no direction: all speed is along it [m]
_PARTS = 40  # intervals of the path, at whose ends the ground is evaluated
_BESIDE = 0.01  # lateral tolerance of the foot on its path [m]
_RISE = 0.005  # least height of an edge above the line start to goal [m]
_AHEAD = 0.06  # distance at which the foot waits before a higher edge [m]
_DESCENT = 0.1  # last distance in which the clearance falls to 0 [m]
_SHORTEST = 0.02  # shorter paths have no edges [m]


@parameters
class SwingDetourParams:
    """Distances of the soles in passing, and limits of the foot's motion.

    The distances are for a sole of 0.25 m x 0.12 m, a shin of 0.11 m x 0.12 m,
    and 3 cm of clearance.
    """

    ahead: float = bounded(
        0.28,
        least=0,
        most=1,
        unit="m",
        of="sole_length",
        doc="distance of the sole centres, in front of the stance foot or "
        "behind it",
    )
    beside: float = bounded(
        0.15,
        least=0,
        most=1,
        unit="m",
        of="sole_width",
        doc="distance of the sole centres, to the swing side",
    )
    max_acceleration: float = bounded(
        50.0,
        above=0.0,
        unit="m/s^2",
        doc="horizontal; accelerating the leg has a reaction on the rest of "
        "the robot",
    )
    max_speed: float = bounded(
        3.0,
        above=0.0,
        finite=False,
        unit="m/s",
        doc="mean horizontal speed of a swing",
    )
    max_descent: float = bounded(
        0.9,
        above=0.0,
        finite=False,
        unit="m/s",
        doc="mean velocity of the descent to the ground",
    )
    max_braking: float = bounded(
        30.0,
        above=0.0,
        finite=False,
        unit="m/s^2",
        doc="deceleration of the descent to the touchdown velocity",
    )
    settling: float = bounded(
        0.02,
        least=0.0,
        most=0.2,
        unit="s",
        doc="time above the foothold before touchdown, so that the foot does "
        "not slide",
    )

    def time_from_rest(self, length: float) -> float:
        """The least time for a path and landing.

        The foot accelerates for one half of the path and brakes for the other,
        with its mean speed limited: max(2 sqrt(length / max_acceleration),
        length / max_speed) + settling.

        Args:
            length: of the path [m].

        Returns:
            Time [s].
        """
        return self.settling + max(
            2.0 * math.sqrt(length / self.max_acceleration),
            length / self.max_speed,
        )

    def way_round(
        self, start: Array, goal: Array, stance: FootPose, swing: Side
    ) -> Array:
        """Minimises the length of a path past the stance foot.

        It leads in straight lines past up to two corners of the stance foot.
        The corners are closer to the stance foot if start or goal is.

        Args:
            start: where the foot is (2,) in W [m].
            goal: its foothold (2,) in W [m].
            stance: pose of the stance foot in W.
            swing: side of the swing foot.

        Returns:
            Points (n, 2) in W [m], `start` and `goal` included.
        """
        return np.array(
            self._way(start.tolist(), goal.tolist(), stance, swing=swing)
        )

    def _way(
        self, start: Point, goal: Point, stance: FootPose, swing: Side
    ) -> list[Point]:
        """Returns the points of `way_round`."""
        p = _beside(stance, swing, *start)
        q = _beside(stance, swing, *goal)
        ahead = min(self._length(p), self._length(q))
        low, high = min(p[0], q[0]), max(p[0], q[0])
        corners = []
        if low <= -ahead < high:
            corners.append((-ahead, self.beside))
        if low < ahead <= high:
            corners.append((ahead, self.beside))
        path, left = [p], corners if q[0] > p[0] else corners[::-1]
        while left:  # shortest path: next is the point most to the swing side
            x, y = path[-1]
            corner = max(
                [*left, q], key=lambda c: math.atan2(c[1] - y, abs(c[0] - x))
            )
            if corner is q:
                break
            path.append(corner)
            left = [c for c in left if abs(c[0] - q[0]) < abs(corner[0] - q[0])]
        if len(path) == 1:
            return [start, goal]
        passed = np.array([(x, swing.sign * y) for x, y in path[1:]])
        return [start, *stance.to_world(passed).tolist(), goal]

    def shortest_time(
        self, path: Array, velocity: Array | None = None
    ) -> float:
        """The least time of the foot to the end of a path, where it rests.

        The foot accelerates and brakes; or brakes harder on the whole path; or,
        too fast, overshoots and returns.  Only forward speed counts.

        Args:
            path: points (n, 2) [m].
            velocity: at its begin (2,) [m/s]; None: at rest.

        Returns:
            Time [s].
        """
        return self._shortest_time(
            path.tolist(), _AT_REST if velocity is None else velocity.tolist()
        )

    def _shortest_time(self, path: list[Point], velocity: Point) -> float:
        """Returns the `shortest_time` [s]."""
        parts = [
            (x1 - x0, y1 - y0)
            for (x0, y0), (x1, y1) in itertools.pairwise(path)
        ]
        length = sum(math.hypot(x, y) for x, y in parts)
        (x, y), (vx, vy) = parts[0], velocity
        v, d = math.hypot(vx, vy), math.hypot(x, y)
        if d > _TINY:
            v = max((x * vx + y * vy) / d, 0.0)
        a = self.max_acceleration
        stop = 0.5 * v * v / a
        if stop <= length:
            return max(
                (2.0 * math.sqrt(a * (length + stop)) - v) / a,
                length / self.max_speed,
            )
        if stop <= PEAK * length:
            return 2.0 * length / v
        return v / (PEAK * a) + 2.0 * math.sqrt((stop / PEAK - length) / a)

    def time_of_way(
        self, start: Array, goal: Array, stance: FootPose, swing: Side
    ) -> float:
        """The least time from rest to landing, past the stance foot.

        Args:
            start: where the foot is (2,) in W [m].
            goal: its foothold (2,) in W [m].
            stance: pose of the stance foot in W.
            swing: side of the swing foot.

        Returns:
            Time [s].
        """
        path = self._way(start.tolist(), goal.tolist(), stance, swing=swing)
        return self.settling + self._shortest_time(path, _AT_REST)

    def _length(self, p: Point) -> float:
        """Returns `ahead`, or less if `p` is closer in front or behind."""
        length, too_deep = abs(p[0]), self.beside - p[1]
        return length if 0.0 < self.ahead - length < too_deep else self.ahead


def _beside(stance: FootPose, swing: Side, x: float, y: float) -> Point:
    """Returns the point (x, y) of W in the sole frame; y to the swing side."""
    (x0, y0, _), yaw = stance.p_WF.tolist(), stance.yaw
    c, s, dx, dy = math.cos(yaw), math.sin(yaw), x - x0, y - y0
    return c * dx + s * dy, swing.sign * (c * dy - s * dx)


@dataclass(frozen=True, eq=False)
class SwingEdges(Immutable):
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
        return max(
            float(self.heights.max()) - self.clearance, float(self.goal[2])
        )

    @property
    def drop(self) -> float:
        """Height [m] of descent after the last edge."""
        return max(
            float(self.heights[-1 - _PARTS // 5 :].max() - self.goal[2]), 0.0
        )

    def needed(self, points: Array) -> Array:
        """The least heights of the sole.

        Args:
            points: where its centre is (k, 2) in W [m].

        Returns:
            Heights (k,) in W [m].
        """
        s = self._progress(points)
        below, above = np.floor(s).astype(int), np.ceil(s).astype(int)
        return np.asarray(np.maximum(self.heights[below], self.heights[above]))

    def are_in_the_way(self, p_WF: Array) -> bool:
        """Whether a sole must rise before it moves on.

        Args:
            p_WF: its centre (3,) in W [m].

        Returns:
            True before an edge that is higher, by half of the clearance.
        """
        s = float(self._progress(p_WF[None, :2])[0])
        length = math.dist(self.start[:2], self.goal[:2])
        ahead = math.ceil(s + _PARTS * _AHEAD / length)
        highest = self.heights[math.floor(s) : ahead + 1].max()
        return bool(p_WF[2] < highest - 0.5 * self.clearance)

    def _progress(self, points: Array) -> Array:
        """Returns the passed path intervals (k,) [-] at `points` (k, 2)."""
        path = self.goal[:2] - self.start[:2]
        share = (points - self.start[:2]) @ path / (path @ path)
        return np.asarray(_PARTS * np.minimum(np.maximum(share, 0.0), 1.0))


def edges_on_way(
    schedule: ContactSchedule, ground: Ground | None, clearance: float
) -> SwingEdges | None:
    """The edges on the path of the present swing.

    An edge is ground above the straight line from lift-off to the foothold.

    Args:
        schedule: feet, phase and footsteps.
        ground: the regions; None: unlimited level ground.
        clearance: of the sole over an edge [m].

    Returns:
        The edges; None if there are none, or no swing.
    """
    if schedule.phase is not Phase.SWING or ground is None or ground.is_level:
        return None
    step = schedule.footsteps[0]
    start, goal = schedule.feet[step.side], step.pose
    length = math.dist(start.p_WF[:2], goal.p_WF[:2])
    if length < _SHORTEST:
        return None
    touching = touching_heights(ground, start, goal)
    s = np.linspace(0.0, 1.0, _PARTS + 1)
    line = (1.0 - s) * start.p_WF[2] + s * goal.p_WF[2]
    above = clearance * np.minimum((1.0 - s) * length / _DESCENT, 1.0)
    heights = np.where(touching > line + _RISE, touching + above, -np.inf)
    if not np.any(heights > -np.inf):
        return None
    return SwingEdges(
        start=start.p_WF, goal=goal.p_WF, heights=heights, clearance=clearance
    )


def touching_heights(ground: Ground, start: FootPose, goal: FootPose) -> Array:
    """The contact heights of a sole along its path.

    They are those of the centre of the sole, _BESIDE larger on each side, at
    equal distances on the straight path, while it turns and tilts evenly.

    Args:
        ground: the regions, and the sole.
        start: pose at lift-off in W.
        goal: pose of the foothold in W.

    Returns:
        Heights (n,) in W [m]; minus infinity without ground.
    """
    sole = ground.sole * (1.0 + _BESIDE / np.abs(ground.sole))
    turn = math.remainder(goal.yaw - start.yaw, math.tau)
    below = convex_hull(np.vstack([start.outline(sole), goal.outline(sole)]))
    regions = [r for r in ground.regions if len(intersection(r.polygon, below))]
    heights = []
    for s in np.linspace(0.0, 1.0, _PARTS + 1).tolist():
        n = start.normal + s * (goal.normal - start.normal)
        n = n / math.hypot(*n.tolist())
        p_WF = start.p_WF + s * (goal.p_WF - start.p_WF)
        outline = FootPose(p_WF, start.yaw + s * turn, n).outline(sole)
        (x, y, z), highest = n.tolist(), -math.inf
        for region in regions:  # planes, which touch the sole at a corner
            corners = intersection(region.polygon, outline)
            if len(corners):
                rise = (corners - p_WF[:2]) @ [x / z, y / z]
                above = float((region.heights(corners) + rise).max())
                highest = max(highest, above)
        heights.append(highest)
    return np.array(heights)
