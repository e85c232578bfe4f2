"""Hashes change with what a trial depends on, and with nothing else."""

import re
import shutil
import subprocess
import sys

import pytest

from diagrams.envelope import fingerprints
from diagrams.scenario import load_scenario
from diagrams.summary import versions
from nadia_balance.robot import MODELS
from tests.source_files import ROOT


def test_names_every_file_of_a_trial():
    """Oracle: what Python imports for one, here, without the fingerprints."""
    code = "import sys, diagrams.envelope.trial; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True
    )
    package = "diagrams.envelope."
    names = {
        f"{module.removeprefix(package)}.py"
        for module in done.stdout.split()
        if module.startswith(package)
    }
    assert names - {"fingerprints.py"} == set(fingerprints.TRIAL_FILES)


def test_is_sixteen_digits_each_time():
    found = {fingerprints.code_hash() for _ in range(2)}
    (digits,) = found
    assert re.fullmatch("[0-9a-f]{16}", digits)


@pytest.mark.parametrize(
    "change",
    [
        {"description": "x"},
        {"seed": 7},
        {"mechanisms": "icp_only"},
    ],
)
def test_ignores_what_a_sweep_sets_itself(change):
    scenario = load_scenario("push")
    before = fingerprints.parameters_hash(scenario)
    for name, value in change.items():
        setattr(scenario, name, value)
    push = scenario.pushes[0]
    push.delta_v, push.force = None, 100.0
    push.direction_deg, push.phase, push.time = 10.0, None, 1.0
    push.side, push.fraction = "left", 0.5
    assert fingerprints.parameters_hash(scenario) == before
    assert push.force == 100.0, "it must leave the scenario alone"


@pytest.mark.parametrize(
    "text",
    [
        "duration: 13.0",
        "required_steps: 3",
        "gait: {swing_duration: 0.6}",
        "controller: {balance: {feedback_gain: 2.5}}",
        "pushes: [{delta_v: 0.4, time: 1.0, duration: 0.2}]",
        "pushes: [{delta_v: 0.4, time: 1.0, after_steps: 3}]",
    ],
)
def test_sees_every_other_parameter(text):
    changed = load_scenario("push", text=text)
    same = load_scenario("push")
    assert fingerprints.parameters_hash(changed) != (
        fingerprints.parameters_hash(same)
    )


def test_a_robot_is_what_its_files_say_not_where_they_are(tmp_path):
    scenario = load_scenario("push")
    before = fingerprints.parameters_hash(scenario)
    robot = tmp_path / "elsewhere"
    shutil.copytree(MODELS / "nadia", robot)
    scenario.robot = str(robot / "robot.yaml")
    assert fingerprints.parameters_hash(scenario) == before
    files = fingerprints.robot_hash(scenario.robot)
    assert files == fingerprints.robot_hash("nadia")
    urdf = robot / "nadia.urdf"
    text = urdf.read_text()
    urdf.write_text(f"{text}\n<!-- changed -->\n")
    assert fingerprints.parameters_hash(scenario) != before
    assert fingerprints.robot_hash(scenario.robot) != files


def test_says_that_the_robot_is_missing():
    scenario = load_scenario("push")
    scenario.robot = "nowhere.yaml"
    with pytest.raises(FileNotFoundError, match="robot = nowhere.yaml: no suc"):
        fingerprints.parameters_hash(scenario)
    with pytest.raises(FileNotFoundError, match="robot = nowhere.yaml: no suc"):
        fingerprints.robot_hash("nowhere.yaml")


def test_this_code_is_told_by_versions_and_a_hash():
    """Oracle: the versions in every summary."""
    asked = {**versions(), "code": fingerprints.code_hash()}
    assert fingerprints.this_code() == asked


def test_sees_a_change_of_the_code_but_not_of_a_plot(tmp_path):
    """Oracle: a copy of the project, changed in one file at a time."""
    junk = shutil.ignore_patterns("__pycache__")
    for folder in ("nadia_balance", "diagrams", "models"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=junk)
    before = fingerprints.code_hash(tmp_path)
    assert before == fingerprints.code_hash()
    for name in ("diagrams/plots/style.py", "diagrams/envelope/report.py"):
        (tmp_path / name).write_text("")
        assert fingerprints.code_hash(tmp_path) == before
    for name in (
        "diagrams/summary.py",
        *(f"diagrams/envelope/{name}" for name in fingerprints.TRIAL_FILES),
        "nadia_balance/core/lipm.py",
        "models/nadia/robot.yaml",
    ):
        (tmp_path / name).write_text("")
        assert (after := fingerprints.code_hash(tmp_path)) != before
        before = after
