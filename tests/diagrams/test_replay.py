"""What is written into the page; tests/test_browser.py looks at it.

The oracle of the recording is the page itself: Meshcat's commands are in it as
msgpack in base64, where a number is a byte 0xcb and a big-endian double.
"""

import base64
import re
import struct
from html.parser import HTMLParser

import pytest
from pydrake.geometry import Meshcat, Sphere
from pydrake.math import RigidTransform

from diagrams.meshcat_scene import FRAMES_PER_SECOND
from diagrams.replay import start_recording, write_replay
from nadia_balance.systems import palette
from nadia_balance.systems.balance_visualizer import MIDDLE

BALL = "/ball"


@pytest.fixture
def meshcat() -> Meshcat:
    """A tab with a ball at the origin."""
    meshcat = Meshcat()
    meshcat.SetObject(BALL, Sphere(0.1))
    meshcat.SetTransform(BALL, RigidTransform())
    return meshcat


def move(meshcat: Meshcat, x: float, time: float):
    meshcat.SetTransform(BALL, RigidTransform([x, 0.0, 0.0]), time)


def commands(page: str, kind: str) -> bytes:
    """All commands of this kind that concern the ball."""
    found = re.findall(r";base64,([A-Za-z0-9+/=]+)", page)
    decoded = [base64.b64decode(text) for text in found]
    wanted = [c for c in decoded if kind.encode() in c and b"ball" in c]
    assert wanted, f"no {kind} in the page"
    return b"".join(wanted)


def holds(command: bytes, number: float) -> bool:
    return b"\xcb" + struct.pack(">d", number) in command


def replay_of(meshcat: Meshcat, folder) -> str:
    path = folder / "replay.html"
    write_replay(meshcat, path)
    return path.read_bytes().decode("utf-8")


def test_replays_what_came_since_the_start_and_nothing_else(meshcat, tmp_path):
    """Oracle: three places that no other number in the page has."""
    start_recording(meshcat)
    move(meshcat, 1.2345, 0.5)
    start_recording(meshcat)  # the run before is not a part of this one
    move(meshcat, 2.3456, 0.5)
    page = replay_of(meshcat, tmp_path)
    animation = commands(page, "set_animation")
    assert holds(animation, 2.3456)
    assert not holds(animation, 1.2345)
    move(meshcat, 3.4567, 1.0)  # after the end
    page = replay_of(meshcat, tmp_path)
    assert not holds(commands(page, "set_animation"), 3.4567)


def test_records_at_the_pace_of_the_scene(meshcat):
    """Oracle: Drake's recording, asked for its frames."""
    start_recording(meshcat)
    recording = meshcat.get_mutable_recording()
    assert recording.frames_per_second() == FRAMES_PER_SECOND
    assert recording.frame(10.0) == 320


@pytest.mark.parametrize("live", [False, True])
def test_only_a_live_tab_moves_meanwhile(meshcat, tmp_path, live):
    """Oracle: where the ball is apart from the animation."""
    start_recording(meshcat, live=live)
    move(meshcat, 2.3456, 0.5)
    transform = commands(replay_of(meshcat, tmp_path), "set_transform")
    assert holds(transform, 2.3456) is live


class Legend(HTMLParser):
    """Name -> colour of the entries within the element `legend`."""

    def __init__(self):
        super().__init__()
        self.entries, self.color, self.inside = {}, None, False

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.inside |= attributes.get("id") == "legend"
        if self.inside and tag == "b":
            self.color = attributes["style"].removeprefix("color:")

    def handle_data(self, data):
        if self.color and data.strip(" \N{BLACK SQUARE}"):
            self.entries[data.strip()] = self.color
            self.color = None


def test_the_legend_has_every_colour_by_name(meshcat, tmp_path):
    """Oracle: the palette, in its order."""
    start_recording(meshcat)
    legend = Legend()
    legend.feed(replay_of(meshcat, tmp_path))
    assert list(legend.entries.items()) == list(palette.LEGEND.items())


class Page:
    """A tab whose page has the end of a body in the text of a script."""

    html = '<body><script>"</body>"</script></body>\n</html>\n'

    def StopRecording(self):
        pass

    def PublishRecording(self):
        pass

    def StaticHtml(self):
        return self.html


def test_adds_to_the_end_of_the_body_and_changes_nothing_else(tmp_path):
    """Oracle: the page as it was, less what is added."""
    page = replay_of(Page(), tmp_path)
    head, tail = '<body><script>"</body>"</script>', "</body>\n</html>\n"
    assert page.startswith(head)
    assert page.endswith(tail)
    added = page.removeprefix(head).removesuffix(tail)
    assert added.startswith('<div id="legend"')
    assert added.rstrip().endswith("</script>")
    assert added.count("<script>") == added.count("</script>") == 1
    assert f'"{MIDDLE}"' in added
    assert "%s" not in added  # filled in
