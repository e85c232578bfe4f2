"""Oracles: blocks that take a known time; the run that nobody measured."""

import time

import numpy as np
import pytest
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    EventStatus,
    LeafSystem,
)
from pydrake.systems.primitives import ConstantVectorSource

from diagrams.block_times import Meter, block_times, copy_inputs, leaves
from diagrams.simulation import start
from tests.diagrams.simulated import diagram_of

PERIOD = 0.002


class Sleeper(LeafSystem):
    """Takes 4 ms for its first output, 8 for its second, 16 to update."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("number", 1)
        self.DeclareVectorInputPort("optional", 1)
        self.state = self.DeclareDiscreteState([1.0])
        for name, seconds in (("first", 0.004), ("second", 0.008)):
            self.DeclareVectorOutputPort(name, 1, self.sleeping(seconds))
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self.update)

    def sleeping(self, seconds):
        def calc(context, output):
            time.sleep(seconds)
            number = self.GetInputPort("number").Eval(context)
            output.SetFromVector(
                number + context.get_discrete_state(self.state).value()
            )

        return calc

    def update(self, context, state):
        time.sleep(0.016)
        state.set_value(self.state, [5.0])
        return EventStatus.Succeeded()


@pytest.fixture
def sleeping() -> tuple[Diagram, Sleeper]:
    """A diagram within a diagram, and the sleeper in it."""
    inner = DiagramBuilder()
    sleeper = inner.AddNamedSystem("sleeper", Sleeper())
    three = inner.AddNamedSystem("three", ConstantVectorSource([3.0]))
    inner.Connect(three.get_output_port(), sleeper.GetInputPort("number"))
    outer = DiagramBuilder()
    outer.AddSystem(inner.Build())
    outer.AddNamedSystem("other", ConstantVectorSource([0.0]))
    return outer.Build(), sleeper


def test_finds_the_blocks_however_deep(sleeping):
    names = [block.get_name() for block in leaves(sleeping[0])]
    assert sorted(names) == ["other", "sleeper", "three"]


@pytest.mark.parametrize(
    ("num_outputs", "seconds"), [(0, 0.016), (1, 0.020), (2, 0.028)]
)
def test_measures_the_first_outputs_and_the_update(
    sleeping, num_outputs, seconds
):
    """Oracle: how long it sleeps, again in every tick.

    A sleep is never too short; on a busy machine it may be long.
    """
    diagram, sleeper = sleeping
    meter = Meter(sleeper, num_outputs)
    root = diagram.CreateDefaultContext()
    measured = [meter.measure(root) for _ in range(5)]
    assert min(measured) >= seconds - 1e-4
    assert min(measured) < seconds + 0.004


def test_copies_state_and_inputs_but_not_what_is_not_connected(sleeping):
    """Oracle: 3 from the input, 7 from the state; the original stays."""
    diagram, sleeper = sleeping
    root = diagram.CreateDefaultContext()
    source = sleeper.GetMyMutableContextFromRoot(root)
    source.SetDiscreteState([7.0])
    target = sleeper.CreateDefaultContext()
    copy_inputs(sleeper, source, target)
    assert sleeper.GetOutputPort("first").Eval(target) == [10.0]
    assert not sleeper.GetInputPort("optional").HasValue(target)
    target.SetDiscreteState([8.0])
    assert sleeper.GetOutputPort("first").Eval(source) == [10.0]


def test_does_not_disturb_what_it_measures():
    """Oracle: the same ten ticks of a loop that is not measured, bit by bit."""
    states = []
    for measured in (True, False):
        loop = start(diagram_of("{gait: {num_steps: 2}}"))
        loop.AdvanceTo(0.1)
        if measured:
            figures = block_times(loop, ticks=10)
        else:
            for tick in range(51, 61):
                loop.AdvanceTo(tick * PERIOD)
        plant = loop.get_system().plant
        context = plant.GetMyContextFromRoot(loop.get_context())
        states.append(plant.GetPositionsAndVelocities(context).copy())
        assert loop.get_context().get_time() == pytest.approx(0.12)
    assert np.array_equal(*states)
    whole = figures["balance_controller"]["median_us"]
    for part in ("whole_body_kinematics", "whole_body_qp"):
        assert 0.0 < figures[part]["median_us"] < whole
