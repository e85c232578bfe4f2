"""The main job: what it takes, what it refuses, what it leaves behind."""

import signal

import numpy as np
import pytest
import yaml

from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.scripts import command_line, push
from nadia_balance.systems.signals import PushSignal
from tests.scripts.running import assert_refused, run_script, summary_of

QUICK = ["--plant", "lipm", "--no-meshcat"]


@pytest.fixture
def asked_for(monkeypatch, capsys):
    """Returns the scenario that a command line would simulate."""
    seen = []

    def look(scenario, *_, **__):
        seen.append(scenario)
        raise ValueError("looked at")

    monkeypatch.setattr(command_line.simulation, "closed_loop", look)

    def scenario(*argv):
        outcome = run_script(push, [*QUICK, *argv], capsys)
        assert_refused(outcome, "looked at")
        return seen.pop()

    return scenario


@pytest.mark.parametrize(
    ("direction", "right_swing", "left_swing"),
    [
        ("backward", 180.0, -180.0),
        ("inward", 90.0, -90.0),  # toward the stance foot
        ("outward", 270.0, -270.0),
        ("-45.5", -45.5, -45.5),
    ],
)
def test_directions(asked_for, direction, right_swing, left_swing):
    """Oracle: the stance foot is the left one in a right swing."""
    for side, degrees in (("right", right_swing), ("left", left_swing)):
        at = f"{side} transfer 50 %"
        scenario = asked_for(f"--direction={direction}", "--at", at)
        assert scenario.pushes[0].direction_deg == degrees


def test_a_terrain_takes_the_scenario_of_its_name(asked_for):
    """Oracle: its gait and pushes; one may be named, a push be added."""
    assert asked_for("--terrain", "gap").gait.step_width == 0.3
    named = asked_for("--terrain", "gap", "--scenario_name", "push")
    assert named.gait.num_steps == 30 and named.terrain.name == "gap"
    asked = "--terrain slopes --delta-v 0.3 --shape ramp".split()
    for more, when in ([], "right swing 25 %"), (["--at", "6 s"], "6 s"):
        (push,) = asked_for(*asked, *more).pushes
        assert (push.delta_v, push.at, push.shape) == (0.3, when, "ramp")


# What is asked for, and how the answer begins; scenarios, robots: see there.
REFUSED = [
    (["--scenario_name", "x"], "scenario_name = 'x': must be one of push,"),
    (["--scenario_name", "stand"], "pushes = []: must have a push"),
    (["--port", "7001"], "port = 7001: must not come with --no-meshcat"),
    (["--duration", "nan"], "argument --duration: 'nan': must be a finite"),
    (["--delta-v", "-1"], "pushes[0].delta_v = -1.0: must be in [0, 100]"),
    (["--random", "0"], "random = 0: must be in [1, 100]"),
    (["--random", "3", "--at", "2 s"], "at = '2 s': must not come with --ran"),
    (["--out", ""], "argument --out: '': must be a path"),
    (["--out", "x/" * 2000], "out = 'x/x/x/x/"),
    (
        ["--scenario_text", "pushes: [{delta_v: 1, at: 1 s, body: world}]"],
        "body = 'world': must be a body of the robot",
    ),
    (["--direction", "up"], "direction = 'up': must be degrees, or one of for"),
    (["--at", "noon"], "at = 'noon': must be like \"right swing 25 %\", from"),
    (["--hold"], "hold = True: must not come with --no-meshcat"),
    (["--live"], "no_meshcat = True: must not come with --live"),
    (["--live", "--delta-v", "0"], "delta_v = 0.0: must not come with --live"),
    (["--live", "--random", "3"], "random = 3: must not come with --live"),
    (["--live", "--at", "2 s"], "at = 2 s: must not come with --live"),
    (["--command", "0.3 0"], "argument --command: '0.3 0': must be forward, l"),
    (["--command", "0 nan 0"], "argument --command: 'nan': must be a finite"),
    (["--command", "99 0 0"], "commands[0].forward = 99.0: must be in [-10, "),
    (
        ["--command", "0 0 1", "--scenario_text", "gait: {num_steps: 3}"],
        "gait.num_steps = 3: must not come with commands",
    ),
    (
        ["--at", "standing", "--scenario_text", "gait: {num_steps: 3}"],
        "gait.num_steps = 3: must not come with at = standing",
    ),
]


def test_a_command_takes_the_place_of_steps(asked_for):
    """Oracle: by hand; the scenario's push stays, or a new one is asked for."""
    flags = "--command", "0.2 -0.1 0.3"
    scenario = asked_for("--scenario_name", "push", *flags)
    (row,) = scenario.commands
    assert (row.time, row.forward, row.left, row.turn) == (0, 0.2, -0.1, 0.3)
    assert not scenario.gait.has_steps and len(scenario.pushes) == 1
    scenario = asked_for(*flags, "--delta-v", 0.4)
    assert scenario.pushes[0].at == "right swing 25 %"


def test_a_push_while_it_stands_is_of_a_robot_that_does_not_walk(asked_for):
    """Oracle: by hand; so is a new push in a scenario without steps."""
    scenario = asked_for("--at", "standing")
    assert scenario.pushes[0].at == "1 s"
    assert not scenario.gait.has_steps and not scenario.commands
    stands = asked_for("--scenario_name", "stand", "--delta-v", 0.4)
    assert stands.pushes[0].at == "1 s"


