"""Nadia at another size moves as Nadia does, in lengths and times of its own.

Oracle: Froude's similarity, of the equations of motion in the same gravity.
"""

import math

import numpy as np
import pytest

from nadia_balance.diagrams.scenario import load_scenario
from tests.diagrams.simulated import run_of
from tests.scaled_robot import scaled_nadia

SMALL = 0.25  # a power of 4: lengths and times are scaled without rounding


def pushed(ratio, robot, delta_v, direction):
    """The ICP (n, 2) [m] in Nadia's lengths, by tick."""
    scenario = load_scenario("push", robot=robot)
    scenario.lipm_period *= math.sqrt(ratio)
    scenario.pushes[0].delta_v = delta_v * math.sqrt(ratio)
    scenario.pushes[0].duration *= math.sqrt(ratio)
    scenario.pushes[0].direction_deg = direction
    scenario.pushes[0].after_steps = 0
    scenario.duration = 4.0 * math.sqrt(ratio)
    return run_of(scenario, "lipm").logs["icp"] / ratio


@pytest.mark.parametrize("delta_v, way", [(0.41, 90.0), (1.0, 0.0)])
def test_a_small_point_mass_recovers_as_a_large_one(tmp_path, delta_v, way):
    """Oracle: the same motion, while the ICP goes 0.1 m and 1 m.

    To 2.5 mm: the via points of the swing are on a grid of 10 ms for either,
    in swings of 0.25 s and of 0.125 s.
    """
    small = str(scaled_nadia(SMALL, tmp_path))
    found = pushed(SMALL, small, delta_v, way)
    expected = pushed(1.0, "nadia", delta_v, way)
    assert np.ptp(expected, axis=0).max() > 0.1
    np.testing.assert_allclose(found, expected, atol=2.5e-3)
