"""Oracles: Newton's second law by hand; a PD on the height of the soles."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.body.com_height import ComHeightParams
from nadia_balance.core.walking.state import FootPose, FootPoses, Side
from nadia_balance.systems.feedback import ComHeightController
from tests.blocks import answer, asked
from tests.example_walks import MODEL
from tests.systems.test_momentum_qp import FEET, SWING, TRANSFER

PARAMS = ComHeightParams()
COM, ECMP = np.array([0.01, 0.1]), np.array([0.05, -0.02])
VELOCITY = np.array([0.2, 0.5])


def rate(state, params=PARAMS, height=MODEL.com_height):
    """The momentum rate of a level motion at this height in W [m]."""
    system = ComHeightController(params, MODEL, 0.004)
    context = asked(
        system,
        com_state=[*COM, height, *VELOCITY, 0.0],
        ecmp_command=[0.3, 0.4, *ECMP],
        walking_state=state,
    )
    return answer(system, context, "momentum_rate")


def test_the_ground_force_points_from_the_ecmp_to_the_com():
    """Oracle: m g (c - r) / z, level with the line through both points."""
    force = rate(TRANSFER) + [0.0, 0.0, MODEL.mass * 9.81]
    line = np.array([*(COM - ECMP), MODEL.com_height])
    assert np.cross(force, line) == pytest.approx(np.zeros(3), abs=1e-9)


def test_a_support_foot_on_a_stair_lifts_the_com():
    """Oracle: PD on the height above the support sole."""
    feet = FEET.with_foot(Side.LEFT, FootPose([0.0, 0.125, 0.01]))
    state = replace(TRANSFER, schedule=replace(TRANSFER.schedule, feet=feet))
    expected = MODEL.mass * PARAMS.position_gain * 0.01
    assert rate(state)[2] == pytest.approx(expected)


def test_sinks_in_a_swing_as_the_icp_runs_away():
    """Oracle: Newton's second law, with the CoM sinking by its law."""
    still = replace(PARAMS, sink_gain=0.0)
    away = np.linalg.norm(COM + VELOCITY / MODEL.omega - ECMP)
    sinking = 1.8 * MODEL.omega**2 * (away - 0.2)
    assert sinking > 1.0
    change = rate(SWING) - rate(SWING, still)
    assert change == pytest.approx([0.0, 0.0, -MODEL.mass * sinking])
    assert rate(TRANSFER).tolist() == rate(TRANSFER, still).tolist()


@pytest.mark.parametrize("share", [0.79, 0.81])
def test_a_swing_is_the_same_on_raised_ground(share):
    """Oracle: symmetry; the CoM is below, and above, its least height.

    Below 0.8 of the nominal height it does not sink: it is pulled up by as much
    as it may be.
    """
    schedule, up = SWING.schedule, 0.3

    def raised(pose):
        return replace(pose, p_WF=pose.p_WF + [0.0, 0.0, up])

    feet = FootPoses(*(raised(schedule.feet[side]) for side in Side))
    steps = tuple(
        replace(step, pose=raised(step.pose)) for step in schedule.footsteps
    )
    state = replace(
        SWING, schedule=replace(schedule, feet=feet, footsteps=steps)
    )
    height = share * MODEL.com_height
    expected = rate(SWING, height=height)
    assert rate(state, height=height + up) == pytest.approx(expected)
    sinks = expected[2] < 0.99 * MODEL.mass * PARAMS.max_acceleration
    assert sinks == (share > 0.8)