def test_random_pushes_come_one_after_the_other(asked_for):
    """Oracle: the last but for its own time leaves as long as the first had."""
    scenario = asked_for("--random", 5, "--seed", 2, "--delta-v", 0.2)
    times = [push.moment.time for push in scenario.pushes]
    assert len(times) == 5 and times == sorted(times)
    assert all(push.delta_v <= 0.2 for push in scenario.pushes)
    assert scenario.duration == pytest.approx(14.1 + times[-1])
    assert scenario.gait.num_steps >= scenario.duration - 1.0


@pytest.fixture
def nothing_runs(monkeypatch, tmp_path):
    """Fails if anything is simulated; the present folder is a new one."""

    def fail(*args):
        raise AssertionError("simulated")

    monkeypatch.setattr(command_line.simulation, "advance", fail)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("argv", "message"), REFUSED)
def test_refuses_what_has_no_meaning(argv, message, nothing_runs, capsys):
    """Oracle: exit code 2, one line, nothing simulated, nothing left."""
    outcome = run_script(push, ["--no-meshcat", *argv], capsys)
    assert_refused(outcome, message)
    assert outcome.out == []
    assert not list(nothing_runs.iterdir())


def test_recovers_and_leaves_all_behind(tmp_path, capsys):
    """Oracle: exit code 0, the story, the files, the figures asked for.

    The first tick of 10 ms past 25 % of 0.7 s is at 26 %.
    """
    argv = [*QUICK, "--duration", 7, "--direction", "inward", "--out", tmp_path]
    argv += ["--scenario_text", "calm_steps: 1"]
    outcome = run_script(push, argv, capsys)
    assert (outcome.code, outcome.err) == (0, [])
    assert "push 0.45 m/s inward, right swing 26 %" in outcome.out[0]
    assert "RECOVERED in 1 step  " in outcome.out[-2]
    assert outcome.out[-1].startswith(f"wrote {tmp_path}/")
    summary = summary_of(tmp_path)
    assert (summary["recovered"], summary["reason"]) == (True, "")
    assert (summary["direction_deg"], summary["delta_v"]) == (90.0, 0.45)
    assert (summary["robot"], summary["plant"]) == ("nadia", "lipm")
    assert summary["fell_at"] is None
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"summary.json", "scenario.yaml", "log.npz"}


def test_the_scenario_left_behind_gives_the_same_bits(tmp_path, capsys):
    """Oracle: all arrays of the log; flags and defaults are in the file.

    The robot is not Nadia: what its size has scaled stays as it is.
    """
    first, second = tmp_path / "first", tmp_path / "second"
    argv = [*QUICK, "--duration", 3.6, "--delta-v", 0.123456789, "--seed", 7]
    argv += ["--robot", "g1"]
    run_script(push, [*argv, "--out", first], capsys)
    file = first / "scenario.yaml"
    argv = [*QUICK, "--scenario_file", file, "--out", second]
    run_script(push, argv, capsys)
    first_yaml, second_yaml = (
        yaml.safe_load((folder / "scenario.yaml").read_text())
        for folder in (first, second)
    )
    assert first_yaml == second_yaml
    with np.load(first / "log.npz") as a, np.load(second / "log.npz") as b:
        assert set(a) == set(b)
        assert PushSignal(a["push_signal"].T).force.any()
        for name in a:
            assert np.array_equal(a[name], b[name], equal_nan=True), name


@pytest.mark.parametrize(
    ("argv", "code", "told"),
    [
        # It ends before the swing.
        (["--duration", 3], 3, "UNDECIDED: not pushed: "),
        # A sweep begins at zero.
        (["--at", "standing", "--delta-v", 0, "--duration", 2], 0, "STOOD"),
        (["--at", "standing", "--delta-v", 2], 1, "FELL: CoM out of reach of "),
    ],
)
def test_says_whether_it_has_recovered(argv, code, told, tmp_path, capsys):
    """Oracle: the project's definition: two whole steps, if there are any."""
    outcome = run_script(push, [*QUICK, *argv, "--out", tmp_path], capsys)
    assert outcome.code == code
    assert f" s  {told}" in outcome.out[-2]
    summary = summary_of(tmp_path)
    assert (summary["fell_at"] is not None) == told.startswith("FELL")
    assert summary["recovered"] is (code == 0)


def test_ctrl_c_does_not_lose_what_is_written(tmp_path, monkeypatch, capsys):
    """Oracle: the files, and exit code 130."""
    write = command_line.pages.write_run

    def write_pressed(*arguments):
        signal.raise_signal(signal.SIGINT)
        return write(*arguments)

    monkeypatch.setattr(command_line.pages, "write_run", write_pressed)
    argv = ["--duration", "2.5", "--at", "standing", "--out", tmp_path]
    outcome = run_script(push, [*QUICK, *argv], capsys)
    assert (outcome.code, outcome.err) == (130, [])
    assert "wrote" in outcome.out[-1]
    assert (tmp_path / "log.npz").exists()


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_it_with_its_results(tmp_path, sent, monkeypatch, capsys):
    """Oracle: a signal from within to who would go on for ten minutes."""

    def press(diagram, context):
        if context.get_time() > 0.1:
            signal.raise_signal(sent)
        return ""

    argv = ["--duration", "600", "--at", "standing", "--out", tmp_path]
    monkeypatch.setattr(LipmDiagram, "fall_reason", press)
    outcome = run_script(push, [*QUICK, *argv], capsys)
    assert (outcome.code, outcome.err) == (130, [])
    assert "INTERRUPTED" in " ".join(outcome.out)
    assert not summary_of(tmp_path)["recovered"]
    with np.load(tmp_path / "log.npz") as log:
        assert 1 <= len(log["t"]) < 100_000
        assert len(log["icp"]) == len(log["t"])
