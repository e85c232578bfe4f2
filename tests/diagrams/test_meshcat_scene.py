"""The Meshcat tab: its port and its scene."""

import re

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from diagrams.meshcat_scene import set_scene, start_meshcat


def test_takes_any_free_port_unless_told():
    meshcat, message = start_meshcat()
    assert meshcat.port() >= 7000
    assert message == ""


def test_takes_the_port_it_is_told():
    port = free_port()
    meshcat, message = start_meshcat(port)
    assert meshcat.port() == port
    assert message == ""


def test_a_busy_port_is_replaced_by_a_free_one_and_said_so():
    """Oracle: two Meshcats, of which the first has the port."""
    first, _ = start_meshcat()
    second, message = start_meshcat(first.port())
    assert second.port() != first.port()
    assert re.fullmatch(
        rf"port {first.port()} is busy: using {second.port()}", message
    )


@pytest.mark.parametrize("port", [-1, 0, 80, 1023, 65536, 100_000])
def test_an_impossible_port_is_refused(port):
    """Drake itself would abort the process, or take another port."""
    with pytest.raises(ValueError, match=rf"^port = {port}: must be in \["):
        start_meshcat(port)


def free_port():
    """A port that is free now."""
    return Meshcat().port()


def test_sets_a_floor_below_the_soles():
    """Oracle: Drake's Meshcat has the paths; nothing was there before."""
    meshcat = Meshcat()
    assert not meshcat.HasPath("/Floor")
    set_scene(meshcat)
    assert meshcat.HasPath("/Floor/plane")
    assert meshcat.HasPath("/Floor/grid")


def test_the_camera_goes_where_the_robot_starts():
    """Oracle: the same view, moved by the same distance."""
    start = np.array([5.0, -3.0])
    poses = []
    for where in (None, start):
        meshcat = Spy()
        set_scene(meshcat, where)
        poses.append(meshcat.pose)
    for before, after in zip(*poses, strict=True):
        assert after - before == pytest.approx([5.0, -3.0, 0.0])


class Spy:
    """Remembers the camera and swallows all else."""

    def SetCameraPose(self, camera, target):
        self.pose = (np.array(camera), np.array(target))

    def __getattr__(self, name):
        return lambda *args, **kwargs: None
