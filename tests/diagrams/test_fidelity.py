"""Drives as they could be built, and ideal ones, of a robot that is shoved."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.balance_controller import BalanceController
from nadia_balance.robot.model import load_robot
from nadia_balance.systems.foot_force_sensor import FootForceSensor
from nadia_balance.systems.push_source import PushSource
from nadia_balance.systems.wiring import connect
from tests.diagrams.simulated import diagram_of, figures, scenario_of, simulated

PERIOD = 0.004
PUSH = "duration: 0.5, pushes: [{delta_v: 0.3, at: 0.1 s, direction_deg: 90}]}"
REALISTIC = f"{{fidelity: realistic, {PUSH}"
IDEAL = f"{{fidelity: ideal, {PUSH}"


def test_real_torques_lag_behind_the_commanded():
    """Oracle: a first-order lag of 40 Hz in closed form, from tick to tick.

    The joints are slower than half their limit.  The robot stands at first,
    and its drives hold it.
    """
    logs = simulated(REALISTIC).logs
    commanded, torques = logs["actuation"], logs["torques"]
    left = math.exp(-2.0 * math.pi * 40.0 * PERIOD)
    expected = commanded + left * (torques - commanded)
    assert figures(REALISTIC)["max_joint_speed_ratio"] < 0.5
    assert torques[1:] == pytest.approx(expected[:-1], abs=1e-9)
    assert np.array_equal(torques[0], commanded[0])


def test_an_ideal_robot_has_no_drives():
    """Oracle: bits of a loop by hand, the controller's torques on the plant."""
    scenario = scenario_of(IDEAL)
    robot, builder = load_robot("nadia", "ideal"), DiagramBuilder()
    plant, _ = robot.add_plant_to(builder)
    controller = builder.AddSystem(
        BalanceController(
            scenario.controller, robot, start=scenario.start(robot.point_mass)
        )
    )
    sensor = builder.AddSystem(FootForceSensor(plant, robot, PERIOD))
    push = builder.AddSystem(
        PushSource(
            scenario.pushes, robot.mass, PERIOD, plant, robot.pelvis_body
        )
    )
    connect(builder, plant, controller, state="estimated_state")
    connect(builder, plant, sensor, "contact_results")
    connect(builder, sensor, controller, "foot_forces")
    connect(builder, controller, plant, "actuation")
    connect(builder, controller, push, "walking_state")
    connect(builder, push, plant, spatial_forces="applied_spatial_force")
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(50 * PERIOD)
    state = plant.get_state_output_port().Eval(
        plant.GetMyContextFromRoot(simulator.get_context())
    )
    logs = simulated(IDEAL).logs
    assert not diagram_of(IDEAL).HasSubsystemNamed("joint_drives")
    assert np.array_equal(state, logs["state"][50])
    assert np.array_equal(logs["torques"], logs["actuation"])
    assert figures(IDEAL)["max_joint_speed_ratio"] == 0.0
