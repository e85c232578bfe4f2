"""Nadia moves alike anywhere and, in its own lengths and times, at any size.

Oracle: Froude's similarity, of the equations of motion in the same gravity.
"""

import math

import numpy as np
import pytest

from nadia_balance.diagrams.scenario import load_scenario
from tests.diagrams.simulated import run_of, soon_pushed
from tests.scaled_robot import scaled_nadia

SMALL = 0.25  # a power of 4: lengths and times are scaled without rounding
FAR = "place: {x: 1000, y: 1000, yaw_deg: 114.59}"  # 2 rad


def pushed(ratio, robot, delta_v, direction):
    """The ICP (n, 2) [m] in Nadia's lengths, by tick."""
    time = math.sqrt(ratio)
    scenario = load_scenario("push", robot=robot)
    scenario = scenario.with_push(direction, delta_v * time).changed(
        lipm_period=scenario.lipm_period * time, duration=4.0 * time
    )
    scenario.pushes[0].duration *= time
    scenario.pushes[0].after_steps = 0
    return run_of(scenario, "lipm").logs["icp"] / ratio


@pytest.mark.parametrize("delta_v, way", [(0.41, 90.0), (0.9, 30.0)])
def test_a_small_point_mass_recovers_as_a_large_one(tmp_path, delta_v, way):
    """Oracle: the same motion, while the ICP goes 0.1 m and 1 m.

    To 2.5 mm: the via points of the swing are on a grid of 10 ms for either,
    unless a touchdown then falls into the next tick (1 m/s at 30 deg: 10 mm;
    forward: 4 mm).
    """
    small = str(scaled_nadia(SMALL, tmp_path))
    found = pushed(SMALL, small, delta_v, way)
    expected = pushed(1.0, "nadia", delta_v, way)
    assert np.ptp(expected, axis=0).max() > 0.1
    np.testing.assert_allclose(found, expected, atol=2.5e-3)


def test_a_pushed_robot_moves_as_at_the_origin():
    """Oracle: the same run, turned and moved; its push is turned with it.

    1e-6 m is the bar: coordinates of 1 km are rounded to 1e-13 m, which
    contacts and QPs make 6e-9 m within 2 s.
    """
    near, far = soon_pushed(), soon_pushed(f"{{{FAR}}}")
    expected, found = (run_of(scenario).logs for scenario in (near, far))
    place = far.place.pose
    assert np.linalg.norm(np.ptp(expected["icp"], axis=0)) > 0.1
    moved = place.to_world(expected["icp"])
    np.testing.assert_allclose(found["icp"], moved, rtol=0.0, atol=1e-6)
    joints = slice(7, 7 + expected["actuation"].shape[1])
    there, here = (log["state"][:, joints] for log in (found, expected))
    np.testing.assert_allclose(there, here, atol=1e-6)
