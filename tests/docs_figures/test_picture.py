"""Pictures of a replay, by a real browser."""

import contextlib

import numpy as np
import pytest
from PIL import Image
from pydrake.geometry import Rgba, Sphere
from pydrake.math import RigidTransform

import picture
from nadia_balance.palette import PUSH
from nadia_balance.results.pages import start_recording, write_replay
from nadia_balance.view.balance_visualizer import MIDDLE
from nadia_balance.view.scene import start_meshcat
from tests.results.made_up_run import Recipe, make_log
from tests.scripts.running import assert_refused, run_script

SIZE = ["--width", 200, "--height", 300]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Folders of runs: pushed, calm, and with half a log.

    In the replay of the first one a ball, as red as a push, is seen at first.
    The robot is at x = 1 m/s t.
    """
    folder = tmp_path_factory.mktemp("runs")
    (folder / "older").mkdir()
    older = make_log()
    older["push_signal"] = older["push_signal"][:, 1:]
    np.savez(folder / "older" / "log.npz", **older)
    (folder / "older" / "summary.json").write_text(
        '{"versions": {"nadia_balance": "0.1.0"}}'
    )
    for name, recipe in (
        ("pushed", Recipe()),
        ("calm", Recipe(pushed_step=None, changed={})),
        ("half", Recipe()),
    ):
        (folder / name).mkdir()
        (folder / name / "summary.json").write_text("{}")
        np.savez(folder / name / "log.npz", **make_log(recipe))
    log = folder / "half" / "log.npz"
    log.write_bytes(log.read_bytes()[:-100])
    meshcat = start_meshcat()[0]
    start_recording(meshcat)
    meshcat.SetObject("ball", Sphere(0.2), Rgba(0.8, 0.1, 0.1))
    for time, height in (0.0, picture._TARGET), (1.0, 100.0), (2.0, 100.0):
        meshcat.SetTransform(MIDDLE, RigidTransform([time, 0, 0]), time)
        meshcat.SetTransform("ball", RigidTransform([0, 0, height]), time)
    write_replay(meshcat, folder / "pushed" / "replay.html")
    return folder


@pytest.fixture
def draw(browser, monkeypatch, capsys):
    """The command line, with the browser of all tests; and its page."""
    lend, others = contextlib.nullcontext, browser.contexts
    monkeypatch.setattr(picture, "launch_chromium", lambda _: lend(browser))
    monkeypatch.setattr(picture.sync_api, "sync_playwright", lend)

    def run(*argv):
        outcome = run_script(picture, argv, capsys)
        contexts = [one for one in browser.contexts if one not in others]
        return outcome, contexts and contexts[-1].pages[0]

    yield run
    for context in browser.contexts:
        if context not in others:
            context.close()


def red_pixels(image: np.ndarray) -> int:
    """How many pixels may be of the arrow that shows the push."""
    red, green, blue = np.moveaxis(image / 255.0, 2, 0)
    return int(np.sum((red > 0.5) & (green < 0.2) & (blue < 0.3)))


def test_shows_the_moments_side_by_side(draw, runs, tmp_path):
    """Oracles: the ball; the camera, whose y is up, 2 m to the left of it.

    Below, the colours are explained: of frames with all regions, each 1/16 s.
    """
    out = tmp_path / "strip.png"
    view = "--azimuth 90 --elevation 0 --distance 2 --times 0 1.52".split()
    outcome, page = draw("--run", runs / "pushed", "--out", out, *view, *SIZE)
    assert outcome.out == [f"wrote {out}"]
    camera, target = (
        np.array(page.evaluate(f"viewer.{name}.toArray()"))
        for name in ("camera.position", "controls.target")
    )
    assert camera - target == pytest.approx([0.0, 0.0, -2.0], abs=1e-9)
    assert target[0] == pytest.approx(1.5, abs=1e-6)
    assert page.evaluate("document.body.dataset.caption") == "1.52 s"
    with Image.open(out) as file:
        image = np.asarray(file)
    assert image.shape[1] == 2 * 200 + 8
    assert 300 + 20 < image.shape[0] < 2 * 300
    first, second = np.split(image[:300, 4:-4], 2, axis=1)
    assert red_pixels(first) > 25
    assert red_pixels(second) == 0
    assert red_pixels(image[300:]) > 20


def test_a_gif_begins_again(draw, runs):
    """Oracle: an eighth of a second for each frame, in hundredths; 3 s at last.

    All frames have the colours of one palette.
    """
    run = runs / "pushed"
    outcome, _ = draw("--run", run, "--gif", "--times", 0, 1, *SIZE)
    assert outcome.code == 0, outcome.err
    with Image.open(run / "picture.gif") as gif:
        assert (gif.size, gif.n_frames) == ((200, 300), 2)
        assert gif.info["loop"] == 0
        colors, durations = set(), []
        for frame in range(2):
            gif.seek(frame)
            durations.append(gif.info["duration"])
            pixels = np.asarray(gif.convert("RGB")).reshape(-1, 3)
            colors |= {*map(tuple, pixels.tolist())}
    assert durations == [120, 3000]
    assert 50 < len(colors) <= 256


def test_the_palette_keeps_what_is_rare():
    """Oracle: a gradient with four orange pixels; the push is in no frame."""
    grey = np.linspace(0, 255, 90_000).astype(np.uint8).reshape(300, 300)
    pixels = np.dstack([grey, grey, grey])
    pixels[:2, :8] = orange = 240, 120, 20
    palette = picture._palette([Image.fromarray(pixels)])
    colors = np.array(palette.getpalette()).reshape(-1, 3)
    assert len(colors) <= 256
    push = np.array([*bytes.fromhex(PUSH[1:])])
    for color, most in (push, 0), (orange, 8), ((128, 128, 128), 4):
        assert np.abs(colors - color).max(axis=1).min() <= most


def test_the_moments_are_those_of_a_push_and_what_came_of_it(runs):
    """Oracle: the recipe: pushed from 1.976 s to 2.076 s; then it lands at
    2.23 and 2.77 s.
    """
    run = runs / "pushed"
    assert picture.moments(run) == pytest.approx([2.076, 2.2, 2.74], abs=2e-3)
    times = picture.moments(run, gif=True)
    assert times[0] == pytest.approx(1.976 - 0.4, abs=2e-3)
    assert np.diff(times) == pytest.approx(0.0625)
    end = 2.076 + 2.4
    assert end - 0.1 < times[-1] < end + 1e-6  # the sum of 46 periods


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--times", "x"], "argument --times"),
        (["--out", "a.gif"], "out = 'a.gif'"),
        (["--distance", "0"], "distance = 0.0"),
        (["--times", "1", "11.5"], "times = 11.5: must be within the replay"),
        (["--times", "1", "--run", "half"], "run = 'half': must have a whole"),
        (["--run", "calm"], "times: must be given, without a push"),
        (["--run", "half"], "run = 'half': must have a whole log.npz"),
        (
            ["--run", "older"],
            "run = 'older': must have a whole log.npz and summary.json, as "
            "--times are not given (ValueError('push_signal = ",
        ),
    ],
)
def test_says_what_is_wrong_on_one_line(argv, message, runs, draw, monkeypatch):
    """Oracle: what is in the folders; nothing is written."""
    monkeypatch.chdir(runs)
    outcome, _ = draw("--run", "pushed", *argv)
    assert_refused(outcome, message)
    assert not list(runs.rglob("*.png"))
