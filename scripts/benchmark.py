"""Measures the speed of the closed loop, and of each block of the controller.

All measurements alternate in one run and use the processor time of this thread,
so the ratios do not depend on the machine or on its load.

The plant is measured twice.  *Alone* it runs only its own steps, with its code
and data in the processor's caches.  *In the loop* the same simulation runs one
tick at a time, each after a tick of the closed loop, with the caches as the
controller leaves them: this is an upper bound of the closed loop's speed.

Examples:
    python scripts/benchmark.py
    python scripts/benchmark.py --json --seconds 10
    python scripts/benchmark.py --mechanisms all_with_cross_over
    python scripts/benchmark.py --record     # a row in docs/results/speed.csv
    python scripts/benchmark.py --scenario_text "{robot: my/robot.yaml}"
"""

import nadia_balance.scripts  # noqa: F401  (first, for Ctrl-C)

# isort: split
import contextlib
import csv
import json
import platform
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlant
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, System

from nadia_balance.collision_avoidance import CollisionAvoidance
from nadia_balance.core.qp import DenseQp
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import start
from nadia_balance.results.summary import versions
from nadia_balance.robot import add_ground, load_robot
from nadia_balance.scripts.command_line import (
    DONE,
    ONE_OF,
    CommandLine,
    finite,
    place,
    program,
    say,
)

STIFFNESS, DAMPING = 3000.0, 100.0  # joint gains of the plant alone
LONGEST = 3600  # [s]
START = 1.0  # start of the measurement, while the robot steps [s]
ROUNDS, TICKS = 10, 500  # rounds of plant and loop; ticks of blocks
SMALL = 10  # QPs with more variables are those of the whole body
RECORD = Path("docs/results/speed.csv")


