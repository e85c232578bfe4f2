"""How tests ask a block: inputs and outputs by the names of their ports."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, PortDataType, System

from nadia_balance.systems.ports import NOTHING


def fix(system: System, context: Context, **inputs: object) -> None:
    """Fixes the inputs of these names."""
    for name, value in inputs.items():
        port = system.GetInputPort(name)
        if port.get_data_type() == PortDataType.kAbstractValued:
            value = Value(NOTHING if value is None else value)
        port.FixValue(context, value)


def asked(system: System, **inputs: object) -> Context:
    """A new context in which these inputs are fixed."""
    context = system.CreateDefaultContext()
    fix(system, context, **inputs)
    return context


def answer(system: System, context: Context, output: str):
    """The value of the output port of this name."""
    return system.GetOutputPort(output).Eval(context)


def running(system: System, **inputs: object) -> tuple[Simulator, Context]:
    """A simulator of `system` alone, before its first tick, and its context."""
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    fix(system, context, **inputs)
    return simulator, context


def told(system, period, inputs: list[dict], *outputs: str):
    """The values of each output (n, ...) in n ticks with their inputs."""
    simulator, context = running(system, **inputs[0])
    simulator.Initialize()
    rows = []
    for i, now in enumerate(inputs, start=1):
        fix(system, context, **now)
        rows.append([answer(system, context, name) for name in outputs])
        simulator.AdvanceTo(i * period)
    return [np.array(values) for values in zip(*rows, strict=True)]


def tick(simulator: Simulator, period: float) -> None:
    """Makes the update that is due, and goes to the next one."""
    simulator.AdvanceTo(simulator.get_context().get_time() + period)
