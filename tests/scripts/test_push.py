"""The main job: what it takes, what it refuses, what it leaves behind."""

import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from diagrams import command_line
from diagrams.mechanisms import AS_IN_PARAMETERS, MECHANISMS
from nadia_balance.robot import MODELS
from scripts import push
from tests.scripts.running import (
    as_program,
    assert_refused,
    environment,
    run_script,
    summary_of,
)

QUICK = ["--plant", "lipm", "--no-meshcat"]


@pytest.fixture
def asked_for(monkeypatch, capsys):
    """Returns the scenario that a command line would simulate."""
    seen = []

    def look(diagram):
        seen.append(diagram.scenario)
        raise ValueError("looked at")

    monkeypatch.setattr(command_line, "start", look)

    def scenario(*argv):
        outcome = run_script(push, [*QUICK, *argv], capsys)
        assert_refused(outcome, "looked at")
        return seen.pop()

    return scenario


def test_does_what_the_flags_say(asked_for):
    """Oracle: the flags of the project's first checks."""
    flags = (
        "--robot nadia --direction 90 --delta-v 0.3 --phase swing --side "
        "right --fraction 0.25 --mechanisms icp_only --duration 8 --seed 0"
    )
    scenario = asked_for(*flags.split())
    (first,) = scenario.pushes
    assert (scenario.robot, scenario.mechanisms) == ("nadia", "icp_only")
    assert (scenario.duration, scenario.seed) == (8.0, 0)
    assert (first.direction_deg, first.delta_v) == (90.0, 0.3)
    assert (first.phase, first.side, first.fraction) == ("swing", "right", 0.25)
    assert first.duration == 0.1


@pytest.mark.parametrize(
    ("direction", "right_swing", "left_swing"),
    [
        ("forward", 0.0, 0.0),
        ("backward", 180.0, -180.0),
        ("inward", 90.0, -90.0),  # toward the stance foot
        ("outward", 270.0, -270.0),
        ("30", 30.0, 30.0),
        ("-45.5", -45.5, -45.5),
    ],
)
def test_directions(asked_for, direction, right_swing, left_swing):
    """Oracle: the stance foot is the left one in a right swing."""
    for side, degrees in (("right", right_swing), ("left", left_swing)):
        scenario = asked_for(f"--direction={direction}", "--side", side)
        assert scenario.pushes[0].direction_deg == degrees


@pytest.mark.parametrize(
    ("at", "side", "phase", "fraction"),
    [
        ("right swing 25 %", "right", "swing", 0.25),
        ("left transfer 50%", "left", "transfer", 0.5),
        ("left swing 12.5 %", "left", "swing", 0.125),
    ],
)
def test_at_says_it_in_short(asked_for, at, side, phase, fraction):
    (first,) = asked_for("--at", at).pushes
    assert (first.side, first.phase, first.fraction) == (side, phase, fraction)


def test_a_standing_robot_takes_no_steps(asked_for):
    scenario = asked_for(
        "--phase", "standing", "--scenario_text", "gait: {step_width: 0.3}"
    )
    assert scenario.gait.num_steps == 0
    assert scenario.pushes[0].time == 1.0
    assert scenario.pushes[0].phase is None


def test_a_scenario_pushed_by_force_may_be_pushed_by_delta_v(asked_for):
    text = "pushes: [{force: 200.0, time: 1.0}]"
    assert asked_for("--scenario_text", text).pushes[0].force == 200.0
    (first,) = asked_for("--scenario_text", text, "--delta-v", 0.1).pushes
    assert (first.force, first.delta_v) == (None, 0.1)


