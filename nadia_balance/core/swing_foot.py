"""The swing foot's reference: never a jump, whatever the goal or clock do.

Each tick continues from the previous reference with the one quintic that
meets the goal at the time that is left.  While goal and clock stay as they
were, this is the same polynomial as before; when they change, position,
velocity and acceleration still continue.
"""

import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.walking import Array, FootPose, WalkingState

X, Y, Z, YAW = range(4)


@dataclass(kw_only=True)
class SwingFootParams:
    """Shape of the swing."""

    height: float = 0.10  # apex above the higher of start and goal [m]
    apex_fraction: float = 0.45  # of the swing, when the apex is reached [-]
    touchdown_velocity: float = 0.10  # downward, at and after the end [m/s]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        if not 0.0 < self.height <= 0.5:
            raise ValueError(f"height = {self.height}: must be in (0, 0.5] m")
        if not 0.1 <= self.apex_fraction <= 0.9:
            raise ValueError(
                f"apex_fraction = {self.apex_fraction}: must be in [0.1, 0.9]"
            )
        if not 0.0 <= self.touchdown_velocity <= 1.0:
            raise ValueError(
                f"touchdown_velocity = {self.touchdown_velocity}: "
                "must be in [0, 1] m/s"
            )


@dataclass(frozen=True)
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


def quintic(start: Array, end: Array, horizon: Array, t: float) -> Array:
    """Follows the quintic from `start` to `end` for the time `t`.

    `start`, `end`, result: rows p, v, a, shape (3, n); `horizon` (n,) [s] is
    the time from start to end, >= t > 0, one for each column.
    """
    s, h = t / horizon, horizon
    p0, v0, a0 = start[0], start[1] * h, start[2] * h * h
    v1, a1 = end[1] * h, end[2] * h * h
    gap = end[0] - p0 - v0 - 0.5 * a0
    dv, da = v1 - v0 - a0, a1 - a0
    c3 = 10.0 * gap - 4.0 * dv + 0.5 * da
    c4 = -15.0 * gap + 7.0 * dv - da
    c5 = 6.0 * gap - 3.0 * dv + 0.5 * da
    return np.array(
        [
            p0 + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5)))),
            (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h,
            (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h),
        ]
    )


def swing_foot_motion(
    previous: FootMotion,
    state: WalkingState,
    period: float,
    params: SwingFootParams,
) -> FootMotion:
    """Returns the reference of the swing foot one `period` [s] later.

    `previous` is the reference of the last tick, `state` the walking state of
    this one.  Outside of a swing, the foot that will swing next rests where
    it stands.  When the swing's clock has run out, the foot goes on downward
    with the touchdown velocity until the ground stops it.
    """
    schedule = state.schedule
    side = schedule.support_side.other
    if schedule.in_contact(side) or state.time_in_phase <= 0.0:
        return FootMotion.at_rest(schedule.feet[side])
    if state.waiting:
        return _descend(previous, period, params)
    goal = schedule.footsteps[0].pose
    end, left = _targets(schedule.feet[side], goal, state, params)
    end[0, YAW] = _nearest_turn(goal.yaw, previous.pva[0, YAW])
    return FootMotion(quintic(previous.pva, end, left + period, period))


def _targets(
    start: FootPose,
    goal: FootPose,
    state: WalkingState,
    params: SwingFootParams,
) -> tuple[Array, Array]:
    """Where to be (3, 4) and how much time is left for it (4,) [s]."""
    left = np.full(4, state.remaining_time)
    end = np.zeros((3, 4))
    end[0, :3] = goal.p_WF
    duration = state.schedule.duration
    time_to_apex = params.apex_fraction * duration - state.time_in_phase
    if time_to_apex >= 0.0:
        left[Z] = time_to_apex
        end[0, Z] = max(start.p_WF[2], goal.p_WF[2]) + params.height
        # The acceleration of a parabola of this height and duration.
        end[2, Z] = -8.0 * params.height / duration**2
    else:
        end[1, Z] = -params.touchdown_velocity
    return end, left


def _descend(
    previous: FootMotion, period: float, params: SwingFootParams
) -> FootMotion:
    pva = np.zeros((3, 4))
    pva[0] = previous.pva[0]
    pva[0, Z] -= params.touchdown_velocity * period
    pva[1, Z] = -params.touchdown_velocity
    return FootMotion(pva)


def _nearest_turn(yaw: float, reference: float) -> float:
    """Returns `yaw` plus the full turns that bring it nearest."""
    turns = round((reference - yaw) / (2.0 * math.pi))
    return yaw + 2.0 * math.pi * turns
