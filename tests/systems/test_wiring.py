"""Oracles: what comes out of a diagram; error messages."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from nadia_balance.systems.wiring import fill, wire
from tests.blocks import answer, asked
from tests.systems.test_ports import Sink


class Ones(LeafSystem):
    """Gives a pair of ones, or of another size."""

    def __init__(self, size=2):
        super().__init__()
        self.DeclareVectorOutputPort(
            "pair", size, lambda _, output: output.SetFromVector(np.ones(size))
        )


def wired(inputs=("pose", "pair", "mechanisms"), **blocks):
    builder = DiagramBuilder()
    wire(builder, blocks, inputs)
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
            {"a": Ones(3), "b": Sink()},
            "input port 'pair' is a vector of 2, a's output is a vector of 3: "
            "they must be alike",
        ),
        (
            "pair mechanisms",
            {"b": Sink("pose")},
            "input port 'pose' is abstract, b's output is a vector of 2: they "
            "must be alike",
        ),
    ],
)
def test_refuses_to_wire_what_does_not_fit(inputs, blocks, message):
    """Oracle: one line that names block and port."""
    with pytest.raises(ValueError, match=f"^b = Sink: {message}$"):
        wired(inputs.split(), **blocks)


def test_refuses_a_class_in_place_of_a_block():
    """Other refusals: tests/test_controllers.py."""
    with pytest.raises(ValueError, match=r"^a = .*Sink'>: must be a System"):
        fill({"a": Sink}, {"a": ()}, {"a": Sink}, [])
