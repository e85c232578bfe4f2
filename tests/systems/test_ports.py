"""Oracles: Drake's own report of what is connected; error messages."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from nadia_balance.core.walking import FootPose, Footstep, Side
from nadia_balance.systems.ports import (
    connect,
    declare_input,
    eval_finite,
    eval_optional,
    eval_typed,
    export_input,
    export_outputs,
    feed_input,
)

POSE = FootPose([1.0, 2.0, 3.0], 0.5)


class Sink(LeafSystem):
    """Takes a pose and two numbers."""

    def __init__(self):
        super().__init__()
        self.pose = declare_input(self, "pose", POSE)
        self.DeclareVectorInputPort("pair", 2)
        self.DeclareVectorOutputPort(
            "same_pair",
            2,
            lambda context, output: output.SetFromVector(
                self.GetInputPort("pair").Eval(context)
            ),
        )


def test_hands_out_the_value_itself():
    """Oracle: identity; nothing is copied."""
    sink = Sink()
    context = sink.CreateDefaultContext()
    sink.pose.FixValue(context, Value(POSE))
    found = eval_typed(sink, context, sink.pose, FootPose)
    assert found == POSE
    assert found.p_WF is POSE.p_WF


def test_names_system_port_and_both_types():
    """Oracle: the message."""
    sink = Sink()
    sink.set_name("my_sink")
    context = sink.CreateDefaultContext()
    step = Footstep(Side.LEFT, POSE, 0.3, 0.7)
    sink.pose.FixValue(context, Value(step))
    message = "my_sink: input port 'pose' got a Footstep, needs a FootPose"
    with pytest.raises(TypeError, match=message):
        eval_typed(sink, context, sink.pose, FootPose)


@pytest.mark.parametrize("bad", [[np.nan, 0.0], [0.0, np.inf], [-np.inf, 1]])
def test_names_system_and_port_of_what_is_not_finite(bad):
    """Oracle: the message; what is finite is handed out as it is."""
    sink = Sink()
    sink.set_name("my_sink")
    context = sink.CreateDefaultContext()
    pair = sink.GetInputPort("pair")
    pair.FixValue(context, [1e150, -1e-150])
    assert eval_finite(sink, context, pair).tolist() == [1e150, -1e-150]
    pair.FixValue(context, bad)
    message = "^my_sink: input port 'pair' is not finite$"
    with pytest.raises(RuntimeError, match=message):
        eval_finite(sink, context, pair)


def test_an_optional_value_may_be_missing():
    """Oracle: not connected, None, a pose; the message for all else."""
    sink = Sink()
    context = sink.CreateDefaultContext()
    assert eval_optional(sink, context, sink.pose, FootPose) is None
    for value in None, POSE:
        sink.pose.FixValue(context, Value(value))
        assert eval_optional(sink, context, sink.pose, FootPose) == value
    sink.pose.FixValue(context, Value(Side.LEFT))
    with pytest.raises(TypeError, match="'pose' got a Side, needs a FootPose"):
        eval_optional(sink, context, sink.pose, FootPose)


def test_connects_and_exports_by_name():
    """Oracle: a value that goes in comes out, through all sinks."""
    builder = DiagramBuilder()
    first, second = builder.AddSystem(Sink()), builder.AddSystem(Sink())
    third = builder.AddSystem(Sink())
    with pytest.raises(RuntimeError, match="same_pair"):
        connect(builder, first, second, "same_pair")  # is no input
    export_input(builder, "pair", first, second)
    feed_input(builder, third, "pair")
    export_outputs(builder, second, "same_pair")
    builder.ExportOutput(third.GetOutputPort("same_pair"), "third")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("pair").FixValue(context, [4.0, 5.0])
    for name in "same_pair", "third":
        port = diagram.GetOutputPort(name)
        np.testing.assert_array_equal(port.Eval(context), [4.0, 5.0])
