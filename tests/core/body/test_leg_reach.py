"""Oracles: two legs of two links each, tried one by one; the Nadia paper."""

import math

import numpy as np
import pytest

from nadia_balance.core.body.com_height import leg_reach
from nadia_balance.core.body.model import LegGeometry
from nadia_balance.robot.model import load_robot_params

THIGH, SHIN = 0.35, 0.42
LEGS = LegGeometry(
    length=THIGH + SHIN, ankle_height=0.08, com_above_hip=0.1, hip_width=0.2
)
COM_HEIGHT = 0.9
# From hip to ankle, crouching.
HEIGHT = 0.8 * COM_HEIGHT - 0.1 - 0.08


def farthest(lean: float) -> tuple[float, float]:
    """How far an ankle is from under its hip, along and aside [m].

    Of all bends of a knee, and all leans as far as `lean` [rad]; a leg is not
    longer than 0.97 of a straight one, the hip as low as HEIGHT.
    """
    bends = np.linspace(0.0, 2.5, 50001)
    squared = THIGH**2 + SHIN**2 + 2.0 * THIGH * SHIN * np.cos(bends)
    along = np.sqrt(
        squared[(squared > HEIGHT**2) & (squared < (0.97 * LEGS.length) ** 2)]
        - HEIGHT**2
    )
    aside = HEIGHT * np.tan(np.linspace(0.0, lean, 1001))
    return along.max(), aside[aside <= along.max()].max()


@pytest.mark.parametrize("lean", [0.2, 0.5, 1.2])
def test_the_feet_are_as_far_apart_as_two_legs_go(lean):
    """Oracle: enumeration of the bends of a knee; the hips are half-way."""
    along, aside = farthest(lean)
    length, width_max = leg_reach(LEGS, COM_HEIGHT, lean)
    assert length == pytest.approx(2.0 * along, abs=2e-3)
    assert width_max == pytest.approx(0.2 + 2.0 * aside, abs=2e-3)


def test_nadias_is_the_papers():
    """Oracle: Sec. VII: 1 m and 0.8 m; its ankles roll by 25 degrees."""
    robot = load_robot_params("nadia")[0]
    found = leg_reach(robot.legs, robot.com_height, math.radians(25.0))
    np.testing.assert_allclose(found, (1.0, 0.8), rtol=0.01)


def test_refuses_legs_that_a_crouch_does_not_bend():
    """Oracle: 0.18 m and 0.97 of the legs are 0.927 m, less than 0.8 x 1.2."""
    with pytest.raises(ValueError, match=r"^com_height = 1\.2: must leave"):
        leg_reach(LEGS, 1.2, 0.5)
