"""Clicks as a browser sends them, put into a real Meshcat."""

import pytest
from pydrake.geometry import Meshcat

from nadia_balance.core.walking.vocabulary import MECHANISMS
from nadia_balance.view import live_controls
from nadia_balance.view.scene import start_meshcat
from tests.blocks import answer, running, tick
from tests.clicks import click

PERIOD = 0.02


@pytest.fixture
def meshcat() -> Meshcat:
    return start_meshcat()[0]


class Session:
    """A run with the controls, and what comes out of them at each poll."""

    def __init__(self, meshcat, controls=None):
        self.controls = controls or live_controls.LiveControls(
            meshcat, MECHANISMS["all_with_cross_over"], PERIOD
        )
        self.simulator, self._context = running(self.controls)
        self.simulator.AdvanceTo(0.5 * PERIOD)

    def poll(self):
        tick(self.simulator, PERIOD)

    def output(self, name):
        return answer(self.controls, self._context, name).tolist()


def test_counts_the_clicks_on_push_at_the_next_poll(meshcat):
    """Oracle: the clicks; Drake's own dependency graph."""
    session = Session(meshcat)
    assert not session.controls.HasAnyDirectFeedthrough()
    counts = []
    for clicks in (1, 0, 2):
        for _ in range(clicks):
            click(meshcat, live_controls.PUSH)
        counts.append(session.output("live_push")[0])
        session.poll()
    assert counts == [0.0, 1.0, 1.0]
    assert session.output("live_push")[0] == 3.0
