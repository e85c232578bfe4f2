"""Clicks as a browser sends them, put into a real Meshcat."""

from dataclasses import fields

import pytest
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from nadia_balance.core.mechanisms import Mechanisms
from nadia_balance.systems.live_controls import (
    DIRECTION,
    LABELS,
    PUSH,
    SIZE,
    LiveControls,
)
from tests.tab import click

PERIOD = 0.02
ALL = Mechanisms(True, True, True, True)


@pytest.fixture
def meshcat() -> Meshcat:
    return Meshcat()


class Tab:
    """A tab, and what comes out of the controls at each poll."""

    def __init__(self, meshcat, mechanisms=ALL):
        self.meshcat = meshcat
        self.controls = LiveControls(meshcat, mechanisms, period=PERIOD)
        self.simulator = Simulator(self.controls)
        self.simulator.Initialize()

    def poll(self):
        time = self.simulator.get_context().get_time()
        self.simulator.AdvanceTo(time + PERIOD)

    def output(self, name):
        port = self.controls.GetOutputPort(name)
        return port.Eval(self.simulator.get_context()).tolist()


def test_begins_as_told(meshcat):
    """Oracle: the arguments; a push of 0.3 m/s to the left."""
    tab = Tab(meshcat, Mechanisms(step=True, transfer=True))
    assert tab.output("live_push") == pytest.approx([0.0, 0.3, 90.0])
    assert tab.output("mechanisms") == [1.0, 0.0, 1.0, 0.0]
    assert sorted(meshcat.GetButtonNames()) == sorted(
        [
            PUSH,
            "step adjustment: on",
            "swing timing: off",
            "transfer timing: on",
            "cross-over: off",
        ]
    )
    assert sorted(meshcat.GetSliderNames()) == sorted([SIZE, DIRECTION])


def test_there_is_a_label_for_each_mechanism():
    """Oracle: the fields, in their order."""
    assert list(LABELS) == [field.name for field in fields(Mechanisms)]


def test_counts_the_clicks_on_push(meshcat):
    """Oracle: the clicks; they are seen at the next poll, not before."""
    tab = Tab(meshcat)
    counts = []
    for clicks in (1, 0, 2):
        for _ in range(clicks):
            click(meshcat, PUSH)
        counts.append(tab.output("live_push")[0])
        tab.poll()
    assert counts == [0.0, 1.0, 1.0]
    assert tab.output("live_push")[0] == 3.0


def test_follows_the_sliders(meshcat):
    """Oracle: what they were set to, in their steps of 0.01 and 5."""
    tab = Tab(meshcat)
    meshcat.SetSliderValue(SIZE, 0.72)
    meshcat.SetSliderValue(DIRECTION, 211.0)
    tab.poll()
    assert tab.output("live_push") == pytest.approx([0.0, 0.72, 210.0])


@pytest.mark.parametrize("index", range(4))
def test_a_click_on_a_toggle_switches_its_mechanism(meshcat, index):
    """Oracle: off, and on again; the label says so, the others stay."""
    tab = Tab(meshcat)
    label = list(LABELS.values())[index]
    for now, then, value in ("on", "off", 0.0), ("off", "on", 1.0):
        click(meshcat, f"{label}: {now}")
        tab.poll()
        expected = [1.0] * 4
        expected[index] = value
        assert tab.output("mechanisms") == expected
        assert f"{label}: {then}" in meshcat.GetButtonNames()
        assert f"{label}: {now}" not in meshcat.GetButtonNames()
    assert len(meshcat.GetButtonNames()) == 5


def test_toggles_clicked_in_one_period_all_count(meshcat):
    """Oracle: one click switches, two do not."""
    tab = Tab(meshcat)
    click(meshcat, "step adjustment: on")
    click(meshcat, "cross-over: on")
    for _ in range(2):
        click(meshcat, "swing timing: on")
    tab.poll()
    assert tab.output("mechanisms") == [0.0, 1.0, 1.0, 0.0]
    tab.poll()
    assert tab.output("mechanisms") == [0.0, 1.0, 1.0, 0.0]


def test_a_new_run_forgets_the_clicks_but_keeps_the_sliders(meshcat):
    """Oracle: the second run in one tab begins with no push."""
    tab = Tab(meshcat)
    click(meshcat, PUSH)
    click(meshcat, "cross-over: on")
    meshcat.SetSliderValue(SIZE, 0.72)
    tab.poll()
    again = Simulator(tab.controls)
    again.Initialize()
    again.AdvanceTo(PERIOD)
    context = again.get_context()
    push = tab.controls.GetOutputPort("live_push").Eval(context)
    assert push.tolist() == pytest.approx([0.0, 0.72, 90.0])
    mechanisms = tab.controls.GetOutputPort("mechanisms").Eval(context)
    assert mechanisms.tolist() == [1.0] * 4
    assert "cross-over: on" in meshcat.GetButtonNames()


def test_another_run_in_the_same_tab_takes_over_its_controls(meshcat):
    """Oracle: one button and one slider each, set as the new run begins."""
    Tab(meshcat)
    meshcat.SetSliderValue(SIZE, 0.72)
    tab = Tab(meshcat, Mechanisms())
    assert tab.output("live_push") == pytest.approx([0.0, 0.3, 90.0])
    assert len(meshcat.GetButtonNames()) == 5
    assert not any(b.endswith(": on") for b in meshcat.GetButtonNames())


def test_the_outputs_depend_on_the_state_only(meshcat):
    """Oracle: Drake's own dependency graph, and an untouched tab's clicks."""
    tab = Tab(meshcat)
    assert not tab.controls.HasAnyDirectFeedthrough()
    click(meshcat, PUSH)
    assert tab.output("live_push")[0] == 0.0
    context = tab.controls.CreateDefaultContext()
    context.SetDiscreteState([5.0, 0.1, 30.0, 0.0, 1.0, 0.0, 1.0])
    port = tab.controls.GetOutputPort
    assert port("live_push").Eval(context).tolist() == [5.0, 0.1, 30.0]
    assert port("mechanisms").Eval(context).tolist() == [0.0, 1.0, 0.0, 1.0]
