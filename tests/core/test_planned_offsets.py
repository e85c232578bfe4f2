"""Oracles: the ICP's flow from foot to foot; by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.lipm import icp_after
from nadia_balance.core.planned_offsets import planned_offsets
from tests.example_walks import OMEGA, SOLE, walk

PARAMS = CaptureRegionStepAdjusterParams(enabled=False)


@pytest.mark.parametrize("aware", [False, True])
def test_the_planned_steps_capture_what_starts_in_their_offset(aware):
    """Oracle: the ICP's flow; a transfer is at once, or integrated.

    The CoP rests above each foothold, and the ICP comes to the last of them.
    """
    params = replace(PARAMS, transfer_aware=aware)
    schedule = walk(length=0.2, turn=0.4, num_steps=4, transfer=0.2, swing=0.5)
    steps = schedule.footsteps
    offsets = planned_offsets(steps, SOLE, params, OMEGA)
    assert len(offsets) == 3
    holds = [step.pose.p_WF[:2] for step in steps]

    def transferred(icp, start, end):
        if not aware:
            return icp_after(icp, end, OMEGA, 0.2)
        flow = solve_ivp(
            lambda t, xi: OMEGA * (xi - start - t / 0.2 * (end - start)),
            (0.0, 0.2),
            icp,
            rtol=1e-10,
            atol=1e-12,
        )
        return flow.y[:, -1]

    # The first transfer starts anywhere: C_1 has its factor.
    factor = OMEGA * 0.2 / (1.0 - math.exp(-OMEGA * 0.2)) if aware else 1.0
    before = holds[0] - [0.1, 0.2]
    for n in (1, 2, 3):
        (offset,) = offsets[n - 1]
        icp = before + (holds[0] + offset - before) / factor
        for k in range(n):
            start = before if k == 0 else holds[k - 1]
            icp = transferred(icp, start, holds[k])
            if k + 1 < n:
                icp = icp_after(icp, holds[k], OMEGA, 0.5)
        np.testing.assert_allclose(icp, holds[n - 1], atol=1e-7)


def test_with_feet_the_planned_steps_capture_more():
    """Oracle: by hand: D_1 = G_1, D_2 = (1 - E) G_1 + E (s_2 + G_2)."""
    params = replace(PARAMS, finite_foot=True)
    steps = walk(length=0.0, num_steps=2, transfer=0.2, swing=0.4).footsteps
    first, second = planned_offsets(steps, SOLE, params, OMEGA)
    # The right foot's inner side is to its left, the left one's to its right.
    low, high = np.array([-0.075, -0.03]), np.array([0.105, 0.04])
    np.testing.assert_allclose(first.min(axis=0), low)
    np.testing.assert_allclose(first.max(axis=0), high)
    E = math.exp(-OMEGA * 0.6)
    swapped_low, swapped_high = [-0.075, -0.04], [0.105, 0.03]
    step = np.array([0.0, 0.25])
    np.testing.assert_allclose(
        second.min(axis=0), (1.0 - E) * low + E * (step + swapped_low)
    )
    np.testing.assert_allclose(
        second.max(axis=0), (1.0 - E) * high + E * (step + swapped_high)
    )
