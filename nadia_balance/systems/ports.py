"""Typed abstract ports, and wiring by signal name."""

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
        raise TypeError(
            f"{system.get_name() or type(system).__name__}: input port "
            f"'{port.get_name()}' got a {type(value).__name__}, "
            f"needs a {kind.__name__}"
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
        builder.ConnectInput(name, system.GetInputPort(name))


def export_outputs(builder: DiagramBuilder, system, *names: str) -> None:
    """Makes the ports of these names outputs of the diagram."""
    for name in names:
        builder.ExportOutput(system.GetOutputPort(name), name)
