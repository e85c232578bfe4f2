"""Oracles: what comes out of a diagram; error messages."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from nadia_balance.core.mechanisms import MECHANISMS
from nadia_balance.core.walking import FootPose, Footstep, Side
from nadia_balance.systems import ports
from nadia_balance.systems.momentum_qp import EcmpCommand
from tests.blocks import answer, asked, fix

POSE = FootPose([1.0, 2.0, 3.0], 0.5)


class Sink(LeafSystem):
    """Takes a pose and two numbers."""

    def __init__(self, output="twice"):
        super().__init__()
        self.set_name("my_sink")
        self.pose = ports.ValueInput(self, "pose", FootPose)
        self.pair = ports.VectorInput(self, "pair", 2)
        self.mechanisms = ports.MechanismsInput(self)
        self.DeclareVectorOutputPort(
            output,
            2,
            lambda context, output: output.SetFromVector(
                2.0 * self.pair(context)
            ),
            {self.pair.ticket()},
        )


class Ones(LeafSystem):
    """Gives a pair of ones, or of another size."""

    def __init__(self, size=2):
        super().__init__()
        self.DeclareVectorOutputPort(
            "pair", size, lambda _, output: output.SetFromVector(np.ones(size))
        )


@pytest.fixture
def sink():
    return Sink()


def test_hands_out_the_value_itself_and_checks_its_type(sink):
    """Oracle: identity; the message names system, port and both types."""
    context = asked(sink, pose=POSE)
    assert sink.pose(context) is POSE
    fix(sink, context, pose=Footstep(Side.LEFT, POSE, 0.3, 0.7))
    message = "^my_sink: input port 'pose' got a Footstep, needs a FootPose$"
    with pytest.raises(TypeError, match=message):
        sink.pose(context)


@pytest.mark.parametrize("bad", [[np.nan, 0.0], [0.0, np.inf], [-np.inf, 1]])
def test_names_system_and_port_of_what_is_not_finite(sink, bad):
    """Oracle: the message; what is finite is handed out as it is."""
    context = asked(sink, pair=[1e150, -1e-150])
    assert sink.pair(context).tolist() == [1e150, -1e-150]
    fix(sink, context, pair=bad)
    message = "^my_sink: input port 'pair' is not finite$"
    with pytest.raises(RuntimeError, match=message):
        sink.pair(context)


def test_a_port_with_a_default_may_stay_open(sink):
    """Oracle: the default, itself or as a value; the message for all else."""
    pose = ports.ValueInput(sink, "maybe", FootPose, None)
    context = asked(sink)
    assert pose(context) is None
    for value in None, POSE:
        fix(sink, context, maybe=value)
        assert pose(context) is value
    fix(sink, context, maybe=Side.LEFT)
    with pytest.raises(TypeError, match="'maybe' got a Side, needs a FootPose"):
        pose(context)


def test_a_vector_can_have_names(sink):
    """Oracle: the namedview's entries; its size is that of the port."""
    command = ports.VectorInput(sink, "command", EcmpCommand)
    context = asked(sink, command=[1.0, 2.0, 3.0, 4.0])
    assert command(context).ecmp.tolist() == [3.0, 4.0]


def test_all_mechanisms_are_on_unless_they_are_told(sink):
    """Oracle: the table of names."""
    context = asked(sink)
    assert sink.mechanisms(context) == MECHANISMS["all_with_cross_over"]
    for on in MECHANISMS.values():
        fix(sink, context, mechanisms=on.as_vector())
        assert sink.mechanisms(context) == on


def test_connects_by_name():
    """Oracle: a value that goes in comes out four times as large."""
    builder = DiagramBuilder()
    first = builder.AddNamedSystem("first", Sink("pair"))
    second = builder.AddNamedSystem("second", Sink())
    ports.connect(builder, first, second, "pair")
    with pytest.raises(RuntimeError, match="twice"):
        ports.connect(builder, second, first, "twice")  # is no input
    builder.ExportInput(first.GetInputPort("pair"), "in")
    builder.ExportOutput(second.get_output_port(), "out")
    diagram = builder.Build()
    context = asked(diagram, **{"in": [4.0, 5.0]})
    assert answer(diagram, context, "out").tolist() == [16.0, 20.0]


def wired(inputs=("pose", "pair", "mechanisms"), **blocks):
    builder = DiagramBuilder()
    ports.wire(builder, blocks, inputs)
    return builder.Build()


def test_wires_by_name_and_exports_the_rest():
    """Oracle: by hand; one input for both, and the outputs of both."""
    diagram = wired(a=Sink("once"), b=Sink("twice"))
    context = asked(diagram, pair=[4.0, 5.0])
    for name in "once", "twice":
        assert answer(diagram, context, name).tolist() == [8.0, 10.0]
    assert diagram.num_input_ports() == 3
    chained = wired(inputs=("pose", "mechanisms"), a=Ones(), b=Sink())
    context = chained.CreateDefaultContext()
    assert answer(chained, context, "twice").tolist() == [2.0, 2.0]


@pytest.mark.parametrize(
    ("inputs", "blocks", "message"),
    [
        (
            "pose pair mechanisms",
            {"a": Sink(), "b": Sink()},
            "must not have the output port 'twice', another block has it",
        ),
        (
            "pose mechanisms",
            {"b": Sink()},
            "input port 'pair' must be one of mechanisms, pose, twice",
        ),
        (
            "pose mechanisms",
            {"a": Ones(3), "b": Sink()},
            "input port 'pair' must be a vector of 3, as a's output; it is a "
            "vector of 2",
        ),
        (
            "pair mechanisms",
            {"b": Sink("pose")},
            "input port 'pose' must be a vector of 2, as b's output; it is "
            "abstract",
        ),
    ],
)
def test_refuses_to_wire_what_does_not_fit(inputs, blocks, message):
    """Oracle: one line that names block and port."""
    with pytest.raises(ValueError, match=f"^b = Sink: {message}$"):
        wired(inputs.split(), **blocks)


def test_fills_roles_with_the_given_blocks_or_the_defaults():
    """Oracle: the systems themselves; None leaves a role empty."""
    mine, roles = (
        Sink(),
        {"a": ports.Role(Sink, ()), "b": ports.Role(Sink, ("twice",))},
    )
    assert ports.fill(roles, {"b": mine, "a": None}) == {"b": mine}
    assert type(ports.fill(roles, {"b": mine})["a"]) is Sink


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        ({"a": Sink}, "^a = .*Sink'>: must be a System"),
        ({"b": Sink()}, "^b = Sink: must have the output port 'once'$"),
        ({"c": Sink()}, "^block = 'c': must be one of a, b, d$"),
    ],
)
def test_refuses_blocks_that_do_not_fit_their_role(blocks, message):
    roles = {"a": ports.Role(Sink, ()), "b": ports.Role(Sink, ("once",))}
    with pytest.raises(ValueError, match=message):
        ports.fill(roles, blocks, ["d"])
