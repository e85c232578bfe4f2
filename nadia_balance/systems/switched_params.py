"""Parameters that can be switched while the simulation runs."""

from collections.abc import Callable
from dataclasses import fields
from typing import Generic, TypeVar

from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem, ValueProducer

from nadia_balance.core.mechanisms import Mechanisms
from nadia_balance.systems.ports import eval_finite

T = TypeVar("T")


class SwitchedParams(Generic[T]):
    """The parameters of a system, as its input `mechanisms` switches them.

    The input is the vector of `Mechanisms`, a number above 0.5 is on; not
    connected, the parameters stay as they are.  They are made anew, a cache
    entry, only when a switch changes.
    """

    def __init__(
        self,
        system: LeafSystem,
        params: T,
        switched: Callable[[T, Mechanisms], T],
    ):
        """Declares the input of `system`; `switched` is pure."""
        self._system, self._original = system, params
        self._switched = switched
        self._port = system.DeclareVectorInputPort(
            "mechanisms", len(fields(Mechanisms))
        )
        self._entry = system.DeclareCacheEntry(
            "switched params",
            ValueProducer(lambda: Value((None, params)), self._calc),
            {self._port.ticket()},
        )
        self.ticket = self._entry.ticket()

    def __call__(self, context: Context) -> T:
        """Returns the parameters as they are now; do not change them."""
        return self._entry.Eval(context)[1]

    def _calc(self, context, entry):
        on, params = None, self._original
        if self._port.HasValue(context):
            values = eval_finite(self._system, context, self._port)
            on = (values > 0.5).tolist()
            if on == entry.get_value()[0]:
                return
            params = self._switched(params, Mechanisms(*on))
        entry.set_value((on, params))
