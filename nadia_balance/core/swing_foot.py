"""The swing foot's reference: never a jump, whatever the goal or clock do.

Each tick continues from the previous reference with the one quintic that
meets the goal at the time that is left.  While goal and clock stay as they
were, this is the same polynomial as before; when they change, position,
velocity and acceleration still continue.  What has to be passed on the way,
the apex and the corners of the stance foot, is dropped shortly before.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from nadia_balance.core.quintic import (
    end_beyond,
    quintic,
    quintic_at,
    time_to_pass,
)
from nadia_balance.core.swing_detour import (
    PEAK,
    SwingDetourParams,
    shortest_time,
    way_round,
)
from nadia_balance.core.walking import (
    Array,
    FootPose,
    Phase,
    WalkingState,
)

XY, Z, YAW = slice(2), slice(2, 3), 3

# The time that the foot needs is stretched in such steps, and so often at the
# most, until its acceleration is no more than PEAK times the largest [-].
_STRETCH, _STRETCHES = 1.1, 8
_CHECKED = np.linspace(0.1, 1.0, 10)[:, None]  # parts of the time to go

_SOON = 0.02  # what is so near in time is not aimed at any more [s]
_THERE = 0.01  # so near to its foothold, a foot may come down [m]
_FALL = 0.175  # with less time left, a foot is not lifted so high [s]


@dataclass(kw_only=True)
class SwingFootParams:
    """Shape of the swing."""

    height: float = 0.10  # apex above the higher of start and goal [m]
    # The apex of a leg that uncrosses behind or before the other one: its knee
    # would meet the other shin.
    uncrossing_height: float = 0.06  # [m]
    touchdown_velocity: float = 0.20  # downward, at and after the end [m/s]
    detour: SwingDetourParams = field(default_factory=SwingDetourParams)

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name in ("height", "uncrossing_height"):
            if not 0.0 < (value := getattr(self, name)) <= 0.5:
                raise ValueError(f"{name} = {value}: must be in (0, 0.5] m")
        if not 0.0 <= self.touchdown_velocity <= 1.0:
            raise ValueError(
                f"touchdown_velocity = {self.touchdown_velocity}: "
                "must be in [0, 1] m/s"
            )
        self.detour.validate()


@dataclass(frozen=True, eq=False)
class FootMotion:
    """Rows p, v, a of [x, y, z, yaw] of the sole in W, shape (3, 4)."""

    pva: Array

    @classmethod
    def at_rest(cls, pose: FootPose) -> "FootMotion":
        """The foot stands at `pose`."""
        pva = np.zeros((3, 4))
        pva[0] = *pose.p_WF, pose.yaw
        return cls(pva)

    def as_vector(self) -> Array:
        """[p(3), v(3), a(3), yaw, yawdot, yawddot] in W, shape (12,)."""
        return np.concatenate((self.pva[:, :3].ravel(), self.pva[:, YAW]))

    @classmethod
    def from_vector(cls, vector: Array) -> "FootMotion":
        """The inverse of `as_vector`."""
        pva = np.empty((3, 4))
        pva[:, :3] = vector[:9].reshape(3, 3)
        pva[:, YAW] = vector[9:]
        return cls(pva)


def swing_foot_motion(
    previous: FootMotion,
    state: WalkingState,
    period: float,
    params: SwingFootParams,
) -> FootMotion:
    """Returns the reference of the swing foot one `period` [s] later.

    `previous` is the reference of the last tick, `state` the walking state of
    this one.  Outside of a swing, the foot that will swing next rests where
    it stands.  A foot that cannot be in place in time comes later.  When it is
    there, and the swing's clock has run out, it goes on downward with the
    touchdown velocity until the ground stops it.
    """
    schedule = state.schedule
    side = schedule.support_side.other
    if schedule.phase is not Phase.SWING or state.time_in_phase <= 0.0:
        return FootMotion.at_rest(schedule.feet[side])
    goal, start = schedule.footsteps[0].pose, previous.pva
    way = way_round(
        start[0, XY],
        goal.p_WF[:2],
        schedule.feet[side.other],
        side,
        params.detour,
    )
    end = np.zeros((3, 4))
    end[0] = *goal.p_WF, _nearest_turn(goal.yaw, start[0, YAW])
    end[1, Z] = -params.touchdown_velocity
    left = state.remaining_time + (_SOON if state.waiting else period)
    end[:, XY], left = _within_limits(start[:, XY], way, left, params.detour)
    apex = _apex(start[:2, 2], float(end[0, 2]), left, state, params)
    if apex is not None:
        end[:, Z] = _aim(start[:, Z], end[:, Z], left, apex)
    pva = quintic_at(start, end, np.full(4, left), period)
    if state.waiting and math.dist(start[0, XY], goal.p_WF[:2]) < _THERE:
        z = float(start[0, 2]) - params.touchdown_velocity * period
        pva[:, 2] = z, -params.touchdown_velocity, 0.0
    return FootMotion(pva)


def _within_limits(
    start: Array, way: Array, left: float, detour: SwingDetourParams
) -> tuple[Array, float]:
    """Returns where to aim at (3, 2), and in which time >= `left` [s].

    Along `way` (n, 2), round its first corner, and if it can be with no more
    than PEAK times the acceleration.
    """
    end = np.zeros((3, 2))
    end[0] = way[-1]
    needed = shortest_time(way, detour, start[1])
    left = max(left, needed)
    corner = len(way) > 2
    times = _CHECKED[: len(_CHECKED) // 2] if corner else _CHECKED
    most = PEAK * detour.max_acceleration
    aim = end
    for _ in range(_STRETCHES):
        aim = _aim(start, end, left, way[1]) if corner else end
        if left > _STRETCH**_STRETCHES * needed:
            break
        a = quintic(start, aim, np.full(2, left), left * times)[2]
        if np.max(np.hypot(*a.T)) <= most:
            break
        left *= _STRETCH
    return aim, left


def _aim(start: Array, end: Array, left: float, via: Array) -> Array:
    """Returns where to aim at (3, n) so as to pass `via` (n,), or `end`."""
    if left < 2.0 * _SOON:
        return end
    t = time_to_pass(start, end, left, via)
    if min(t, left - t) < _SOON:
        return end
    return end_beyond(start, end, left, via, t)


def _apex(
    start: Array,
    ground: float,
    left: float,
    state: WalkingState,
    params: SwingFootParams,
) -> Array | None:
    """Returns the apex (1,), while the height `start` (p, v) goes up to it."""
    schedule = state.schedule
    lift_off = schedule.feet[schedule.support_side.other].p_WF[2]
    height = params.height
    if schedule.legs_crossed:
        height = min(height, params.uncrossing_height)
    height *= min(1.0, (left / _FALL) ** 2)
    apex = max(lift_off, ground) + height
    return np.array([apex]) if start[0] < apex and start[1] >= 0.0 else None


def _nearest_turn(yaw: float, reference: float) -> float:
    """Returns `yaw` plus the full turns that bring it nearest."""
    turns = round((reference - yaw) / (2.0 * math.pi))
    return yaw + 2.0 * math.pi * turns
