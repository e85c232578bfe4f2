"""Meshcat: its port; its scene is seen in test_balance_visualizer."""

import pytest

from nadia_balance import palette
from nadia_balance.view.scene import ChangingPolygon, start_meshcat
from tests.example_walks import SOLE


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


def test_a_long_walk_keeps_its_last_shapes_only():
    """Oracle: Drake's Meshcat; less than STILL is no new shape."""
    meshcat, kept = start_meshcat()[0], 5
    polygon = ChangingPolygon(meshcat, "/p", palette.rgba("#000000"))
    polygon.KEPT = kept
    for frame in range(kept + 3):
        for move in 0.0, 0.004:
            polygon.draw(SOLE + [frame, move], 0.0, 0.1 * frame)
    there = [meshcat.HasPath(f"/p/{i}") for i in range(1, kept + 5)]
    assert there == [False] * 3 + [True] * kept + [False]
    polygon.forget()
    assert not meshcat.HasPath("/p/8")
