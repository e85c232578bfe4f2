"""Live Meshcat in a real browser: what is clicked there arrives.

The programs `push.py --live` and `simulate.py --live` are used, on the point
mass; in the robot's diagram, clicks are tested in test_humanoid.
"""

import re
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Locator, Page

from nadia_balance.diagrams.live import SPEED
from nadia_balance.robot.model import load_robot
from tests.scripts import running

PATIENCE = 60.0  # with a machine that is busy [s]
BEGIN = "t = 0.00 s, standing"
# The number of frames in the time of a frame that takes 0.3 s.
SLOW_FRAME = """() => {
  const render = viewer.render;
  let frames = 0;
  viewer.render = () => {
    frames += 1;
    const end = performance.now() + 300;
    while (performance.now() < end);
  };
  viewer.set_dirty();
  while (!frames) viewer.animate();
  viewer.set_dirty();
  viewer.animate();
  viewer.render = render;
  return frames;
}"""
# A gamepad that the page believes in; its sticks are at rest.
GAMEPAD = """
  window.sticks = [0, 0, 0, 0];
  navigator.getGamepads = () => [
    {connected: true, index: 0, buttons: [], axes: window.sticks}];
"""


def wait_until(page: Page, has_come: Callable[[], bool]) -> None:
    """Waits, while the page lives on."""
    for _ in range(round(PATIENCE / 0.05)):
        if has_come():
            return
        page.wait_for_timeout(50)
    raise TimeoutError


def click(page: Page, label: str) -> None:
    page.get_by_text(label, exact=True).click()


def set_slider(page: Page, label: str, text: str) -> None:
    box = page.locator("li.cr", has_text=label).locator("input")
    box.fill(text)
    box.press("Enter")


@contextmanager
def page_of(
    browser: Browser, program: subprocess.Popen, script: str = ""
) -> Iterator[Page]:
    """The page of the `program`, which runs the `script` before its own."""
    told = filter(lambda line: line.startswith("Live:"), program.stdout)
    url = next(told).split()[1]
    # Small, as all pixels are computed without a GPU.
    page = browser.new_page(viewport={"width": 700, "height": 450})
    page.set_default_timeout(1000.0 * PATIENCE)
    page.add_init_script(script)
    page.goto(url)
    yield page
    page.close()


def shows(page: Page, *words: str) -> Callable[[], bool]:
    """Tells whether the page's text has all of these `words`."""
    text = page.locator("#status")
    return lambda: all(word in text.inner_text() for word in words)


def walked(page: Page) -> float:
    """The velocity forward that the page tells [m/s]."""
    text = page.locator("#status").inner_text()
    return float(re.search(r"walks (-?[0-9.]+) m/s", text)[1])


def heights(page: Page, *labels: str) -> list[float]:
    """Where these controls are, from the top [pixels]."""
    boxes = (page.get_by_text(label, exact=True) for label in labels)
    return [box.bounding_box()["y"] for box in boxes]


def bottom(locator: Locator) -> float:
    """Where it ends, from the top [pixels]."""
    box = locator.bounding_box()
    return box["y"] + box["height"]


def test_a_user_walks_pushes_pauses_resets_toggles_and_stops(browser):
    """Oracles: the page's text, its camera, the exit code, the terminal.

    There, m delta_v / 0.1 s: to the left; then what is typed into the boxes.
    """
    argv = "--live", "--plant", "lipm"
    with running.program("push", *argv, stderr=None) as program:
        try:
            with page_of(browser, program) as page:
                use(page)
            assert program.wait(PATIENCE) == 0
            lines = program.stdout.read().splitlines()
        finally:
            program.kill()
    assert lines[-1].endswith("  reset")
    first, second = (line for line in lines if "  push " in line)
    mass = load_robot("nadia").mass
    assert "  push 0.30 m/s " in first
    assert first.endswith(f"  F = {mass * 3.0:.0f} N")
    assert "  push 0.20 m/s backward, " in second
    assert second.endswith(f"  F = {mass * 2.0:.0f} N")


