"""Any scenario, any robot, from anywhere."""

import shutil

import numpy as np
import pytest

from diagrams.scenario import scenario_names
from nadia_balance.robot import MODELS
from scripts import simulate
from tests.scripts.running import (
    as_program,
    assert_refused,
    run_script,
    summary_of,
)


def test_simulates_a_scenario_of_a_file(tmp_path, capsys):
    """Oracle: two steps, of which the file knows."""
    file = tmp_path / "mine.yaml"
    file.write_text("two: {duration: 4.5, gait: {num_steps: 2}}\n")
    argv = ["--scenario_file", file, "--scenario_name", "two", "--plant"]
    argv += ["lipm", "--no-meshcat", "--out", tmp_path / "run"]
    outcome = run_script(simulate, argv, capsys)
    assert (outcome.code, outcome.err) == (0, [])
    assert "WALKED 2 steps" in outcome.out[0]
    assert summary_of(tmp_path / "run")["steps_taken"] == 2


def test_a_scenario_without_a_push_tells_of_none(tmp_path, capsys):
    argv = ["--scenario_name", "stand", "--plant", "lipm", "--no-meshcat"]
    argv += ["--duration", 1, "--out", tmp_path]
    outcome = run_script(simulate, argv, capsys)
    assert outcome.code == 0
    assert "STOOD" in outcome.out[0]
    summary = summary_of(tmp_path)
    assert (summary["direction_deg"], summary["delta_v"]) == (None, None)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        ([], "the following arguments are required: --scenario_name"),
        (["--scenario_name", "x"], "scenario_name = 'x': must be one of push,"),
        (
            ["--scenario_name", "stand", "--delta-v", 3],
            "unrecognized arguments",
        ),
    ],
)
def test_refuses_what_has_no_meaning(argv, message, capsys):
    assert_refused(run_script(simulate, argv, capsys), message)


def test_help_names_every_scenario(capsys):
    """Oracle: the scenarios of the package; a line break may split a list."""
    outcome = run_script(simulate, ["--help"], capsys)
    assert outcome.code == 0
    words = " ".join(outcome.out).replace(",", " ").split()
    assert set(scenario_names()) < {word.rstrip(".") for word in words}
    for flag in ("--scenario_file", "--robot", "--seed", "--out", "--hold"):
        assert any(flag in line for line in outcome.out)


def test_another_robot_from_another_folder(tmp_path):
    """Oracle: the CoM height in the robot.yaml of a copy of Nadia.

    As a program of its own, in a folder that knows nothing of the project.
    """
    robot = tmp_path / "my_nadia"
    shutil.copytree(MODELS / "nadia", robot)
    file = robot / "robot.yaml"
    text = file.read_text()
    assert "com_height: 0.888" in text
    file.write_text(text.replace("com_height: 0.888", "com_height: 0.86"))
    done = as_program(
        *("simulate", "--scenario_name", "stand", "--no-meshcat"),
        *("--robot", "my_nadia/robot.yaml", "--duration", 0.6),
        cwd=tmp_path,
    )
    assert (done.returncode, done.stderr) == (0, "")
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("_stand")
    with np.load(folder / "log.npz") as log:
        # The posture, that of 0.888 m, draws her up by a millimetre.
        assert log["com_state"][:, 2] == pytest.approx(0.86, abs=0.003)
    assert summary_of(folder)["robot"] == "my_nadia/robot.yaml"
    assert summary_of(folder)["max_icp_error_m"] < 0.001
