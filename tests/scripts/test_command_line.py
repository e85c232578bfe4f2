"""What the scripts share: flags, Meshcat, the results, Ctrl-C.

By simulate.py, which is no more than that.
"""

import io
import os
import signal
from importlib.metadata import version

import numpy as np
import pytest

from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.results import pages
from nadia_balance.robot.params import MODELS
from nadia_balance.scripts import command_line, simulate
from tests.scripts import running
from tests.scripts.running import assert_refused, ended, run_script, summary_of

LIPM = ["--plant", "lipm", "--no-meshcat"]
STAND = ["--scenario_name", "stand", *LIPM, "--duration", "0.5"]


def run(capsys, *argv):
    """Stands for half a second, but for what the flags say."""
    return run_script(simulate, [*STAND, *argv], capsys)


def test_simulates_a_scenario_of_a_file(tmp_path, capsys):
    """Oracle: two steps, of which the file knows, and the one beside them."""
    file = tmp_path / "mine.yaml"
    gait = "gait: {num_steps: 2, step: {length: 0.1}}"
    file.write_text(f"two: {{duration: 5.5, {gait}}}\n")
    robot = (MODELS / "nadia" / "robot.yaml").resolve()
    argv = ["--scenario_file", file, "--scenario_name", "two", *LIPM]
    argv += ["--out", tmp_path / "run", "--robot", os.path.relpath(robot)]
    outcome = run_script(simulate, argv, capsys)
    assert (outcome.code, outcome.err) == (0, [])
    assert "WALKED 3 steps" in outcome.out[0]
    summary = summary_of(tmp_path / "run")
    assert summary["steps_taken"] == 3
    text = (tmp_path / "run" / "scenario.yaml").read_text()
    assert f" {robot}  # flag\n" in text
    assert summary["pushes"] == []
    assert (summary["direction_deg"], summary["delta_v"]) == (None, None)


def test_a_long_run_leaves_its_last_chapter(tmp_path, monkeypatch, capsys):
    """Oracle: by hand, chapters of 2 s; pushes 10 s apart, from 11 s on."""
    pushes = load_scenario("hour").pushes
    times = [push.moment.time for push in pushes]
    assert times == pytest.approx(1.0 + 10.0 * np.arange(1, 360))
    assert max(push.delta_v for push in pushes) <= 0.4
    monkeypatch.setattr(command_line, "CHAPTER", 2.0)
    argv = ["--scenario_name", "hour", "--duration", 5, "--out", tmp_path]
    outcome = run(capsys, *argv)
    assert (outcome.code, outcome.err) == (0, [])
    told = [line.partition(":")[0] for line in outcome.out[:2]]
    assert told == ["t=2 s  walks on", "t=4 s  walks on"]
    with np.load(tmp_path / "log.npz") as log:
        assert log["t"][[0, -1]] == pytest.approx([4.0, 5.0], abs=0.01)
    assert summary_of(tmp_path)["duration_s"] == pytest.approx(1.0, abs=0.01)


def test_an_error_writes_what_was_logged(tmp_path, monkeypatch, capsys):
    """Oracle: 0.3 s of 0.5 s, a row every 10 ms; no word of a fall."""

    def end(diagram, context):
        if context.get_time() >= 0.3:
            raise RuntimeError("icp is not finite")
        return ""

    monkeypatch.setattr(LipmDiagram, "fall_reason", end)
    outcome = run(capsys, "--out", tmp_path)
    assert outcome.code == 1
    told = "t=0.30 s  STOPPED: icp is not finite   max ICP error"
    assert outcome.out[0].startswith(told)
    summary = summary_of(tmp_path)
    assert summary["reason"] == "stopped: icp is not finite"
    assert summary["fell_at"] is None
    with np.load(tmp_path / "log.npz") as log:
        assert log["t"][-1] == pytest.approx(0.3)
        assert len(log["icp"]) == len(log["t"]) == 31


