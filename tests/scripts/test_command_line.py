"""What the scripts share: flags, Meshcat, the results, Ctrl-C."""

import argparse
import io
import json
import sys
from importlib.metadata import version

import numpy as np
import pytest

from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.scripts import command_line
from nadia_balance.scripts.command_line import (
    CommandLine,
    finite,
    main_job,
    output_flags,
    scenario_flags,
    scenario_from,
)
from tests.scripts.running import assert_refused, run_script, summary_of


class Job:
    """A script that simulates what the flags say."""

    @staticmethod
    def main(argv):
        parser = CommandLine(prog="job")
        scenario_flags(parser, name="stand")
        output_flags(parser)
        return main_job(parser, argv, scenario_from)


QUICK = ["--plant", "lipm", "--duration", "0.5"]


def run(capsys, *argv):
    return run_script(Job, [*QUICK, *argv], capsys)


def test_finite_reads_finite_numbers():
    assert [finite(text) for text in ("-2.5", "1e-3")] == [-2.5, 0.001]
    for text in ("nan", "-inf", "1e999", "one", ""):
        with pytest.raises(argparse.ArgumentTypeError, match="finite number"):
            finite(text)


def test_an_error_is_one_line(capsys):
    """Oracle: argparse alone would print the usage as well."""
    outcome = run(capsys, "--nonsense")
    assert outcome.code == 2
    assert outcome.err == ["job: unrecognized arguments: --nonsense"]


def test_leaves_the_results_in_a_folder_of_its_own(
    tmp_path, monkeypatch, capsys
):
    """Oracle: runs/<date>_<time>_<name>, in the present folder."""
    monkeypatch.chdir(tmp_path)
    outcome = run(capsys)
    assert outcome.code == 0
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("_stand")
    last = outcome.out[-1]
    assert last.startswith(f"wrote runs/{folder.name}/{{log.npz, ")
    for name in last.partition("{")[2].rstrip("}").split(", "):
        assert (folder / name).stat().st_size > 0


@pytest.mark.parametrize(
    ("error", "told", "reason"),
    [
        (KeyboardInterrupt(), "INTERRUPTED", "interrupted"),
        (
            RuntimeError("icp is not finite"),
            "STOPPED: icp is not finite",
            "stopped: icp is not finite",
        ),
    ],
    ids=["Ctrl-C", "an error"],
)
def test_an_early_end_writes_what_was_logged(
    tmp_path, monkeypatch, capsys, error, told, reason
):
    """Oracle: 0.3 s of 0.5 s, a row every 10 ms; no word of a fall."""

    def end(diagram, context):
        if context.get_time() >= 0.3:
            raise error
        return ""

    monkeypatch.setattr(LipmDiagram, "fall_reason", end)
    outcome = run(capsys, "--out", tmp_path)
    assert outcome.code == 1
    assert outcome.out[0].startswith(f"t=0.30 s  {told}   max ICP error")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["recovered"], summary["reason"]) == (False, reason)
    assert summary["fell_at"] is None
    with np.load(tmp_path / "log.npz") as log:
        assert log["t"][-1] == pytest.approx(0.3)
        assert len(log["icp"]) == len(log["t"]) == 31


def test_fidelity_is_a_flag(tmp_path, capsys):
    """Oracles: the scenario that is left behind; the message, by hand."""
    assert run(capsys, "--fidelity", "realistic", "--out", tmp_path).code == 0
    assert "fidelity: realistic" in (tmp_path / "scenario.yaml").read_text()
    message = "fidelity = 'true': must be one of realistic, ideal"
    assert_refused(run(capsys, "--fidelity", "true"), message)


def test_engine_is_a_flag(tmp_path, capsys, monkeypatch):
    """Oracles: what is left behind; the messages, by hand."""
    flags = ("--plant", "humanoid", "--no-meshcat", "--engine", "mujoco")
    assert run(capsys, *flags, "--out", tmp_path).code == 0
    assert "engine: mujoco" in (tmp_path / "scenario.yaml").read_text()
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["engine"] == "mujoco"
    assert summary["versions"]["mujoco"] == version("mujoco")
    message = "engine = 'mujoco': must be drake for a point mass"
    assert_refused(run(capsys, "--engine", "mujoco"), message)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.delitem(sys.modules, "nadia_balance.mujoco_model")
    message = "engine = 'mujoco': must have its package: pip install mujoco"
    assert_refused(run(capsys, *flags), message)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--open"], "open = True: must not come with --plant lipm: no Mesh"),
        (["--realtime-rate", "-1"], "realtime_rate = -1.0: must be >= 0"),
        (["--graphviz", "/none/a.dot"], "graphviz = /none/a.dot: must be a f"),
    ],
)
def test_refuses_output_flags_without_effect(argv, message, tmp_path, capsys):
    assert_refused(run(capsys, *argv, "--out", tmp_path), message)


def test_draws_the_diagram_and_says_of_which_plant(tmp_path, capsys):
    """Oracle: Graphviz dot, with a node for each block."""
    graph = tmp_path / "diagram.dot"
    assert run(capsys, "--graphviz", graph, "--out", tmp_path).code == 0
    text = graph.read_text()
    assert text.startswith("digraph")
    for name in ("capture_point_controller", "plant", "push_source"):
        assert name in text
    assert summary_of(tmp_path)["plant"] == "lipm"


def test_holds_meshcat_until_enter_or_ctrl_c(monkeypatch, capsys):
    """Oracle: what is left of the input, and the printed address."""

    class Interrupted:
        def readline(self):
            raise KeyboardInterrupt

    lines = io.StringIO("\nnot read\n")
    meshcat, _ = command_line.start_meshcat()
    for user in (lines, Interrupted()):
        monkeypatch.setattr("sys.stdin", user)
        command_line._hold(meshcat)
        assert meshcat.web_url() in capsys.readouterr().out
    assert lines.read() == "not read\n"
