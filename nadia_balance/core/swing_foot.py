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

from nadia_balance.core.quintic import end_beyond, quintic, time_to_pass
from nadia_balance.core.swing_detour import SwingDetourParams, way_round
from nadia_balance.core.walking import (
    Array,
    FootPose,
    Phase,
    WalkingState,
)

XY, Z, YAW = slice(2), 2, 3

# What is so near in time [s] is not aimed at any more.
_AT_CORNER, _AT_APEX = 0.02, 0.04


@dataclass(kw_only=True)
class SwingFootParams:
    """Shape of the swing."""

    height: float = 0.10  # apex above the higher of start and goal [m]
    apex_fraction: float = 0.45  # of the swing, when the apex is reached [-]
    touchdown_velocity: float = 0.20  # downward, at and after the end [m/s]
    detour: SwingDetourParams = field(default_factory=SwingDetourParams)

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
        self.detour.validate()


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
    if schedule.phase is not Phase.SWING or state.time_in_phase <= 0.0:
        return FootMotion.at_rest(schedule.feet[side])
    if state.waiting:
        return _descend(previous, period, params)
    pva, goal = previous.pva, schedule.footsteps[0].pose
    left = np.full(4, state.remaining_time + period)
    end = np.zeros((3, 4))
    end[0, :3] = goal.p_WF
    end[0, YAW] = _nearest_turn(goal.yaw, pva[0, YAW])
    end[:, XY] = _round_stance(pva[:, XY], end[:, XY], state, period, params)
    end[:, Z], left[Z] = _up_or_down(goal, state, period, params)
    return FootMotion(quintic(pva, end, left, period))


def _round_stance(
    start: Array,
    end: Array,
    state: WalkingState,
    period: float,
    params: SwingFootParams,
) -> Array:
    """Returns the end (3, 2) to aim at in the plane.

    Beyond `end` (3, 2), if a corner of the stance foot is in the way.
    """
    left = state.remaining_time + period
    support = state.schedule.support_side
    stance = state.schedule.feet[support]
    way = way_round(start[0], end[0], stance, support.other, params.detour)
    if len(way) == 2 or left < 2.0 * _AT_CORNER:
        return end
    t = time_to_pass(start, end, left, way[1], period)
    if min(t, left - t) < _AT_CORNER:
        return end
    return end_beyond(start, end, left, way[1], t)


def _up_or_down(
    goal: FootPose, state: WalkingState, period: float, params: SwingFootParams
) -> tuple[Array, float]:
    """Where the height has to be next, (3,), and the time [s] until then.

    The apex is at a fraction of the time that the swing really takes, be its
    clock advanced or not.
    """
    remaining = state.remaining_time
    duration = state.elapsed + remaining
    time_to_apex = params.apex_fraction * duration - state.elapsed
    ground = float(goal.p_WF[2])
    if time_to_apex < _AT_APEX:
        down = np.array([ground, -params.touchdown_velocity, 0.0])
        return down, remaining + period
    lift_off = state.schedule.feet[state.schedule.support_side.other]
    apex = max(float(lift_off.p_WF[2]), ground) + params.height
    # The acceleration of a parabola of this height and duration.
    acceleration = -8.0 * params.height / duration**2
    return np.array([apex, 0.0, acceleration]), time_to_apex + period


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
