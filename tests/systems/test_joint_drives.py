"""Oracle: the torque-speed line by hand; the lag: diagrams/test_robots.py."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.systems.hardware import JointDrives
from tests.blocks import answer, running
from tests.whole_body_examples import nadia, standing_state

PLANT, _ = nadia().add_plant_to(DiagramBuilder())
LIMITS = PLANT.GetEffortUpperLimits()


def torques(commanded: np.ndarray, state: np.ndarray):
    """What is there 0.1 s after a command, from nothing."""
    system = JointDrives(PLANT, nadia())
    simulator, context = running(system, actuation=commanded, state=state)
    simulator.AdvanceTo(0.1)
    return answer(system, context, "torques")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("speed", "share"), [(6.0, 1.0), (9.0, 0.5), (15.0, 0)]
)
def test_what_drives_a_joint_fades_with_its_speed(speed, share, sign):
    """Oracle: the line; the other joints, and what brakes, have it all."""
    knee = PLANT.GetJointActuatorByName("LEFT_KNEE_Y")
    state, drives = standing_state(), LIMITS.copy()
    velocity = PLANT.num_positions() + knee.joint().velocity_start()
    state[velocity] = sign * speed
    drives[PLANT.GetActuatorNames().index("nadia_LEFT_KNEE_Y")] *= share
    reached = torques(2.0 * sign * LIMITS, state)
    assert reached == pytest.approx(sign * drives)
    reached = torques(-2.0 * sign * LIMITS, state)
    assert reached == pytest.approx(-sign * LIMITS)
