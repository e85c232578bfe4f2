"""Oracles: the step response in closed form; the torque-speed line by hand."""

import math

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.systems.joint_drives import JointDrives
from tests.blocks import answer, running
from tests.whole_body_examples import nadia, standing_state

STEP = 0.001  # of the plant [s]
PLANT, _ = nadia().add_plant_to(DiagramBuilder())
LIMITS = PLANT.GetEffortUpperLimits()


def torques_after(ticks: int, commanded: np.ndarray, state: np.ndarray):
    """What is there so long after a command, from nothing."""
    system = JointDrives(PLANT, nadia())
    inputs = {"actuation": commanded, "state": state}
    simulator, context = running(system, **inputs)
    if ticks:
        simulator.AdvanceTo((ticks - 0.5) * STEP)
    return answer(system, context, "torques")


@pytest.mark.parametrize("ticks", [0, 1, 4, 40])
def test_follows_with_a_lag(ticks):
    """Oracle: 1 - exp(-omega t), of 40 Hz."""
    commanded = np.linspace(-0.9, 0.9, 23) * LIMITS
    share = 1.0 - math.exp(-2.0 * math.pi * 40.0 * ticks * STEP)
    found = torques_after(ticks, commanded, standing_state())
    assert found == pytest.approx(share * commanded)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("speed", "most"), [(6.0, 1.0), (9.0, 0.5), (15.0, 0)])
def test_what_drives_a_joint_fades_with_its_speed(speed, most, way):
    """Oracle: the line; the other joints, and what brakes, have it all."""
    knee = PLANT.GetJointActuatorByName("LEFT_KNEE_Y")
    state, drives = standing_state(), LIMITS.copy()
    velocity = PLANT.num_positions() + knee.joint().velocity_start()
    state[velocity] = way * speed
    drives[PLANT.GetActuatorNames().index("nadia_LEFT_KNEE_Y")] *= most
    found = torques_after(100, 2.0 * way * LIMITS, state)
    assert found == pytest.approx(way * drives)
    found = torques_after(100, -2.0 * way * LIMITS, state)
    assert found == pytest.approx(-way * LIMITS)
