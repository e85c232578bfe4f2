"""Clicks as a browser sends them, put into a real Meshcat."""

from nadia_balance.core.walking.vocabulary import MECHANISMS
from nadia_balance.view.live_controls import PUSH, SLIDERS, LiveControls
from nadia_balance.view.scene import start_meshcat
from tests.blocks import answer, running, tick
from tests.clicks import click

PERIOD = 0.02


def test_counts_the_clicks_on_push_at_the_next_poll():
    """Oracle: the clicks; the sliders' values, in the order of the port."""
    meshcat, seen = start_meshcat()[0], []
    controls = LiveControls(meshcat, MECHANISMS["all_with_cross_over"], PERIOD)
    for name, value in zip(SLIDERS, (0.75, 45.0, 0.2), strict=True):
        meshcat.SetSliderValue(name, value)
    simulator, context = running(controls)
    simulator.AdvanceTo(0.5 * PERIOD)
    for clicks in (1, 0, 2, 0):
        for _ in range(clicks):
            click(meshcat, PUSH)
        seen.append(answer(controls, context, "live_push").tolist())
        tick(simulator, PERIOD)
    assert seen == [[clicks, 0.75, 45.0, 0.2] for clicks in (0, 1, 1, 3)]
