"""The replay in a browser: words, curves, marks, clock, and every size."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from nadia_balance import palette
from nadia_balance.results import pages
from nadia_balance.results.film import LEAD, axis_top, film
from nadia_balance.results.log import icp_error, pushes, steps
from nadia_balance.results.story import telling
from nadia_balance.view.balance_visualizer import MIDDLE
from nadia_balance.view.scene import set_scene, start_meshcat
from tests.results.made_up_run import Recipe, make_log, summary_of

PHONE, SCREEN = {"width": 390, "height": 844}, {"width": 1280, "height": 800}
X = f"viewer.scene_tree.find({MIDDLE[1:].split('/')}).object.position.x"
NO_WEBGL = "HTMLCanvasElement.prototype.getContext = () => null"

# Of the page; of the sky's top and the floor, red, green and blue up to 255.  A
# page hears of another scheme in one of the next frames.
COLORS = """async () => {
  for (const _ of "two") await new Promise(requestAnimationFrame);
  const find = (path) => viewer.scene_tree.find(path).object;
  const {r, g, b} = find(["Background", "<object>"]).top_color;
  const {color} = find(["Floor", "plane", "<object>"]).material;
  return [getComputedStyle(document.body).backgroundColor, [r, g, b],
          [16, 8, 0].map((shift) => (color.getHex() >> shift) & 255)];
}"""
# The top of a drawing, without its line's width [pixels].
Y = """(drawing) => {
  const matrix = drawing.getScreenCTM();
  return drawing.getBBox().y * matrix.d + matrix.f;
}"""


@pytest.fixture(scope="module")
def run():
    """A log and its summary; the title would end a script."""
    log = make_log(Recipe())
    log["velocity_command"] = np.tile([0.3, 0.0, 0.0], (len(log["t"]), 1))
    return log, summary_of(log) | {"scenario": "</script>"}


@pytest.fixture(scope="module")
def url(run, tmp_path_factory):
    """The replay of the run; in its scene, x = 1 m/s t."""
    meshcat = start_meshcat()[0]
    set_scene(meshcat)
    pages.start_recording(meshcat)
    for time in (0.0, run[0]["t"][-1]):
        meshcat.SetTransform(MIDDLE, RigidTransform([time, 0.0, 0.0]), time)
    path = tmp_path_factory.mktemp("replay") / "replay.html"
    pages.write_replay(meshcat, path, film(*run))
    return path.as_uri()


@pytest.fixture
def opened(browser, url):
    """Opens the replay, as this kind of browser shows it."""
    contexts = []

    def show(script="", **kind):
        contexts.append(browser.new_context(offline=True, **kind))
        page = contexts[-1].new_page()
        page.add_init_script(script)
        page.goto(url)
        if not script:
            page.wait_for_function("viewer.film.time > 0")
        return page

    yield show
    for context in contexts:
        context.close()


def test_the_page_tells_the_story_and_begins_again(run, opened):
    """Oracle: the story of the made-up run, by the page's clock.

    Each line comes at its time, the last one without the figures of the end.
    The film begins 1 s before the push, also anew.
    """
    log, summary = run
    story = telling(log, summary)
    begin, end = pushes(log)[0].start - LEAD, story[-1][0]
    page = opened(viewport={"width": 700, "height": 450})
    assert page.evaluate("viewer.film.time") >= begin
    for time in end - 0.1, end + 0.5:
        page.evaluate(f"viewer.film.play(false); viewer.film.seek({time})")
        phase = "recovering (right swing)"
        if time > end:
            phase = "walking (left swing)"
        shown = " ".join(page.inner_text("#words").split())
        assert shown.startswith("</script> · ")
        assert f"{phase}, commanded forward 0.30 m/s" in shown
        assert page.inner_text("#now") == f"t = {time:.2f} s"
        for begins, line in story:
            words = " ".join(line.split("   ")[0].split())
            assert (words in shown) == (begins <= time), words
    page.evaluate("viewer.film.play(); viewer.film.seek(1e9)")
    at_end = page.evaluate("viewer.film.time")
    assert at_end == pytest.approx(log["t"][-1])
    page.wait_for_function(f"viewer.film.time < {begin + 1.5}")
    assert page.evaluate("viewer.film.time") >= begin


def test_clicks_drags_marks_and_keys_move_the_film(run, opened):
    """Oracles: the share of the width that is clicked; the scene, x = t."""
    log, _ = run
    end = float(log["t"][-1])
    page = opened(viewport={"width": 700, "height": 450})
    strips = page.locator("#strips").bounding_box()
    within = 2.0 * end / strips["width"]  # of a pixel

    def is_at(time):
        page.wait_for_function(f"Math.abs({X} - {time}) < 0.02")
        found = page.evaluate("viewer.film.time")
        assert found == pytest.approx(time, abs=within)

    def point(share):
        page.mouse.move(
            strips["x"] + share * strips["width"], strips["y"] + 30.0
        )

    page.evaluate("viewer.film.play(false)")
    point(0.25)
    page.mouse.down()
    is_at(0.25 * end)
    point(0.75)
    is_at(0.75 * end)
    page.mouse.up()
    assert not page.evaluate("viewer.film.playing")
    point(0.5)
    is_at(0.75 * end)  # let go
    second = steps(log)[1].swing.start
    for name, time in ("push", pushes(log)[0].start), ("step 2", second):
        page.click(f"#marks button[title^='{name}, t = {time:.2f}']")
        is_at(time)
    for keys, time in (
        ("ArrowRight", second + 0.1),
        ("Shift+ArrowRight", second + 1.1),
        ("ArrowLeft", second + 1.0),
        ("Shift+ArrowLeft", second),
    ):
        page.keyboard.press(keys)
        is_at(time)
    page.keyboard.press("ArrowDown")
    assert page.input_value("#speed") == "0.5"
    page.keyboard.press("ArrowUp")
    assert page.input_value("#speed") == "1"
    page.keyboard.press("Space")
    page.wait_for_function(f"viewer.film.time > {second + 0.05}")
    page.keyboard.press("Space")
    assert not page.evaluate("viewer.film.playing")


def test_a_strip_has_an_axis_from_0_and_its_limit(run, opened):
    """Oracle: the log's own ICP error, by the pixels of the axis.

    It is up to 187 mm: 20 cm are the top, and the limit of 5 cm a quarter.
    """
    log, _ = run
    page = opened(viewport={"width": 700, "height": 450})
    plot = page.locator(".plot").first
    axis = [text.split()[0] for text in plot.locator("span").all_inner_texts()]
    top = 100.0 * np.max(icp_error(log))
    assert [*map(float, axis)] == [0.0, 5.0, axis_top(top)]
    outer = plot.locator("svg").bounding_box()
    scale = outer["height"] / axis_top(top)
    for name, value in ("polyline", top), ("line", 5.0):
        y = plot.locator(name).evaluate(Y)
        zero = outer["y"] + outer["height"]
        assert zero - y == pytest.approx(scale * value, abs=0.5), name
    # The film has less frames than the log: at the largest error that lasts.
    errors = 100.0 * icp_error(log)
    spans = np.lib.stride_tricks.sliding_window_view(errors, 41)
    lasts = np.ptp(spans, axis=1) < 0.3
    middle = 20 + int(np.argmax(np.where(lasts, spans.max(axis=1), 0.0)))
    moment, error = log["t"][middle], errors[middle]
    page.evaluate(f"viewer.film.play(false); viewer.film.seek({moment})")
    said = float(page.inner_text(".strip i").split()[0])
    assert said == pytest.approx(error, abs=0.3)


@pytest.mark.parametrize(
    ("largest", "top"), [(0.19, 0.2), (6.0, 6.0), (101.0, 120.0), (9.9, 10.0)]
)
def test_an_axis_ends_at_a_round_number(largest, top):
    assert axis_top(largest) == pytest.approx(top)


@pytest.mark.parametrize("size", [SCREEN, PHONE])
def test_no_word_lies_over_the_scene(opened, size):
    """Oracle: the boxes; a phone without the tag would take 980 pixels."""
    is_phone = size is PHONE
    page = opened(viewport=size, is_mobile=is_phone, has_touch=is_phone)
    assert page.evaluate("innerWidth") == size["width"]
    width = page.evaluate("document.documentElement.scrollWidth")
    assert width == size["width"]
    pane, *others = (
        page.locator(name).bounding_box()
        for name in ("#meshcat-pane", "#words", "#film")
    )
    canvas = page.locator("canvas").first.bounding_box()
    assert canvas == pytest.approx(pane, abs=1.0)
    assert pane["height"] > 0.4 * size["height"]
    for box in others:
        beside = box["x"] + box["width"] <= pane["x"] + 0.5
        assert beside or box["y"] >= pane["y"] + pane["height"] - 0.5


def test_a_dark_page_has_a_dark_sky_and_its_floor(opened):
    """Oracle: the palette; by day, Meshcat's own floor."""
    page = opened(viewport={"width": 700, "height": 450})
    day = palette.SKY_TOP, palette.FLOOR
    night = palette.NIGHT_TOP, palette.NIGHT_FLOOR
    for scheme, colors, background in (
        ("light", day, "rgb(255, 255, 255)"),
        ("dark", night, "rgb(23, 27, 34)"),
        ("light", day, "rgb(255, 255, 255)"),
    ):
        page.emulate_media(color_scheme=scheme)
        page_color, *drawn = page.evaluate(COLORS)
        assert page_color == background
        for color, expected in zip(drawn, colors, strict=True):
            parts = 255.0 * np.array(palette.rgb(expected))
            assert color == pytest.approx(parts, abs=4.0), scheme


def test_a_browser_without_webgl_is_told(opened):
    page = opened(NO_WEBGL, viewport=PHONE)
    assert "lacks WebGL" in page.inner_text("#status")
