"""The arrows of the user: where the push and the way point."""

import math
import struct

import numpy as np
import pytest

from nadia_balance.core.walking.state import FootPose, FootPoses
from nadia_balance.view import aims
from nadia_balance.view.aims import Aims, commanded_way
from nadia_balance.view.scene import start_meshcat

FEET = FootPoses(
    left=FootPose([0.0, 0.1, 0.2], yaw=0.1),
    right=FootPose([0.0, -0.1, 0.2], yaw=0.3),
)


@pytest.mark.parametrize(
    "command", [(0.3, -0.1, 0.0), (0.3, -0.1, 0.5), (0.0, 0.0, -0.4)]
)
def test_the_way_is_that_of_a_point_ahead(command):
    """Oracle: the robot's motion, integrated by 1,000 small steps."""
    forward, left, turn = command
    x, y, yaw, steps = 0.0, 0.0, 0.0, 1000
    dt = aims.HORIZON / steps
    for _ in range(steps):
        middle = yaw + 0.5 * turn * dt
        x += (forward * math.cos(middle) - left * math.sin(middle)) * dt
        y += (forward * math.sin(middle) + left * math.cos(middle)) * dt
        yaw += turn * dt
    ahead = aims.AHEAD * np.array([math.cos(yaw), math.sin(yaw)])
    points = commanded_way(np.array(command))
    assert points[0] == pytest.approx([aims.AHEAD, 0.0])
    assert points[-1] == pytest.approx(ahead + [x, y], abs=1e-6)


def test_the_push_points_at_the_trunk_and_is_as_long_as_it_is_large():
    """Oracle: Meshcat's own transforms: 0.6 m per m/s, along the direction."""
    meshcat = start_meshcat()[0]
    drawn = Aims(meshcat)
    drawn.draw_push(np.array([1.0, 2.0, 0.9]), math.pi / 2.0, 0.5)
    X = _transform(meshcat, aims.PUSH)
    assert X[:3, 3] == pytest.approx([1.0, 2.0, 0.9])
    assert X[:3, 2] == pytest.approx([0.0, 1.0, 0.0])  # to the left
    shaft = _transform(meshcat, f"{aims.PUSH}/shaft")
    assert shaft[2, 2] == pytest.approx(0.3)
    assert shaft[2, 3] + 0.15 == pytest.approx(-0.34)  # behind the tip
    assert _is_visible(meshcat, aims.PUSH)
    drawn.draw_push(np.zeros(3), 0.0, 0.0)
    assert not _is_visible(meshcat, aims.PUSH)


def test_the_way_is_drawn_on_the_ground_while_there_is_a_command():
    """Oracle: Meshcat's own scene; the height of the soles."""
    meshcat = start_meshcat()[0]
    drawn = Aims(meshcat)
    com = np.array([1.0, 2.0, 0.9])
    drawn.draw_command(np.zeros(3), com, FEET)
    assert not meshcat.HasPath(aims.COMMAND)
    drawn.draw_command(np.array([0.3, 0.0, 0.0]), com, FEET)
    X = _transform(meshcat, aims.COMMAND)
    assert X[:2, 3] == pytest.approx([1.0, 2.0])
    assert 0.2 < X[2, 3] < 0.22
    assert X[:2, 0] == pytest.approx([math.cos(0.2), math.sin(0.2)])
    drawn.draw_command(np.zeros(3), com, FEET)
    assert not meshcat.HasPath(aims.COMMAND)


def _transform(meshcat, path) -> np.ndarray:
    """The pose that Meshcat keeps: 16 doubles at the end, by columns."""
    packed = meshcat._GetPackedTransform(path)
    numbers = [value for _, value in struct.iter_unpack(">cd", packed[-144:])]
    return np.array(numbers).reshape(4, 4).T


def _is_visible(meshcat, path) -> bool:
    """What Meshcat keeps: it packs true as 0xc3."""
    return meshcat._GetPackedProperty(path, "visible").endswith(b"\xc3")
