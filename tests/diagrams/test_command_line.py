"""What the scripts share: flags, the tab, the results, Ctrl-C."""

import argparse
import io
import json

import numpy as np
import pytest

from diagrams import command_line
from diagrams.command_line import (
    CommandLine,
    finite,
    main_job,
    output_flags,
    scenario_flags,
    scenario_from,
)
from diagrams.lipm import LipmDiagram


def run(*argv) -> int:
    """The main job on a point mass; `argv` are its flags."""
    parser = CommandLine(prog="job")
    scenario_flags(parser, name="stand")
    output_flags(parser)
    argv = ["--plant", "lipm", "--duration", "0.5", *map(str, argv)]
    return main_job(parser, argv, scenario_from)


@pytest.mark.parametrize("text", ["1", "-2.5", "1e-3", " 4 "])
def test_finite_reads_numbers(text):
    assert finite(text) == float(text)


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e999", "one", ""])
def test_finite_refuses_all_else(text):
    with pytest.raises(argparse.ArgumentTypeError, match="finite number"):
        finite(text)


def test_an_error_is_one_line(capsys):
    """Oracle: argparse alone would print the usage as well."""
    parser = CommandLine(prog="job")
    with pytest.raises(SystemExit) as end:
        parser.parse_args(["--nonsense"])
    assert end.value.code == 2
    assert capsys.readouterr().err == (
        "job: unrecognized arguments: --nonsense\n"
    )


def test_flags_override_the_scenario():
    parser = CommandLine()
    scenario_flags(parser, name="stand")
    argv = "--duration 3 --seed 5 --robot other.yaml --scenario_text"
    args = parser.parse_args([*argv.split(), "{duration: 4, seed: 6}"])
    scenario = scenario_from(args)
    assert (scenario.duration, scenario.seed) == (3.0, 5)
    assert scenario.robot == "other.yaml"
    args = parser.parse_args(["--scenario_text", "{duration: 4, seed: 6}"])
    assert (scenario_from(args).duration, scenario_from(args).seed) == (4, 6)


def test_leaves_the_results_in_a_folder_of_its_own(
    tmp_path, monkeypatch, capsys
):
    """Oracle: runs/<date>_<time>_<name>, in the present folder."""
    monkeypatch.chdir(tmp_path)
    assert run() == 0
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("_stand")
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith(f"wrote runs/{folder.name}/{{log.npz, ")
    for name in last.partition("{")[2].rstrip("}").split(", "):
        assert (folder / name).stat().st_size > 0


def test_ctrl_c_writes_what_was_logged(tmp_path, monkeypatch, capsys):
    """Oracle: 0.3 s of 0.5 s, a row every 10 ms but for the last tick."""

    def interrupt(diagram, context):
        if context.get_time() >= 0.3:
            raise KeyboardInterrupt
        return ""

    monkeypatch.setattr(LipmDiagram, "fall_reason", interrupt)
    assert run("--out", tmp_path) == 1
    assert "INTERRUPTED" in capsys.readouterr().out
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["recovered"], summary["reason"]) == (False, "interrupted")
    assert summary["fell_at"] is None
    with np.load(tmp_path / "log.npz") as log:
        assert log["t"][-1] == pytest.approx(0.29)
        assert len(log["icp"]) == len(log["t"]) == 30


def test_an_error_while_running_ends_in_a_clear_line(
    tmp_path, monkeypatch, capsys
):
    """Oracle: exit code 1; what and when; no word of a fall.

    The last whole tick of 10 ms began at 0.29 s.
    """

    def poison(diagram, context):
        if context.get_time() >= 0.3:
            raise RuntimeError("icp is not finite")
        return ""

    monkeypatch.setattr(LipmDiagram, "fall_reason", poison)
    assert run("--out", tmp_path) == 1
    said = capsys.readouterr().out
    assert said.startswith("t=0.29 s  STOPPED: icp is not finite   max ICP")
    assert "FELL" not in said
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert not summary["recovered"]
    assert summary["reason"] == "stopped: icp is not finite"
    assert summary["fell_at"] is None


def test_a_robot_that_is_none_leaves_no_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run("--robot", "fred") == 2
    assert not list(tmp_path.iterdir())
    assert capsys.readouterr().err.startswith("job: robot = 'fred': must be ")


@pytest.mark.parametrize("flag", ["open", "hold"])
def test_a_point_mass_has_no_tab_to_look_at(flag, capsys):
    assert run(f"--{flag}") == 2
    assert capsys.readouterr().err == (
        f"job: {flag} = True: must not come with --plant lipm, there is no "
        "tab\n"
    )


def test_draws_the_diagram(tmp_path):
    """Oracle: Graphviz dot, with a node for each block."""
    graph = tmp_path / "diagram.dot"
    assert run("--graphviz", graph, "--out", tmp_path) == 0
    text = graph.read_text()
    assert text.startswith("digraph")
    for name in ("capture_point_controller", "plant", "push_source"):
        assert name in text


def test_holds_the_tab_until_enter(monkeypatch, capsys):
    """Oracle: what is left of the input, and the printed address."""
    lines = io.StringIO("\nnot read\n")
    monkeypatch.setattr("sys.stdin", lines)
    meshcat, _ = command_line.start_meshcat()
    command_line._hold(meshcat)
    assert lines.read() == "not read\n"
    assert meshcat.web_url() in capsys.readouterr().out


def test_ctrl_c_ends_the_holding(monkeypatch):
    class Interrupted:
        def readline(self):
            raise KeyboardInterrupt

    monkeypatch.setattr("sys.stdin", Interrupted())
    command_line._hold(command_line.start_meshcat()[0])
