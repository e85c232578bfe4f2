"""A run folder holds everything, and says so before it is too late."""

import json
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from diagrams.replay import start_recording
from diagrams.run_folder import (
    prepare_folder,
    read_run,
    write_plots,
    write_run,
)
from diagrams.summary import RunInfo, summarize
from tests.diagrams.made_up_run import Recipe, cut, make_log, without_robot

PLOTS = ["timeline.png", "footsteps.png", "icp.png", "effort.png"]
INFO = RunInfo(robot="nadia", mechanisms="step", delta_v=0.6)


@pytest.fixture(scope="module")
def log():
    return make_log(Recipe())


def test_writes_all_that_a_run_leaves_behind(log, tmp_path):
    """Oracle: the list of users.md; what is named exists and is not empty."""
    meshcat = Meshcat()
    start_recording(meshcat)
    names = write_run(
        tmp_path, log, summarize(log, INFO), "robot: nadia\n", meshcat
    )
    expected = ["replay.html", "log.npz", "summary.json", "scenario.yaml"]
    assert names == expected + PLOTS
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)
    assert all((tmp_path / name).stat().st_size > 10 for name in names)
    assert (tmp_path / "scenario.yaml").read_text() == "robot: nadia\n"


def test_without_meshcat_there_is_no_replay(log, tmp_path):
    names = write_run(tmp_path, log, summarize(log, INFO), "")
    assert "replay.html" not in names


def test_what_is_written_can_be_read_again_bit_by_bit(log, tmp_path):
    summary = summarize(log, INFO)
    write_run(tmp_path, log, summary, "")
    log_again, summary_again = read_run(tmp_path)
    assert summary_again == summary
    assert log_again.keys() == log.keys()
    for name, array in log.items():
        np.testing.assert_array_equal(log_again[name], array, err_msg=name)


def test_plots_need_nothing_but_the_log_and_the_summary(log, tmp_path):
    """Oracle: pictures of a run that was read back, equal to the last byte."""
    first, again = tmp_path / "first", tmp_path / "again"
    again.mkdir()
    first.mkdir()
    write_run(first, log, summarize(log, INFO), "")
    assert write_plots(again, *read_run(first)) == PLOTS
    for name in PLOTS:
        assert (again / name).read_bytes() == (first / name).read_bytes()


def signals(*names):
    """A change: the log without these."""
    return lambda log: {k: v for k, v in log.items() if k not in names}


@pytest.mark.parametrize(
    ("change", "names"),
    [
        (without_robot, PLOTS),
        (signals("foot_forces"), PLOTS),
        (signals("push_force"), PLOTS),
        (lambda log: cut(log, 700), PLOTS),
        (lambda log: cut(log, 1), []),
        (lambda log: cut(log, 0), []),
        (
            lambda log: signals(
                "foot_forces", "momentum_qp_status", "whole_body_qp_status"
            )(signals("actuation", "state")(log)),
            PLOTS[:3],
        ),
    ],
    ids=[
        "a point mass",
        "no forces",
        "no push",
        "cut off in a swing",
        "one row",
        "no row",
        "no effort",
    ],
)
def test_plots_cope_with_what_a_log_lacks(log, tmp_path, change, names):
    poor = change(log)
    assert write_plots(tmp_path, poor, summarize(poor, INFO)) == names
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)


def test_failures_show_in_the_effort_plot(log, tmp_path):
    """Oracle: the picture changes when QPs fail or fall back."""
    summary = summarize(log, INFO)
    status = log["whole_body_qp_status"].copy()
    status[1000:1100, 0] = 0.0
    status[1200:1300, 1] = 1.0
    pictures = set()
    for name, qp in (("a", log["whole_body_qp_status"]), ("b", status)):
        folder = prepare_folder(tmp_path / name)
        write_plots(folder, {**log, "whole_body_qp_status": qp}, summary)
        pictures.add((folder / "effort.png").read_bytes())
    assert len(pictures) == 2


def test_makes_the_folder_with_its_parents(tmp_path):
    folder = prepare_folder(tmp_path / "a" / "b")
    assert folder.is_dir()
    assert list(folder.iterdir()) == [], "the check leaves nothing behind"


def test_an_existing_folder_is_used_again(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert prepare_folder(tmp_path) == tmp_path
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_without_a_name_runs_go_below_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = prepare_folder(None, "push")
    assert folder.parent == Path("runs")
    assert folder.name.endswith("_push")
    assert folder.is_dir()


@pytest.mark.parametrize("out", ["file/below", "file", "/proc/nowhere", "a\0b"])
def test_a_folder_that_cannot_be_written_is_refused(out, tmp_path, monkeypatch):
    """Even root cannot write below a file, nor into /proc."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(ValueError, match="must be a folder to write to") as e:
        prepare_folder(out)
    assert str(e.value).startswith("out = ")
    assert "\n" not in str(e.value)


def test_the_summary_is_strict_json(log, tmp_path):
    write_run(tmp_path, log, summarize(log, INFO), "")

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    text = (tmp_path / "summary.json").read_text()
    assert json.loads(text, parse_constant=refuse)["robot"] == "nadia"
