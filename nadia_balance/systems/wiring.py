"""Wiring of blocks by the names of their signals."""

from collections.abc import Callable, Iterable, Mapping
from itertools import filterfalse

from pydrake.systems import framework


def fill(
    makers: Mapping[str, Callable[[], framework.System]],
    outputs: Mapping[str, str],
    blocks: Mapping[str, framework.System | None],
    others: Iterable[str] = (),
) -> dict[str, framework.System]:
    """Returns a system for each role: that in `blocks`, or of its maker.

    None in `blocks` leaves the role empty.  `outputs` are the names of the
    ports that a role must have; `others` are roles elsewhere, for the message.

    Raises ValueError: `blocks` has an unknown role, no System, or a system that
    lacks an output of its role.
    """
    for role, block in blocks.items():
        if role not in makers:
            known = ", ".join((*makers, *others))
            raise ValueError(f"block = {role!r}: must be one of {known}")
        if block is None:
            continue
        if not isinstance(block, framework.System):
            raise ValueError(
                f"{role} = {block!r}: must be a System, made already"
            )
        for name in filterfalse(block.HasOutputPort, outputs[role].split()):
            raise ValueError(
                f"{role} = {type(block).__name__}: must have the output port "
                f"{name!r}"
            )
    given = blocks | {
        role: makers[role]() for role in makers if role not in blocks
    }
    return {role: given[role] for role in makers if given[role] is not None}


def connect(
    builder: framework.DiagramBuilder,
    source: framework.System,
    sink: framework.System,
    *names: str,
    **renamed: str,
) -> None:
    """Connects the ports of these names from `source` to `sink`.

    Ports of different names: `connect(..., name_at_source="name_at_sink")`.
    """
    for name, other in [*zip(names, names, strict=True), *renamed.items()]:
        builder.Connect(source.GetOutputPort(name), sink.GetInputPort(other))


def wire(
    builder: framework.DiagramBuilder,
    blocks: Mapping[str, framework.System],
    inputs: Iterable[str],
) -> None:
    """Adds `blocks`, connects ports of equal names and exports the others.

    A signal has the same name everywhere: each input port is connected to the
    output port of its name, or to the diagram's input of that name, which must
    be one of `inputs`.  All outputs become outputs of the diagram.

    Raises ValueError: an input without a source, an output of two blocks, or
    ports of one name and different types; names block and port.
    """
    sources = {}
    for role, block in blocks.items():
        builder.AddNamedSystem(role, block)
        for port in map(block.get_output_port, range(block.num_output_ports())):
            if (name := port.get_name()) in sources:
                raise ValueError(
                    f"{role} = {type(block).__name__}: must not have the "
                    f"output port {name!r}, another block has it"
                )
            sources[name] = port
            builder.ExportOutput(port, name)
    exported = set()
    for role, block in blocks.items():
        for port in map(block.get_input_port, range(block.num_input_ports())):
            what = f"{role} = {type(block).__name__}: input port "
            if (name := port.get_name()) in sources:
                _check_fit(what, port, sources[name])
                builder.Connect(sources[name], port)
            elif name not in inputs:
                raise ValueError(
                    f"{what}{name!r} must be one of "
                    f"{', '.join(sorted({*sources, *inputs}))}"
                )
            elif name in exported:
                builder.ConnectInput(name, port)
            else:
                builder.ExportInput(port, name)
                exported.add(name)


def _check_fit(
    what: str, port: framework.InputPort, source: framework.OutputPort
) -> None:
    """Raises ValueError if `source` and `port` differ in type or size."""
    found, needed = _kind(port), _kind(source)
    if found != needed:
        raise ValueError(
            f"{what}{port.get_name()!r} must be {needed}, as "
            f"{source.get_system().get_name()}'s output; it is {found}"
        )


def _kind(port: framework.InputPort | framework.OutputPort) -> str:
    if port.get_data_type() == framework.PortDataType.kAbstractValued:
        return "abstract"
    return f"a vector of {port.size()}"
