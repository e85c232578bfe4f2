"""The way of the swing foot round the stance leg, seen from above.

Whatever stands beside the stance foot or across it can only be reached round
its front or round its back: the swing leg never goes round the far side.
"""

import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.walking import Array, FootPose, Side

_AT_REST = np.zeros(2)
_TINY = 1e-9  # a shorter way has no direction: all speed is along it [m]

# A foot that is too fast to stop on its way brakes with up to so many times
# the acceleration.  A quintic has 1.44 times that of full thrust forth and
# back, but also has to make good for speed across the way.
PEAK = 2.0


@dataclass(kw_only=True)
class SwingDetourParams:
    """How far the soles stay apart while one passes, and how fast it does."""

    # Of the sole centres.  A sole is 0.25 m x 0.12 m, a shin 0.11 m x 0.12 m;
    # 3 cm of air.
    ahead: float = 0.28  # in front of the stance foot, and behind it [m]
    beside: float = 0.15  # to the swing side of the stance foot [m]
    # Horizontally, all the way forth and then back.  The rest of the body has
    # to bear what accelerates the leg [m/s^2].
    max_acceleration: float = 35.0

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name in ("ahead", "beside"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} = {value}: must be in [0, 1] m")
        if not 0.0 < self.max_acceleration < math.inf:
            raise ValueError(
                f"max_acceleration = {self.max_acceleration}: "
                "must be finite and > 0 m/s^2"
            )


def way_round(
    start: Array,
    goal: Array,
    stance: FootPose,
    swing: Side,
    params: SwingDetourParams,
) -> Array:
    """Returns the points (n, 2) [m] in W of the shortest way to the goal.

    From `start` (2,) round none, one or two corners of the stance foot to
    `goal` (2,), in straight lines; both are in the result.  A start or goal
    that is nearer to the front or back of the stance foot than `ahead` is
    passed on its own side all the same.
    """
    mirror = np.array([1.0, float(swing.sign)])  # y toward the swing side
    p, q = (mirror * stance.to_sole(point[None])[0] for point in (start, goal))
    ahead = min(_length(p, params), _length(q, params))
    low, high = min(p[0], q[0]), max(p[0], q[0])
    corners = []
    if low <= -ahead < high:
        corners.append(np.array([-ahead, params.beside]))
    if low < ahead <= high:
        corners.append(np.array([ahead, params.beside]))
    way, left = [p], corners if q[0] > p[0] else corners[::-1]
    while left:  # a taut string: always the point seen most to the swing side
        nearest = max([*left, q], key=lambda c: _slope(c - way[-1]))
        if nearest is q:
            break
        way.append(nearest)
        left = [c for c in left if abs(c[0] - q[0]) < abs(nearest[0] - q[0])]
    return stance.to_world(np.array([*way, q]) * mirror)


def shortest_time(
    way: Array, params: SwingDetourParams, velocity: Array = _AT_REST
) -> float:
    """Returns how long [s] the foot takes at least to the end of the `way`.

    Along the points `way` (n, 2) [m], from `velocity` (2,) [m/s] to rest: it
    accelerates for one part of the way and brakes for the other; or it brakes
    harder, all the way; or, if it is too fast for that, comes back.  Speed
    across the way, or away from it, does not count.
    """
    parts = (way[1:] - way[:-1]).tolist()
    length = sum(math.hypot(*part) for part in parts)
    (x, y), (vx, vy) = parts[0], velocity.tolist()
    v, d = math.hypot(vx, vy), math.hypot(x, y)
    if d > _TINY:
        v = max((x * vx + y * vy) / d, 0.0)
    a = params.max_acceleration
    stop = 0.5 * v * v / a
    if stop <= length:
        return (2.0 * math.sqrt(a * (length + stop)) - v) / a
    if stop <= PEAK * length:
        return 2.0 * length / v
    back = stop / PEAK - length
    return v / (PEAK * a) + 2.0 * math.sqrt(back / a)


def _length(p: Array, params: SwingDetourParams) -> float:
    """Returns `ahead`, or less if `p` is in front or behind and nearer."""
    length = abs(float(p[0]))
    too_deep = params.beside - float(p[1])
    return length if 0.0 < params.ahead - length < too_deep else params.ahead


def _slope(d: Array) -> float:
    return math.atan2(d[1], abs(d[0]))
