"""What later steps are worth if every foot goes where it is told."""

from __future__ import annotations

import itertools

import numpy as np

from nadia_balance.core.capture_region import later_steps
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.swing_geometry import counted_feet, step_contractions
from nadia_balance.core.walking import Array, Footstep


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
    contractions = step_contractions(steps, params, omega)
    scale, centres = 1.0, [np.zeros(2)]
    ways = itertools.pairwise(step.pose.p_WF[:2] for step in steps)
    for (start, end), contraction in zip(ways, contractions, strict=False):
        scale *= contraction
        centres.append(centres[-1] + scale * (end - start))
    nowhere = [np.zeros((1, 2))] * len(contractions)
    feet = counted_feet(steps, sole, params)
    around = later_steps(nowhere, contractions, feet)
    return tuple(a + c for a, c in zip(around, centres, strict=True))
