"""How long a tick of the controller takes, block by block."""

import time

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, System

from diagrams.humanoid import HumanoidDiagram
from nadia_balance.core.whole_body_command import whole_body_command
from nadia_balance.core.whole_body_qp import WholeBodyQp
from nadia_balance.core.whole_body_tasks import GRAVITY
from nadia_balance.systems.whole_body_inverse_dynamics import (
    WholeBodyInverseDynamics,
)
from nadia_balance.systems.whole_body_kinematics import (
    WholeBodyKinematics,
    whole_body_model,
)


def block_times(loop: Simulator, ticks: int = 500) -> dict:
    """Times of the controller, of its blocks, and of parts of the largest.

    Each has a context of its own, which in every tick of the running loop
    gets anew the state and the inputs from there, so that nothing is cached.
    """
    diagram, root = loop.get_system(), loop.get_mutable_context()
    controller = diagram.controller
    period = diagram.scenario.controller.control_period
    # The outputs of the whole would be computed twice, before its update and
    # after: the update asks for all that takes time.
    meters = {controller.get_name(): Meter(controller, num_outputs=0)}
    for block in leaves(controller):
        meters[block.get_name()] = Meter(block, block.num_output_ports())
    whole_body = WholeBodyMeter(diagram)
    times = {name: [] for name in (*meters, *WholeBodyMeter.NAMES)}
    first = round(root.get_time() / period)
    for tick in range(first + 1, first + 1 + ticks):
        loop.AdvanceTo(tick * period)  # as Drake counts: its update is due
        for name, meter in meters.items():
            times[name].append(meter.measure(root))
        for name, seconds in whole_body.measure(root).items():
            times[name].append(seconds)
    return {
        name: {
            "median_us": 1e6 * float(np.median(values)),
            "p99_us": 1e6 * float(np.percentile(values, 99)),
        }
        for name, values in times.items()
    }


class Meter:
    """Runs one tick of a block, alone."""

    def __init__(self, block: System, num_outputs: int):
        """Measures `block`: its first outputs, then what it has to update."""
        self._block, self._simulator = block, Simulator(block)
        self._ports = [block.get_output_port(i) for i in range(num_outputs)]

    def measure(self, root: Context) -> float:
        """Returns how long the tick takes [s] that is due in `root`."""
        context = self._simulator.get_mutable_context()
        copy_inputs(
            self._block, self._block.GetMyContextFromRoot(root), context
        )
        self._simulator.Initialize()  # makes this tick's update pending
        start = time.perf_counter()
        for port in self._ports:
            port.Eval(context)
        self._simulator.AdvancePendingEvents()
        return time.perf_counter() - start


class WholeBodyMeter:
    """Runs the parts of WholeBodyInverseDynamics, alone."""

    NAMES = ("whole_body_kinematics", "whole_body_qp")

    def __init__(self, diagram: HumanoidDiagram):
        """Has its own copies of them."""
        robot, plant = diagram.robot, diagram.robot.control_plant()
        params = robot.whole_body
        model = whole_body_model(robot, plant, params.joint_lower_limits)
        self._params, self._weight = params, model.mass * GRAVITY
        self._kinematics = WholeBodyKinematics(robot, plant)
        self._context = plant.CreateDefaultContext()
        self._qp, self._active = WholeBodyQp(params, model), None
        (self._block,) = (
            block
            for block in leaves(diagram.controller)
            if isinstance(block, WholeBodyInverseDynamics)
        )

    def measure(self, root: Context) -> dict[str, float]:
        """Returns how long each part takes [s]: all terms, the whole QP."""
        context = self._block.GetMyContextFromRoot(root)
        state, momentum_rate, swing, walking_state = (
            self._block.GetInputPort(name).Eval(context)
            for name in (
                "estimated_state",
                "momentum_rate",
                "swing_foot_reference",
                "walking_state",
            )
        )
        start = time.perf_counter()
        self._kinematics.plant.SetPositionsAndVelocities(self._context, state)
        terms = self._kinematics.calc(self._context)
        middle = time.perf_counter()
        command = whole_body_command(
            self._params, walking_state, momentum_rate, swing, self._weight
        )
        found = self._qp.solve(terms, command, self._active)
        end = time.perf_counter()
        self._active = found.qp.active
        return dict(
            zip(self.NAMES, (middle - start, end - middle), strict=True)
        )


def leaves(diagram) -> list[System]:
    """The LeafSystems inside of `diagram`, however deep."""
    found = []
    for system in diagram.GetSystems():
        inner = hasattr(system, "GetSystems")
        found += leaves(system) if inner else [system]
    return found


def copy_inputs(block: System, source: Context, target: Context) -> None:
    """Gives `target` the state and inputs that `block` has in `source`."""
    target.SetTimeStateAndParametersFrom(source)
    for i in range(block.num_input_ports()):
        port = block.get_input_port(i)
        if port.HasValue(source):
            port.FixValue(target, port.Eval(source))
