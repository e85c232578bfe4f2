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


@pytest.fixture(scope="module")
def written(log, tmp_path_factory):
    """The folder of a run, and the names that `write_run` tells."""
    meshcat = start_meshcat()[0]
    pages.start_recording(meshcat)
    path = folder.prepare_folder(tmp_path_factory.mktemp("run") / "new")
    summary = made_up_run.summary_of(log)
    text = "robot: nadia\n"
    return path, pages.write_run(path, log, summary, text, meshcat=meshcat)


def test_writes_all_that_a_run_leaves_behind(log, written, tmp_path):
    """Oracle: what is named exists and is not empty; nothing else does."""
    path, names = written
    expected = ["replay.html", "log.npz", "summary.json", "scenario.yaml"]
    assert names == expected + PLOTS
    assert sorted(p.name for p in path.iterdir()) == sorted(names)
    assert all((path / name).stat().st_size > 10 for name in names)
    assert (path / "scenario.yaml").read_text() == "robot: nadia\n"
    short = made_up_run.cut(log, 1)  # has no plots
    names = pages.write_run(tmp_path, short, made_up_run.summary_of(short), "")
    assert names == expected[1:], "without Meshcat"


def test_a_run_that_is_read_again_is_the_same(log, written, tmp_path):
    """Oracle: the log bit by bit, its pictures to the last byte."""
    (first, _), again = written, tmp_path
    summary = made_up_run.summary_of(log)
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
