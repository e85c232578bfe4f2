"""Oracle: bounds of what a drive may be told: of the torque's limit a tick."""

import pytest

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import start
from nadia_balance.systems.signals import read
from tests.diagrams.simulated import run_of, soon


def standing(robot: str, sensors: str) -> Scenario:
    return load_scenario("stand", robot=robot, sensors=sensors, duration=1.2)


def walking(robot: str, sensors: str) -> Scenario:
    text = "{gait: {num_steps: 2}}"
    scenario = load_scenario("walk_in_place", robot=robot, text=text)
    return soon(scenario).changed(sensors=sensors, duration=2.4, seed=3)


@pytest.mark.parametrize("robot", ["g1", "nadia"])
@pytest.mark.parametrize(
    ("scenario", "most"), [(standing, 0.005), (walking, 0.02)]
)
def test_torques_do_not_follow_the_noise_of_the_joints(robot, scenario, most):
    """Five times as much without the filter (G1: 2.5 and 4.8 %)."""
    run = run_of(scenario(robot, "proprioceptive"))
    assert run.fell_at is None
    assert run.summary["torque_step_ratio"] < most


@pytest.mark.parametrize(
    ("sensors", "has_gains"), [("perfect", False), ("industrial", True)]
)
def test_drives_hold_the_joints_where_noise_hides_them(sensors, has_gains):
    """Oracle: the gains that the drives are told at the start."""
    diagram = HumanoidDiagram(standing("g1", sensors))
    context = start(diagram).get_context()
    port = diagram.controller.GetOutputPort("joint_command")
    assert bool(read(port, context).reshape(5, -1)[3:].all()) == has_gains
    assert bool(read(port, context).reshape(5, -1)[3:].any()) == has_gains
