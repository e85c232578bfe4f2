"""Pictures of a replay side by side, by a Chromium of their own.

As a program: the browser that the tests share is busy in this process.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from diagrams import pictures
from scripts import picture
from tests.diagrams.made_up_run import Recipe, make_log
from tests.scripts.running import as_program, assert_refused, run_script
from tests.test_browser import PUSH, write_imitation

WIDTH, HEIGHT = 300, 400


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A run that was pushed from 4.2 to 4.3 s."""
    path = tmp_path_factory.mktemp("run")
    write_imitation(path / "replay.html")
    return path


@pytest.fixture
def asked_for(monkeypatch, tmp_path, capsys):
    """Returns what a command line would take pictures of, and how."""
    np.savez(tmp_path / "log.npz", **make_log(Recipe()))
    (tmp_path / "summary.json").write_text("{}")
    (tmp_path / "replay.html").touch()
    seen = []
    monkeypatch.setattr(pictures, "write_strip", lambda *a: seen.append(a))

    def call(*argv):
        outcome = run_script(picture, ["--run", tmp_path, *argv], capsys)
        assert (outcome.code, outcome.err) == (0, [])
        return seen.pop()

    return call


def red_pixels(image: np.ndarray) -> int:
    """How many pixels may be of the arrow that shows the push."""
    red, green, blue = np.moveaxis(image[:, :, :3], 2, 0)
    return int(np.sum((red > 0.5) & (green < 0.2) & (blue < 0.3)))


def test_shows_the_moments_side_by_side(folder, tmp_path):
    """Oracle: pushed at 4.25 s, and a second later no more.

    The colours are explained below the pictures.
    """
    out = tmp_path / "strip.png"
    done = as_program(
        *("picture", "--run", folder, "--times", 0.5 * sum(PUSH), 5.5),
        *("--captions", "pushed", "<b>", "--out", out),
        *("--width", WIDTH, "--height", HEIGHT),
        cwd=tmp_path,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"wrote {out}\n"
    image = imread(out)
    height, width, _ = image.shape
    assert width == 2 * WIDTH + 8
    assert HEIGHT + 20 < height < HEIGHT + 200
    first, second = image[:HEIGHT, :WIDTH], image[:HEIGHT, WIDTH + 8 :]
    assert red_pixels(first) > 100
    assert red_pixels(second) == 0
    assert red_pixels(image[HEIGHT:]) > 20


def test_looks_at_a_push_and_what_came_of_it(asked_for, tmp_path):
    """Oracle: the recipe: pushed until 2.08 s; landings at 2.23 and 2.77 s."""
    replay, times, captions, view, out = asked_for()
    assert replay == tmp_path / "replay.html"
    assert times == pytest.approx([2.076, 2.2, 2.74], abs=0.002)
    assert captions == [f"{time:.2f} s" for time in times]
    assert view == pictures.View()
    assert out == tmp_path / "picture.png"


def test_looks_from_where_it_is_told(asked_for):
    """Oracle: the flags."""
    flags = "--azimuth 90 --elevation 5 --distance 2 --width 300 --height 200"
    *_, view, out = asked_for(*flags.split(), "--times", "1", "--out", "a.png")
    assert view == pictures.View(
        azimuth_deg=90, elevation_deg=5, distance=2, width_px=300, height_px=200
    )
    assert out == Path("a.png")


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--times", "x"], "argument --times: 'x': must be a finite number"),
        (["--times", "1", "--out", "a.gif"], "out = 'a.gif': must end in .png"),
        (
            ["--times", "1", "2", "--captions", "a"],
            "captions = 1: must be as many as times, 2",
        ),
        (
            ["--times", "1", "--distance", "0"],
            "distance = 0.0: must be in [0.5, 50.0]",
        ),
        (["--times", "1", "--run", "/none"], "run = '/none': must be a folder"),
    ],
)
def test_says_what_is_wrong_on_one_line(argv, message, folder, capsys):
    outcome = run_script(picture, ["--run", folder, *argv], capsys)
    assert_refused(outcome, message)


def test_knows_no_moments_of_a_run_without_a_push():
    log = make_log(Recipe(pushed_step=None, changed={}))
    with pytest.raises(ValueError, match="times: must be given, as nobody was"):
        picture.moments(log)


@pytest.mark.parametrize("fault", ["cut off", "empty", "other", "key"])
def test_refuses_a_log_that_is_not_whole(fault, tmp_path, capsys):
    """Oracle: a log that it does read, and what was done to it."""
    log, file = make_log(Recipe()), tmp_path / "log.npz"
    (tmp_path / "summary.json").write_text("{}")
    (tmp_path / "replay.html").touch()
    if fault == "key":
        del log["walking_signal"]
    np.savez(file, **log)
    if fault == "cut off":
        file.write_bytes(file.read_bytes()[:-100])
    elif fault != "key":
        file.write_bytes(b"" if fault == "empty" else b"no log")
    outcome = run_script(picture, ["--run", tmp_path], capsys)
    message = f"run = {str(tmp_path)!r}: must have a whole log.npz"
    assert_refused(outcome, message)


def test_refuses_a_replay_that_is_cut_off(folder, tmp_path):
    """Oracle: half of a replay that it does read."""
    half = (folder / "replay.html").read_text()
    (tmp_path / "replay.html").write_text(half[: len(half) // 2])
    argv = ("--run", tmp_path, "--times", 1)
    done = as_program("picture", *argv, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    told = f"picture.py: run = {str(tmp_path)!r}: must have a whole replay.html"
    assert line.startswith(told)


def test_refuses_a_time_after_the_end(folder, tmp_path):
    """Oracle: the replay takes ten seconds."""
    argv = ("--run", folder, "--times", 1, 11.5)
    done = as_program("picture", *argv, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        "picture.py: times = 11.5: must be within the replay, [0, 10.00] s\n"
    )
    assert not (folder / "picture.png").exists()


def test_says_that_chromium_is_missing(folder, tmp_path, monkeypatch):
    """Oracle: a computer without programs, and an empty folder for browsers."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("PLAYWRIGHT_BROWSERS_PATH", str(tmp_path))
    argv = ("--run", folder, "--times", 1)
    done = as_program("picture", *argv, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        "picture.py: Chromium is missing or does not start: apt-get install "
        "chromium, or playwright install chromium\n"
    )


def test_says_that_playwright_is_missing(folder, monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "diagrams.pictures")
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    outcome = run_script(picture, ["--run", folder], capsys)
    assert_refused(
        outcome,
        "playwright is missing: pip install 'nadia_balance[docs]'",
    )