# What is asked for, and how the answer begins.
REFUSED = [
    (
        ["--scenario_name", "walk_on_water"],
        "scenario_name = 'walk_on_water': must",
    ),
    (["--scenario_name", "stand"], "scenario_name = 'stand': must have a push"),
    (
        ["--scenario_file", "nowhere.yaml"],
        "scenario_file = nowhere.yaml: no such",
    ),
    (
        ["--scenario_text", "nonsense: 1"],
        "scenario_text: nonsense: unknown field",
    ),
    (["--scenario_text", "{"], "scenario_text: malformed YAML: line 1"),
    (["--scenario_text", "gait: {foo: 1}"], "scenario_text: gait.foo: unknown"),
    (
        ["--scenario_text", "gait: 3"],
        "scenario_text: gait = 3: must be a mapping",
    ),
    (
        ["--scenario_text", "duration: x"],
        "scenario_text: duration = 'x': must be a",
    ),
    (["--scenario_text", "duration: .nan"], "duration = nan: must be finite"),
    (
        ["--scenario_text", "gait: {step: {length: 2}}"],
        "step 1 (right): 2.000 m",
    ),
    (
        ["--scenario_text", "controller: {balance: {solver: x}}"],
        "solver = 'x': must",
    ),
    (
        ["--scenario_text", "pushes: [{delta_v: 1,time: 1,body: X}]"],
        "body = 'X': m",
    ),
    (
        ["--scenario_text", "pushes: [{delta_v: 1,time: 1,duration: 0.001}]"],
        "duration = 0.001: must be a multiple of 0.002 s",
    ),
    (["--robot", "fred"], "robot = 'fred': must be one of atlas, nadia"),
    (["--robot", "nowhere.yaml"], "robot = nowhere.yaml: no such file"),
    (["--mechanisms", "luck"], "mechanisms = 'luck': must be one of icp_only"),
    (
        ["--duration", "nan"],
        "argument --duration: 'nan': must be a finite number",
    ),
    (["--duration", "-1"], "duration = -1.0: must be"),
    (["--duration", "0"], "duration = 0.0: must be"),
    (
        ["--duration", "soon"],
        "argument --duration: 'soon': must be a finite number",
    ),
    (["--seed", "-1"], "seed = -1: must be >= 0"),
    (["--seed", "1.5"], "argument --seed: invalid int value: '1.5'"),
    (["--fraction", "2"], "fraction = 2.0: must be in [0, 1]"),
    (["--fraction", "-0.1"], "fraction = -0.1: must be in [0, 1]"),
    (["--delta-v", "-1"], "delta_v = -1.0: must be finite and >= 0"),
    (
        ["--delta-v", "nan"],
        "argument --delta-v: 'nan': must be a finite number",
    ),
    (
        ["--direction", "up"],
        "direction = 'up': must be degrees, or one of forward",
    ),
    (["--direction", "nan"], "direction = 'nan': must be degrees"),
    (["--at", "noon"], "at = 'noon': must be like \"right swing 25 %\""),
    (["--at", "left swing 250 %"], "fraction = 2.5: must be in [0, 1]"),
    (
        ["--at", "left swing 25 %", "--side", "right"],
        "side = right: must not come with",
    ),
    (
        ["--phase", "standing", "--side", "left"],
        "side = left: must come with --phase swing or transfer",
    ),
    (
        ["--scenario_name", "push_standing", "--fraction", "0.5"],
        "fraction = 0.5: must come with --phase swing or transfer",
    ),
    (["--hold"], "hold = True: must not come with --no-meshcat"),
    (["--open"], "open = True: must not come with --no-meshcat"),
    (["--phase", "flight"], "argument --phase: invalid choice: 'flight'"),
    (["--side", "middle"], "argument --side: invalid choice: 'middle'"),
    (["--plant", "moon"], "argument --plant: invalid choice: 'moon'"),
    (["--realtime-rate", "-1"], "realtime_rate = -1.0: must be >= 0"),
    (
        ["--realtime-rate", "inf"],
        "argument --realtime-rate: 'inf': must be a finite",
    ),
    (["--port", "x"], "argument --port: invalid int value: 'x'"),
    (["--out", "/dev/null/x"], "out = '/dev/null/x': must be a folder"),
    (
        ["--graphviz", "/nowhere/x.dot"],
        "graphviz = /nowhere/x.dot: must be a file",
    ),
    (["--nonsense"], "unrecognized arguments: --nonsense"),
    (
        ["--scenario_name", "push_standing", "--phase", "swing"],
        "phase = 'swing': must come with steps in the gait",
    ),
    (
        ["--scenario_name", "push_standing", "--duration", "1"],
        "time = 1.0: must be < duration = 1.0 s",
    ),
]


