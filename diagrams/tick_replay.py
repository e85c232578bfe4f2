"""Ticks of a controller, replayed from inputs that were recorded.

A controller that gets the inputs of a run, tick by tick, repeats the run to the
last bit, without the plant: what it computes in a tick can be measured alone,
and as often as need be.
"""

import copy
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, System

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Phase
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.diagrams.simulation import start
from nadia_balance.systems.signals import PHASES, WalkingSignal, read


@dataclass(frozen=True)
class Ticks:
    """What a controller got in n ticks, and what it made of it.

    Args:
        period: time between two ticks [s].
        inputs: values of its input ports in each tick, by name.
        actuation: torques (n, nu) [N m].
        walking_signal: before the update of each tick (n, 17).
        pushed: whether a push acts, or has acted before (n,).
    """

    period: float
    inputs: list[dict[str, Any]]
    actuation: Array
    walking_signal: Array
    pushed: Any

    @property
    def walks(self) -> Any:
        """True for the ticks of walking: not those of standing (n,)."""
        return self.walking_signal[:, 0] != PHASES.index(Phase.STANDING)

    @property
    def moves(self) -> Any:
        """True for the ticks that move the foothold of a swing (n,)."""
        now = WalkingSignal(self.walking_signal.T)
        swings = now.phase == PHASES.index(Phase.SWING)
        same = swings[1:] & swings[:-1]
        same &= np.diff(now.steps_taken) == 0.0
        moved = (np.diff(now.target, axis=1) != 0.0).any(axis=0)
        return np.append(same & moved, False)


def record_push(scenario: Scenario, after: float) -> Ticks:
    """Simulates a scenario, and records its controller's ticks.

    Args:
        scenario: of the closed loop, with a push.
        after: time from the begin of the push to the end [s].

    Returns:
        The ticks, from the first one on.
    """
    diagram = HumanoidDiagram(scenario)
    simulator = start(diagram)
    root = simulator.get_mutable_context()
    controller = diagram.controller
    context = controller.GetMyContextFromRoot(root)
    period = scenario.controller.control_period
    inputs: list[dict[str, Any]] = []
    is_pushed, left = False, round(after / period)
    while left > 0 and len(inputs) * period < scenario.duration:
        if inputs:  # AdvanceTo(0.0) would update
            simulator.AdvanceTo(len(inputs) * period)
        inputs.append(_read_inputs(controller, context))
        signal = read(diagram.push.GetOutputPort("push_signal"), root)
        is_pushed = is_pushed or signal[0] > 0.0
        left -= is_pushed
    simulator.AdvanceTo(len(inputs) * period)
    logs = diagram.read_logs(root)
    rows = slice(len(inputs))
    return Ticks(
        period,
        inputs,
        actuation=logs["actuation"][rows],
        walking_signal=logs["walking_signal"][rows],
        pushed=np.maximum.accumulate(logs["push_signal"][rows, 0] > 0.0),
    )


def _read_inputs(controller: System, context: Context) -> dict[str, Any]:
    """The values of its ports, in its context, without those left open."""
    ports: list[Any] = [
        controller.get_input_port(i)
        for i in range(controller.num_input_ports())
    ]
    return {
        port.get_name(): copy.copy(port.Eval(context))
        for port in ports
        if port.HasValue(context)
    }


def replay(controller: System, ticks: Ticks) -> tuple[Array, Array]:
    """Lets a controller compute recorded ticks.

    Args:
        controller: one that was not simulated yet.
        ticks: inputs of its ticks.

    Returns:
        The processor time of each tick (n,) [s], and its torques (n, nu) [N m].
    """
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    output: Any = controller.GetOutputPort("actuation")
    times = np.empty(len(ticks.inputs))
    torques = np.empty_like(ticks.actuation)
    for i, values in enumerate(ticks.inputs):
        for name, value in values.items():
            controller.GetInputPort(name).FixValue(context, value)
        if i == 0:
            simulator.Initialize()  # makes the first tick's update pending
        begin = time.thread_time()
        torques[i] = output.Eval(context)
        simulator.AdvancePendingEvents()
        times[i] = time.thread_time() - begin
        simulator.AdvanceTo((i + 1) * ticks.period)
    return times, torques
