"""A run folder holds everything, and says so before it is too late."""

import contextlib
import json

import matplotlib as mpl
import numpy as np
import pytest

from nadia_balance.results import folder, pages
from nadia_balance.view.scene import start_meshcat
from tests.results import made_up_run

PLOTS = ["timeline.png", "footsteps.png", "icp.png", "effort.png"]
EFFORT = ("foot_forces",)


@pytest.fixture(scope="module")
def log():
    return made_up_run.make_log(made_up_run.Recipe())


def test_writes_all_that_a_run_leaves_behind(log, tmp_path):
    """Oracle: what is named exists and is not empty; nothing else does."""
    meshcat = start_meshcat()[0]
    pages.start_recording(meshcat)
    summary = made_up_run.summary_of(log)
    names = pages.write_run(
        tmp_path, log, summary, scenario="robot: nadia\n", meshcat=meshcat
    )
    expected = ["replay.html", "log.npz", "summary.json", "scenario.yaml"]
    assert names == expected + PLOTS
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)
    assert all((tmp_path / name).stat().st_size > 10 for name in names)
    assert (tmp_path / "scenario.yaml").read_text() == "robot: nadia\n"


def test_a_run_that_is_read_again_is_the_same(log, tmp_path):
    """Oracle: the log bit by bit, its pictures to the last byte."""
    first, again = (folder.prepare_folder(tmp_path / name) for name in "ab")
    summary = made_up_run.summary_of(log)
    names = pages.write_run(first, log, summary, "")
    assert "replay.html" not in names, "without Meshcat"
    with np.load(first / "log.npz", allow_pickle=False) as data:
        log_again = dict(data)
    text = (first / "summary.json").read_text("utf-8")
    assert (summary_again := json.loads(text)) == summary
    assert log_again.keys() == log.keys()
    for name, array in log.items():
        np.testing.assert_array_equal(log_again[name], array, err_msg=name)
    with mpl.rc_context({"text.usetex": True, "font.size": 30.0}):  # a user's
        assert pages.write_plots(again, log_again, summary_again) == PLOTS
    for name in PLOTS:
        assert (again / name).read_bytes() == (first / name).read_bytes()


def test_two_runs_at_once_have_a_folder_each(tmp_path, monkeypatch):
    """Oracle: the folders; what is named is refused to the second one."""
    monkeypatch.chdir(tmp_path)
    with contextlib.ExitStack() as held:
        new = folder.new_folder
        folders = [held.enter_context(new(None, "run", [])) for _ in "ab"]
        assert len({*folders}) == 2
        with (
            pytest.raises(ValueError, match="in use by no other run"),
            folder.new_folder(folders[0], "run", []),
        ):
            pass
    with folder.new_folder(folders[0], "run", []) as again:
        assert again == folders[0]


@pytest.mark.parametrize(
    ("change", "names"),
    [
        (lambda log: made_up_run.cut(log, 700), PLOTS),
        (lambda log: made_up_run.cut(log, 1), []),
        (lambda log: {n: log[n] for n in {*log} - {*EFFORT}}, PLOTS[:3]),
    ],
    ids=["cut off", "one row", "no effort"],
)
def test_plots_cope_with_what_a_log_lacks(log, tmp_path, change, names):
    """Oracle: by hand; the log of a point mass lacks all of the robot."""
    poor = change(made_up_run.without_robot(log))
    summary = made_up_run.summary_of(poor)
    assert pages.write_plots(tmp_path, poor, summary) == names
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)


@pytest.mark.parametrize("out", ["file/below", "file", "/proc/nowhere", "a\0b"])
def test_a_folder_that_cannot_be_written_is_refused(out, tmp_path, monkeypatch):
    """Even root cannot write below a file, nor into /proc."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(ValueError, match="must be a folder to write to") as e:
        folder.prepare_folder(out)
    assert str(e.value).startswith("out = ")
    assert "\n" not in str(e.value)
