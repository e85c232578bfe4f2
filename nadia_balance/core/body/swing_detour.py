"""The horizontal path of the swing foot past the stance leg.

A foothold beside the stance foot or across it is reached past its front or
its back; the swing leg never passes the far side.
"""

import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.bounds import bounded
from nadia_balance.core.walking.vocabulary import FootPose, Side

Point = tuple[float, float]

# Ratio of the largest braking to `max_acceleration` of a foot too fast to stop
# on its path.  A quintic from rest to rest peaks at 1.44 times bang-bang
# acceleration, but also has to correct lateral speed.
PEAK = 2.0

# Ratio of the remaining time of a foot at full speed, in the second half of its
# swing, to the time from rest.
UNDER_WAY = math.sqrt(0.5)

_AT_REST = np.zeros(2)
_TINY = 1e-9  # a shorter path has no direction: all speed is along it [m]


@dataclass(kw_only=True)
class SwingDetourParams:
    """Distances of the soles in passing, and limits of the foot's motion."""

    # Distances of the sole centres, in front of the stance foot or behind it,
    # and to its swing side, for a sole of 0.25 m x 0.12 m, a shin of 0.11 m x
    # 0.12 m, and 3 cm of clearance.
    ahead: float = bounded(
        0.28, least=0.0, most=1.0, unit="m", of="sole_length"
    )
    beside: float = bounded(
        0.15, least=0.0, most=1.0, unit="m", of="sole_width"
    )
    # Horizontal; accelerating the leg has a reaction on the rest of the robot.
    max_acceleration: float = bounded(50.0, above=0.0, unit="m/s^2")
    # Mean horizontal speed of a swing.
    max_speed: float = bounded(3.0, above=0.0, finite=False, unit="m/s")
    # Mean velocity of the descent to the ground.
    max_descent: float = bounded(0.9, above=0.0, finite=False, unit="m/s")
    # Deceleration of the descent to the touchdown velocity.
    max_braking: float = bounded(30.0, above=0.0, finite=False, unit="m/s^2")
    # Time above the foothold before touchdown, so that the foot does not slide.
    settling: float = bounded(0.01, least=0.0, most=0.2, unit="s")

    def time_from_rest(self, length: float) -> float:
        """Returns the least time [s] for a path of `length` [m] and landing.

        The foot accelerates for one half of the path and brakes for the other,
        with its mean speed limited to `max_speed`.
        """
        fastest = 2.0 * math.sqrt(length / self.max_acceleration)
        return max(fastest, length / self.max_speed) + self.settling


def way_round(
    start: Array,
    goal: Array,
    stance: FootPose,
    swing: Side,
    params: SwingDetourParams,
) -> Array:
    """Returns the points (n, 2) [m] in W of the shortest path to the goal.

    It leads in straight lines from `start` (2,) past up to two corners of the
    stance foot to `goal` (2,); both ends are included.  The corners are closer
    to the stance foot if start or goal is.
    """
    p, q = (_beside(stance, swing, *at.tolist()) for at in (start, goal))
    ahead = min(_length(p, params), _length(q, params))
    low, high = min(p[0], q[0]), max(p[0], q[0])
    corners = []
    if low <= -ahead < high:
        corners.append((-ahead, params.beside))
    if low < ahead <= high:
        corners.append((ahead, params.beside))
    way, left = [p], corners if q[0] > p[0] else corners[::-1]
    while left:  # shortest path: next is the point most to the swing side
        x, y = way[-1]
        nearest = max(
            [*left, q], key=lambda c: math.atan2(c[1] - y, abs(c[0] - x))
        )
        if nearest is q:
            break
        way.append(nearest)
        left = [c for c in left if abs(c[0] - q[0]) < abs(nearest[0] - q[0])]
    passed = [(x, swing.sign * y) for x, y in way[1:]]
    points = stance.to_world(np.array(passed)) if passed else ()
    return np.array((start, *points, goal))


def shortest_time(
    way: Array, params: SwingDetourParams, velocity: Array = _AT_REST
) -> float:
    """Returns the least time [s] of the foot to the end of the path `way`.

    The path has the points `way` (n, 2) [m], from `velocity` (2,) [m/s] to
    rest.  The foot accelerates for one part of the path and brakes for the
    other; or it brakes harder on the whole path; or, if it is too fast, it
    overshoots and returns.  Lateral and backward speed are ignored.
    """
    parts = (way[1:] - way[:-1]).tolist()
    length = sum(math.hypot(*part) for part in parts)
    (x, y), (vx, vy) = parts[0], velocity.tolist()
    v, d = math.hypot(vx, vy), math.hypot(x, y)
    if d > _TINY:
        v = max((x * vx + y * vy) / d, 0.0)
    a = params.max_acceleration
    slowest = length / params.max_speed
    stop = 0.5 * v * v / a
    if stop <= length:
        return max((2.0 * math.sqrt(a * (length + stop)) - v) / a, slowest)
    if stop <= PEAK * length:
        return 2.0 * length / v
    back = stop / PEAK - length
    return v / (PEAK * a) + 2.0 * math.sqrt(back / a)


def time_of_way(
    start: Array,
    goal: Array,
    stance: FootPose,
    swing: Side,
    params: SwingDetourParams,
) -> float:
    """Returns the least time [s] from rest at `start` to a landing at `goal`.

    Points (2,) [m] in W; the path passes the `stance` foot.
    """
    way = way_round(start, goal, stance, swing, params)
    return shortest_time(way, params) + params.settling


def _beside(stance: FootPose, swing: Side, x: float, y: float) -> Point:
    """Returns the point (x, y) of W in the sole frame; y to the swing side."""
    (x0, y0, _), yaw = stance.p_WF.tolist(), stance.yaw
    c, s, dx, dy = math.cos(yaw), math.sin(yaw), x - x0, y - y0
    return c * dx + s * dy, swing.sign * (c * dy - s * dx)


def _length(p: Point, params: SwingDetourParams) -> float:
    """Returns `ahead`, or less if `p` is closer in front or behind."""
    length, too_deep = abs(p[0]), params.beside - p[1]
    return length if 0.0 < params.ahead - length < too_deep else params.ahead