def test_help_tells_what_can_be_named_and_what_is_taken_if_not(capsys):
    """Oracle: the names that a scenario may have; the exit codes."""
    outcome = run_script(push, ["--help"], capsys)
    assert outcome.code == 0
    text = " ".join(" ".join(outcome.out).split())
    names = f"{', '.join(MECHANISMS)}, or {AS_IN_PARAMETERS}, what the"
    assert f"to recover by: {names}" in text
    assert "--scenario_file (default: push)" in text
    assert text.count("efault: as in the scenario") == 2
    assert "1 did not recover (summary.json says why), 2 bad input." in text


@pytest.fixture
def nothing_runs(monkeypatch, tmp_path):
    """Fails if anything is simulated; the present folder is a new one."""

    def fail(*args):
        raise AssertionError("simulated")

    monkeypatch.setattr(command_line, "advance", fail)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("argv", "message"), REFUSED, ids=[" ".join(argv) for argv, _ in REFUSED]
)
def test_refuses_what_has_no_meaning(argv, message, nothing_runs, capsys):
    """Oracle: exit code 2, one line, nothing simulated, nothing left."""
    outcome = run_script(push, ["--no-meshcat", *argv], capsys)
    assert_refused(outcome, message)
    assert outcome.out == []
    assert not list(nothing_runs.iterdir()) or "--graphviz" in argv


@pytest.mark.parametrize("port", [80, -1, 70000])
def test_refuses_an_impossible_port(port, nothing_runs, capsys):
    outcome = run_script(push, ["--port", port], capsys)
    assert_refused(outcome, f"port = {port}: must be in [1024, 65535]")


