"""What later steps are worth if every foot goes where it is told."""

from __future__ import annotations

import math

import numpy as np

from nadia_balance.core.capture_region import later_steps, transfer_factor
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.reachability import in_world
from nadia_balance.core.walking import Array, FootPose, Footstep


def planned_offsets(
    steps: tuple[Footstep, ...],
    sole: Array,
    params: CaptureRegionStepAdjusterParams,
    omega: float,
) -> tuple[Array, ...]:
    """Returns D_1, ..., D_N [m], if every step goes where it is planned.

    As those of `swing_geometry`, but with the one foothold of the plan in
    place of each region: D_n is a single point (1, 2), or with
    `params.finite_foot` a polygon.  Unlike the others, these do not nest: a
    planned step is not left out.
    """
    number = min(params.num_steps, len(steps))
    factors = [_factor(steps, n, params, omega) for n in range(number)]
    scale, centres = 1.0, [np.zeros(2)]
    contractions, feet = [], []
    for n, step in enumerate(steps[:number]):
        about = FootPose(yaw=step.pose.yaw)
        foot = params.usable_foot(sole)
        feet.append(in_world(foot, about, step.side.other))
        if n + 1 < number:
            following = steps[n + 1]
            E = math.exp(-omega * params.duration(following))
            contractions.append(E * factors[n] / factors[n + 1])
            scale *= contractions[-1]
            vector = (following.pose.p_WF - step.pose.p_WF)[:2]
            centres.append(centres[-1] + scale * vector)
    nowhere = [np.zeros((1, 2))] * len(contractions)
    around = later_steps(
        nowhere, contractions, feet if params.finite_foot else ()
    )
    return tuple(a + c for a, c in zip(around, centres, strict=True))


def _factor(
    steps: tuple[Footstep, ...],
    n: int,
    params: CaptureRegionStepAdjusterParams,
    omega: float,
) -> float:
    """The factor of the transfer after the landing of steps[n]."""
    if not params.transfer_aware or n + 1 >= len(steps):
        return 1.0
    return transfer_factor(omega, params.transfer_duration(steps[n + 1]))
