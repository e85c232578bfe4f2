"""The velocity that leads a walking robot to a waypoint, where it stands.

Neither paper has this: it is what tells a walk by command where to go.
"""

import math
from typing import NamedTuple

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.footstep_plan import within_limits
from nadia_balance.core.plan.gait import middle
from nadia_balance.core.walking.state import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
)
from nadia_balance.parameters.bounds import bounded, parameters


class Waypoint(NamedTuple):
    """Where the pelvis is to stand from a time on, in W.

    Args:
        time: from which it counts [s].
        x: forward [m].
        y: to the left [m].
        yaw: turn to the left [rad].
    """

    time: float
    x: float
    y: float
    yaw: float


@parameters
class WaypointParams:
    """How fast the robot comes to a waypoint, and how close."""

    settling_time: float = bounded(
        0.8,
        doc="the way that is left over the velocity that is commanded",
        above=0.0,
        most=10.0,
        unit="s",
    )
    share_of_limits: float = bounded(
        0.9,
        doc="share of the largest commands, forward, left and turn together",
        above=0.0,
        most=1.0,
    )
    distance: float = bounded(
        0.03, doc="distance that is there", above=0.0, most=1.0, unit="m"
    )
    turn_deg: float = bounded(
        2.0, doc="turn that is there", above=0.0, most=90.0, unit="deg"
    )
    leaving: float = bounded(
        1.5,
        doc="by as many of these distances a robot that stands is off before "
        "it walks again",
        least=1.0,
        most=100.0,
    )


def standing_place(
    schedule: ContactSchedule, feet: FootPoses, step_width: float
) -> FootPose:
    """The level frame between the feet, if the next step ended the walk.

    In a walk it is beside the foot that carries, as the other one is on its
    way; standing, it is in the middle of both.

    Args:
        schedule: present phase.
        feet: measured soles.
        step_width: between the soles, side by side [m].

    Returns:
        The frame, in W.
    """
    side = schedule.support_side
    if schedule.phase is not Phase.STANDING:
        return feet[side].displaced(0.0, -0.5 * side.sign * step_width)
    return middle(feet)


def velocity_to(
    waypoint: Waypoint,
    place: FootPose,
    lead: Array,
    limits: Array,
    params: WaypointParams,
    stands: bool,
) -> Array:
    """The command v = e / settling_time, within the robot's limits.

    With the error e = (x, y, yaw) of the place in its own frame, and 0 within
    `distance` and `turn_deg` of it.  Of a lateral displacement the foot that
    leads makes twice as much in its step, so that v has half of it.  The limits
    are `share_of_limits` of the robot's (`within_limits`).

    Args:
        waypoint: where the pelvis is to be.
        place: frame between the feet where the robot would stand (see
            standing_place).
        lead: of the pelvis before that frame, when it stands (2,) in W [m].
        limits: least and most velocity (2, 3) [m/s], [m/s], [rad/s].
        params: time and tolerances.
        stands: whether it stands.

    Returns:
        Forward, left, turn (3,) [m/s], [m/s], [rad/s]; 0 to stand.
    """
    x, y = place.to_sole(np.array(waypoint[1:3]) - lead).tolist()
    yaw = math.remainder(waypoint.yaw - place.yaw, math.tau)
    factor = params.leaving if stands else 1.0
    if math.hypot(x, y) < factor * params.distance and abs(yaw) < (
        factor * math.radians(params.turn_deg)
    ):
        return np.zeros(3)
    velocity = np.array([x, 0.5 * y, yaw]) / params.settling_time
    return within_limits(velocity, params.share_of_limits * limits)
