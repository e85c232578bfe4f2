"""Pictures of a replay: one by a real browser, the rest by one of ours."""

import contextlib
import io
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Error
from pydrake.geometry import Rgba, Sphere
from pydrake.math import RigidTransform

import picture
from nadia_balance.results.pages import start_recording, write_replay
from nadia_balance.view.balance_visualizer import MIDDLE
from nadia_balance.view.scene import start_meshcat
from tests.results.made_up_run import Recipe, make_log
from tests.scripts.running import assert_refused, run_script

VIEW = picture.View(width=200, height=300)


class FakePage:
    """A replay of ten seconds; every picture is of another grey."""

    def __init__(self, size):
        self.size, self.looks = size, []

    def goto(self, url):
        if url.endswith("half/replay.html"):
            raise Error("it ends too soon\nsomewhere")

    def set_default_timeout(self, _):
        pass

    wait_for_function = set_default_timeout

    def evaluate(self, _, look=None):
        if look is None:
            return 10.0
        self.looks.append(look)

    def set_viewport_size(self, size):
        self.size = size["width"], 40

    def locator(self, name):
        assert name == "#legend"
        return self

    def screenshot(self, style):
        size = [picture._SHARPNESS * length for length in self.size]
        grey = 3 * (50 * len(self.looks),)
        png = io.BytesIO()
        Image.new("RGB", size, grey).save(png, "PNG")
        return png.getvalue()


@pytest.fixture
def page(monkeypatch) -> FakePage:
    """The page that the command line opens."""
    page = FakePage((VIEW.width, VIEW.height))

    def launch(_):
        browser = SimpleNamespace(new_page=lambda **_: page)
        return contextlib.nullcontext(browser)

    monkeypatch.setattr(picture, "launch_chromium", launch)
    nothing = contextlib.nullcontext
    monkeypatch.setattr(picture.sync_api, "sync_playwright", nothing)
    return page


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Folders of runs without replays: pushed, calm, and with half a log."""
    folder = tmp_path_factory.mktemp("runs")
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
    return folder


def red_pixels(image: np.ndarray) -> int:
    """How many pixels may be of the arrow that shows the push."""
    red, green, blue = np.moveaxis(image / 255.0, 2, 0)
    return int(np.sum((red > 0.5) & (green < 0.2) & (blue < 0.3)))


def test_shows_the_moments_side_by_side(browser, tmp_path):
    """Oracle: a ball, as red as a push, that is there at first, and then gone.

    The colours are explained below the pictures.
    """
    replay, out = tmp_path / "replay.html", tmp_path / "strip.png"
    meshcat, times = start_meshcat()[0], [0.5, 1.5]
    start_recording(meshcat)
    meshcat.SetObject("ball", Sphere(0.2), Rgba(0.8, 0.1, 0.1))
    for time, height in zip(times, (picture._TARGET, 100.0), strict=True):
        meshcat.SetTransform(MIDDLE, RigidTransform(), time)
        meshcat.SetTransform("ball", RigidTransform([0, 0, height]), time)
    write_replay(meshcat, replay)
    page = picture.open_replay(browser, replay, times, VIEW)
    picture.write_strip(page, times, VIEW, out)
    page.close()
    with Image.open(out) as file:
        image = np.asarray(file)
    assert image.shape[1] == 2 * VIEW.width + 8
    assert VIEW.height + 20 < image.shape[0] < 2 * VIEW.height
    below = image[VIEW.height :]
    first, second = np.split(image[: VIEW.height, 4:-4], 2, axis=1)
    assert red_pixels(first) > 25
    assert red_pixels(second) == 0
    assert red_pixels(below) > 20


def test_looks_at_a_push_and_what_came_of_it(runs, page, tmp_path, capsys):
    """Oracle: the recipe: pushed until 2.08 s; landings at 2.23 and 2.77 s.

    The pictures are of the frames with all regions, each 1/16 s.
    """
    run, out = runs / "pushed", tmp_path / "strip.png"
    assert picture.moments(run) == pytest.approx([2.076, 2.2, 2.74], abs=2e-3)
    flags = "--azimuth 90 --elevation 0 --distance 2 --width 200 --height 300"
    argv = ["--run", run, "--out", out, *flags.split()]
    outcome = run_script(picture, argv, capsys)
    assert outcome.out == [f"wrote {out}"]
    assert [look["caption"] for look in page.looks] == [
        *("2.08 s", "2.20 s", "2.74 s")
    ]
    frames = [16.0 * look["time"] for look in page.looks]
    assert frames == [33.0, 35.0, 44.0]
    assert page.looks[0]["offset"] == pytest.approx([0.0, 2.0, 0.0], abs=1e-12)
    with Image.open(out) as strip:
        assert strip.size == (3 * 208 - 8, 300 + 40)
        points = [(100, 100), (300, 100), (500, 100), (204, 100)]
        greys = [strip.getpixel(point)[0] for point in points]
    assert greys == [50, 100, 150, 255]


def test_a_gif_is_of_the_last_push_and_begins_again(runs, page, capsys):
    """Oracle: pushed from 1.976 s on, an eighth of a second for each frame."""
    run = runs / "pushed"
    outcome = run_script(picture, ["--run", run, "--gif"], capsys)
    assert outcome.code == 0, outcome.err
    times = [look["time"] for look in page.looks]
    assert times[0] == pytest.approx(1.976 - 0.4, abs=1 / 32)
    assert np.diff(times) == pytest.approx(0.125)
    end = 2.076 + 2.5
    assert end - 0.2 < times[-1] < end
    with Image.open(run / "picture.gif") as gif:
        assert gif.size == (VIEW.width, VIEW.height)
        assert (gif.info["loop"], gif.info["duration"]) == (0, 120)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--times", "x"], "argument --times"),
        (["--out", "a.gif"], "out = 'a.gif'"),
        (["--gif", "--out", "a.png"], "out = 'a.png'"),
        (["--distance", "0"], "distance = 0.0"),
        (["--azimuth", "nan"], "azimuth = nan"),
        (["--times", "1", "11.5"], "times = 11.5: must be within the replay"),
        (["--times", "1", "--run", "half"], "run = 'half': must have a whole"),
        (["--run", "calm"], "times: must be given, without a push"),
        (["--run", "half"], "run = 'half': must have a whole log.npz"),
    ],
)
def test_says_what_is_wrong_on_one_line(
    argv, message, runs, page, monkeypatch, capsys
):
    """Oracle: what is in the folders; nothing is written."""
    monkeypatch.chdir(runs)
    outcome = run_script(picture, ["--run", "pushed", *argv], capsys)
    assert_refused(outcome, message)
    assert not list(runs.rglob("*.png"))
