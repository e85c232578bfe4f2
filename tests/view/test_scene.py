"""Meshcat: its port; its scene is seen in test_balance_visualizer."""

import pytest

from nadia_balance.view.scene import start_meshcat


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
