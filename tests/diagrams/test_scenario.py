"""Scenarios: all of them load, and none that is wrong gets through."""

import pytest
from pydrake.common.yaml import yaml_load_file

from nadia_balance.core.plan.gait import Gait
from nadia_balance.core.walking.push import Push
from nadia_balance.diagrams import scenario as module
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.robot.model import load_robot

FILES = sorted(module.SCENARIO_FOLDER.glob("*.yaml"))


def test_every_scenario_loads_and_has_its_steps_in_reach():
    """Oracle: the footsteps that are made; the names in the files."""
    names = [name for path in FILES for name in yaml_load_file(str(path))]
    assert sorted(names) == sorted(module.scenario_names())
    robots = {name: load_robot(name) for name in ("nadia", "atlas", "g1")}
    for name in names:
        scenario = load_scenario(name)
        assert scenario.description
        model = scenario.point_mass(robots[scenario.robot])
        schedule = scenario.start(model).schedule
        gait = scenario.gait
        walks = bool(gait.num_steps or gait.steps or gait.footholds)
        assert bool(schedule.footsteps) == walks


def test_what_is_given_is_not_scaled():
    """Oracle: the same values as text, which are in SI units."""
    changes = {
        "gait": Gait(num_steps=4, swing_duration=0.6, transfer_duration=0.2),
        "pushes": [Push(delta_v=0.3, duration=0.2, at="1 s")],
    }
    text = """gait: {num_steps: 4, swing_duration: 0.6, transfer_duration: 0.2}
pushes: [{delta_v: 0.3, duration: 0.2, at: 1 s}]"""
    found = load_scenario("walk_in_place", robot="g1", **changes)
    told = load_scenario("walk_in_place", text=text, robot="g1")
    assert found.gait == changes["gait"] and found.pushes == told.pushes
    for name in ("swing_duration", "transfer_duration"):
        assert getattr(found.gait, name) == getattr(told.gait, name)


# What is wrong, and how the message begins.  The bounds of the parameters are
# tested with their classes: here is one of each kind, to see that it is asked.
BAD_TEXTS = {
    "seed: -1": "seed = -1: must be",
    "duration: 0.001": "duration = 0.001: must be",  # half a tick
    "mechanisms: luck": "mechanisms = 'luck': must be one of icp_only",
    "engine: bullet": "engine = 'bullet': must be one of drake, mujoco",
    "imperfections: {delay: 0.003}": "imperfections.delay = 0.003: must",
    "{engine: mujoco, imperfections: {friction_ratio: 0.5}}": (
        "imperfections.friction_ratio = 0.5: must be 1"
    ),
    "time_step: 0.0015": "time_step = 0.0015: must divide",
    "{mechanisms: all_with_cross_over, controller: {icp_step_qp: {}}}": (
        "mechanisms = 'all_with_cross_over': must not let the legs cross"
    ),
    "mechanisms: feedback_step": "mechanisms = 'feedback_step': must go",
    "pushes: [{delta_v: 1, at: 10 s}]": "at = '10 s': must be before duration",
    "{gait: {num_steps: 2}, commands: [{forward: 0.1}]}": (
        "gait.num_steps = 2: must not come with commands"
    ),
    "{gait: {steps: [{}]}, random_commands: 0.5}": "gait.steps = [StepVector(",
    "{commands: [{time: 5}], random_commands: 0.5}": (
        "random_commands = 0.5: must not come with commands"
    ),
    "commands: [{time: -1}]": "commands[0].time = -1.0: must be in [0, 3600] s",
    "commands: [{forward: .nan}]": "commands[0].forward = nan: must be",
    "commands: [{time: 2}, {time: 2, turn: 0.1}]": (
        "commands[1].time = 2.0: must be later than 2.0 s"
    ),
}


@pytest.mark.parametrize("text", BAD_TEXTS)
def test_a_value_out_of_range_is_refused_by_its_name(text):
    with pytest.raises(ValueError) as error:
        load_scenario("stand", text=text)
    assert str(error.value).startswith(BAD_TEXTS[text])