def use(page: Page) -> None:
    """Does what the test is called after, and looks at the page."""
    text = page.locator("#status")
    still = "commanded 0.00, walks 0.00 m/s"
    wait_until(page, shows(page, "standing", still, "ICP error", "factor"))
    assert page.title() == "nadia_balance live"
    assert page.locator("#legend").is_visible()
    told = page.locator("#help").inner_text()
    for words in (
        "W faster",
        "X stop walking",
        "90 left",
        "as the support foot points",
    ):
        assert words in told
    # After a frame of 0.3 s, the next one leaves as much for the messages.
    assert page.evaluate(SLOW_FRAME) == 1
    # A page that is slower than what it is sent falls ever farther behind, as
    # on a busy machine without a GPU.
    page.evaluate("viewer.renderer.setPixelRatio(0.1)")
    places = heights(page, "Push", "Pause", "cross-over: on", "Scene")
    assert places == sorted(places) and places[0] < 30.0
    walk(page)
    set_slider(page, SPEED, "0.3")
    click(page, "Push")
    wait_until(page, shows(page, "last push 0.30 m/s "))
    set_slider(page, "size [m/s]", "0.2")
    set_slider(page, "direction [deg]", "180")
    page.wait_for_timeout(200)
    page.keyboard.press("p")  # the key of the button
    wait_until(page, shows(page, "last push 0.20 m/s backward"))
    click(page, "cross-over: on")
    page.get_by_text("cross-over: off", exact=True).wait_for()
    click(page, "Pause")
    wait_until(page, shows(page, "PAUSED"))
    before = text.inner_text()
    page.wait_for_timeout(200)
    assert text.inner_text() == before
    page.keyboard.press("x")
    click(page, "Reset")
    wait_until(page, shows(page, BEGIN, "PAUSED"))
    page.get_by_text("cross-over: off", exact=True).wait_for()
    places = heights(page, "Push", "Pause", "cross-over: off", "Scene")
    assert places == sorted(places) and places[0] < 30.0
    page.set_viewport_size({"width": 360, "height": 740})  # a phone
    page.wait_for_function("innerWidth == 360")
    pane, words = page.locator("#meshcat-pane"), page.locator("#words")
    (push,) = heights(page, "Push")
    under = [bottom(pane), words.bounding_box()["y"], bottom(words), push]
    assert under == sorted(under)
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    click(page, "cross-over: off")
    click(page, "Pause")
    page.get_by_text("cross-over: on", exact=True).wait_for()
    wait_until(page, lambda: not shows(page, BEGIN)())
    click(page, "Stop")
    wait_until(page, shows(page, "has ended"))


def walk(page: Page) -> None:
    """Walks forward by keys, with a try of all others."""
    for key, words in (
        ("a", "turn: commanded 0.10, "),
        ("q", "left: commanded 0.10, "),
    ):
        page.keyboard.press(key)
        wait_until(page, shows(page, words))
    for key in "ddee":
        page.keyboard.press(key)
    wait_until(page, shows(page, "turn: commanded -0.10, "))
    wait_until(page, shows(page, "left: commanded -0.10, "))
    page.keyboard.press("x")
    wait_until(page, shows(page, "t = ", "standing", "commanded 0.00, "))
    x = "viewer.controls.target.x"
    before = page.evaluate(x)
    for key in "wwwws":
        page.keyboard.press(key)
    wait_until(page, shows(page, "walking", "commanded 0.30, "))
    wait_until(page, lambda: abs(walked(page) - 0.3) < 0.02)
    wait_until(page, lambda: page.evaluate(x) > before + 0.3)


def test_a_gamepad_walks_and_a_standing_robot_catches_itself(browser):
    """Oracles: the page's text; the terminal tells the same; the exit code.

    A stick that is held commands the most, and no longer when it is released;
    1 m/s forward takes a step, and one to be square; 1.5 m/s are too much.
    """
    argv = "--live", "--plant", "lipm"
    with running.program("simulate", *argv, stderr=None) as program:
        try:
            with page_of(browser, program, GAMEPAD) as page:
                play(page)
            assert program.wait(PATIENCE) == 0
            lines = program.stdout.read().splitlines()
        finally:
            program.kill()
    first, recovered, second, fell = lines
    assert "  push 1.00 m/s forward, standing  F = " in first
    assert recovered.endswith("  RECOVERED in 2 steps")
    assert "  push 1.50 m/s left, standing  F = " in second
    assert "  FELL: CoM out of reach of both feet: capture region " in fell


def play(page: Page) -> None:
    """Does what the test is called after, and looks at the page."""
    wait_until(page, shows(page, "standing", "commanded 0.00, "))
    page.evaluate("viewer.renderer.setPixelRatio(0.1)")
    set_slider(page, SPEED, "1.5")
    page.evaluate("sticks = [0, -0.6, 0, 0]")
    # 0.45 of 0.85 of the stick's way, of at most 0.780 m/s.
    wait_until(page, shows(page, "walking", "commanded 0.41, "))
    wait_until(page, lambda: abs(walked(page) - 0.41) < 0.03)
    page.evaluate("sticks = [0, 0, 0, 0]")
    still = "standing", "commanded 0.00, walks 0.00 m/s"
    wait_until(page, shows(page, *still))
    set_slider(page, "size [m/s]", "1")
    set_slider(page, "direction [deg]", "0")
    page.wait_for_timeout(300)
    click(page, "Push")
    wait_until(page, shows(page, "RECOVERED in 2 steps", *still))
    set_slider(page, "size [m/s]", "1.5")
    set_slider(page, "direction [deg]", "90")
    page.wait_for_timeout(300)
    click(page, "Push")
    wait_until(page, shows(page, "FELL: ", "capture region "))
    wait_until(page, lambda: not shows(page, "FELL: ")())  # it begins anew
    wait_until(page, shows(page, *still))
    click(page, "Stop")
    wait_until(page, shows(page, "has ended"))
