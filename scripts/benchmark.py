"""Measures the speed of the closed loop, and of each block of the controller.

Everything is measured in one run, so that the ratios hold on any machine.

Examples:
    python scripts/benchmark.py
    python scripts/benchmark.py --json --seconds 10
"""

import json
import sys
import time

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, System

from diagrams.command_line import CommandLine, finite
from diagrams.humanoid import HumanoidDiagram
from diagrams.scenario import Scenario, load_scenario
from nadia_balance.core.whole_body_command import whole_body_command
from nadia_balance.core.whole_body_qp import WholeBodyQp
from nadia_balance.core.whole_body_tasks import GRAVITY
from nadia_balance.robot import load_robot, terrain_file
from nadia_balance.systems.whole_body_inverse_dynamics import (
    WholeBodyInverseDynamics,
)
from nadia_balance.systems.whole_body_kinematics import (
    WholeBodyKinematics,
    whole_body_model,
)

STIFFNESS, DAMPING = 3000.0, 100.0  # of the joints of the plant alone
START = 1.0  # when the measurement begins: she steps [s]


def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; 0 done, 2 bad input."""
    parser = CommandLine(
        prog="benchmark.py", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("--scenario_name", default="walk_in_place")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument(
        "--seconds", type=finite, default=5.0, help="to simulate, > 0 [s]"
    )
    args = parser.parse_args(argv)
    try:
        scenario = load_scenario(args.scenario_name)
        if not args.seconds > 0.0:
            raise ValueError(f"seconds = {args.seconds}: must be > 0")
    except ValueError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    figures = measure(scenario, args.seconds)
    print(json.dumps(figures, indent=2) if args.json else as_text(figures))
    return 0


def measure(scenario: Scenario, seconds: float) -> dict:
    """Returns all figures; see as_text for what they mean."""
    alone = plant_alone(scenario)
    loop = Simulator(HumanoidDiagram(scenario))
    loop.get_system().set_initial_state(loop.get_mutable_context())
    rates = {"plant": [], "loop": []}
    for simulator in (alone, loop):
        simulator.AdvanceTo(START)
    # In turns, since machines drift.
    for end in np.linspace(START, START + seconds, 11)[1:]:
        rates["plant"].append(real_time_factor(alone, end))
        rates["loop"].append(real_time_factor(loop, end))
    plant, closed = (float(np.median(rates[k])) for k in ("plant", "loop"))
    return {
        "plant_alone": {"real_time_factor": plant},
        "closed_loop": {
            "real_time_factor": closed,
            "ratio_to_plant_alone": float(
                np.median(np.divide(rates["loop"], rates["plant"]))
            ),
        },
        "blocks": block_times(loop),
    }


def plant_alone(scenario: Scenario) -> Simulator:
    """The same robot, ground and contact, held by Drake's joint control."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(scenario.plant_config, builder)
    robot = load_robot(scenario.robot)
    robot.add_to(plant)
    Parser(plant).AddModels(str(terrain_file()))
    for i in plant.GetJointActuatorIndices():
        plant.get_joint_actuator(i).set_controller_gains(
            PdControllerGains(p=STIFFNESS, d=DAMPING)
        )
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    q = robot.standing_positions()
    plant.SetPositions(context, q)
    joints = [
        plant.get_joint_actuator(i).joint().position_start()
        for i in plant.GetJointActuatorIndices()
    ]
    plant.get_desired_state_input_port(
        plant.GetModelInstanceByName(robot.name)
    ).FixValue(context, np.concatenate([q[joints], np.zeros(len(joints))]))
    return simulator


def real_time_factor(simulator: Simulator, end: float) -> float:
    """Simulated seconds per second of processor time until `end` [s]."""
    simulated = end - simulator.get_context().get_time()
    start = time.process_time()
    simulator.AdvanceTo(end)
    return simulated / (time.process_time() - start)


def block_times(loop: Simulator, ticks: int = 500) -> dict:
    """Times of the controller, of its blocks, and of parts of the largest.

    Each has a context of its own, which in every tick of the running loop
    gets anew the state and the inputs from there, so that nothing is cached.
    """
    diagram, root = loop.get_system(), loop.get_mutable_context()
    controller, period = (
        diagram.controller,
        diagram.scenario.controller.control_period,
    )
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


def as_text(figures: dict) -> str:
    """The figures as a table."""
    plant, loop = figures["plant_alone"], figures["closed_loop"]
    lines = [
        f"plant alone   {plant['real_time_factor']:6.2f} x real time",
        f"closed loop   {loop['real_time_factor']:6.2f} x real time, "
        f"{loop['ratio_to_plant_alone']:.2f} of the plant alone",
        f"{'block, per tick':32} {'median us':>10} {'p99 us':>10}",
    ]
    lines += [
        f"{name:32} {block['median_us']:10.0f} {block['p99_us']:10.0f}"
        for name, block in figures["blocks"].items()
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
