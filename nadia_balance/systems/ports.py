"""Ports that check their values, and what a block computes in a tick.

SIGNALS has types and units of all ports.  A port that is not finite, or of
another type, raises an error as soon as the block reads it; a block whose
parameters are out of range is not made (ValueError).  A `period` is in [s].

Controller blocks update their state in periodic unrestricted events.  Drake
computes all events that are due from the state and the inputs before any of
them, so that all blocks see the same state in a tick: x+ = f(x-, u).  The
walking state is a Python value, which only an unrestricted event can change.
Drake makes discrete updates after all unrestricted ones: they would see the new
walking state.  Only StatePredictor, which does not read it, has such an update.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar, cast

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import (
    CacheEntry,
    Context,
    DependencyTicket,
    LeafSystem,
    State,
    System,
    ValueProducer,
)

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import ContactSchedule, WalkingState
from nadia_balance.parameters.bounds import check_number
from nadia_balance.systems.signals import SIGNALS, is_vector, size

TICK_TOLERANCE = 1e-6  # times of ticks differ by rounding [s]
_REQUIRED = object()
Plan = TypeVar("Plan")


@functools.lru_cache(maxsize=64)
def _switches(values: bytes) -> Mechanisms:
    return Mechanisms.from_vector(np.frombuffer(values))


_VIEWS = {"mechanisms": lambda vector: _switches(vector.tobytes())}


class _Nothing:
    """Replaces None, which newer Drake versions refuse as a value."""

    def __bool__(self) -> bool:
        return False

    def __deepcopy__(self, memo: object) -> "_Nothing":
        return self


#: The value of a signal that has none.
NOTHING = _Nothing()


class Block(LeafSystem):
    """A LeafSystem of Drake without witness functions: a base of our blocks."""

    # In every step a Simulator asks each block written in Python whether it has
    # this method.  Where there is none, pybind11 asks again in the next step,
    # and formats an AttributeError each time, 1.2 us; where it finds a method
    # of C++, whichever, it never asks again.  None is ever called.
    DoGetWitnessFunctions = LeafSystem.AllocateContext


class Input:
    """An input port that checks its value; a call returns the value."""

    def __init__(
        self,
        system: LeafSystem,
        name: str,
        kind: int | type,
        default: object = _REQUIRED,
        view: Callable[[Array], Any] | None = None,
    ) -> None:
        """Declares the port.

        Args:
            system: block that gets the port.
            name: name of the port.
            kind: size of a vector, the namedview that a call returns, or the
                type of a Python value.
            default: value while the port is not connected; without one, it
                must be.
            view: what a call makes of a vector, by default nothing.
        """
        self._system = system
        self._default = default
        self._kind: Any = kind
        self._view = view if isinstance(kind, int) else kind
        self._is_vector = is_vector(kind)
        if default is not _REQUIRED:
            owner: Any = system
            owner.open_inputs = {*getattr(system, "open_inputs", ()), name}
        if self._is_vector:
            self._port = system.DeclareVectorInputPort(name, size(kind))
        else:
            self._port = system.DeclareAbstractInputPort(name, Value(NOTHING))

    def ticket(self) -> DependencyTicket:
        """The port's ticket, for whatever depends on the port.

        Returns:
            The ticket of Drake's input port.
        """
        return self._port.ticket()

    def __call__(self, context: Context) -> Any:
        """The port's value.

        Args:
            context: that of the block.

        Returns:
            The vector, its view, or the Python value itself.

        Raises:
            RuntimeError: a vector is not finite.
            TypeError: a value is neither of its kind nor the default: Drake
                connects any abstract output to any abstract input.
        """
        # An error of Drake's, caught, would take a tenth of the whole tick.
        if self._default is not _REQUIRED and not self._port.HasValue(context):
            return self._default
        value: Any = self._port.Eval(context)
        if not self._is_vector:
            return value if isinstance(value, self._kind) else self._none(value)
        # The sum of squares is finite only if all entries are; `dot` is the
        # fastest way to compute it, but overflows from 1e154 on.
        if not (math.isfinite(value.dot(value)) or np.isfinite(value).all()):
            raise self.error(context, "is not finite")
        return value if self._view is None else self._view(value)

    def _none(self, value: Any) -> Any:
        """The default, if a value that is not of the kind means it."""
        value = None if value is NOTHING else value
        if value is not self._default:
            raise TypeError(
                self._message(
                    f"got a {type(value).__name__}, "
                    f"needs a {self._kind.__name__}"
                )
            )
        return value

    def error(self, context: Context, fault: str) -> RuntimeError:
        """The error that something is wrong with the port, and since when.

        Args:
            context: that of the block, at the time of the error.
            fault: what is wrong, such as "is not finite".

        Returns:
            The error, to be raised.
        """
        return RuntimeError(
            self._message(f"{fault} at {context.get_time():.3f} s")
        )

    def _message(self, fault: str) -> str:
        name = self._system.get_name() or type(self._system).__name__
        return f"{name}: input port '{self._port.get_name()}' {fault}"


# What a value depends on; None: all inputs of its block.
Needs = Iterable[Input | CacheEntry | DependencyTicket]


def input_port(
    system: LeafSystem, name: str, kind: int | type | None = None
) -> Input:
    """Declares an input port that must be connected.

    Args:
        system: block that gets the port.
        name: name of the signal and of its port.
        kind: see Input; by default that of SIGNALS.

    Returns:
        The port, which returns its value in a context: `port(context)`.
    """
    return Input(
        system,
        name,
        kind=SIGNALS[name] if kind is None else kind,
        view=_VIEWS.get(name),
    )


def optional_input(
    system: LeafSystem, name: str, default: object = None
) -> Input:
    """Declares an input port that may stay open.

    Args:
        system: block that gets the port.
        name: name of the signal, one of SIGNALS, and of its port.
        default: value while the port is not connected.

    Returns:
        The port, which returns its value in a context: `port(context)`.
    """
    return Input(
        system, name, kind=SIGNALS[name], default=default, view=_VIEWS.get(name)
    )


def _tickets(system: LeafSystem, needs: Needs | None) -> set[DependencyTicket]:
    if needs is None:
        return {system.all_input_ports_ticket()}
    return {
        need if isinstance(need, DependencyTicket) else need.ticket()
        for need in needs
    }


def declare_output(
    system: LeafSystem,
    name: str,
    calc: Callable[[Context], Any],
    needs: Needs | None = None,
) -> CacheEntry:
    """Declares an output port y = calc(context), one of SIGNALS.

    Args:
        system: block that gets the port.
        name: name of the signal and of its port.
        calc: returns the vector, or the Python value, which may be None.
        needs: what the value depends on, by default all inputs.

    Returns:
        The cache entry of the port.
    """
    kind = SIGNALS[name]
    tickets = _tickets(system, needs)

    def write(context: Any, output: Any) -> None:
        value = calc(context)
        output.set_value(NOTHING if value is None else value)

    if is_vector(kind):
        port: Any = system.DeclareVectorOutputPort(
            name,
            size(kind),
            lambda context, output: output.SetFromVector(calc(context)),
            tickets,
        )
    else:
        port = system.DeclareAbstractOutputPort(
            name, lambda: Value(NOTHING), write, tickets
        )
    return cast(CacheEntry, port.cache_entry())


def declare_cache(
    system: LeafSystem,
    name: str,
    calc: Callable[[Context, Any], object],
    needs: Needs | None = None,
) -> CacheEntry:
    """Declares a cache entry z = calc(context, last z).

    Reuse of the last value may save work, but must not change the result; the
    first calculation has NOTHING as last value.

    Args:
        system: block that gets the entry.
        name: name of the entry.
        calc: returns the value; None is kept as NOTHING, which is false, too.
        needs: what the value depends on, by default all inputs.

    Returns:
        The cache entry.
    """

    def update(context: Any, cache: Any) -> None:
        value = calc(context, cache.get_value())
        cache.set_value(NOTHING if value is None else value)

    return system.DeclareCacheEntry(
        name,
        ValueProducer(lambda: Value(NOTHING), update),
        _tickets(system, needs),
    )


def declare_scratch(system: LeafSystem, other: System) -> CacheEntry:
    """Declares a Context of another system, to compute in.

    Args:
        system: block that gets it.
        other: a plant, or the diagram that has it.

    Returns:
        The cache entry with the Context.
    """
    return system.DeclareCacheEntry(
        "scratch",
        ValueProducer(
            lambda: Value(other.CreateDefaultContext()),
            ValueProducer.NoopCalc,  # type: ignore[arg-type]
        ),
        {system.nothing_ticket()},
    )


def once_per_schedule(
    calc: Callable[[WalkingState], Plan],
) -> Callable[[WalkingState], Plan]:
    """A plan that is computed once for each ContactSchedule.

    The plan is constant while the schedule lasts, which is many ticks: the
    function keeps the last one, with the schedule as its key.

    Args:
        calc: returns the plan, which depends on the state's schedule alone.

    Returns:
        The function that returns the plan of a walking state.
    """
    last: tuple[ContactSchedule | None, Any] = (None, None)

    def plan(state: WalkingState) -> Plan:
        nonlocal last
        # A schedule is never changed, and comparing its values would be slow.
        schedule, planned = last
        if state.schedule is not schedule:
            planned = calc(state)
            last = (state.schedule, planned)
        return cast(Plan, planned)

    return plan


def check_period(period: float) -> None:
    """Checks a period before a block computes with it.

    Args:
        period: time between two ticks [s].

    Raises:
        ValueError: it is no number > 0.
    """
    check_number("period", period, above=0.0, unit="s")


def declare_update(
    system: LeafSystem, period: float, update: Callable[[Context, State], None]
) -> None:
    """Declares the unrestricted update of a tick, from time 0 on.

    Args:
        system: block that gets the update.
        period: time between two ticks [s].
        update: writes the new State.

    Raises:
        ValueError: see check_period.
    """
    check_period(period)
    system.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, update)


def declare_outcome(
    system: LeafSystem,
    outputs: Mapping[str, int],
    memory: Mapping[str, int],
    calc: Callable[[Context, dict[str, Any]], tuple[Any, ...]],
    period: float,
    needs: Needs | None = None,
    holds: bool = False,
) -> None:
    """x+ = f(x-, u): declares the outputs of a tick, and all of the state.

    x (n,) is outputs and memory, one behind the other, n the sum of their
    sizes; with `holds` the state has the time of the next tick [s] behind it.
    Each output port has its part of x+.  An update in every period makes x+
    the discrete state x- of the next tick; at the start x- is 0.

    Args:
        system: block that gets the state, its update and the output ports.
        outputs: size of each output port by its name.
        memory: size of each part of the state that is no output, by name.
        calc: f: returns the parts of x+ in the order of outputs and memory;
            its second argument has those of x-, by name.
        period: time between two ticks [s].
        needs: what u is, by default all inputs.
        holds: whether the outputs keep their values of a tick, whatever the
            inputs are then, until the next tick is due.
    """
    sizes = {**outputs, **memory}
    ends = dict(zip(sizes, itertools.accumulate(sizes.values()), strict=True))
    parts = {name: slice(end - sizes[name], end) for name, end in ends.items()}
    state: Any = system.DeclareDiscreteState(sum(sizes.values()) + holds)
    tickets = _tickets(system, needs)
    tickets.add(system.discrete_state_ticket(state))

    def tick(context: Context, _: Any) -> Array:
        last: Any = context.get_discrete_state(state).value()
        values = {name: last[part] for name, part in parts.items()}
        following = list(calc(context, values))
        if holds:
            following.append((context.get_time() + period,))
        return np.concatenate(following)

    outcome: Any = declare_cache(system, "outcome", tick, needs=tickets)

    def held(context: Context) -> Any:
        last = context.get_discrete_state(state).value()
        left = last[-1] - context.get_time()
        if TICK_TOLERANCE < left <= period + TICK_TOLERANCE:
            return last
        return outcome.Eval(context)

    def remember(context: Context, new: State) -> None:
        new.get_mutable_discrete_state(state).set_value(outcome.Eval(context))

    if holds:
        tickets.add(system.time_ticket())
    tickets.add(outcome.ticket())
    now = held if holds else outcome.Eval
    for name, length in outputs.items():
        system.DeclareVectorOutputPort(
            name,
            length,
            lambda context, output, part=parts[name]: output.set_value(  # type: ignore[misc]
                now(context)[part]
            ),
            tickets,
        )
    declare_update(system, period, remember)
