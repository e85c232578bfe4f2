"""Ports that check their values, and what a block computes in a tick.

A port that is not finite, or of another type than its block needs, raises an
error as soon as the block reads it; a block whose parameters are out of range
is not made (ValueError).  The `period` of a block is in [s].

Controller blocks update their state in periodic unrestricted events.  Drake
computes all events that are due from the state and the inputs before any of
them, so that all blocks see the same state in a tick: x+ = f(x-, u).
"""

import abc
import itertools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems import framework
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.walking.mechanisms import MECHANISMS, Mechanisms
from nadia_balance.core.walking.vocabulary import WalkingState
from nadia_balance.systems.signals import size

_REQUIRED = object()
_EARLY = 1e-6  # times of ticks differ by rounding [s]


class Input(abc.ABC):
    """An input port that checks its value; a call returns the value.

    The `default`, if given, is the value while the port is not connected.
    """

    def __init__(
        self, system: LeafSystem, port: framework.InputPort, default: object
    ):
        self._system, self._port, self._default = system, port, default

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
        return self._checked(value)

    @abc.abstractmethod
    def _checked(self, value: Any) -> Any:
        """Returns the value to the caller; raises if it is invalid."""

    def _message(self, what: str) -> str:
        name = self._system.get_name() or type(self._system).__name__
        return f"{name}: input port '{self._port.get_name()}' {what}"


class _Nothing:
    """Replaces None, which newer Drake versions refuse as a value."""

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

    All Python values have the same C++ type, so Drake connects any abstract
    output to any abstract input.  A call raises TypeError for a value that is
    neither of this kind nor the `default`.
    """

    def __init__(
        self,
        system: LeafSystem,
        name: str,
        kind: type,
        default: object = _REQUIRED,
    ):
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
    """A vector input port; a call raises RuntimeError for non-finite values.

    `shape` is the port's size, or the namedview that a call returns.
    """

    def __init__(
        self,
        system: LeafSystem,
        name: str,
        shape: int | type,
        default: object = _REQUIRED,
    ):
        self._view = None if isinstance(shape, int) else shape
        length = shape if isinstance(shape, int) else size(shape)
        port = system.DeclareVectorInputPort(name, length)
        super().__init__(system, port, default)

    def _checked(self, value: np.ndarray) -> Any:
        # The sum of squares is finite only if all entries are; `dot` is the
        # fastest way to compute it.
        if not math.isfinite(value.dot(value)):
            raise RuntimeError(self._message("is not finite"))
        return value if self._view is None else self._view(value)


class MechanismsInput(VectorInput):
    """The input port `mechanisms` (4,); all are on if it is not connected."""

    def __init__(self, system: LeafSystem):
        every = MECHANISMS["all_with_cross_over"]
        super().__init__(system, "mechanisms", 4, every)

    def _checked(self, value: np.ndarray) -> Mechanisms:
        return Mechanisms.from_vector(super()._checked(value))


def declare_cache(
    system: LeafSystem,
    name: str,
    calc: Callable[[framework.Context, Any], object],
    needs: set[framework.DependencyTicket],
    first: object = (),
) -> framework.CacheEntry:
    """Declares a cache entry whose value is `calc(context, last value)`.

    Reuse of the last value, initially `first`, may save work, but must not
    change the result, which is not None.
    """
    return system.DeclareCacheEntry(
        name,
        framework.ValueProducer(
            lambda: Value(first),
            lambda context, cache: cache.set_value(
                calc(context, cache.get_value())
            ),
        ),
        needs,
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
    walking_state: ValueInput,
    calc: Callable[[WalkingState], object],
) -> framework.CacheEntry:
    """Declares a cache entry (schedule, plan), with plan = `calc(state)`.

    The plan is computed once for each ContactSchedule.
    """

    def planned(context, last):
        state = walking_state(context)
        if state.schedule is last[0]:
            return last
        return state.schedule, calc(state)

    needs = {walking_state.ticket()}
    return declare_cache(system, "plan", planned, needs, (None, None))


def declare_output(
    system: LeafSystem,
    name: str,
    calc: Callable[[framework.Context], object],
    needs: set[framework.DependencyTicket],
) -> framework.CacheEntry:
    """Declares an abstract output port for what `calc(context)` returns."""
    port = system.DeclareAbstractOutputPort(
        name,
        lambda: Value(NOTHING),
        lambda context, output: output.set_value(_packed(calc(context))),
        needs,
    )
    return port.cache_entry()


class Outcome:
    """The result of one tick as one vector: the outputs and all of the state.

    `calc(context, last)` returns it; `last` are the parts of the previous
    result by name.  The first `outputs` parts are output ports.  If it `holds`,
    the outputs keep their values of a tick until the next one is due.
    """

    def __init__(
        self,
        system: LeafSystem,
        parts: Mapping[str, int],
        outputs: int,
        calc: Callable[[framework.Context, dict[str, np.ndarray]], np.ndarray],
        needs: set[framework.DependencyTicket],
        period: float,
        holds: bool = False,
    ):
        """Declares state, cache, ports and update; `parts` are sizes by name.

        The result depends on `needs` and on the state (0 at the start), and
        becomes the state in an update every `period` [s].
        """
        ends = itertools.accumulate(parts.values(), initial=0)
        slices = itertools.starmap(slice, itertools.pairwise(ends))
        self._parts = dict(zip(parts, slices, strict=True))
        # With `holds`, the last entry is the time of the next tick [s].
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
            return framework.EventStatus.Succeeded()

        system.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, remember)

    def _held(self, context: framework.Context) -> np.ndarray:
        """The result of the tick of the time in `context`."""
        last = context.get_discrete_state(self._state).value()
        left = last[-1] - context.get_time()
        if _EARLY < left <= self._period + _EARLY:
            return last
        return self._cache.Eval(context)

    def _split(self, vector: np.ndarray) -> dict[str, np.ndarray]:
        return {name: vector[part] for name, part in self._parts.items()}
