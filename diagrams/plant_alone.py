"""The plant without its controller: what the closed loop is compared with."""

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from diagrams.scenario import Scenario
from nadia_balance.robot import load_robot, terrain_file

STIFFNESS, DAMPING = 3000.0, 100.0  # of the joints


def plant_alone(scenario: Scenario) -> Simulator:
    """The same robot, ground and contact, held by Drake's joint control."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(scenario.plant_config, builder)
    robot = load_robot(scenario.robot)
    instance = robot.add_to(plant)
    Parser(plant).AddModels(str(terrain_file()))
    for i in plant.GetJointActuatorIndices():
        plant.get_joint_actuator(i).set_controller_gains(
            PdControllerGains(p=STIFFNESS, d=DAMPING)
        )
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    q = robot.standing_positions()
    plant.SetPositions(context, q)
    joints = [
        plant.get_joint_actuator(i).joint().position_start()
        for i in plant.GetJointActuatorIndices()
    ]
    plant.get_desired_state_input_port(instance).FixValue(
        context, np.concatenate([q[joints], np.zeros(len(joints))])
    )
    return simulator
