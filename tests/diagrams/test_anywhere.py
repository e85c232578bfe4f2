"""Where the robot starts, and which way it faces, is nothing to it."""

import numpy as np

from nadia_balance.diagrams.scenario import load_scenario
from tests.diagrams.simulated import EARLY, run_of

FAR = "place: {x: 1000, y: 1000, yaw_deg: 114.59}"  # 2 rad


def test_a_pushed_robot_moves_as_at_the_origin():
    """Oracle: the same run, turned and moved; its push is turned with it.

    1e-6 m is the bar: coordinates of 1 km are rounded to 1e-13 m, which
    contacts and QPs make 6e-9 m within 2 s.
    """
    push = "pushes: [{delta_v: 0.35, direction_deg: 60, at: 0.8 s}]"
    rest = f"{push}, {EARLY % 'num_steps: 9'}"
    near, far = (
        load_scenario("push", text=f"{{{place}, {rest}}}")
        for place in ("place: {}", FAR)
    )
    near.duration = far.duration = 1.4
    expected, found = (run_of(scenario).logs for scenario in (near, far))
    place = far.place.pose
    assert np.linalg.norm(np.ptp(expected["icp"], axis=0)) > 0.1
    moved = place.to_world(expected["icp"])
    np.testing.assert_allclose(found["icp"], moved, rtol=0.0, atol=1e-6)
    joints = slice(7, 7 + expected["actuation"].shape[1])
    there, here = (log["state"][:, joints] for log in (found, expected))
    np.testing.assert_allclose(there, here, atol=1e-6)
