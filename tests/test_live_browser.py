"""Live Meshcat in a real browser: what is clicked there arrives.

The program `push.py --live` is clicked, on the point mass; in the robot's
diagram, clicks are tested in test_humanoid.
"""

import subprocess
from collections.abc import Callable

from playwright.sync_api import Browser, Page

from nadia_balance.diagrams.live import SPEED
from nadia_balance.robot.model import load_robot
from tests.scripts import running

PATIENCE = 60.0  # with a machine that is busy [s]
BEGIN = "t = 0.80 s"  # the first swing, of this gait
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
GAIT = "num_steps: 30, initial_transfer_duration: 0.3, step: {length: 0.4}"


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


def test_a_user_pushes_pauses_resets_toggles_and_stops(browser):
    """Oracles: the page's text, its camera, the exit code, the terminal.

    There, m delta_v / 0.1 s: to the left; then what is typed into the boxes.
    """
    argv = "--live", "--plant", "lipm", "--scenario_text", f"gait: {{{GAIT}}}"
    with running.program("push", *argv, stderr=None) as program:
        try:
            use(browser, program)
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


def heights(page: Page, *labels: str) -> list[float]:
    """Where these controls are, from the top [pixels]."""
    boxes = (page.get_by_text(label, exact=True) for label in labels)
    return [box.bounding_box()["y"] for box in boxes]


def use(browser: Browser, program: subprocess.Popen) -> None:
    """Does what the test is called after, and looks at the page."""
    told = filter(lambda line: line.startswith("Live:"), program.stdout)
    url = next(told).split()[1]
    # Small, as all pixels are computed without a GPU.
    page = browser.new_page(viewport={"width": 700, "height": 450})
    page.set_default_timeout(1000.0 * PATIENCE)
    page.goto(url)
    text = page.locator("#status")

    def has_come(*words: str) -> Callable[[], bool]:
        return lambda: all(word in text.inner_text() for word in words)

    wait_until(page, has_come("t = ", "ICP error", "walks", "factor", "Space"))
    assert page.locator("#legend").is_visible()
    # After a frame of 0.3 s, the next one leaves as much for the messages.
    assert page.evaluate(SLOW_FRAME) == 1
    # A page that is slower than what it is sent falls ever farther behind, as
    # on a busy machine without a GPU.
    page.evaluate("viewer.renderer.setPixelRatio(0.1)")
    set_slider(page, SPEED, "0.3")
    places = heights(page, "Push", "Pause", "cross-over: on", "Scene")
    assert places == sorted(places) and places[0] < 30.0
    click(page, "Push")
    wait_until(page, has_come("last push 0.30 m/s "))
    x = "viewer.controls.target.x"
    wait_until(page, lambda: page.evaluate(x) > 0.3)
    set_slider(page, "size [m/s]", "0.2")
    set_slider(page, "direction [deg]", "180")
    page.wait_for_timeout(200)
    page.keyboard.press("p")  # the key of the button
    wait_until(page, has_come("last push 0.20 m/s backward"))
    click(page, "cross-over: on")
    page.get_by_text("cross-over: off", exact=True).wait_for()
    click(page, "Pause")
    wait_until(page, has_come("PAUSED"))
    before = text.inner_text()
    page.wait_for_timeout(200)
    assert text.inner_text() == before
    click(page, "Reset")
    wait_until(page, has_come(BEGIN, "walks", "PAUSED"))
    page.get_by_text("cross-over: off", exact=True).wait_for()
    places = heights(page, "Push", "Pause", "cross-over: off", "Scene")
    assert places == sorted(places) and places[0] < 30.0
    page.set_viewport_size({"width": 360, "height": 740})  # a phone
    page.wait_for_function("innerWidth == 360")
    (below,) = heights(page, "Scene")
    assert text.bounding_box()["y"] > below
    click(page, "cross-over: off")
    click(page, "Pause")
    page.get_by_text("cross-over: on", exact=True).wait_for()
    wait_until(page, lambda: not has_come(BEGIN)())
    click(page, "Stop")
    wait_until(page, has_come("has ended"))
    page.close()