def test_engine_is_a_flag(tmp_path, capsys):
    """Oracles: what is left behind; the message, by hand."""
    flags = ("--plant", "humanoid", "--engine", "mujoco")
    assert run(capsys, *flags, "--out", tmp_path).code == 0
    assert "engine: mujoco" in (tmp_path / "scenario.yaml").read_text()
    summary = summary_of(tmp_path)
    assert summary["engine"] == "mujoco"
    assert summary["versions"]["mujoco"] == version("mujoco")
    message = "engine = 'mujoco': must be drake for a point mass"
    assert_refused(run(capsys, "--engine", "mujoco"), message)


def test_holds_meshcat_until_enter_or_ctrl_c(monkeypatch, capsys):
    """Oracle: what is left of the input, and the printed address."""

    class Interrupted:
        def readline(self):
            raise KeyboardInterrupt

    lines = io.StringIO("\nnot read\n")
    meshcat, _ = command_line.start_meshcat()
    for user in (lines, Interrupted(), None):  # None: it is closed
        monkeypatch.setattr("sys.stdin", user)
        command_line._hold(meshcat)
        assert meshcat.web_url() in capsys.readouterr().out
    assert lines.read() == "not read\n"


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_program_in_any_place(sent):
    """Oracle: the shell's code of Ctrl-C; the signals of before are back."""
    usual = signal.default_int_handler  # a shell's background jobs have none
    ours = signal.signal(signal.SIGINT, usual)
    before = signal.getsignal(sent)
    assert command_line.program(lambda _: signal.raise_signal(sent))([]) == 130
    assert signal.getsignal(sent) is before
    signal.signal(signal.SIGINT, ours)


def test_ctrl_c_at_the_very_start_is_no_traceback(tmp_path):
    """Oracle: stderr, and that the signal itself ended it (130 in a shell)."""
    start = running.python("-c", INTERRUPTED_START, "push", cwd=tmp_path)
    outcome = ended(start)
    assert (outcome.code, outcome.err) == (-signal.SIGINT, [])


# Presses Ctrl-C as soon as a script begins to import the command line.
INTERRUPTED_START = """
import importlib.abc, os, runpy, signal, sys

class Press(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "nadia_balance.scripts.command_line":
            os.kill(os.getpid(), signal.SIGINT)

# Of a suite that runs in the background, children ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
script = sys.argv.pop(1)
sys.argv[0] = f"{script}.py"
sys.meta_path.insert(0, Press())
runpy.run_module(f"nadia_balance.scripts.{script}", run_name="__main__")
"""


def test_results_are_whole_although_nobody_reads_the_story(tmp_path):
    """Oracle: a pipe whose reader has gone; the files, which can be read."""
    reader, writer = os.pipe()
    os.close(reader)
    argv = "simulate", *STAND, "--out", "run"
    outcome = ended(running.program(*argv, cwd=tmp_path, stdout=writer))
    assert (outcome.code, outcome.err) == (0, [])
    os.close(writer)
    with np.load(tmp_path / "run" / "log.npz") as log:
        assert log["t"][-1] == summary_of(tmp_path / "run")["duration_s"]


def test_a_full_disk_leaves_no_half_file(tmp_path, monkeypatch, capsys):
    """Oracle: the system's error in the last file; the story is told."""
    monkeypatch.setattr(pages, "write_plots", running.full_disk)
    outcome = run(capsys, "--out", tmp_path)
    assert outcome.code == 4
    assert outcome.err == ["simulate.py: [Errno 28] No space left on device"]
    assert "STOOD" in outcome.out[0]
    assert list(tmp_path.iterdir()) == []


def test_the_results_of_another_run_are_not_overwritten(tmp_path, capsys):
    """Oracle: the bytes that were there."""
    file = tmp_path / "summary.json"
    file.write_text("mine")
    outcome = run(capsys, "--out", tmp_path)
    why = "must be a folder without summary.json"
    assert_refused(outcome, f"out = '{tmp_path}': {why}")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]


def test_a_present_folder_that_is_gone_is_told(tmp_path, monkeypatch, capsys):
    """Oracle: the system's error; Drake's would be a traceback."""
    monkeypatch.chdir(tmp_path)
    tmp_path.rmdir()
    assert_refused(run(capsys), "present folder: must exist")
