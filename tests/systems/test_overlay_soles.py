"""Footholds and footprints, against a Meshcat that remembers."""

import math

import numpy as np
import pytest

from nadia_balance.core.walking import FootPose, Side, rectangle
from nadia_balance.systems import palette
from nadia_balance.systems.overlay_soles import Footprints, SoleOutline
from tests.fake_meshcat import FakeMeshcat

SOLE = rectangle(0.25, 0.12)
POSE = FootPose([1.0, 2.0, 0.3], math.radians(30.0))
PERIOD = 1.0 / 32.0


def test_a_sole_is_outlined_at_its_pose():
    """Oracle: FootPose.to_world of the corners."""
    meshcat = FakeMeshcat()
    SoleOutline(meshcat, "/s", SOLE, palette.rgba(palette.LEFT)).draw(POSE, 2.0)
    X_WF = meshcat.at("/s", "transform", 2.0)
    starts = []
    for i in range(4):
        X = X_WF @ meshcat.live[f"/s/{i}", "transform"]
        length, width, _ = meshcat.live[f"/s/{i}/<object>", "scale"]
        starts.append(X[:2, 3] - 0.5 * (length - width) * X[:2, 0])
    assert starts == pytest.approx(POSE.to_world(SOLE), abs=1e-12)


def test_a_sole_hides_again():
    meshcat = FakeMeshcat()
    outline = SoleOutline(meshcat, "/s", SOLE, palette.rgba(palette.LEFT))
    outline.draw(POSE, 1.0)
    outline.hide(2.0)
    assert meshcat.at("/s", "visible", 1.5)
    assert not meshcat.at("/s", "visible", 2.0)


def test_a_footprint_appears_with_its_step_and_stays():
    """Oracle: the second step lands at 1 s; prints do not vanish."""
    meshcat = FakeMeshcat()
    prints = Footprints(meshcat, "/f", SOLE, PERIOD)
    other = FootPose([5.0, 0.0, 0.0])
    for frame in range(64):
        if frame < 32:
            prints.draw(Side.LEFT, 1, POSE, frame * PERIOD)
        else:
            prints.draw(Side.RIGHT, 2, other, frame * PERIOD)
    seen = [meshcat.at("/f/right_2", "visible", t) for t in (0.0, 0.96, 1.0)]
    assert seen == [False, False, True]
    for t in (0.0, 1.9):
        assert meshcat.at("/f/left_1", "visible", t)
        X = meshcat.at("/f/left_1", "transform", t)
        assert X[:2, 3] == pytest.approx([1.0, 2.0])
        assert X[:2, :2] == pytest.approx(POSE.rotation)
        assert 0.3 < X[2, 3] < 0.31, "just above the floor"


def test_footprints_have_the_colour_of_their_foot():
    meshcat = FakeMeshcat()
    prints = Footprints(meshcat, "/f", SOLE, PERIOD)
    for number, side in enumerate(Side):
        prints.draw(side, number, POSE, 0.0)
    for number, side in enumerate(Side):
        color = meshcat.colors[f"/f/{side.value}_{number}"]
        expected = palette.rgb(palette.foot_color(side))
        assert [color.r(), color.g(), color.b()] == pytest.approx(expected)


def test_a_footprint_is_one_object_however_often_it_is_drawn():
    meshcat = FakeMeshcat()
    prints = Footprints(meshcat, "/f", SOLE, PERIOD)
    for frame in range(10):
        prints.draw(Side.LEFT, 3, POSE, frame * PERIOD)
    assert meshcat.objects == {"/f/left_3": 1}


def test_a_new_run_forgets_the_footprints():
    meshcat = FakeMeshcat()
    prints = Footprints(meshcat, "/f", SOLE, PERIOD)
    prints.draw(Side.LEFT, 3, POSE, 0.0)
    prints.forget()
    assert meshcat.objects == {}


def test_the_mesh_of_a_footprint_covers_the_sole():
    """Oracle: the area of the rectangle, 0.25 m x 0.12 m."""
    triangles = []

    class Spy(FakeMeshcat):
        def SetTriangleMesh(self, path, vertices, faces, rgba):
            super().SetTriangleMesh(path, vertices, faces, rgba)
            triangles.extend(vertices.T[f] for f in faces.T)

    Footprints(Spy(), "/f", SOLE, PERIOD).draw(Side.LEFT, 0, POSE, 0.0)
    areas = [np.cross(b - a, c - a)[2] / 2 for a, b, c in triangles]
    assert all(area > 0.0 for area in areas)
    assert sum(areas) == pytest.approx(0.25 * 0.12)
