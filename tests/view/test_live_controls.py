"""Clicks and sticks as a browser sends them, put into a real Meshcat."""

import numpy as np
import pytest

from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.view.live_controls import (
    COMMANDS,
    DEAD_ZONE,
    FORWARD,
    HALT,
    LEFT,
    PUSH,
    SLIDERS,
    TURN,
    LiveControls,
    slider_step,
    stick_command,
)
from nadia_balance.view.scene import start_meshcat
from tests.blocks import answer, running, tick
from tests.clicks import click, hold_sticks

PERIOD = 0.02
LIMITS = np.array([[-0.5, -0.161, -0.9], [0.95, 0.161, 0.9]])
ALL_ON = MECHANISMS["all_with_cross_over"]


def polled():
    """A Meshcat with LiveControls, and what one more poll commands."""
    meshcat = start_meshcat()[0]
    controls = LiveControls(meshcat, ALL_ON, LIMITS, PERIOD)
    simulator, context = running(controls)
    simulator.Initialize()

    def command() -> list[float]:
        tick(simulator, PERIOD)
        return answer(controls, context, "velocity_command").tolist()

    return meshcat, command


def test_counts_the_clicks_on_push_at_the_next_poll():
    """Oracle: the clicks; the sliders' values, in the order of the port."""
    meshcat, seen = start_meshcat()[0], []
    controls = LiveControls(meshcat, ALL_ON, LIMITS, PERIOD)
    for name, value in zip(SLIDERS, (0.75, 45.0, 0.2), strict=True):
        meshcat.SetSliderValue(name, value)
    assert controls.aimed_push() == [0.75, 45.0, 0.2]
    simulator, context = running(controls)
    simulator.AdvanceTo(0.5 * PERIOD)
    for clicks in (1, 0, 2, 0):
        for _ in range(clicks):
            click(meshcat, PUSH)
        seen.append(answer(controls, context, "live_push").tolist())
        tick(simulator, PERIOD)
    assert seen == [[clicks, 0.75, 45.0, 0.2] for clicks in (0, 1, 1, 3)]


def test_commands_what_the_sliders_say_until_the_stop():
    """Oracle: the values set; after Stop walking 0, on the sliders, too."""
    meshcat, command = polled()
    assert command() == [0.0, 0.0, 0.0]
    for name, value in zip(COMMANDS, (0.3, -0.1, 0.2), strict=True):
        meshcat.SetSliderValue(name, value)
    assert command() == pytest.approx([0.3, -0.1, 0.2])
    assert command() == pytest.approx([0.3, -0.1, 0.2])
    click(meshcat, HALT)
    assert command() == [0.0, 0.0, 0.0]
    assert [meshcat.GetSliderValue(name) for name in COMMANDS] == [0.0] * 3
    meshcat.SetSliderValue(TURN, 0.4)  # a stop is heard once
    assert command() == pytest.approx([0.0, 0.0, 0.4])


def test_a_new_run_keeps_the_sliders_and_hears_no_old_click():
    """Oracle: a stop that was clicked before the run does not count in it."""
    meshcat = start_meshcat()[0]
    controls = LiveControls(meshcat, ALL_ON, LIMITS, PERIOD)
    meshcat.SetSliderValue(FORWARD, 0.2)
    for name in PUSH, HALT:
        click(meshcat, name)
    simulator, context = running(controls)
    simulator.Initialize()
    tick(simulator, PERIOD)
    command = answer(controls, context, "velocity_command")
    assert command == pytest.approx([0.2, 0.0, 0.0])
    assert answer(controls, context, "live_push")[0] == 0.0


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [(FORWARD, -0.5, 0.9), (LEFT, -0.15, 0.15), (TURN, -0.9, 0.9)],
)
def test_sliders_go_as_far_as_the_robot_in_whole_steps(name, low, high):
    """Oracle: LIMITS, rounded to steps of 0.1, or of 0.05, towards 0."""
    meshcat, _ = polled()
    assert meshcat.SetSliderValue(name, -9.0) == pytest.approx(low)
    assert meshcat.SetSliderValue(name, 9.0) == pytest.approx(high)
    assert meshcat.SetSliderValue(name, 0.001) == 0.0


def test_the_step_of_a_slider_is_fine_enough():
    """Oracle: by hand: three steps up to the limit, 0.1 at most."""
    steps = [slider_step(limit) for limit in (2.0, 0.3, 0.299, 0.06, 0.001)]
    assert steps == [0.1, 0.1, 0.05, 0.02, 0.005]


def test_a_held_stick_commands_and_the_sliders_count_when_it_is_released():
    """Oracle: the limits, in the robot's signs; all three at once by 3^0.5."""
    meshcat, command = polled()
    meshcat.SetSliderValue(FORWARD, 0.3)
    hold_sticks(meshcat, 0.0, -1.0, 0.0, 0.0)  # up
    assert command() == pytest.approx([0.95, 0.0, 0.0])
    hold_sticks(meshcat, 1.0, 1.0, -1.0, 0.0)  # right, down; left
    assert command() == pytest.approx([-0.2887, -0.09295, 0.5196], abs=1e-4)
    hold_sticks(meshcat, 0.1, -0.1, 0.0, 1.0)  # of a worn gamepad
    assert command() == pytest.approx([0.3, 0.0, 0.0])


def test_a_stick_begins_at_the_edge_of_its_dead_zone():
    """Oracle: linear from 0 at its edge to the limit; missing axes rest."""
    half = 0.5 * (1.0 + DEAD_ZONE)
    assert stick_command([0.0, -half], LIMITS)[0] == pytest.approx(0.475)
    assert stick_command([0.0, half], LIMITS)[0] == pytest.approx(-0.25)
    at_edge = stick_command([DEAD_ZONE, -DEAD_ZONE, DEAD_ZONE], LIMITS)
    assert not at_edge.any()
    assert not stick_command([], LIMITS).any()
