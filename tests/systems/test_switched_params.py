"""Oracles: the function that switches; a count of how often it is asked."""

from dataclasses import dataclass, replace

import pytest
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.mechanisms import Mechanisms
from nadia_balance.systems.switched_params import SwitchedParams


@dataclass(kw_only=True)
class Params:
    gain: float = 3.0
    on: Mechanisms | None = None


PARAMS = Params(gain=2.0)


class Switched(LeafSystem):
    """Its output is 1 if it may step, 0 if not, -1 if nobody said."""

    def __init__(self):
        super().__init__()
        self.calls = []
        self.params = SwitchedParams(self, PARAMS, self._switched)
        self.DeclareVectorOutputPort(
            "steps", 1, self._calc, prerequisites_of_calc={self.params.ticket}
        )

    def _switched(self, params, on):
        self.calls.append(on)
        return replace(params, on=on)

    def _calc(self, context, output):
        on = self.params(context).on
        output[0] = -1.0 if on is None else float(on.step)


@pytest.fixture
def system():
    return Switched()


def fix(system, context, *values):
    system.GetInputPort("mechanisms").FixValue(context, values)


def test_unconnected_the_params_are_the_original_ones(system):
    """Oracle: identity."""
    context = system.CreateDefaultContext()
    assert system.params(context) is PARAMS
    assert system.get_output_port().Eval(context) == [-1.0]
    assert system.calls == []


@pytest.mark.parametrize("bits", range(16))
def test_connected_they_are_switched(system, bits):
    """Oracle: the bits; what is above one half is on."""
    on = [bool(bits >> i & 1) for i in range(4)]
    context = system.CreateDefaultContext()
    fix(system, context, *(0.51 if x else 0.49 for x in on))
    assert system.params(context) == Params(gain=2.0, on=Mechanisms(*on))
    assert all(
        type(x) is bool for x in vars(system.params(context).on).values()
    )


def test_they_are_made_anew_only_when_a_switch_changes(system):
    """Oracle: the count; Drake says that the port changed each time."""
    context = system.CreateDefaultContext()
    fix(system, context, 1, 0, 0, 0)
    first = system.params(context)
    for _ in range(3):
        fix(system, context, 1, 0, 0, 0)
        assert system.params(context) is first
    assert len(system.calls) == 1
    fix(system, context, 1, 0, 0, 1)
    assert system.params(context).on == Mechanisms(step=True, cross_over=True)
    fix(system, context, 1, 0, 0, 0)
    assert system.params(context) == first
    assert len(system.calls) == 3


def test_what_depends_on_them_follows(system):
    """Oracle: the switch, through the output that asks for the ticket."""
    context = system.CreateDefaultContext()
    port = system.get_output_port()
    for on in 1.0, 0.0, 1.0:
        fix(system, context, on, 0, 0, 0)
        assert port.Eval(context) == [on]


def test_contexts_do_not_share_them(system):
    """Oracle: each context's own switches."""
    contexts = [system.CreateDefaultContext()]
    fix(system, contexts[0], 1, 1, 1, 1)
    system.params(contexts[0])
    contexts += [contexts[0].Clone(), system.CreateDefaultContext()]
    fix(system, contexts[1], 0, 0, 0, 0)
    steps = [system.get_output_port().Eval(c)[0] for c in contexts]
    assert steps == [1.0, 0.0, -1.0]
