"""Oracles: the law of core.plan.waypoints, asked by hand; messages."""

import re

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.core.plan.waypoints import Waypoint
from nadia_balance.core.walking.state import FootPose, FootPoses, WalkingState
from nadia_balance.systems.waypoints import WaypointFollower
from tests.blocks import answer, fix
from tests.example_walks import standing
from tests.whole_body_examples import nadia, standing_state

LIMITS = np.array([[-0.5, -0.3, -1.0], [0.8, 0.3, 1.0]])
POINTS = [Waypoint(1.0, 3.0, 0.0, 0.0), Waypoint(2.0, 0.0, -3.0, 0.0)]


def test_each_waypoint_counts_from_its_time():
    """Oracle: by hand: at once forward or to the right, at the limit.

    The feet stand at the origin, the pelvis 1 m behind the CoM: the feet have
    to go 1 m beyond the first waypoint.
    """
    width = nadia().point_mass.step_width
    feet = FootPoses(*(FootPose([0.0, a * width, 0.0]) for a in (0.5, -0.5)))
    follower = WaypointFollower(POINTS, nadia(), LIMITS)
    simulator = Simulator(follower)
    context = simulator.get_mutable_context()
    state = standing_state()
    com = np.zeros(6)
    com[:2] = state[4:6] + [1.0, 0.0]
    fix(
        follower,
        context,
        walking_state=WalkingState(standing(feet)),
        foot_poses=feet,
        com_state=com,
        predicted_state=state,
    )
    for time, expected in (
        (0.996, [0.0, 0.0, 0.0]),
        (1.0, [0.72, 0.0, 0.0]),
        (1.996, [0.72, 0.0, 0.0]),
    ):
        simulator.AdvanceTo(time)
        command = answer(follower, context, "velocity_command")
        assert command == pytest.approx(expected, abs=1e-12)
    simulator.AdvanceTo(2.0)
    forward, left, turn = answer(follower, context, "velocity_command")
    # 1 m forward, 3 m to the right, of which a step of the leading foot
    # takes twice as much as it is told.
    assert left / forward == pytest.approx(-1.5)
    assert np.hypot(forward / 0.8, left / 0.3) == pytest.approx(0.9)
    assert turn == 0.0


@pytest.mark.parametrize(
    "points",
    [[], POINTS[::-1], POINTS[:1] * 2, [POINTS[0]._replace(yaw=np.nan)]],
)
def test_waypoints_must_be_in_order(points):
    with pytest.raises(
        ValueError, match=f"^{re.escape(f'waypoints = {points}')}"
    ):
        WaypointFollower(points, nadia(), LIMITS)
