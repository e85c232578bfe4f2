"""The page to play with: its numbers are those of core, and it can be played.

Oracle: the controller's own functions at ICPs, by shapely; what a browser does.
"""

import base64
import json
import re

import numpy as np
import pytest
from shapely import Polygon

import play
from nadia_balance.core.steps.capture_region import capture_region
from tests.scripts.running import run_script
from tests.source_files import ROOT

PAGE, TEMPLATE = ROOT / "docs/play.html", ROOT / "docs/figures/play.html"
DATA = re.compile(r"^const data = (.*);$", re.MULTILINE)
# Time, ICP and crossing: after a push inward, outward, back, and nearly none.
CASES = [
    (2, (0.113, 0.087), True),
    (2, (0.113, 0.087), False),
    (0, (-0.031, 0.207), True),
    (5, (0.149, -0.052), True),
    (4, (-0.187, -0.131), False),
    (3, (0.004, -0.111), True),
]


@pytest.fixture(scope="module")
def page(browser):
    context = browser.new_context(
        offline=True, viewport={"width": 1000, "height": 700}
    )
    page = context.new_page()
    page.goto(PAGE.as_uri())
    yield page
    context.close()


def core_foothold(time: float, icp, crossing: bool) -> np.ndarray:
    swing = play.geometry(crossing)
    return play.adjustment(swing, time, icp=np.array(icp)).pose.p_WF[:2]


def test_the_published_page_is_that_of_this_code():
    """Oracle: core, at some places of the grid; its words are the template's.

    The columns of the table are counted by hand: y, then x.
    """
    text = PAGE.read_text("utf-8")
    data = json.loads(DATA.search(text)[1])
    whole = DATA.sub("const data = {{data}};", text)
    assert whole == TEMPLATE.read_text("utf-8"), "python docs/figures/play.py"
    flat = np.frombuffer(base64.b64decode(data["footholds"]), dtype="<i2")
    footholds = flat.reshape(2, len(data["times"]), len(play.Y), -1, 2)
    rng = np.random.default_rng(1)
    for _ in range(60):
        crossing, time, row, column = (
            int(rng.integers(size)) for size in footholds.shape[:4]
        )
        icp = np.array([data["x"][column], data["y"][row]])
        expected = core_foothold(play.TIMES[time], icp, bool(crossing))
        found = footholds[crossing, time, row, column]
        assert found == pytest.approx(1000.0 * expected, abs=0.6)
    assert PAGE.stat().st_size < 400_000


@pytest.mark.parametrize(("time", "icp", "crossing"), CASES)
def test_the_page_draws_the_regions_of_core(page, time, icp, crossing):
    """At ICPs beside the grid."""
    swing = play.geometry(crossing)
    moment = play.TIMES[time]
    one = swing.one_step_region(
        np.array(icp), (moment, moment + play.PARAMS.waiting_time)
    )
    drawn = page.evaluate("(args) => regions(...args)", [icp, time, crossing])
    assert len(drawn) == len(swing.offsets) == 3
    for polygon, offsets in zip(drawn, swing.offsets, strict=True):
        expected = Polygon(capture_region(one, offsets))
        off = Polygon(polygon).symmetric_difference(expected).area
        assert off < 1e-4 * expected.length
    expected = core_foothold(moment, icp, crossing)
    found = page.evaluate("(args) => foothold(...args)", [icp, time, crossing])
    assert found == pytest.approx(expected, abs=0.02)


def test_the_icp_and_the_push_are_dragged(page):
    """Oracle: by hand: 0.2 m are to the left, and 0.3 m/s move by 0.3 / w."""
    page.click("#reset")
    before = page.evaluate("shown")
    box = page.locator("#view").bounding_box()
    # The drawing is whole in the window: metres by pixels.
    scale = page.evaluate("view.getScreenCTM().a")
    handle = page.get_by_label("ICP before the push").bounding_box()
    x = handle["x"] + 0.5 * handle["width"]
    y = handle["y"] + 0.5 * handle["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 0.1 * scale, y - 0.05 * scale)
    page.mouse.up()
    page.mouse.move(x, y)  # let go
    after = page.evaluate("shown")
    change = np.subtract(after["icp"], before["icp"])
    assert change == pytest.approx([0.1, 0.05], abs=1e-6)
    assert after["foothold"] != before["foothold"]
    assert box["height"] == pytest.approx(700.0)
    page.get_by_label("tip of the push").focus()
    for _ in range(10):
        page.keyboard.press("ArrowDown")
    change = np.subtract(page.evaluate("shown.icp"), after["icp"])
    expected = [0.0, -0.3 / play.MODEL.omega]
    assert change == pytest.approx(expected, abs=1e-5)
    assert "stop" in page.inner_text("#verdict")


def test_without_javascript_it_says_so(browser):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(PAGE.as_uri())
    assert "needs JavaScript" in page.inner_text("aside")
    context.close()


def test_the_command_writes_the_page(tmp_path, monkeypatch, capsys):
    """Oracle: the page for one ICP and time; the table takes seconds."""
    for name, few in ("X", play.X[:2]), ("Y", play.Y[:2]), ("TIMES", (0.3,)):
        monkeypatch.setattr(play, name, few)
    out = tmp_path / "page.html"
    outcome = run_script(play, ["--out", out], capsys)
    assert (outcome.code, outcome.out) == (0, [f"wrote {out}"])
    assert json.loads(DATA.search(out.read_text("utf-8"))[1])["times"] == [0.3]
