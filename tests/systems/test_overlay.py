"""Shapes that move in recordings, against a Meshcat that remembers."""

import numpy as np
import pytest
from pydrake.geometry import Sphere

from nadia_balance.systems import palette
from nadia_balance.systems.overlay import Arrow, Marker, PolygonOutline
from tests.fake_meshcat import FakeMeshcat

COLOR = palette.rgba(palette.SUPPORT)
PENTAGON = np.array(
    [[0.3, 0.0], [0.2, 0.4], [-0.1, 0.5], [-0.3, 0.1], [0.0, -0.3]]
)


def drawn_edges(meshcat, count, time, width):
    """The visible edges as (start, end) pairs (n, 2, 2), from the boxes."""
    edges = []
    for i in range(count):
        if meshcat.at(f"/p/{i}", "visible", time):
            X = meshcat.at(f"/p/{i}", "transform", time)
            length = meshcat.at(f"/p/{i}/<object>", "scale", time)[0]
            half = 0.5 * (length - width) * X[:2, 0]
            edges.append([X[:2, 3] - half, X[:2, 3] + half])
    return np.array(edges)


def test_the_boxes_of_an_outline_are_the_edges_of_the_polygon():
    """Oracle: the polygon's own vertices, from the boxes' poses and sizes."""
    meshcat = FakeMeshcat()
    outline = PolygonOutline(meshcat, "/p", 8, COLOR, width=0.01)
    outline.draw(PENTAGON, z=0.02, time=1.0)
    edges = drawn_edges(meshcat, 8, 1.0, width=0.01)
    expected = np.stack([PENTAGON, np.roll(PENTAGON, -1, axis=0)], axis=1)
    assert edges == pytest.approx(expected, abs=1e-12)
    assert meshcat.at("/p/0", "transform", 1.0)[2, 3] == 0.02


def test_an_outline_keeps_its_old_shape_in_earlier_frames():
    """Oracle: what was drawn at that time."""
    meshcat = FakeMeshcat()
    outline = PolygonOutline(meshcat, "/p", 5, COLOR, width=0.01)
    outline.draw(PENTAGON, 0.0, time=1.0)
    outline.draw(PENTAGON[:3] + 1.0, 0.0, time=2.0)
    outline.draw(np.zeros((0, 2)), 0.0, time=3.0)
    counts = [len(drawn_edges(meshcat, 5, t, 0.01)) for t in (1, 2, 3)]
    assert counts == [5, 3, 0]
    first = drawn_edges(meshcat, 5, 1.0, 0.01)[:, 0]
    assert first == pytest.approx(PENTAGON, abs=1e-12)


def test_an_outline_adds_its_objects_only_once():
    """Oracle: a recording cannot hold new objects (users.md)."""
    meshcat = FakeMeshcat()
    outline = PolygonOutline(meshcat, "/p", 5, COLOR)
    for i in range(10):
        outline.draw(PENTAGON[: 3 + i % 3], 0.0, i / 32.0)
    assert meshcat.objects == {f"/p/{i}": 1 for i in range(5)}


def test_an_outline_refuses_a_polygon_with_too_many_edges():
    outline = PolygonOutline(FakeMeshcat(), "/p", 4, COLOR)
    with pytest.raises(ValueError, match="edges = 5: must be at most 4"):
        outline.draw(PENTAGON, 0.0, 0.0)


def test_a_marker_appears_where_and_when_it_is_drawn():
    meshcat = FakeMeshcat()
    marker = Marker(meshcat, "/m", Sphere(0.1), palette.ICP)
    assert not meshcat.live["/m", "visible"]
    marker.draw(np.array([1.0, 2.0, 3.0]), time=0.5)
    assert meshcat.at("/m", "visible", 0.5)
    assert meshcat.at("/m", "position", 0.5) == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    "force", [[300.0, 0.0, 0.0], [0.0, -2.0, 0.0], [-1.0, 1.0, 0.0]]
)
def test_an_arrow_points_along_the_force_at_the_place(force):
    """Oracle: its z axis is the unit force, its origin the place."""
    meshcat = FakeMeshcat()
    arrow = Arrow(meshcat, "/a", palette.PUSH)
    place, force = np.array([0.1, 0.2, 1.0]), np.array(force)
    arrow.draw(place, force, time=1.0)
    X = meshcat.at("/a", "transform", 1.0)
    unit = force / np.linalg.norm(force)
    assert X[:3, 2] == pytest.approx(unit, abs=1e-12)
    assert X[:3, 3] == pytest.approx(place)
    shaft, head = (
        meshcat.live[f"/a/{part}", "transform"][2, 3]
        for part in ("shaft", "head")
    )
    assert shaft < head < 0.0, "it must come from behind the place"


def test_an_arrow_lingers_in_the_recording_but_not_in_the_live_view():
    """Oracle: pushed from 1.0 to 1.1 s at 32 Hz; LINGER is 0.5 s."""
    meshcat = FakeMeshcat()
    arrow = Arrow(meshcat, "/a", palette.PUSH)
    arrow.forget(time=0.0)
    for frame in range(64):
        if 32 <= frame < 36:
            arrow.draw(np.ones(3), np.ones(3), frame / 32.0)
            assert meshcat.live["/a", "visible"]
        else:
            arrow.hide()
            assert not meshcat.live["/a", "visible"]
    shown = [meshcat.at("/a", "visible", t) for t in (0.9, 1.0, 1.1, 1.4, 1.7)]
    assert shown == [False, True, True, True, False]
