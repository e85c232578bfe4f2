"""Meshcat: its port, its scene, its recording as it is in the page.

The oracle of the recording is the page itself: Meshcat's commands are in it as
msgpack in base64, where a number is a byte 0xcb and a big-endian double.
tests/test_browser.py looks at it.
"""

import base64
import re
import struct

import pytest
from pydrake.geometry import Meshcat, Sphere
from pydrake.math import RigidTransform

from nadia_balance import palette
from nadia_balance.results.pages import start_recording, write_replay
from nadia_balance.results.scene import FRAMES_PER_SECOND, start_meshcat
from nadia_balance.systems.balance_visualizer import MIDDLE

BALL = "/ball"


def test_takes_the_port_it_is_told_or_says_that_it_is_busy():
    """Oracle: Meshcats, of which the second has the port of the third."""
    first, message = start_meshcat()
    assert (first.port() >= 7000, message) == (True, "")
    free = start_meshcat()[0].port()  # and gone again
    second, message = start_meshcat(free)
    assert (second.port(), message) == (free, "")
    third, message = start_meshcat(free)
    assert third.port() != free
    assert message == f"port {free} is busy: using {third.port()}"


@pytest.mark.parametrize("port", [-1, 1023, 65536])
def test_an_impossible_port_is_refused(port):
    """Drake itself would abort the process, or take another port."""
    with pytest.raises(ValueError, match=rf"^port = {port}: must be in \["):
        start_meshcat(port)


@pytest.fixture
def meshcat() -> Meshcat:
    """A ball at the origin."""
    meshcat = start_meshcat()[0]
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
    start_recording(meshcat, live=True)
    move(meshcat, 1.2345, 0.5)
    start_recording(meshcat)  # the run before is not a part of this one
    recording = meshcat.get_mutable_recording()
    assert recording.frames_per_second() == FRAMES_PER_SECOND
    move(meshcat, 2.3456, 0.5)
    page = replay_of(meshcat, tmp_path)
    animation = commands(page, "set_animation")
    assert holds(animation, 2.3456)
    assert not holds(animation, 1.2345)
    transform = commands(page, "set_transform")
    assert holds(transform, 1.2345), "shown while it was live"
    assert not holds(transform, 2.3456), "and not what was only recorded"
    move(meshcat, 3.4567, 1.0)  # after the end
    page = replay_of(meshcat, tmp_path)
    assert not holds(commands(page, "set_animation"), 3.4567)


class Page:
    """A page that has the end of a body in the text of a script."""

    head, tail = '<body><script>"</body>"</script>', "</body>\n</html>\n"

    def StopRecording(self):
        pass

    def PublishRecording(self):
        pass

    def StaticHtml(self):
        return self.head + self.tail


def test_adds_to_the_end_of_the_body_and_changes_nothing_else(tmp_path):
    """Oracle: the page as it was, and the palette, in its order."""
    page = replay_of(Page(), tmp_path)
    assert page.startswith(Page.head)
    assert page.endswith(Page.tail)
    added = page.removeprefix(Page.head).removesuffix(Page.tail)
    assert "<div id=\"legend\"" in added
    assert added.count("<script>") == added.count("</script>") == 1
    assert f'"{MIDDLE}"' in added
    assert "%s" not in added  # filled in
    entries = re.findall(r">(<b [^>]+>&#963[23];</b>)+ ([^<]+)<", added)
    legend = {name: bold for bold, name in entries}
    adjusted = legend.pop("foothold as adjusted")
    assert palette.RIGHT in adjusted and "&#9633;" in adjusted
    assert list(legend) == list(palette.LEGEND)
    for name, color in palette.LEGEND.items():
        square = 9632 + (name in palette.OUTLINED)
        assert legend[name] == f'<b style="color:{color}">&#{square};</b>'
