"""What is called reachable is: the oracle is inverse kinematics, of Drake."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.body.reachability import step_regions
from nadia_balance.core.math.polygon import contains
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.reach import reach_within, stride
from tests import run_cache


def cut_down():
    """What is left of a reach that is too long, and where that is wrong.

    The reach, its regions that were missed altogether, and how many points at
    random within the others there are, and are missed.
    """
    robot = load_robot("nadia")
    whole = replace(robot.point_mass.reach, length_forward=1.3, width_max=1.0)
    robot.point_mass = replace(robot.point_mass, reach=whole)
    reach, missed_regions = reach_within(robot)
    rng, missed, count = np.random.default_rng(1), 0, 0
    for polygon in step_regions(reach, cross_over=True).values():
        for point in rng.uniform(polygon.min(0), polygon.max(0), (20, 2)):
            beside = abs(point[0]) < 0.28 and point[1] < 0.15
            if contains(point, polygon) and not beside:
                missed += stride(robot, point) is None
                count += 1
    return reach, missed_regions, count, missed


@pytest.mark.parametrize("name", ["nadia", "atlas", "g1"])
def test_what_comes_with_a_robot_is_within_its_reach(name):
    """Oracle: inverse kinematics at every corner; nothing is cut down."""
    robot = load_robot(name)
    assert reach_within(robot) == (robot.point_mass.reach, set())


def test_a_reach_that_is_too_long_is_cut_down():
    """Oracle: inverse kinematics, at random within the regions that are left.

    The bar of the project: 2 % of what is called reachable are not.
    """
    reach, missed_regions, count, missed = run_cache.once(
        __name__, "", cut_down
    )
    assert not missed_regions
    assert 0.9 < reach.length_forward < 1.25
    assert count > 25
    assert missed <= 0.02 * count
