"""Drawings in a real Meshcat; test_balance_visualizer.py looks at them."""

import pytest
from shapely import Polygon, union_all

from nadia_balance import palette
from nadia_balance.view import overlay
from nadia_balance.view.scene import start_meshcat
from tests.example_walks import SOLE

BLACK = palette.rgba("#000000")


@pytest.mark.parametrize(
    "corners", [SOLE, [[0.3, 0.0], [0.2, 0.4], [-0.1, 0.5], [-0.3, 0.1]]]
)
def test_an_outline_is_of_one_width_within_the_polygon(corners):
    """Oracle: shapely's buffer with sharp corners."""
    painted = []

    class Spy:
        def SetTriangleMesh(self, path, vertices, faces, color):
            points = vertices.T[:, :2]
            painted.extend(Polygon(points[face]) for face in faces.T)

        def SetProperty(self, *_):
            pass

    polygon = Polygon(corners)
    inner = polygon.buffer(-overlay.LINE, join_style="mitre")
    for filled in False, True:
        painted.clear()
        overlay.add_polygon(
            Spy(), "/p", overlay.at_height(corners, 0.0), BLACK, filled, True
        )
        whole = union_all(painted)
        expected = polygon if filled else polygon - inner
        assert whole.symmetric_difference(expected).area < 1e-9
        twice = sum(one.area for one in painted) - whole.area
        assert twice == pytest.approx(filled * (polygon - inner).area, abs=1e-9)


def test_a_long_walk_keeps_its_last_shapes_only():
    """Oracle: Drake's Meshcat; less than STILL is no new shape."""
    meshcat, kept = start_meshcat()[0], 5
    polygon = overlay.ChangingPolygon(meshcat, "/p", BLACK, 0.1)
    polygon.KEPT = kept
    for frame in range(kept + 3):
        for move in 0.0, 0.004:
            polygon.draw(SOLE + [frame, move], 0.0, 0.1 * frame)
    there = [meshcat.HasPath(f"/p/{i}") for i in range(1, kept + 5)]
    assert there == [False] * 3 + [True] * kept + [False]
    polygon.forget()
    assert not meshcat.HasPath("/p/8")
