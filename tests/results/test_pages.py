"""The replay in a browser."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from nadia_balance.results import pages
from nadia_balance.results.log import pushes, steps
from nadia_balance.results.story import telling
from nadia_balance.view.balance_visualizer import MIDDLE
from nadia_balance.view.scene import start_meshcat
from tests.results.made_up_run import Recipe, make_log, summary_of


def test_the_page_tells_the_story_and_begins_again(browser, tmp_path):
    """Oracle: the story of the made-up run, and the viewer's own clock.

    Each line comes at its time, the last one without the figures of the end.
    """
    meshcat, path = start_meshcat()[0], tmp_path / "replay.html"
    pages.start_recording(meshcat)
    log = make_log(Recipe())
    log["velocity_command"] = np.tile([0.3, 0.0, 0.0], (len(log["t"]), 1))
    summary = summary_of(log) | {"scenario": "</script>"}
    story = telling(log, summary)
    end, _ = story[-1]
    for time in (0.0, end + 1.0):
        meshcat.SetTransform(MIDDLE, RigidTransform([time, 0.0, 0.0]), time)
    pages.write_replay(meshcat, path, pages.replay_status(log, summary))
    page = browser.new_page(offline=True)
    page.goto(path.as_uri())
    page.wait_for_function("viewer.animator.duration > 0")
    for time in end - 0.1, end + 0.5:
        seek = "(t) => { viewer.animator.pause(); viewer.animator.seek(t); }"
        page.evaluate(seek, time)
        phase = "recovering (right swing)"
        if time > end:
            phase = "walking (left swing)"
        clock = f"t = {time:.2f} s, {phase}, commanded forward 0.30 m/s"
        shown = "(t) => document.body.innerText.includes(t)"
        page.wait_for_function(shown, arg=clock)
        shown = " ".join(page.inner_text("#status").split())
        assert shown.startswith("</script> · ")
        for begins, line in story:
            words = " ".join(line.split("   ")[0].split())
            assert (words in shown) == (begins <= time), words
        left = page.evaluate("document.querySelector('#curves hr').style.left")
        share = min(time / log["t"][-1], 1.0)
        assert float(left.rstrip("%")) == pytest.approx(100.0 * share, abs=1e-3)
    # A jump to the push, and to a step: the robot is where it was then.
    second = steps(log)[1].swing.start
    for title, time in ("push", pushes(log)[0].start), ("step 2", second):
        page.click(f"#jumps button[title^='{title}, t = {time:.2f}']")
        x = f"viewer.scene_tree.find({MIDDLE[1:].split('/')}).object.position.x"
        page.wait_for_function(f"Math.abs({x} - {time}) < 0.3")
    page.evaluate("viewer.animator.play()")
    again = "(t) => viewer.animator.playing && viewer.animator.time < t"
    page.wait_for_function(again, arg=end)
    page.close()
