"""Measures the speed of the closed loop, and of each block of the controller.

All measurements alternate in one run and use the processor time of this thread,
so the ratios do not depend on the machine or on its load.  The plant runs by
itself, and once more tick by tick, each after a tick of the closed loop, with
the caches as the controller leaves them: an upper bound of the closed loop.

Examples:
    python scripts/benchmark.py --mechanisms all_with_cross_over --seconds 10
    python scripts/benchmark.py --record     # a row in docs/results/speed.csv
    python scripts/benchmark.py --json --scenario_text "{robot: my/robot.yaml}"
"""

import nadia_balance.scripts  # noqa: F401  (first, for Ctrl-C)

# isort: split
import contextlib
import csv
import json
import platform
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System

from nadia_balance.core.math.qp import DenseQp
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import start
from nadia_balance.results.summary import versions
from nadia_balance.robot.collision_avoidance import CollisionAvoidance
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts import command_line

GAINS = PdControllerGains(p=3000.0, d=100.0)  # of the joints of a plant alone
LONGEST = 3600  # [s]
START = 1.0  # start of the measurement, while the robot steps [s]
ROUNDS, TICKS = 10, 500  # rounds of plant and loop; ticks of blocks
SMALL = 10  # QPs with more variables are those of the whole body
# Methods that are timed inside of a tick, and which calls count.
PARTS = {
    "whole_body_qp_program": (DenseQp, "solve", lambda _, p: p.g.size > SMALL),
    "link_distances": (CollisionAvoidance, "calc", lambda *_: True),
}
FLAGS = {
    "scenario_name": {"default": "walk_in_place", "help": "one of the package"},
    "scenario_text": {"help": "YAML that overrides single fields"},
    "mechanisms": {"help": command_line.ONE_OF},
    "seconds": {"default": 5.0, "type": command_line.finite, "help": "[s]"},
    "json": {"action": "store_true", "help": "print JSON"},
    "record": {
        "nargs": "?",
        "const": Path("docs/results/speed.csv"),
        "type": command_line.place,
        "help": "add a row to this CSV (default: %(const)s)",
    },
}
RECORDED = (  # measurements in a row of the CSV
    "control_period_ms",
    "plant_alone_x_real_time",
    "plant_in_loop_x_real_time",
    "closed_loop_x_real_time",
    "loop_over_plant_in_loop",
    *(f"{n}_{q}_us" for n in ("tick", *PARTS) for q in ("median", "p99")),
)


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv` and returns 0; bad input exits."""
    parser = command_line.CommandLine(
        prog="benchmark.py",
        description=__doc__.partition("\n")[0],
        epilog="Exit code: 0 done, 1 the record cannot be written, "
        "2 bad input, 130 Ctrl-C.",
    )
    for flag, options in FLAGS.items():
        parser.add_argument(f"--{flag}", **options)
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
    text = json.dumps(figures, indent=2) if args.json else as_text(figures)
    command_line.say(text)
    if args.record is not None:
        record(args.record, scenario, figures)
    return command_line.DONE


def measure(scenario: Scenario, seconds: float) -> dict[str, float]:
    """All measurements by name: ratios, and times of a tick [us]."""
    plant, loop = plant_alone(scenario), start(HumanoidDiagram(scenario))
    rates = []
    for end in np.linspace(START, START + seconds, ROUNDS + 1):
        rates.append([real_time_factor(it, end) for it in (plant, loop)])
    alone, closed = np.transpose(rates[1:])  # without the way to START
    with contextlib.ExitStack() as stack:
        parts = {
            name: stack.enter_context(timed(*method))
            for name, method in PARTS.items()
        }
        in_loop, blocks = tick_times(loop, plant, TICKS)
    rate = float(np.median(closed))
    figures = {
        "control_period_ms": 1e3 * scenario.controller.control_period,
        "plant_alone_x_real_time": float(np.median(alone)),
        "plant_in_loop_x_real_time": in_loop,
        "closed_loop_x_real_time": rate,
        "loop_over_plant_alone": float(np.median(closed / alone)),
        "loop_over_plant_in_loop": rate / in_loop,
    }
    for name, times in (blocks | parts).items():
        median, p99 = 1e6 * np.percentile(times or [np.nan], [50.0, 99.0])
        figures |= {f"{name}_median_us": median, f"{name}_p99_us": p99}
    return figures


def plant_alone(scenario: Scenario) -> Simulator:
    """The same robot and plant, on flat ground, with Drake's joint control."""
    builder = DiagramBuilder()
    robot = load_robot(scenario.robot, scenario.fidelity)
    plant, _ = robot.add_plant_to(builder, scenario.time_step)
    joints = []
    for i in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(i)
        actuator.set_controller_gains(GAINS)
        joints.append(actuator.joint().position_start())
    simulator = Simulator(builder.Build())
    context = plant.GetMyContextFromRoot(simulator.get_mutable_context())
    held = plant.GetPositions(context)[joints]
    port = plant.get_desired_state_input_port(actuator.model_instance())
    port.FixValue(context, np.concatenate([held, np.zeros(len(held))]))
    return simulator


def real_time_factor(simulator: Simulator, end: float) -> float:
    """Simulated seconds per second of processor time until `end` [s]."""
    simulated = end - simulator.get_context().get_time()
    begin = time.thread_time()
    simulator.AdvanceTo(end)
    return simulated / (time.thread_time() - begin)


@contextlib.contextmanager
def timed(owner: type, name: str, counts) -> Iterator[list[float]]:
    """Yields the times [s] of the method's calls that `counts` selects."""
    times, method = [], getattr(owner, name)

    def stopped(*args):
        begin = time.thread_time()
        result = method(*args)
        if counts(*args):
            times.append(time.thread_time() - begin)
        return result

    setattr(owner, name, stopped)
    try:
        yield times
    finally:
        setattr(owner, name, method)


def tick_times(
    loop: Simulator, plant: Simulator, ticks: int
) -> tuple[float, dict[str, list[float]]]:
    """Measures the next `ticks` of the `loop`, one by one.

    Returns the real-time factor of the `plant` in the loop, and the times [s]
    of the controller (`tick`) and of its blocks.
    """
    diagram, root = loop.get_system(), loop.get_mutable_context()
    period = diagram.scenario.controller.control_period
    blocks = {"tick": Simulator(diagram.controller)}
    for block in leaves(diagram.controller):
        blocks[block.get_name()] = Simulator(block)
    rates, times = [], {name: [] for name in blocks}
    first = round(root.get_time() / period)
    for tick in range(first + 1, first + 1 + ticks):
        loop.AdvanceTo(tick * period)  # the update at this time is pending
        rates.append(real_time_factor(plant, tick * period))
        for name, block in blocks.items():
            times[name].append(tick_time(block, root))
    return float(np.median(rates)), times


def leaves(system: System) -> list[System]:
    """The LeafSystems of a diagram and its inner diagrams."""
    inner = getattr(system, "GetSystems", list)()
    return sum(map(leaves, inner), []) or [system]


def tick_time(simulator: Simulator, root: Context) -> float:
    """Processor time [s] of the tick of a system that is due in `root`.

    The `simulator` of the system has a context of its own, to which state and
    inputs are copied, so that no result is cached.  Only of a LeafSystem the
    outputs count: a diagram's update evaluates all expensive ones, which would
    otherwise be computed before and after it.
    """
    block, context = simulator.get_system(), simulator.get_mutable_context()
    source = block.GetMyContextFromRoot(root)
    context.SetTimeStateAndParametersFrom(source)
    for i in range(block.num_input_ports()):
        port = block.get_input_port(i)
        if port.HasValue(source):
            port.FixValue(context, port.Eval(source))
    outputs = 0 if isinstance(block, Diagram) else block.num_output_ports()
    simulator.Initialize()  # makes this tick's update pending
    begin = time.thread_time()
    for i in range(outputs):
        block.get_output_port(i).Eval(context)
    simulator.AdvancePendingEvents()
    return time.thread_time() - begin


def as_text(figures: dict[str, float]) -> str:
    """A table of the measurements: ratios, then the times of a tick."""
    ratios = [name for name in figures if not name.endswith("_us")]
    blocks = [n[:-10] for n in figures if n.endswith("_median_us")]
    lines = [f"{name:32} {figures[name]:10.2f}" for name in ratios]
    lines.append(f"{'per tick':32} {'median us':>10} {'p99 us':>10}")
    for name in blocks:
        median, p99 = (figures[f"{name}_{q}_us"] for q in ("median", "p99"))
        lines.append(f"{name:32} {median:10.0f} {p99:10.0f}")
    return "\n".join(lines)


def record(path: Path, scenario: Scenario, figures: dict[str, float]) -> None:
    """Adds a row with the versions, the machine and RECORDED to CSV `path`.

    Raises:
        OSError: the file cannot be written.
    """
    found = versions()
    row = {
        "commit": _commit(),
        "machine": _machine(),
        **{name: found[name] for name in ("python", "drake", "daqp", "numpy")},
        "robot": scenario.robot,
        "mechanisms": scenario.mechanisms,
        **{name: f"{figures[name]:.4g}" for name in RECORDED},
    }
    is_new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, row, lineterminator="\n")
        if is_new:
            writer.writeheader()
        writer.writerow(row)


def _commit() -> str:
    """The commit of the checkout, with a + if files have been changed."""
    command = "git describe --always --dirty=+ --exclude=*".split()
    here = {"cwd": Path(__file__).parent, "stderr": subprocess.DEVNULL}
    with contextlib.suppress(OSError, subprocess.CalledProcessError):
        return subprocess.check_output(command, text=True, **here).strip()
    return "unknown"


def _machine() -> str:
    """The architecture, and on Linux the processor's name."""
    names = [platform.processor()]
    with contextlib.suppress(OSError):
        text = Path("/proc/cpuinfo").read_text()
        names = re.findall(r"^model name\s*: (.*)", text, re.MULTILINE)
    return " ".join([platform.machine(), *names[:1]])


if __name__ == "__main__":
    sys.exit(main())