ROBOT_YAML = {
    "com_height: 0.888": {
        "com_height: -1": "com_height = -1.0: must be finite and > 0",
        "com_height: .nan": "com_height = nan: must be",
        "com_height: 1.5": "step_width = 0.25, com_height = 1.5: must be",
        "com_heigth: 1": "robot = {}: com_heigth: unknown field",
        "com_height: [": "robot = {}: malformed YAML: line",
    },
    "pelvis_body: PELVIS_LINK": {
        "pelvis_body: HIP": "pelvis_body = 'HIP': must be a link of the URDF",
    },
    "urdf: nadia.urdf": {"urdf: nowhere.urdf": "urdf = "},
}
URDF = {
    "cut in half": (lambda text: text[: len(text) // 2], "urdf = {}: "),
    "empty": (lambda text: "", "urdf = {}: no element found"),
    "no robot": (lambda text: "<sdf/>", "urdf = {}: "),
    "negative mass": (
        lambda text: text.replace('mass value="', 'mass value="-', 1),
        "urdf = {}: ",
    ),
    "no mass": (
        lambda text: text.replace('mass value="', 'mass value="nan', 1),
        "urdf = {}: ",
    ),
}


@pytest.fixture
def my_nadia(tmp_path):
    """A copy of Nadia that may be spoilt: the path of its robot.yaml."""
    shutil.copytree(MODELS / "nadia", tmp_path / "nadia")
    return tmp_path / "nadia" / "robot.yaml"


@pytest.mark.parametrize(
    ("old", "new"),
    [(old, new) for old in ROBOT_YAML for new in ROBOT_YAML[old]],
)
def test_refuses_a_bad_robot_yaml(old, new, my_nadia, nothing_runs, capsys):
    text = my_nadia.read_text()
    assert old in text
    my_nadia.write_text(text.replace(old, new))
    outcome = run_script(push, ["--no-meshcat", "--robot", my_nadia], capsys)
    assert_refused(outcome, ROBOT_YAML[old][new].format(my_nadia))
    assert not (nothing_runs / "runs").exists()


@pytest.mark.parametrize("fault", URDF)
def test_refuses_a_bad_urdf(fault, my_nadia, nothing_runs, capsys):
    urdf = my_nadia.with_name("nadia.urdf")
    spoil, message = URDF[fault]
    spoilt = spoil(urdf.read_text())
    assert spoilt != urdf.read_text()
    urdf.write_text(spoilt)
    outcome = run_script(push, ["--no-meshcat", "--robot", my_nadia], capsys)
    assert_refused(outcome, message.format(urdf))


def test_recovers_and_leaves_all_behind(tmp_path, capsys):
    """Oracle: exit code 0, the story, the files, the figures asked for.

    The first tick of 10 ms past 25 % of 0.7 s is at 26 %.
    """
    argv = [*QUICK, "--duration", 7, "--direction", "inward", "--out", tmp_path]
    outcome = run_script(push, argv, capsys)
    assert (outcome.code, outcome.err) == (0, [])
    assert "push 0.45 m/s inward, right swing 26 %" in outcome.out[0]
    assert "RECOVERED" in outcome.out[-2]
    assert outcome.out[-1].startswith(f"wrote {tmp_path}/")
    summary = summary_of(tmp_path)
    assert summary["recovered"]
    short = "the run is too short for 8 more steps, 2 were required"
    assert summary["reason"] == short
    assert f"RECOVERED in 1 step ({short})" in outcome.out[-2]
    assert (summary["direction_deg"], summary["delta_v"]) == (90.0, 0.45)
    assert (summary["robot"], summary["plant"]) == ("nadia", "lipm")
    assert summary["fell_at"] is None
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"summary.json", "scenario.yaml", "log.npz", "icp.png"}


def test_recovered_is_who_takes_eight_more_steps(tmp_path, capsys):
    """Oracle: the project's definition; the scenario as it is."""
    outcome = run_script(push, [*QUICK, "--out", tmp_path], capsys)
    assert outcome.code == 0
    summary = summary_of(tmp_path)
    assert (summary["recovered"], summary["reason"]) == (True, "")
    assert summary["required_steps"] == 8
    assert 8 <= summary["steps_after_push"] <= 11


@pytest.mark.parametrize(
    ("at", "moment"),
    [
        ("right transfer 100 %", "right transfer 99 %"),
        ("left swing 100 %", "left swing 100 %"),
    ],
)
def test_a_push_may_come_at_the_very_end_of_a_phase(
    at, moment, tmp_path, capsys
):
    """Oracle: it comes, and the story says when; in ticks of 2 ms."""
    argv = [*QUICK, "--duration", 7, "--delta-v", 0.05, "--at", at]
    argv += ["--scenario_text", "{lipm_period: 0.002}"]
    outcome = run_script(push, [*argv, "--out", tmp_path], capsys)
    assert outcome.code == 0
    assert f", {moment} " in outcome.out[0]
    assert summary_of(tmp_path)["missed_pushes"] == 0


def test_the_scenario_left_behind_gives_the_same_bits(tmp_path, capsys):
    """Oracle: all arrays of the log; flags and defaults are in the file."""
    first, second = tmp_path / "first", tmp_path / "second"
    argv = [*QUICK, "--duration", 3.6, "--delta-v", 0.123456789, "--seed", 7]
    run_script(push, [*argv, "--out", first], capsys)
    file = first / "scenario.yaml"
    argv = [*QUICK, "--scenario_file", file, "--out", second]
    run_script(push, argv, capsys)
    assert file.read_text() == (second / "scenario.yaml").read_text()
    with np.load(first / "log.npz") as a, np.load(second / "log.npz") as b:
        assert set(a) == set(b)
        assert np.linalg.norm(a["push_force"], axis=1).any()
        for name in a:
            assert np.array_equal(a[name], b[name], equal_nan=True), name


def test_falls_with_exit_code_1(tmp_path, capsys):
    argv = [*QUICK, "--phase", "standing", "--delta-v", 2, "--out", tmp_path]
    outcome = run_script(push, argv, capsys)
    assert outcome.code == 1
    assert "FELL: CoM out of reach of both feet" in outcome.out[-2]
    summary = summary_of(tmp_path)
    assert not summary["recovered"]
    assert 1.0 < summary["fell_at"] < 2.0


def test_who_was_not_pushed_has_not_recovered(tmp_path, capsys):
    """Oracle: the third swing begins at 3.3 s; the run ends before."""
    argv = [*QUICK, "--duration", 3, "--out", tmp_path]
    outcome = run_script(push, argv, capsys)
    assert outcome.code == 1
    assert "NOT PUSHED: " in outcome.out[-2]
    assert not any("RECOVERED" in line for line in outcome.out)
    summary = summary_of(tmp_path)
    assert not summary["recovered"]
    assert summary["reason"].startswith("not pushed: ")


def test_a_push_of_nothing_is_a_push(tmp_path, capsys):
    """A sweep begins at zero."""
    argv = [*QUICK, "--phase", "standing", "--delta-v", 0, "--duration", 2]
    outcome = run_script(push, [*argv, "--out", tmp_path], capsys)
    assert outcome.code == 0
    assert summary_of(tmp_path)["recovered"]


def test_a_busy_port_is_no_reason_to_stop(tmp_path, capsys):
    """Oracle: the port of a Meshcat that runs; the replay is written."""
    busy = command_line.start_meshcat()[0]
    text = "pushes: [{delta_v: 0.001, time: 0.01, duration: 0.01}]"
    argv = ["--port", busy.port(), "--duration", 0.1, "--scenario_text", text]
    outcome = run_script(push, [*argv, "--out", tmp_path], capsys)
    assert (outcome.code, outcome.err) == (0, [])
    assert outcome.out[0].startswith(f"port {busy.port()} is busy: using ")
    assert outcome.out[1].startswith("Meshcat: http://localhost:")
    assert str(busy.port()) not in outcome.out[1]
    assert (tmp_path / "replay.html").stat().st_size > 1e6


def test_ctrl_c_ends_the_program_with_its_results(tmp_path):
    """Oracle: SIGINT to a program that would go on for ten minutes."""
    folder = tmp_path / "run"
    program = subprocess.Popen(
        [sys.executable, "-m", "scripts.push", *QUICK, "--duration", "600"]
        + ["--out", folder],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not folder.exists() and program.poll() is None:
        time.sleep(0.05)  # it is made just before the start
    time.sleep(1.0)
    program.send_signal(signal.SIGINT)
    out, err = program.communicate(timeout=60)
    assert err == ""
    assert program.returncode == 1
    assert "INTERRUPTED" in out
    assert not summary_of(folder)["recovered"]
    with np.load(folder / "log.npz") as log:
        assert 1 <= len(log["t"]) < 100_000
        assert len(log["icp"]) == len(log["t"])


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (
            ("--robot", "fred"),
            "push.py: robot = 'fred': must be one of atlas, nadia",
        ),
        (("--duration", "nan"), "push.py: argument --duration: 'nan': must be"),
        (
            ("--scenario_text", "plant_config: {stiction_tolerance: -1}"),
            "push.py: stiction_tolerance = -1.0: must be finite and > 0",
        ),
    ],
)
def test_the_program_says_on_one_line_what_is_wrong(tmp_path, argv, message):
    """Oracle: what the shell sees."""
    done = as_program("push", "--no-meshcat", *argv, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith(message)
    assert not list(tmp_path.iterdir())
