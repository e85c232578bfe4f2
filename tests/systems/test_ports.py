"""Oracles: what goes in is what is handed out; error messages."""

from dataclasses import replace

import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.plan.gait import Gait, walking_start
from nadia_balance.core.walking.state import FootPose, Footstep, Side
from nadia_balance.systems import ports
from tests.blocks import asked, fix
from tests.example_walks import MODEL

POSE = FootPose([1.0, 2.0, 3.0], 0.5)


class Sink(LeafSystem):
    """Takes a pose and two numbers."""

    def __init__(self, output="twice"):
        super().__init__()
        self.set_name("my_sink")
        self.pose = ports.Input(self, "pose", FootPose)
        self.pair = ports.Input(self, "pair", 2)
        self.mechanisms = ports.optional_input(self, "mechanisms")
        self.DeclareVectorOutputPort(
            output,
            2,
            lambda context, output: output.SetFromVector(
                2.0 * self.pair(context)
            ),
            {self.pair.ticket()},
        )


def test_hands_out_the_value_itself_and_checks_its_type():
    """Oracle: identity, also of huge numbers; the message names both types."""
    sink = Sink()
    context = asked(sink, pose=POSE, pair=[1e150, -1e-150])
    assert sink.pose(context) is POSE
    assert sink.pair(context).tolist() == [1e150, -1e-150]
    fix(sink, context, pose=Footstep(Side.LEFT, POSE, 0.3, 0.7))
    message = "^my_sink: input port 'pose' got a Footstep, needs a FootPose$"
    with pytest.raises(TypeError, match=message):
        sink.pose(context)


def test_a_port_with_a_default_may_stay_open():
    """Oracle: the default, itself or as a value; the message for all else."""
    sink = Sink()
    pose = ports.Input(sink, "maybe", FootPose, None)
    context = asked(sink)
    assert pose(context) is None
    for value in None, POSE:
        fix(sink, context, maybe=value)
        assert pose(context) is value
    fix(sink, context, maybe=Side.LEFT)
    with pytest.raises(TypeError, match="'maybe' got a Side, needs a FootPose"):
        pose(context)


@pytest.mark.parametrize("base", [LeafSystem, ports.Block])
def test_a_simulator_asks_no_block_for_witness_functions(base):
    """Oracle: Python's __getattr__, which sees what is not found.

    A LeafSystem of Drake is asked in each step; once it is not, Block may go.
    """
    missed = []

    class Asked(base):
        def __getattr__(self, name):
            missed.append(name)
            raise AttributeError(name)

    simulator = Simulator(Asked())
    simulator.Initialize()
    for time in 0.1, 0.2, 0.3:
        simulator.AdvanceTo(time)
    asked_for = set() if base is ports.Block else {"DoGetWitnessFunctions"}
    assert set(missed) == asked_for


def test_a_plan_is_computed_once_for_each_schedule():
    """Oracle: a count of the calls; other schedules, and the first again."""
    calls = []

    def calc(state):
        calls.append(state.schedule)
        return len(calls)

    plan = ports.once_per_schedule(calc)
    state = walking_start(Gait(), MODEL)
    later = replace(state, time_in_phase=0.1)
    other = replace(state, schedule=replace(state.schedule, duration=2.0))
    states = state, later, other, other, later
    assert list(map(plan, states)) == [1, 1, 2, 2, 3]
    assert calls == [state.schedule, other.schedule, state.schedule]
