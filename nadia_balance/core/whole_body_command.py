"""From the walking state to what the whole body is to do."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.crossing_turn import crossing_turn
from nadia_balance.core.walking import Phase, Side, WalkingState
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_terms import WholeBodyCommand

Array = NDArray[np.float64]


def whole_body_command(
    params: WholeBodyQpParams,
    state: WalkingState,
    momentum_rate: Array,
    swing: Array,
    weight: float,
) -> WholeBodyCommand:
    """Returns contacts, heading and force bounds of a walking state.

    `momentum_rate` (3,) [N]; `swing` (12,) reference of the swing sole;
    `weight` [N] of the robot.
    """
    schedule = state.schedule
    left, right = (schedule.in_contact(s) for s in (Side.LEFT, Side.RIGHT))
    return WholeBodyCommand(
        momentum_rate=momentum_rate,
        heading=heading(state, swing),
        turn=crossing_turn(state, swing, params.crossing_turn),
        contacts=(left, right),
        max_normal_forces=(
            max_normal_force(params, state, Side.LEFT, weight),
            max_normal_force(params, state, Side.RIGHT, weight),
        ),
        swing=swing,
    )


def heading(state: WalkingState, swing: Array) -> tuple[float, float, float]:
    """Mean yaw, yawdot, yawddot of the feet; moves with a swing."""
    schedule = state.schedule
    stance = schedule.feet[schedule.support_side].yaw
    if schedule.phase is Phase.SWING:
        other, rate, acceleration = swing[9:].tolist()
    else:
        other = schedule.feet[schedule.support_side.other].yaw
        rate = acceleration = 0.0
    difference = math.remainder(other - stance, math.tau)
    return stance + 0.5 * difference, 0.5 * rate, 0.5 * acceleration


def max_normal_force(
    params: WholeBodyQpParams, state: WalkingState, side: Side, weight: float
) -> float:
    """Upper bound [N] of a sole's force: the trailing foot unloads.

    The bound falls linearly from `weight` [N] in the last part of a transfer
    to a step.  A transfer that waits for the ICP needs both feet.
    """
    schedule = state.schedule
    unloads = (
        schedule.phase is Phase.TRANSFER
        and side is not schedule.support_side
        and bool(schedule.footsteps)
        and not state.waiting
    )
    part = params.unloading_fraction * schedule.duration
    if not unloads or state.remaining_time >= part:
        return math.inf
    left = state.remaining_time / part
    return left * weight + (1.0 - left) * params.unloaded_force