@program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv` and returns 0; bad input exits."""
    parser = CommandLine(
        prog="benchmark.py",
        description=__doc__.partition("\n")[0],
        epilog="Exit code: 0 done, 1 the record cannot be written, "
        "2 bad input, 130 Ctrl-C.",
    )
    parser.add_argument(
        "--scenario_name",
        default="walk_in_place",
        help="one of the package (default: %(default)s)",
    )
    parser.add_argument(
        "--scenario_text", help="YAML that overrides single fields"
    )
    parser.add_argument("--mechanisms", help=ONE_OF)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument(
        "--seconds",
        type=finite,
        default=5.0,
        help="to simulate, > 0 (default: %(default)g) [s]",
    )
    parser.add_argument(
        "--record",
        type=place,
        nargs="?",
        const=RECORD,
        metavar="FILE",
        help=f"add a row to this CSV (default: {RECORD})",
    )
    args = parser.parse_args(argv)
    with parser.refusing():
        scenario = load_scenario(
            args.scenario_name,
            text=args.scenario_text,
            mechanisms=args.mechanisms,
        )
        if not 0.0 < args.seconds <= LONGEST:
            raise ValueError(
                f"seconds = {args.seconds}: must be in (0, {LONGEST}]"
            )
    figures = measure(scenario, args.seconds)
    say(json.dumps(figures, indent=2) if args.json else as_text(figures))
    if args.record is not None:
        record(args.record, scenario, figures)
    return DONE


def measure(scenario: Scenario, seconds: float) -> dict:
    """Returns all measured speeds and times; as_text names them."""
    plant, loop = plant_alone(scenario), start(HumanoidDiagram(scenario))
    for simulator in (plant, loop):
        simulator.AdvanceTo(START)
    rates = np.array(
        [
            [real_time_factor(plant, end), real_time_factor(loop, end)]
            for end in np.linspace(START, START + seconds, ROUNDS + 1)[1:]
        ]
    )
    alone, closed = np.median(rates, axis=0)
    with (
        timed(DenseQp, "solve", lambda qp, problem: problem.g.size > SMALL) as (
            qp
        ),
        timed(CollisionAvoidance, "calc") as distances,
    ):
        in_loop, blocks = tick_times(loop, plant, TICKS)
    return {
        "control_period": scenario.controller.control_period,
        "plant_alone": {"real_time_factor": float(alone)},
        "plant_in_loop": {"real_time_factor": in_loop},
        "closed_loop": {
            "real_time_factor": float(closed),
            "ratio_to_plant_alone": float(np.median(rates[:, 1] / rates[:, 0])),
            "ratio_to_plant_in_loop": float(closed) / in_loop,
        },
        "blocks": blocks,
        "parts": {
            "whole_body_qp_program": spread(qp),
            "link_distances": spread(distances),
        },
    }


@contextlib.contextmanager
def timed(
    owner: type, name: str, counts=lambda *_: True
) -> Iterator[list[float]]:
    """Yields the times [us] of the method's calls that `counts` selects."""
    times, method = [], getattr(owner, name)

    def stopped(*args):
        begin = time.thread_time()
        result = method(*args)
        if counts(*args):
            times.append(1e6 * (time.thread_time() - begin))
        return result

    setattr(owner, name, stopped)
    try:
        yield times
    finally:
        setattr(owner, name, method)


def spread(times: list[float]) -> dict[str, float]:
    """Median and 99th percentile of `times`; NaN if it is empty."""
    median, p99 = np.percentile(times or [np.nan], [50.0, 99.0])
    return {"median_us": float(median), "p99_us": float(p99)}


def plant_alone(scenario: Scenario) -> Simulator:
    """The same robot and plant, on flat ground, with Drake's joint control."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(scenario.plant_config, builder)
    robot = load_robot(scenario.robot, scenario.fidelity)
    instance = robot.add_to(plant)
    add_ground(plant)
    actuators = [
        plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()
    ]
    for actuator in actuators:
        actuator.set_controller_gains(PdControllerGains(p=STIFFNESS, d=DAMPING))
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    q = robot.standing_positions()
    plant.SetPositions(context, q)
    held = q[[actuator.joint().position_start() for actuator in actuators]]
    plant.get_desired_state_input_port(instance).FixValue(
        context, np.concatenate([held, np.zeros(len(held))])
    )
    return simulator


def real_time_factor(simulator: Simulator, end: float) -> float:
    """Simulated seconds per second of processor time until `end` [s]."""
    simulated = end - simulator.get_context().get_time()
    begin = time.thread_time()
    simulator.AdvanceTo(end)
    return simulated / (time.thread_time() - begin)


def tick_times(
    loop: Simulator, plant: Simulator, ticks: int
) -> tuple[float, dict]:
    """Measures the next `ticks` of the `loop`, one by one.

    Returns the real-time factor of the `plant` in the loop, and the times of
    the controller and of its blocks.  Each block has a context of its own, to
    which state and inputs of the loop are copied in every tick, so that no
    result is cached.
    """
    diagram, root = loop.get_system(), loop.get_mutable_context()
    controller = diagram.controller
    period = diagram.scenario.controller.control_period
    # Without outputs: the controller's update evaluates all expensive ones,
    # which would otherwise be computed before and after the update.
    meters = {controller.get_name(): Meter(controller, num_outputs=0)}
    for block in leaves(controller):
        meters[block.get_name()] = Meter(block, block.num_output_ports())
    rates, times = [], {name: [] for name in meters}
    first = round(root.get_time() / period)
    for tick in range(first + 1, first + 1 + ticks):
        loop.AdvanceTo(tick * period)  # the update at this time is pending
        rates.append(real_time_factor(plant, tick * period))
        for name, meter in meters.items():
            times[name].append(1e6 * meter.measure(root))
    return float(np.median(rates)), {
        name: spread(values) for name, values in times.items()
    }


class Meter:
    """Runs single ticks of one block."""

    def __init__(self, block: System, num_outputs: int):
        """Measures the first `num_outputs` outputs and updates of `block`."""
        self._block, self._simulator = block, Simulator(block)
        self._ports = [block.get_output_port(i) for i in range(num_outputs)]

    def measure(self, root: Context) -> float:
        """Returns the processor time [s] of the tick that is due in `root`."""
        context = self._simulator.get_mutable_context()
        copy_inputs(
            self._block, self._block.GetMyContextFromRoot(root), context
        )
        self._simulator.Initialize()  # makes this tick's update pending
        begin = time.thread_time()
        for port in self._ports:
            port.Eval(context)
        self._simulator.AdvancePendingEvents()
        return time.thread_time() - begin


def leaves(diagram) -> list[System]:
    """The LeafSystems of `diagram` and its inner diagrams."""
    found = []
    for system in diagram.GetSystems():
        inner = hasattr(system, "GetSystems")
        found += leaves(system) if inner else [system]
    return found


def copy_inputs(block: System, source: Context, target: Context) -> None:
    """Copies state and inputs of `block` from `source` to `target`."""
    target.SetTimeStateAndParametersFrom(source)
    for i in range(block.num_input_ports()):
        port = block.get_input_port(i)
        if port.HasValue(source):
            port.FixValue(target, port.Eval(source))


def as_text(figures: dict) -> str:
    """The measured speeds and times as a table."""
    lines = [
        f"{key.replace('_', ' '):13} "
        f"{figures[key]['real_time_factor']:6.2f} x real time"
        for key in ("plant_alone", "plant_in_loop", "closed_loop")
    ]
    loop = figures["closed_loop"]
    lines[-1] += (
        f", {loop['ratio_to_plant_alone']:.2f} of the plant alone, "
        f"{loop['ratio_to_plant_in_loop']:.2f} of the plant in loop"
    )
    lines.append(f"{'block, per tick':32} {'median us':>10} {'p99 us':>10}")
    lines += [
        f"{name:32} {block['median_us']:10.0f} {block['p99_us']:10.0f}"
        for kind in ("blocks", "parts")
        for name, block in figures[kind].items()
    ]
    period = 1e6 * figures["control_period"]
    lines.append(f"{'the control period':32} {period:10.0f}")
    return "\n".join(lines)


def record(path: Path, scenario: Scenario, figures: dict) -> None:
    """Adds a row with the ratios, the versions and the machine to CSV `path`.

    Raises:
        OSError: the file cannot be written.
    """
    found = versions()
    row = {
        "commit": _commit(),
        "machine": f"{platform.machine()} {_processor()}",
        **{name: found[name] for name in ("python", "drake", "daqp", "numpy")},
        "robot": scenario.robot,
        "mechanisms": scenario.mechanisms,
        "control_period_ms": 1e3 * figures["control_period"],
        **{
            f"{name}_x_real_time": figures[name]["real_time_factor"]
            for name in ("plant_alone", "plant_in_loop", "closed_loop")
        },
        "loop_over_plant_in_loop": figures["closed_loop"][
            "ratio_to_plant_in_loop"
        ],
        **{
            f"{name}_{key}": part[key]
            for name, part in (
                ("tick", figures["blocks"]["balance_controller"]),
                *figures["parts"].items(),
            )
            for key in part
        },
    }
    is_new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if is_new:
            writer.writerow(row)
        writer.writerow(
            f"{value:.4g}" if isinstance(value, float) else value
            for value in row.values()
        )


def _commit() -> str:
    """The commit of the checkout, with a + if files have been changed."""
    command = ["git", "describe", "--always", "--dirty=+", "--exclude=*"]
    here = Path(__file__).parent
    try:
        found = subprocess.run(
            command, cwd=here, capture_output=True, text=True
        )
    except OSError:
        return "unknown"
    return found.stdout.strip() or "unknown"


def _processor() -> str:
    """The processor's name from /proc/cpuinfo, or from Python."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()


if __name__ == "__main__":
    sys.exit(main())
