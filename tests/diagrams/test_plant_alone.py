"""Oracles: the closed loop's own plant, and gravity."""

import shutil

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator

from diagrams.plant_alone import plant_alone
from nadia_balance.robot import MODELS
from tests.diagrams.simulated import diagram_of, scenario_of


def plant_of(simulator: Simulator) -> MultibodyPlant:
    (plant,) = (
        system
        for system in simulator.get_system().GetSystems()
        if isinstance(system, MultibodyPlant)
    )
    return plant


def test_is_the_plant_of_the_closed_loop():
    """Oracle: what there is to step: bodies, contact shapes, time step."""
    text = "{plant_config: {time_step: 0.002}}"
    alone, loop = plant_of(plant_alone(scenario_of(text))), diagram_of(text)
    for number in (
        MultibodyPlant.num_bodies,
        MultibodyPlant.num_multibody_states,
        MultibodyPlant.num_actuators,
        MultibodyPlant.num_collision_geometries,
        MultibodyPlant.time_step,
        MultibodyPlant.get_discrete_contact_approximation,
    ):
        assert number(alone) == number(loop.plant)
    assert alone.time_step() == 0.002


def test_a_robot_may_have_another_name_than_its_urdf(tmp_path):
    """Oracle: the positions at the start, to which the joints are held."""
    shutil.copytree(MODELS / "nadia", tmp_path / "nadia")
    file = tmp_path / "nadia" / "robot.yaml"
    file.write_text(file.read_text().replace("name: nadia", "name: fred"))
    simulator = plant_alone(scenario_of(f"{{robot: {file}}}"))
    plant = plant_of(simulator)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    port = plant.get_desired_state_input_port(
        plant.GetModelInstanceByName("nadia")
    )
    held = port.Eval(context)[: plant.num_actuators()]
    assert sorted(held) == sorted(plant.GetPositions(context)[7:])


def test_stands_where_it_was_put():
    """Oracle: the posture, within the 1.5 cm and 3 deg that springs give.

    The ground carries its weight: it stands, and does not float or fall.
    """
    simulator = plant_alone(scenario_of())
    plant = plant_of(simulator)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    start = plant.GetPositions(context).copy()
    simulator.AdvanceTo(2.0)
    moved = np.abs(plant.GetPositions(context) - start)
    assert np.max(moved[4:7]) < 0.015
    assert np.max(moved[7:]) < np.radians(3.0)
    contacts = plant.get_contact_results_output_port().Eval(context)
    carried = sum(
        abs(contacts.point_pair_contact_info(i).contact_force()[2])
        for i in range(contacts.num_point_pair_contacts())
    )
    weight = plant.CalcTotalMass(context) * 9.81
    assert carried == pytest.approx(weight, rel=0.02)
