"""Any scenario, any robot, from anywhere."""

import shutil

import numpy as np
import pytest

from nadia_balance.diagrams.scenario import scenario_names
from nadia_balance.robot import MODELS
from nadia_balance.scripts import benchmark, push, simulate
from tests.scripts.running import (
    as_program,
    assert_refused,
    run_script,
    summary_of,
)

QUICK = ["--plant", "lipm", "--no-meshcat"]


def test_simulates_a_scenario_of_a_file(tmp_path, capsys):
    """Oracle: two steps, of which the file knows."""
    file = tmp_path / "mine.yaml"
    file.write_text("two: {duration: 4.5, gait: {num_steps: 2}}\n")
    argv = ["--scenario_file", file, "--scenario_name", "two", *QUICK]
    outcome = run_script(simulate, [*argv, "--out", tmp_path / "run"], capsys)
    assert (outcome.code, outcome.err) == (0, [])
    assert "WALKED 2 steps" in outcome.out[0]
    summary = summary_of(tmp_path / "run")
    assert summary["steps_taken"] == 2
    assert summary["pushes"] == []
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


@pytest.mark.parametrize(
    ("script", "flag"),
    [(benchmark, "--seconds"), (push, "--at"), (simulate, "--scenario_file")],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_help_has_the_flags_and_the_exit_codes(script, flag, capsys):
    outcome = run_script(script, ["--help"], capsys)
    assert outcome.code == 0
    text = " ".join(" ".join(outcome.out).split())
    assert flag in text
    assert "Exit code: 0 " in text
    if script is simulate:
        assert all(name in text for name in scenario_names())


def test_another_robot_from_another_folder(tmp_path):
    """Oracle: the CoM height in the robot.yaml of a copy of Nadia.

    As a program of its own, in a folder that knows nothing of the project.
    """
    robot = tmp_path / "my_nadia"
    shutil.copytree(MODELS / "nadia", robot)
    file = robot / "robot.yaml"
    text = file.read_text()
    file.write_text(text + "\ncom_height: 0.86\n")
    done = as_program(
        *("simulate", "--scenario_name", "stand", "--no-meshcat"),
        *("--robot", "my_nadia/robot.yaml", "--duration", 0.6),
        cwd=tmp_path,
    )
    assert (done.returncode, done.stderr) == (0, "")
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("_stand")
    with np.load(folder / "log.npz") as log:
        # The posture, that of 0.888 m, draws it up by a millimetre.
        assert log["com_state"][:, 2] == pytest.approx(0.86, abs=0.003)
    assert summary_of(folder)["robot"] == "my_nadia/robot.yaml"
    assert summary_of(folder)["max_icp_error_m"] < 0.001
