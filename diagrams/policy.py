"""A learned policy as the controller of a scenario."""

import math
from pathlib import Path

from nadia_balance.core.math.bounds import check
from nadia_balance.core.walking.push import Moment
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.policy_controller import PolicyController, PolicyParams
from nadia_balance.robot.model import load_robot


def policy_of(scenario: Scenario, onnx: str | Path) -> PolicyController:
    """Returns the policy in the file `onnx`; its clock times the pushes.

    It walks at the mean velocity of the gait, or stands if that has no steps.
    The moments of the scenario's pushes become times.

    Raises ValueError: the policy does not fit the robot or the scenario.
    """
    params, gait = PolicyParams(), scenario.gait
    step, time = gait.step, gait.swing_duration + gait.transfer_duration
    if gait.steps or gait.footholds:
        raise ValueError("gait: must have num_steps with a policy")
    way = step.length, step.sideways, math.radians(step.yaw_deg)
    if not gait.num_steps or any(way):
        params.command = tuple(part / time for part in way)
    robot = load_robot(scenario.robot, scenario.fidelity)
    policy = PolicyController(robot, onnx, params)
    for push in scenario.pushes:
        push.at = str(Moment(time=policy.time_of(push.moment)))
    check(scenario)
    return policy
