"""The pages as text; the replay in a browser."""

import json
import re

from pydrake.math import RigidTransform

from nadia_balance.results import pages
from nadia_balance.results.log import pushes, steps
from nadia_balance.results.story import telling
from nadia_balance.view.balance_visualizer import MIDDLE
from nadia_balance.view.scene import start_meshcat
from tests.results.made_up_run import Recipe, make_log, summary_of


def said_by(text):
    """What the page's script is given."""
    (found,) = re.findall(r"= (\{.*\});$", text, flags=re.MULTILINE)
    return json.loads(found)


def test_the_page_tells_the_story_with_its_times():
    """Oracle: the story of the terminal, without the figures of its end."""
    log = make_log(Recipe())
    summary = summary_of(log) | {"scenario": "</script>"}
    text = pages.replay_status(log, summary)
    assert text.count("</script>") == 2
    said = said_by(text)
    assert said["title"].startswith("</script>  ·  ")
    told = telling(log, summary)
    assert [line[0] for line in said["story"]] == [time for time, _ in told]
    for (_, line, _), (_, text) in zip(said["story"], told, strict=True):
        assert " ".join(text.split()).startswith(line)
    push = next(line for _, line, _ in said["story"] if "push" in line)
    assert re.search(r"push \d\.\d\d m/s .*F = \d+ N for", push)
    assert said["story"][-1][1].split()[0] == "RECOVERED"
    starts = [start for start, _ in said["phases"]]
    assert starts == sorted(starts)
    assert {"right swing", "left swing"} <= {name for _, name in said["phases"]}


def second(log):
    """When the second swing begins [s]."""
    return steps(log)[1].swing.start


def test_the_page_tells_the_time_and_begins_again(browser, tmp_path):
    """Oracle: the story of the made-up run, and the viewer's own clock."""
    meshcat, path = start_meshcat()[0], tmp_path / "replay.html"
    pages.start_recording(meshcat)
    log = make_log(Recipe())
    summary = summary_of(log)
    end, _ = telling(log, summary)[-1]
    for time in (0.0, end + 1.0):
        meshcat.SetTransform(MIDDLE, RigidTransform([time, 0.0, 0.0]), time)
    pages.write_replay(meshcat, path, pages.replay_status(log, summary))
    page = browser.new_page(offline=True)
    page.goto(path.as_uri())
    page.wait_for_function("viewer.animator.duration > 0")
    for time, seen in ((end - 0.1, False), (end + 0.5, True)):
        page.evaluate(
            "(t) => { viewer.animator.pause(); viewer.animator.seek(t); }", time
        )
        clock = f"t = {time:.2f} s"
        page.wait_for_function(
            "(t) => document.body.innerText.includes(t)", arg=clock
        )
        assert ("RECOVERED" in page.inner_text("#status")) == seen
    # A jump to the push, and to a step: the robot is where it was then.
    for title, time in ("push", pushes(log)[0].start), ("step 2", second(log)):
        page.click(f"#jumps button[title^='{title}, t = {time:.2f}']")
        x = f"viewer.scene_tree.find({MIDDLE[1:].split('/')}).object.position.x"
        page.wait_for_function(f"Math.abs({x} - {time}) < 0.3")
    page.evaluate("viewer.animator.play()")
    page.wait_for_function(
        "(t) => viewer.animator.playing && viewer.animator.time < t", arg=end
    )
    page.close()
