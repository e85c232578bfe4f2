"""A sweep is what its flags say, is checked, and says what it shares."""

import json
import shutil

import pytest

from nadia_balance.core.walking.mechanisms import ATLAS_MECHANISMS, MECHANISMS
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.parameters.yaml_writer import dump
from nadia_balance.robot.model import MODELS
from nadia_balance.scripts.envelope import parser_of, sweep_from
from nadia_balance.sweep.search import SearchParams
from nadia_balance.sweep.trials import Cell, robot_hash
from tests.sweep.made_up import made_up_sweep

LATER = "left transfer 50 %"


def sweep_of(*argv):
    return sweep_from(parser_of().parse_args(argv))


def test_without_flags_it_is_the_papers_figure():
    """Oracle: five columns, twelve directions, 25 % into a right swing."""
    sweep = sweep_of()
    assert sweep.mechanisms == tuple(MECHANISMS)
    assert sweep.directions == tuple(30.0 * i for i in range(12))
    assert sweep.at == ("right swing 25 %",)
    assert sweep.search == SearchParams(resolution=0.02, stride=8, replicas=5)
    assert (sweep.plant, list(sweep.scenarios)) == ("humanoid", ["push"])


def test_the_protocol_of_the_atlas_paper_is_its_figure_6():
    """Oracle: its Sec. V and its caption; half of each step forward."""
    sweep = sweep_of("--protocol", "atlas_fig6")
    assert sweep.mechanisms == tuple(ATLAS_MECHANISMS)
    assert sweep.at == ("right swing 50 %",)
    assert (sweep.one.robot, len(sweep.cells())) == ("atlas", 4 * 4 * 14)
    assert {d % 15.0 for d in sweep.directions} == {0.0}
    gaits = set()
    for name, scenario in sweep.scenarios.items():
        gait, controller = scenario.gait, scenario.controller
        assert gait == load_scenario(name).gait
        step = round(gait.swing_duration + gait.transfer_duration, 9)
        gaits.add((gait.step.length, step))
        assert controller.icp_step_qp is not None
        assert controller.timing_adapter.min_swing_duration == 0.6
        assert scenario.pushes[0].duration == 0.1
    assert gaits == {(0.5, 0.95), (0.5, 2.0), (0.0, 0.95), (0.0, 2.0)}
    quick = sweep_of("--protocol", "atlas_fig6", "--quick")
    assert quick.mechanisms == ("feedback_step_timing",)
    assert list(quick.scenarios) == list(sweep.scenarios)


def test_the_flags_of_a_scenario_are_its_own(monkeypatch):
    """Oracle: by hand; directions are a count, or a list that wraps."""
    for text, degrees in {
        "4": (0.0, 90.0, 180.0, 270.0),
        "-1e-9,359.5, 30 ,-0.5": (0.0, 359.5, 30.0),
    }.items():
        assert sweep_of(f"--directions={text}").directions == degrees
    monkeypatch.chdir(MODELS / "nadia")
    sweep = sweep_of(
        *("--seed", "5", "--plant", "lipm"),
        *("--mechanisms", "step, icp_only", "--robot", "robot.yaml"),
        *("--at", "right swing 25.0%, left transfer 50%"),
    )
    assert (sweep.one.seed, sweep.plant) == (5, "lipm")
    assert sweep.mechanisms == ("step", "icp_only")
    assert sweep.at == ("right swing 25 %", "left transfer 50 %")
    # Found from anywhere.
    assert sweep.one.robot == str(MODELS / "nadia" / "robot.yaml")


@pytest.mark.parametrize("name", ["stand", "push,atlas_in_place_fast"])
def test_refuses_scenarios_of_another_kind(name):
    with pytest.raises(ValueError, match="^scenario_name = .*: must have one"):
        sweep_of("--scenario_name", name)


@pytest.mark.parametrize("plant, tick", [("lipm", 0.01), ("humanoid", 4e-3)])
def test_replicas_differ_by_seed_and_a_tick_and_nothing_else(plant, tick):
    """Oracle: put back what differs, and compare all of the texts."""
    sweep = made_up_sweep(plant=plant)
    scenario = sweep.scenarios["push"] = sweep.scenarios["push"].changed(seed=7)
    scenario.pushes[0].delay = 0.5
    before = dump(scenario)
    cell, texts = Cell("push", LATER, "step", 90.0), set()
    for replica in range(4):
        walk = sweep.walk(cell, replica)
        (push,) = walk.pushes
        assert walk.seed == 7 + replica
        assert push.delay == 0.5 + (replica % 2) * tick
        assert (walk.mechanisms, push.at, push.delta_v) == ("step", LATER, 0)
        push.delay = 0.5
        texts.add(dump(walk.changed(seed=7)))
    assert len(texts) == 1
    assert dump(scenario) == before


def test_parameters_are_all_but_what_a_sweep_sets_itself():
    """Oracle: by hand; JSON, there and back again; other cells."""
    identity = made_up_sweep().identity()
    assert json.loads(json.dumps(identity)) == identity
    other = {"directions": (45.0,), "mechanisms": ("step_swing",)}
    assert made_up_sweep(**other, at=(LATER,)).identity() == identity

    def hash_of(scenario):
        sweep = made_up_sweep(scenarios={"push": scenario})
        return sweep.identity()["parameters"]

    scenario = load_scenario("push")
    before = hash_of(scenario)
    scenario = scenario.changed(description="x", mechanisms="icp_only")
    push = scenario.pushes[0]
    push.delta_v, push.force = None, 100.0
    push.direction_deg, push.at = 10.0, "1 s"
    assert hash_of(scenario) == before
    for text in (
        "duration: 13.0",
        "gait: {swing_duration: 0.6}",
        "controller: {balance: {feedback_gain: 2.5}}",
        "pushes: [{delta_v: 0.4, at: 1 s, duration: 0.2}]",
    ):
        changed = load_scenario("push", text=text)
        assert hash_of(changed) != before, text


def test_a_robot_is_what_its_files_say_not_where_they_are(tmp_path):
    shutil.copytree(MODELS / "nadia", tmp_path / "nadia")
    copied = str(tmp_path / "nadia" / "robot.yaml")
    files = robot_hash(copied)
    assert files == robot_hash("nadia")
    with (tmp_path / "nadia" / "nadia.urdf").open("a") as urdf:
        urdf.write("<!-- changed -->")
    assert robot_hash(copied) != files
    with pytest.raises(FileNotFoundError, match="nowhere.yaml: no such"):
        robot_hash("nowhere.yaml")
