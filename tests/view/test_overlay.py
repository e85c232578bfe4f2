"""Drawings in a real Meshcat; test_balance_visualizer.py looks at them."""

from nadia_balance import palette
from nadia_balance.view import overlay
from nadia_balance.view.scene import start_meshcat
from tests.example_walks import SOLE

BLACK = palette.rgba("#000000")


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
