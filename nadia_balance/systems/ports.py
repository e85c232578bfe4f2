"""Ports that check what they get, and wiring by the names of signals.

All blocks of the controllers that have state update it in periodic unrestricted
events.  Drake computes all of those that are due from the state and the inputs
before any of them, so that in a tick every block sees the same: x+ = f(x-, u).
"""

import abc
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import (
    CacheEntry,
    Context,
    DependencyTicket,
    DiagramBuilder,
    EventStatus,
    InputPort,
    LeafSystem,
    OutputPort,
    PortDataType,
    System,
    ValueProducer,
)

from nadia_balance.core.mechanisms import MECHANISMS, Mechanisms

_REQUIRED = object()
_EARLY = 1e-6  # times of ticks differ by rounding [s]


def entries(first: int, last: int) -> property:
    """The entries `first` to `last` - 1 of a namedview, as one vector."""
    return property(lambda view: view[first:last])


def size(view: type) -> int:
    """The number of entries of a namedview."""
    return len(view.get_fields())


class Input(abc.ABC):
    """An input port that checks what it gets; called, it returns its value.

    If it has a `default`, then that is the value while it is not connected.
    """

    def __init__(self, system: LeafSystem, port: InputPort, default: object):
        self._system, self._port, self._default = system, port, default

    def ticket(self) -> DependencyTicket:
        """That of what depends on it."""
        return self._port.ticket()

    def __call__(self, context: Context) -> Any:
        """Its value in `context`."""
        # To ask HasValue first would evaluate the port twice.
        try:
            value = self._port.Eval(context)
        except (RuntimeError, ValueError):
            if self._default is _REQUIRED or self._port.HasValue(context):
                raise
            return self._default
        return self._checked(value)

    @abc.abstractmethod
    def _checked(self, value: Any) -> Any:
        """The value as it is handed out; raises if it is not as it must be."""

    def _message(self, what: str) -> str:
        name = self._system.get_name() or type(self._system).__name__
        return f"{name}: input port '{self._port.get_name()}' {what}"


class _Nothing:
    """Takes the place of None, which newer Drakes refuse as a value."""

    def __bool__(self) -> bool:
        return False

    def __deepcopy__(self, memo: object) -> "_Nothing":
        return self


NOTHING = _Nothing()


def _packed(value: object) -> object:
    return NOTHING if value is None else value


def _unpacked(value: object) -> Any:
    return None if value is NOTHING else value


class ValueInput(Input):
    """An abstract input port for Python values of one `kind`.

    All Python values are one C++ type, so that Drake connects any abstract
    output to any abstract input without a word.  Called, it raises TypeError
    for a value that is neither of this kind nor the `default`.
    """

    def __init__(
        self,
        system: LeafSystem,
        name: str,
        kind: type,
        default: object = _REQUIRED,
    ):
        """Declares the port."""
        port = system.DeclareAbstractInputPort(name, Value(NOTHING))
        super().__init__(system, port, default)
        self._kind = kind

    def _checked(self, value: Any) -> Any:
        value = _unpacked(value)
        if not isinstance(value, self._kind) and value is not self._default:
            got, needed = type(value).__name__, self._kind.__name__
            raise TypeError(self._message(f"got a {got}, needs a {needed}"))
        return value


class VectorInput(Input):
    """A vector input port; called, it raises RuntimeError unless all is finite.

    `shape` is its size, or the namedview that it returns.
    """

    def __init__(
        self,
        system: LeafSystem,
        name: str,
        shape: int | type,
        default: object = _REQUIRED,
    ):
        """Declares the port."""
        self._view = None if isinstance(shape, int) else shape
        length = shape if isinstance(shape, int) else size(shape)
        port = system.DeclareVectorInputPort(name, length)
        super().__init__(system, port, default)

    def _checked(self, value: np.ndarray) -> Any:
        # A sum of squares is finite only if all are, and the cheapest to ask;
        # of all ways to sum them up this is the fastest.
        if not math.isfinite(value.dot(value)):
            raise RuntimeError(self._message("is not finite"))
        return value if self._view is None else self._view(value)


class MechanismsInput(VectorInput):
    """The input port `mechanisms` (4,); all are on if it is not connected."""

    def __init__(self, system: LeafSystem):
        """Declares the port."""
        every = MECHANISMS["all_with_cross_over"]
        super().__init__(system, "mechanisms", 4, every)

    def _checked(self, value: np.ndarray) -> Mechanisms:
        return Mechanisms.from_vector(super()._checked(value))


def declare_cache(
    system: LeafSystem,
    name: str,
    calc: Callable[[Context, Any], object],
    needs: set[DependencyTicket],
    first: object = None,
) -> CacheEntry:
    """Declares a cache entry whose value is `calc(context, the last one)`.

    To return the last one may save work; it must not change the result.
    """
    return system.DeclareCacheEntry(
        name,
        ValueProducer(
            lambda: Value(_packed(first)),
            lambda context, cache: cache.set_value(
                _packed(calc(context, _unpacked(cache.get_value())))
            ),
        ),
        needs,
    )


