"""Oracles: weights of boxes that lie on the ground."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.geometry import Sphere
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.walking.state import Side
from nadia_balance.systems.hardware import FootForceSensor
from tests.boxes import cube, ground, register

ROBOT = SimpleNamespace(
    foot_bodies={Side.LEFT: "left", Side.RIGHT: "right"}, mass=8.0
)
WEIGHT_LEFT, WEIGHT_RIGHT = 3.0 * 9.81, 5.0 * 9.81
HALF, KNOB = 0.05, 0.01
CORNERS = [[x, y, -HALF] for x in (-HALF, HALF) for y in (-HALF, HALF)]
ON_GROUND_LEFT = [0.0, 0.3, HALF + KNOB]
ON_GROUND_RIGHT = [0.0, -0.3, HALF + KNOB]
ON_RIGHT_FOOT = [0.0, -0.3, 3 * HALF + 2 * KNOB]


def recorded(left, right, period=0.002, every=0.0, **noise) -> np.ndarray:
    """Lets two boxes settle where they are put, and reads the sensor.

    Once a `period`, or `every` so many seconds, from 0 to 0.6 s (n, 2).  A box
    on a plane touches it in one point and rocks: each has four knobs.
    """
    builder = DiagramBuilder()
    plant = ground(builder)
    robot = plant.AddModelInstance("robot")
    for name, mass, p_WB in (("left", 3.0, left), ("right", 5.0, right)):
        body = cube(plant, name, robot, mass, 2 * HALF, p_WB)
        for corner in CORNERS:
            register(plant, body, Sphere(KNOB), corner)
    plant.Finalize()
    sensor = builder.AddSystem(FootForceSensor(plant, ROBOT, period, **noise))
    builder.Connect(
        plant.get_contact_results_output_port(), sensor.get_input_port()
    )
    logger = LogVectorOutput(
        sensor.GetOutputPort("foot_forces"), builder, every or period
    )
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.6)
    return logger.FindLog(simulator.get_context()).data().T


def test_a_foot_on_the_other_foot_is_not_on_the_ground():
    """Oracle: the lower one carries both weights."""
    forces = recorded(ON_RIGHT_FOOT, ON_GROUND_RIGHT)[-1]
    assert forces[0] == 0.0
    assert forces[1] == pytest.approx(WEIGHT_LEFT + WEIGHT_RIGHT, rel=1e-2)


@pytest.mark.parametrize("period", [0.001, 0.004])
def test_no_impact_is_missed(period):
    """Oracle: the momentum of a fall from 5 cm to rest is that of the weight.

    The impacts last for one step of the plant, 1 ms.
    """
    high = [0.0, 0.3, HALF + KNOB + 0.05]
    forces = recorded(high, ON_GROUND_RIGHT, period=period)
    assert np.max(forces[:, 0]) > 10.0 * WEIGHT_LEFT
    impulse = period * np.sum(forces, axis=0)
    expected = 0.6 * np.array([WEIGHT_LEFT, WEIGHT_RIGHT])
    assert impulse == pytest.approx(expected, rel=0.01)


def test_the_output_changes_once_a_period():
    """Oracle: the means of what a sensor tells that has a step as period."""
    high = [0.0, 0.3, HALF + KNOB + 0.05]
    steps = recorded(high, ON_GROUND_RIGHT, period=0.001)[1:]
    held = recorded(high, ON_GROUND_RIGHT, period=0.004, every=0.001)[4:]
    means = steps.reshape(-1, 4, 2).mean(axis=1)
    expected = np.repeat(means, 4, axis=0)[: len(held)]
    assert held == pytest.approx(expected)


def test_noise_is_a_share_of_the_load_and_the_offset_stays():
    """Oracle: moments, of 150 ticks at rest; equal seeds, equal bits."""
    sensors = SensorParams(load_noise=0.05, load_bias=0.02)
    loads = recorded(ON_GROUND_LEFT, ON_GROUND_RIGHT, sensors=sensors)[150:]
    weights = np.array([WEIGHT_LEFT, WEIGHT_RIGHT])
    noise = loads.std(axis=0) / weights
    assert noise == pytest.approx([0.05, 0.05], rel=4.0 / 300**0.5)
    offset = np.abs(loads.mean(axis=0) - weights)
    assert np.all(offset < 4.0 * 0.02 * (WEIGHT_LEFT + WEIGHT_RIGHT))
    again = recorded(ON_GROUND_LEFT, ON_GROUND_RIGHT, sensors=sensors)[150:]
    assert np.array_equal(loads, again)


@pytest.mark.parametrize(
    ("period", "step", "message"),
    [
        (0.0015, 0.001, "^period = 0.0015: must be a multiple of 0.001 s"),
        (0.002, 0.0, "^time_step = 0.0: must be > 0 s"),
        (math.nan, 0.001, "^period = nan: must be finite and > 0 s"),
    ],
)
def test_refuses_a_period_that_the_plant_does_not_keep(period, step, message):
    """Oracle: the message names what is wrong."""
    plant = MultibodyPlant(time_step=step)
    for name in ROBOT.foot_bodies.values():
        plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    plant.Finalize()
    with pytest.raises(ValueError, match=message):
        FootForceSensor(plant, ROBOT, period)
