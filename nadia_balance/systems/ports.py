"""Ports that check their values, and what a block computes in a tick.

SIGNALS has types and units of all ports.  A port that is not finite, or of
another type, raises an error as soon as the block reads it; a block whose
parameters are out of range is not made (ValueError).  A `period` is in [s].

Controller blocks update their state in periodic unrestricted events.  Drake
computes all events that are due from the state and the inputs before any of
them, so that all blocks see the same state in a tick: x+ = f(x-, u).
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems import framework
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.mechanisms import MECHANISMS, Mechanisms
from nadia_balance.systems.signals import SIGNALS, is_vector, size

_REQUIRED = object()
_EARLY = 1e-6  # times of ticks differ by rounding [s]


class _Nothing:
    """Replaces None, which newer Drake versions refuse as a value."""

    def __bool__(self) -> bool:
        return False

    def __deepcopy__(self, memo: object) -> "_Nothing":
        return self


NOTHING = _Nothing()


class Input:
    """An input port that checks its value; a call returns the value.

    `kind` is the size of a vector, the namedview that a call returns, or the
    type of a Python value.  Not connected, the value is the `default`, if
    given.  A call raises RuntimeError for a vector that is not finite, and
    TypeError for a value that is neither of its kind nor the `default`: Drake
    connects any abstract output to any abstract input.
    """

    def __init__(
        self,
        system: LeafSystem,
        name: str,
        kind: int | type,
        default: object = _REQUIRED,
        view: Callable[[np.ndarray], Any] | None = None,
    ):
        """Declares it; a call returns the `view` of a vector, if given."""
        self._system, self._kind, self._default = system, kind, default
        self._view = view
        if is_vector(kind):
            self._checked = self._vector
            self._port = system.DeclareVectorInputPort(name, size(kind))
            if not isinstance(kind, int):
                self._view = kind
        else:
            self._checked = self._value
            self._port = system.DeclareAbstractInputPort(name, Value(NOTHING))

    def ticket(self) -> framework.DependencyTicket:
        """The port's ticket, for whatever depends on the port."""
        return self._port.ticket()

    def __call__(self, context: framework.Context) -> Any:
        """The port's value in `context`."""
        # Calling HasValue first would evaluate the port twice.
        try:
            value = self._port.Eval(context)
        except (RuntimeError, ValueError):
            if self._default is _REQUIRED or self._port.HasValue(context):
                raise
            return self._default
        return self._checked(value, context)

    def _value(self, value: Any, _: framework.Context) -> Any:
        value = None if value is NOTHING else value
        if not isinstance(value, self._kind) and value is not self._default:
            got, needed = type(value).__name__, self._kind.__name__
            raise TypeError(self._message(f"got a {got}, needs a {needed}"))
        return value

    def _vector(self, value: np.ndarray, context: framework.Context) -> Any:
        # The sum of squares is finite only if all entries are; `dot` is the
        # fastest way to compute it.
        if not math.isfinite(value.dot(value)):
            raise self.error(context, "is not finite")
        return value if self._view is None else self._view(value)

    def error(self, context: framework.Context, what: str) -> RuntimeError:
        """The error that `what` is wrong with the port, and since when."""
        at = f"at {context.get_time():.3f} s"
        return RuntimeError(self._message(f"{what} {at}"))

    def _message(self, what: str) -> str:
        name = self._system.get_name() or type(self._system).__name__
        return f"{name}: input port '{self._port.get_name()}' {what}"


# What a signal is for a block that is not connected to it.
_DEFAULTS = {
    "mechanisms": MECHANISMS["all_with_cross_over"],
    "time_adjustment": (0.0, 0.0),
    "velocity_command": np.zeros(3),
}
_VIEWS = {"mechanisms": Mechanisms.from_vector}
# What a value depends on; None: all inputs of its block.
Needs = Iterable[Input | framework.CacheEntry | framework.DependencyTicket]


def inputs(system: LeafSystem, *names: str) -> list[Input]:
    """Declares input ports for the SIGNALS of these names, in their order.

    A string may have several; `name?` is None while it is not connected.
    """
    found = []
    for name in " ".join(names).split():
        name, maybe, _ = name.partition("?")
        default = None if maybe else _DEFAULTS.get(name, _REQUIRED)
        port = Input(system, name, SIGNALS[name], default, _VIEWS.get(name))
        found.append(port)
    return found


def _tickets(
    system: LeafSystem, needs: Needs | None
) -> set[framework.DependencyTicket]:
    if needs is None:
        return {system.all_input_ports_ticket()}
    return {
        need if isinstance(need, framework.DependencyTicket) else need.ticket()
        for need in needs
    }