def declare_output(
    system: LeafSystem,
    name: str,
    calc: Callable[[Context], object],
    needs: set[DependencyTicket],
) -> CacheEntry:
    """Declares an abstract output port for what `calc(context)` returns."""
    port = system.DeclareAbstractOutputPort(
        name,
        lambda: Value(NOTHING),
        lambda context, output: output.set_value(_packed(calc(context))),
        needs,
    )
    return port.cache_entry()


class Outcome:
    """What one tick comes to, as one vector: outputs, and all of the state.

    `calc(context, last)` returns it; `last` are the parts of the one before,
    by name.  The first parts are output ports, as many as `outputs` says.  If
    it `holds`, then the outputs are those of a tick until the next one is due.
    """

    def __init__(
        self,
        system: LeafSystem,
        parts: Mapping[str, int],
        outputs: int,
        calc: Callable[[Context, dict[str, np.ndarray]], np.ndarray],
        needs: set[DependencyTicket],
        period: float,
        holds: bool = False,
    ):
        """Declares all of it; `parts` are sizes by name, 0 before the start.

        It depends on `needs` and on the state, which it becomes in an update
        every `period` [s].
        """
        ends = itertools.accumulate(parts.values(), initial=0)
        slices = itertools.starmap(slice, itertools.pairwise(ends))
        self._parts = dict(zip(parts, slices, strict=True))
        # If it holds, in the end the time of the next tick [s]; 0 at the start.
        length = sum(parts.values()) + holds
        self._state = system.DeclareDiscreteState(length)
        self._period = period
        needs = needs | {system.discrete_state_ticket(self._state)}

        def tick(context, _):
            last = context.get_discrete_state(self._state).value()
            now = calc(context, self._split(last))
            return np.append(now, context.get_time() + period) if holds else now

        self._cache = declare_cache(system, "outcome", tick, needs)
        if holds:
            needs = needs | {system.time_ticket()}
        now = self._held if holds else self._cache.Eval
        for name in itertools.islice(parts, outputs):
            system.DeclareVectorOutputPort(
                name,
                parts[name],
                lambda context, output, part=self._parts[name]: (
                    output.set_value(now(context)[part])
                ),
                needs | {self._cache.ticket()},
            )

        def remember(context, new):
            outcome = self._cache.Eval(context)
            new.get_mutable_discrete_state(self._state).set_value(outcome)
            return EventStatus.Succeeded()

        system.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=period, offset_sec=0.0, update=remember
        )

    def _held(self, context: Context) -> np.ndarray:
        """The outcome of the tick that `context` is in."""
        last = context.get_discrete_state(self._state).value()
        left = last[-1] - context.get_time()
        if _EARLY < left <= self._period + _EARLY:
            return last
        return self._cache.Eval(context)

    def _split(self, vector: np.ndarray) -> dict[str, np.ndarray]:
        return {name: vector[part] for name, part in self._parts.items()}


def require_outputs(role: str, system: System, *names: str) -> None:
    """Checks that the block `system` can play its `role`.

    Raises:
        ValueError: it lacks an output port of these names, or is no System;
            names both.
    """
    if not isinstance(system, System):
        raise ValueError(f"{role} = {system!r}: must be a System, made already")
    for name in names:
        if not system.HasOutputPort(name):
            raise ValueError(
                f"{role} = {type(system).__name__}: must have the output port "
                f"{name!r}"
            )


def connect(
    builder: DiagramBuilder,
    source: System,
    sink: System,
    *names: str,
    **renamed: str,
) -> None:
    """Connects the ports of these names from `source` to `sink`.

    Where the names differ: `connect(..., name_at_source="name_at_sink")`.
    """
    for name, other in [*zip(names, names, strict=True), *renamed.items()]:
        builder.Connect(source.GetOutputPort(name), sink.GetInputPort(other))


def wire(
    builder: DiagramBuilder, blocks: Mapping[str, System], inputs: Iterable[str]
) -> None:
    """Adds `blocks` and connects all ports of one name; exports the rest.

    One signal has one name everywhere: every input port is fed by the output
    port of its name, or by the input of the diagram of that name, which must
    be one of `inputs`.  All outputs become outputs of the diagram.

    Raises:
        ValueError: an input that nobody feeds, an output that two blocks
            have, or two ports of one name that do not fit; names block and
            port.
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


def _check_fit(what: str, port: InputPort, source: OutputPort) -> None:
    """Raises ValueError if `source` and `port` carry other kinds of value."""
    found, needed = _kind(port), _kind(source)
    if found != needed:
        raise ValueError(
            f"{what}{port.get_name()!r} must be {needed}, as "
            f"{source.get_system().get_name()}'s output; it is {found}"
        )


def _kind(port: InputPort | OutputPort) -> str:
    if port.get_data_type() == PortDataType.kAbstractValued:
        return "abstract"
    return f"a vector of {port.size()}"
