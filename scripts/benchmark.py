"""Measures the speed of the closed loop, beside that of its plant alone.

All measurements alternate in one run and use the processor time of this thread,
so the ratios do not depend on the machine or on its load.  The plant runs by
itself, and once more tick by tick, each after a tick of the closed loop, with
the caches as the controller leaves them: an upper bound of the closed loop.
"""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import contextlib
import csv
import json
import platform
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import cast

import numpy as np
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import start
from nadia_balance.results.versions import versions
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.plants import actuators
from nadia_balance.scripts import command_line

LONGEST = 3600  # [s]
START = 1.0  # start of the measurement, while the robot steps [s]
ROUNDS, TICKS = 10, 500  # rounds of plant and loop; ticks one by one


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs a command line.

    Args:
        argv: its words; None: those of the process.

    Returns:
        0; bad input exits.
    """
    parser = _parser()
    args = parser.parse_args(argv)
    with parser.refusing():
        scenario = load_scenario(
            args.scenario_name,
            text=args.scenario_text,
            mechanisms=args.mechanisms,
        )
        if not 0.0 < args.seconds <= LONGEST:
            parser.error(f"seconds = {args.seconds}: must be in (0, {LONGEST}]")
    figures = measure(scenario, args.seconds)
    if args.json:
        command_line.say(json.dumps(figures, indent=2))
    else:
        command_line.say(*(f"{n:26} {x:8.2f}" for n, x in figures.items()))
    if args.record is not None:
        record(args.record, scenario, figures)
    return command_line.DONE


def _parser() -> command_line.CommandLine:
    parser = command_line.CommandLine(
        __file__,
        __doc__,
        "0 done, 2 bad input, 4 the record cannot be written, 130 Ctrl-C.",
    )
    parser.add_argument(
        "--scenario_name", default="walk_in_place", help="default: %(default)s"
    )
    parser.add_argument(
        "--scenario_text", help="YAML that overrides single fields"
    )
    parser.add_argument("--mechanisms", help=command_line.MECHANISMS)
    parser.add_argument(
        "--seconds", default=5.0, type=command_line.finite, help="[s] (5)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument(
        "--record",
        nargs="?",
        const=Path("docs/results/speed.csv"),
        type=command_line.place,
        help="add a row to a CSV (without a path: %(const)s)",
    )
    return parser


def measure(scenario: Scenario, seconds: float) -> dict[str, float]:
    """Measures plant and loop in turns, then single ticks.

    Args:
        scenario: of the loop.
        seconds: simulated time of the loop after START [s].

    Returns:
        All measurements by name: ratios, and times of a tick [us].
    """
    plant, loop = plant_alone(scenario), start(HumanoidDiagram(scenario))
    rates = [
        [real_time_factor(plant, end), real_time_factor(loop, end)]
        for end in np.linspace(START, START + seconds, ROUNDS + 1)
    ]
    alone, closed = np.transpose(rates[1:])  # without the way to START
    in_loop, ticks = tick_times(loop, plant, TICKS)
    median, p99 = 1e6 * np.percentile(ticks, [50.0, 99.0])
    rate = float(np.median(closed))
    return {
        "control_period_ms": 1e3 * scenario.controller.control_period,
        "plant_alone_x_real_time": float(np.median(alone)),
        "plant_in_loop_x_real_time": in_loop,
        "closed_loop_x_real_time": rate,
        "loop_over_plant_alone": rate / float(np.median(alone)),
        "loop_over_plant_in_loop": rate / in_loop,
        "tick_median_us": float(median),
        "tick_p99_us": float(p99),
    }


def plant_alone(scenario: Scenario) -> Simulator:
    """The same robot and plant, on flat ground, with Drake's joint control.

    Args:
        scenario: with the robot and the time step.

    Returns:
        Its simulation, at the start.
    """
    builder = DiagramBuilder()
    plant, _ = load_robot(scenario.robot, scenario.fidelity).add_plant_to(
        builder, scenario.time_step
    )
    joints = []
    for actuator in actuators(plant):
        actuator.set_controller_gains(PdControllerGains(p=3000.0, d=100.0))
        joints.append(actuator.joint().position_start())
    simulator = Simulator(builder.Build())
    context = plant.GetMyContextFromRoot(simulator.get_mutable_context())
    held = plant.GetPositions(context)[joints]
    plant.get_desired_state_input_port(actuator.model_instance()).FixValue(
        context, np.concatenate([held, np.zeros(len(held))])
    )
    return simulator


def real_time_factor(simulator: Simulator, end: float) -> float:
    """Simulates, and measures the processor time of it.

    Args:
        simulator: goes on until `end`.
        end: simulated time [s].

    Returns:
        Simulated seconds per second of processor time.
    """
    simulated = end - simulator.get_context().get_time()
    begin = time.thread_time()
    simulator.AdvanceTo(end)
    return simulated / (time.thread_time() - begin)


def tick_times(
    loop: Simulator, plant: Simulator, ticks: int
) -> tuple[float, list[float]]:
    """Measures ticks of the loop, one by one, and the plant after each.

    Args:
        loop: of a HumanoidDiagram.
        plant: the plant alone.
        ticks: number of ticks.

    Returns:
        The plant's real-time factor, and the controller's times [s].
    """
    diagram = cast(HumanoidDiagram, loop.get_system())
    root = loop.get_mutable_context()
    period = diagram.scenario.controller.control_period
    controller, rates, times = Simulator(diagram.controller), [], []
    first = round(root.get_time() / period)
    for tick in range(first + 1, first + 1 + ticks):
        loop.AdvanceTo(tick * period)  # the update at this time is pending
        rates.append(real_time_factor(plant, tick * period))
        times.append(tick_time(controller, root))
    return float(np.median(rates)), times


def tick_time(simulator: Simulator, root: Context) -> float:
    """Measures the tick of a system that is due.

    State and inputs are copied to the context of a simulator, so that no result
    is cached.

    Args:
        simulator: of the system alone.
        root: Context of a diagram in which the system's tick is due.

    Returns:
        Processor time [s].
    """
    system, context = simulator.get_system(), simulator.get_mutable_context()
    source = system.GetMyContextFromRoot(root)
    context.SetTimeStateAndParametersFrom(source)
    for i in range(system.num_input_ports()):
        port = system.get_input_port(i)
        if port.HasValue(source):
            port.FixValue(context, port.Eval(source))
    simulator.Initialize()  # makes this tick's update pending
    begin = time.thread_time()
    simulator.AdvancePendingEvents()
    return time.thread_time() - begin


def record(path: Path, scenario: Scenario, figures: dict[str, float]) -> None:
    """Adds a row with versions, machine and measurements to a CSV.

    Args:
        path: of the CSV, which is begun if need be.
        scenario: that was measured.
        figures: as `measure` returns them.
    """
    packages = versions()
    row = {
        "commit": _commit(),
        "machine": _machine(),
        "python": packages["python"],
        "drake": packages["drake"],
        "daqp": packages["daqp"],
        "numpy": packages["numpy"],
        "robot": scenario.robot,
        "mechanisms": scenario.mechanisms,
        **{name: f"{value:.4g}" for name, value in figures.items()},
    }
    is_new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, row, lineterminator="\n")
        if is_new:
            writer.writeheader()
        writer.writerow(row)


def _commit() -> str:
    """The commit of the checkout, with a + if files have been changed."""
    with contextlib.suppress(OSError, subprocess.CalledProcessError):
        return subprocess.check_output(
            ["git", "describe", "--always", "--dirty=+", "--exclude=*"],
            cwd=Path(__file__).parent,
            stderr=subprocess.DEVNULL,
            text=True,
        ).strip()
    return "unknown"


def _machine() -> str:
    """The architecture, and on Linux the processor's name."""
    names = [platform.processor()]
    with contextlib.suppress(OSError):
        names = re.findall(
            r"^model name\s*: (.*)",
            Path("/proc/cpuinfo").read_text(),
            re.MULTILINE,
        )
    return " ".join([platform.machine(), *names[:1]])


if __name__ == "__main__":
    sys.exit(main())