def declare_output(
    system: LeafSystem,
    name: str,
    calc: Callable[[framework.Context], Any],
    needs: Needs | None = None,
) -> framework.CacheEntry:
    """Declares an output port for what `calc(context)` returns, one of SIGNALS.

    It depends on `needs`, by default on all inputs.
    """
    kind, tickets = SIGNALS[name], _tickets(system, needs)
    if is_vector(kind):
        port = system.DeclareVectorOutputPort(
            name,
            size(kind),
            lambda context, output: output.SetFromVector(calc(context)),
            tickets,
        )
        return port.cache_entry()

    def fill(context, output):
        value = calc(context)
        output.set_value(NOTHING if value is None else value)

    port = system.DeclareAbstractOutputPort(
        name, lambda: Value(NOTHING), fill, tickets
    )
    return port.cache_entry()


def declare_cache(
    system: LeafSystem,
    name: str,
    calc: Callable[[framework.Context, Any], object],
    needs: Needs | None = None,
    first: object = (),
) -> framework.CacheEntry:
    """Declares a cache entry whose value is `calc(context, last value)`.

    It depends on `needs` as declare_output does.  Reuse of the last value,
    initially `first`, may save work, but must not change the result.
    """
    return system.DeclareCacheEntry(
        name,
        framework.ValueProducer(
            lambda: Value(first),
            lambda context, own: own.set_value(calc(context, own.get_value())),
        ),
        _tickets(system, needs),
    )


def declare_scratch(
    system: LeafSystem, other: framework.System
) -> framework.CacheEntry:
    """Declares a Context of `other`, a plant or its diagram, to compute in."""
    return system.DeclareCacheEntry(
        "scratch",
        framework.ValueProducer(
            lambda: Value(other.CreateDefaultContext()),
            framework.ValueProducer.NoopCalc,
        ),
        {system.nothing_ticket()},
    )


def declare_plan(
    system: LeafSystem,
    walking_state: Input,
    calc: Callable[[walking.WalkingState], object],
) -> framework.CacheEntry:
    """Declares a cache entry (schedule, plan), with plan = `calc(state)`.

    The plan is computed once for each ContactSchedule.
    """

    def planned(context, last):
        state = walking_state(context)
        if state.schedule is last[0]:
            return last
        return state.schedule, calc(state)

    return declare_cache(system, "plan", planned, [walking_state], (None, None))


class Outcome:
    """The result of one tick as one vector: the outputs and all of the state.

    `calc(context, last)` returns its parts in their order; `last` are those of
    the previous result by name.  If it `holds`, the outputs keep their values
    of a tick until the next one is due.
    """

    def __init__(
        self,
        system: LeafSystem,
        outputs: Mapping[str, int],
        memory: Mapping[str, int],
        calc: Callable[[framework.Context, dict[str, np.ndarray]], tuple],
        period: float,
        needs: Needs | None = None,
        holds: bool = False,
    ):
        """Declares state, cache, ports and update.

        `outputs` and `memory` are sizes by name.  The result depends on `needs`
        (see declare_output) and on the state (0 at the start), and becomes the
        state in an update every `period` [s].
        """
        sizes = {**outputs, **memory}
        ends = itertools.accumulate(sizes.values(), initial=0)
        slices = itertools.starmap(slice, itertools.pairwise(ends))
        self._parts = dict(zip(sizes, slices, strict=True))
        # With `holds`, the last entry is the time of the next tick [s].
        length = sum(sizes.values()) + holds
        self._state = system.DeclareDiscreteState(length)
        self._period = period
        tickets = _tickets(system, needs)
        tickets.add(system.discrete_state_ticket(self._state))

        def tick(context, _):
            last = context.get_discrete_state(self._state).value()
            named = {name: last[part] for name, part in self._parts.items()}
            parts = calc(context, named)
            if holds:
                parts = (*parts, (context.get_time() + period,))
            return np.concatenate(parts)

        self._cache = declare_cache(system, "outcome", tick, tickets)
        if holds:
            tickets.add(system.time_ticket())
        now = self._held if holds else self._cache.Eval
        tickets.add(self._cache.ticket())
        for name, length in outputs.items():
            system.DeclareVectorOutputPort(
                name,
                length,
                lambda context, output, part=self._parts[name]: (
                    output.set_value(now(context)[part])
                ),
                tickets,
            )

        def remember(context, new):
            outcome = self._cache.Eval(context)
            new.get_mutable_discrete_state(self._state).set_value(outcome)
            return framework.EventStatus.Succeeded()

        system.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, remember)

    def _held(self, context: framework.Context) -> np.ndarray:
        """The result of the tick of the time in `context`."""
        last = context.get_discrete_state(self._state).value()
        left = last[-1] - context.get_time()
        if _EARLY < left <= self._period + _EARLY:
            return last
        return self._cache.Eval(context)
