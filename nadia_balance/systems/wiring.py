"""The wiring of blocks by the names of their signals.

A signal has the same name at every port, so that the names say what is
connected to what.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import cast

from pydrake.systems.framework import (
    DiagramBuilder,
    InputPort,
    OutputPort,
    PortDataType,
    System,
)

from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.yaml_reader import one_line


def connect(
    builder: DiagramBuilder,
    source: System,
    sink: System,
    *names: str,
    **renamed: str,
) -> None:
    """Connects the ports of these names from one block to another.

    Ports of different names: `connect(..., name_at_source="name_at_sink")`.

    Args:
        builder: has both blocks.
        source: block with the output ports.
        sink: block with the input ports.
        *names: names of the ports, the same at both.
        **renamed: names at the sink by those at the source.
    """
    for output, name in (*zip(names, names, strict=True), *renamed.items()):
        builder.Connect(source.GetOutputPort(output), sink.GetInputPort(name))


def fill(
    makers: Mapping[str, Callable[[], System]],
    outputs: Mapping[str, Collection[str]],
    blocks: Mapping[str, System | None],
    others: Iterable[str] = (),
) -> dict[str, System]:
    """The block in each role: that of the user, or else the usual one.

    Args:
        makers: makes the usual block by role; not called for a role in
            `blocks`.
        outputs: output ports that a block must have, by role.
        blocks: the user's blocks by role; None leaves the role empty.
        others: roles elsewhere, for the message.

    Returns:
        The blocks by role, in the order of `makers`.

    Raises:
        ValueError: `blocks` has an unknown role, no System, or a system that
            lacks an output of its role.
    """
    for role, block in blocks.items():
        require(
            role in makers,
            f"block = {role!r}: must be one of {', '.join((*makers, *others))}",
        )
        if block is not None:
            _check_block(role, block, outputs[role])
    filled = {
        role: blocks[role] if role in blocks else make()
        for role, make in makers.items()
    }
    return {role: block for role, block in filled.items() if block is not None}


def _check_block(role: str, block: object, outputs: Collection[str]) -> None:
    if not isinstance(block, System):
        raise ValueError(f"{role} = {block!r}: must be a System, made already")
    for name in outputs:
        require(
            block.HasOutputPort(name),
            f"{role} = {type(block).__name__}: must have the output port "
            f"{name!r}",
        )


def wire(
    builder: DiagramBuilder,
    blocks: Mapping[str, System],
    inputs: Collection[str],
) -> None:
    """Adds blocks, connects ports of equal names and exports the others.

    Each input port is connected to the output port of its name, or else to the
    diagram's input of its name; an optional one may stay open.  All outputs
    become outputs of the diagram.

    Args:
        builder: gets the blocks.
        blocks: the blocks by the names that they get.
        inputs: names that inputs of the diagram may have.

    Raises:
        ValueError: an input without a source, an output of two blocks, or
            ports of one name and different types; names block and port.
    """
    sources: dict[str, OutputPort] = {}
    for role, block in blocks.items():
        builder.AddNamedSystem(role, block)
        for output in map(
            block.get_output_port, range(block.num_output_ports())
        ):
            name = output.get_name()
            require(
                name not in sources,
                f"{role} = {type(block).__name__}: must not have the "
                f"output port {name!r}, another block has it",
            )
            sources[name] = output
            builder.ExportOutput(output, name)
    exported: set[str] = set()
    for role, block in blocks.items():
        for port in map(block.get_input_port, range(block.num_input_ports())):
            name = port.get_name()
            label = f"{role} = {type(block).__name__}: input port {name!r}"
            if name in sources:
                _check_kind(label, port, sources[name])
                try:
                    builder.Connect(sources[name], port)
                except RuntimeError as error:  # of abstract values
                    raise ValueError(f"{label}: {one_line(error)}") from None
            elif name in exported:
                builder.ConnectInput(name, port)
            elif name in inputs:
                builder.ExportInput(port, name)
                exported.add(name)
            elif name not in getattr(block, "open_inputs", ()):
                raise ValueError(
                    f"{label} must be one of "
                    f"{', '.join(sorted({*sources, *inputs}))}"
                )


def _check_kind(label: str, port: InputPort, source: OutputPort) -> None:
    kind, needed = _kind(port), _kind(source)
    if kind != needed:
        name = cast(System, source.get_system()).get_name()
        raise ValueError(
            f"{label} is {kind}, {name}'s output is {needed}: they must be "
            "alike"
        )


def _kind(port: InputPort | OutputPort) -> str:
    is_abstract = port.get_data_type() == PortDataType.kAbstractValued
    return "abstract" if is_abstract else f"a vector of {port.size()}"
