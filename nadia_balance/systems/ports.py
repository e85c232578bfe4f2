"""Typed abstract ports, and wiring by signal name."""

import math

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem


def declare_input(system: LeafSystem, name: str, example: object):
    """Declares an abstract input port that carries values like `example`."""
    return system.DeclareAbstractInputPort(name, Value(example))


def eval_typed(system: LeafSystem, context: Context, port, kind: type):
    """Evaluates an abstract input port, and checks the value's type.

    All Python values are one C++ type, so that Drake connects any abstract
    output to any abstract input without a word.

    Raises:
        TypeError: the value is not a `kind`; names system and port.
    """
    value = port.Eval(context)
    if not isinstance(value, kind):
        raise _wrong_type(system, port, value, kind)
    return value


def eval_optional(system: LeafSystem, context: Context, port, kind: type):
    """As eval_typed, but None if the port is not connected, or has None."""
    value = port.Eval(context) if port.HasValue(context) else None
    if value is not None and not isinstance(value, kind):
        raise _wrong_type(system, port, value, kind)
    return value


def _wrong_type(system: LeafSystem, port, value: object, kind: type):
    return TypeError(
        f"{system.get_name() or type(system).__name__}: input port "
        f"'{port.get_name()}' got a {type(value).__name__}, "
        f"needs a {kind.__name__}"
    )


def eval_finite(system: LeafSystem, context: Context, port) -> np.ndarray:
    """Evaluates a vector input port, and checks that all of it is finite.

    Raises:
        RuntimeError: NaN or infinity; names system and port.
    """
    value = port.Eval(context)
    # A sum of squares is finite only if all are, and the cheapest to ask;
    # of all ways to sum them up this is the fastest.
    if not math.isfinite(value.dot(value)):
        raise RuntimeError(
            f"{system.get_name() or type(system).__name__}: input port "
            f"'{port.get_name()}' is not finite"
        )
    return value


def connect(builder: DiagramBuilder, source, sink, *names: str) -> None:
    """Connects the ports of these names from `source` to `sink`."""
    for name in names:
        builder.Connect(source.GetOutputPort(name), sink.GetInputPort(name))


def export_input(builder: DiagramBuilder, name: str, *systems) -> None:
    """Makes `name` an input of the diagram that feeds all `systems`."""
    first, *others = systems
    builder.ExportInput(first.GetInputPort(name), name)
    for system in others:
        feed_input(builder, system, name)


def feed_input(builder: DiagramBuilder, system, *names: str) -> None:
    """Feeds these inputs that the diagram has already to `system` as well."""
    for name in names:
        builder.ConnectInput(name, system.GetInputPort(name))


def export_outputs(builder: DiagramBuilder, system, *names: str) -> None:
    """Makes the ports of these names outputs of the diagram."""
    for name in names:
        builder.ExportOutput(system.GetOutputPort(name), name)
