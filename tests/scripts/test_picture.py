"""Pictures of a replay side by side, by a Chromium of their own.

As a program: the browser that the tests share is busy in this process.
"""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from nadia_balance.results.log import pushes
from nadia_balance.scripts import picture
from tests.results.made_up_run import Recipe, make_log
from tests.scripts.running import as_program, assert_refused, run_script
from tests.systems.test_balance_visualizer import PUSH, write_imitation

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
    monkeypatch.setattr(picture, "write_strip", lambda *a: seen.append(a))

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
    assert view == picture.View()
    assert out == tmp_path / "picture.png"


def test_looks_from_where_it_is_told(asked_for):
    """Oracle: the flags."""
    flags = "--azimuth 90 --elevation 5 --distance 2 --width 300 --height 200"
    *_, view, out = asked_for(*flags.split(), "--times", "1", "--out", "a.png")
    assert view == picture.View(
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
        (["--times", "1", "--distance", "0"], "distance = 0.0: must be in ["),
        (["--times", "1", "--run", "/none"], "run = '/none': must be a folder"),
    ],
)
def test_says_what_is_wrong_on_one_line(argv, message, folder, capsys):
    outcome = run_script(picture, ["--run", folder, *argv], capsys)
    assert_refused(outcome, message)


@pytest.mark.parametrize("whole", [False, True])
def test_refuses_a_log_without_the_moments(whole, tmp_path, capsys):
    """Oracle: a log that is cut off; a run without a push."""
    file = tmp_path / "log.npz"
    (tmp_path / "summary.json").write_text("{}")
    (tmp_path / "replay.html").touch()
    np.savez(file, **make_log(Recipe(pushed_step=None, changed={})))
    if not whole:
        file.write_bytes(file.read_bytes()[:-100])
    outcome = run_script(picture, ["--run", tmp_path], capsys)
    message = f"run = {str(tmp_path)!r}: must have a whole log.npz"
    no_push = "times: must be given, without a push"
    assert_refused(outcome, no_push if whole else message)


def refusal(folder, *argv) -> str:
    """What it says of a run, as a program of its own."""
    done = as_program("picture", "--run", folder, *argv, cwd=folder)
    assert done.returncode == 2
    assert not (folder / "picture.png").exists()
    (line,) = done.stderr.splitlines()
    return line.removeprefix("picture.py: ")


@pytest.mark.parametrize("whole", [False, True])
def test_refuses_a_time_that_is_not_in_the_replay(whole, folder, tmp_path):
    """Oracle: the replay takes ten seconds; half of its file is none."""
    text = (folder / "replay.html").read_text()
    end = len(text) if whole else len(text) // 2
    (tmp_path / "replay.html").write_text(text[:end])
    told = f"run = {str(tmp_path)!r}: must have a whole replay.html"
    late = "times = 11.5: must be within the replay, [0, 10.00] s"
    said = refusal(tmp_path, "--times", 1, 11.5)
    assert said.startswith(late if whole else told)


def test_says_that_chromium_is_missing(folder, tmp_path, monkeypatch):
    """Oracle: a computer without programs, and an empty folder for browsers."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("PLAYWRIGHT_BROWSERS_PATH", str(tmp_path))
    assert refusal(folder, "--times", 1) == (
        "Chromium is missing or does not start: apt-get install "
        "chromium, or playwright install chromium"
    )


def test_says_that_playwright_is_missing(folder, tmp_path, monkeypatch):
    """Oracle: a package of that name that has no browser."""
    (tmp_path / "playwright").mkdir()
    (tmp_path / "playwright" / "__init__.py").touch()
    outcome = as_program(
        *("picture", "--run", folder, "--times", 1),
        cwd=tmp_path,
        path=tmp_path,
    )
    assert (outcome.returncode, outcome.stderr) == (
        2,
        "picture.py: playwright is missing: pip install playwright\n",
    )


def test_a_gif_moves_and_begins_again(folder, tmp_path):
    """Oracle: pushed at 4.25 s, and a second later no more."""
    out = tmp_path / "push.gif"
    done = as_program(
        *("picture", "--run", folder, "--gif", "--out", out),
        *("--times", 0.5 * sum(PUSH), 5.5),
        *("--width", WIDTH, "--height", HEIGHT),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    with Image.open(out) as gif:
        assert (gif.n_frames, gif.size) == (2, (WIDTH, HEIGHT))
        assert gif.info["loop"] == 0
        frames = []
        for number in range(2):
            gif.seek(number)
            frames.append(np.asarray(gif.convert("RGB")) / 255.0)
    pushed, later = map(red_pixels, frames)
    assert pushed > later + 50


def test_a_gif_is_of_the_last_push(tmp_path):
    """Oracle: the push of the made-up run, frames of an eighth of a second."""
    log = make_log(Recipe())
    np.savez(tmp_path / "log.npz", **log)
    (tmp_path / "summary.json").write_text("{}")
    times = np.array(picture.gif_times(tmp_path))
    push = pushes(log)[-1]
    assert times[0] == pytest.approx(push.start - 0.4)
    assert np.diff(times) == pytest.approx(0.125)
    end = min(push.end + 2.5, log["t"][-1])
    assert end - 0.2 < times[-1] < end + 1e-9
