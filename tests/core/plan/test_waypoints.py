"""Oracles: frames by hand, the limits, and walks of ideal steps."""

import math
from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.plan.waypoints import (
    Waypoint,
    WaypointParams,
    standing_place,
    velocity_to,
)
from nadia_balance.core.walking.state import FootPose, FootPoses, Phase, Side
from tests.example_walks import standing

LIMITS = np.array([[-0.5, -0.3, -1.0], [0.8, 0.3, 1.0]])
PARAMS = WaypointParams()
WIDTH, YAW = 0.24, 0.7
NOWHERE = np.zeros(2)


def feet(ahead=0.0) -> FootPoses:
    """Side by side in a frame at (1, 2), the left one ahead of it."""
    middle = FootPose(np.array([1.0, 2.0, 0.0]), YAW)
    return FootPoses(
        middle.displaced(ahead, 0.5 * WIDTH),
        middle.displaced(0.0, -0.5 * WIDTH),
    )


@pytest.mark.parametrize("side", list(Side))
def test_the_place_in_a_walk_is_beside_the_foot_that_carries(side):
    """Oracle: by hand; the left foot is 0.3 m ahead."""
    walking = replace(standing(feet(0.3)), phase=Phase.SWING, support_side=side)
    place = standing_place(walking, feet(0.3), WIDTH)
    x = 0.3 if side is Side.LEFT else 0.0
    expected = FootPose(np.array([1.0, 2.0, 0.0]), YAW).displaced(x, 0.0)
    assert place.p_WF == pytest.approx(expected.p_WF)
    assert place.yaw == pytest.approx(YAW)


def test_the_place_in_standing_is_between_the_feet():
    """Oracle: by hand, with feet that turn across +-180 degrees."""
    pair = FootPoses(
        FootPose(np.array([1.0, 2.0, 0.0]), math.pi - 0.1),
        FootPose(np.array([0.0, 0.0, 0.0]), -math.pi + 0.3),
    )
    place = standing_place(standing(pair), pair, WIDTH)
    assert place.p_WF[:2] == pytest.approx([0.5, 1.0])
    assert math.cos(place.yaw - (math.pi + 0.1)) == pytest.approx(1.0)


def test_a_lead_of_the_pelvis_moves_the_feet_back():
    """Oracle: by hand: the pelvis is there if the feet are 5 cm behind it."""
    place = FootPose(np.array([0.35, 0.0, 0.0]), 0.0)
    command = velocity_to(
        Waypoint(0.0, 0.4, 0.0, 0.0),
        place,
        lead=np.array([0.05, 0.0]),
        limits=LIMITS,
        params=PARAMS,
        stands=True,
    )
    assert not command.any()


@pytest.mark.parametrize("stands", [True, False])
def test_it_walks_on_from_what_would_not_make_it_walk(stands):
    """Oracle: 4 cm are more than `distance`, and less than 1.5 of it."""
    command = velocity_to(
        Waypoint(0.0, 0.04, 0.0, 0.0),
        FootPose(),
        NOWHERE,
        limits=LIMITS,
        params=PARAMS,
        stands=stands,
    )
    assert command.any() != stands


@pytest.mark.parametrize(
    ("goal", "yaw"), [((3.0, 0.1), 0.2), ((-2.0, -1.0), 3.0), ((0.0, 1.0), 0.0)]
)
def test_commands_are_within_their_share_and_lead_there(goal, yaw):
    """Oracle: the norm of the shares; and steps of v T, which end there.

    Every second step takes twice the lateral one, as the foot leads.
    """
    step, place = 0.7, FootPose(np.array([0.2, 0.1, 0.0]), -0.4)
    waypoint = Waypoint(0.0, *goal, yaw)
    first = True
    for i in range(60):
        v = velocity_to(
            waypoint, place, NOWHERE, limits=LIMITS, params=PARAMS, stands=False
        )
        share = np.linalg.norm(v / np.where(v > 0.0, LIMITS[1], LIMITS[0]))
        assert share <= PARAMS.share_of_limits + 1e-9
        assert not first or share == pytest.approx(PARAMS.share_of_limits)
        first = False
        aside = 2.0 * step * v[1] * (i % 2)
        place = place.displaced(step * v[0], aside, step * v[2])
    assert not v.any()
    assert math.dist(place.p_WF[:2], goal) <= PARAMS.distance
    turn = math.remainder(place.yaw - yaw, math.tau)
    assert abs(turn) <= math.radians(PARAMS.turn_deg)
