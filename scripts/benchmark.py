"""Measures the speed of the closed loop and of its controller's ticks.

The closed loop and the plant alone run in turns, and all use the processor time
of this thread, so that their ratio does not depend on the machine or its load.
Ticks are those of a push: recorded, and replayed through fresh controllers, to
the last bit; of each tick the shortest of REPLAYS times counts.
"""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import contextlib
import csv
import json
import platform
import re
import sys
import time
from pathlib import Path

import numpy as np
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.mechanisms import MOST
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import start
from nadia_balance.diagrams.tick_replay import Ticks, record_push, replay
from nadia_balance.parameters.bounds import require
from nadia_balance.results.folder import appearing, write_csv
from nadia_balance.results.versions import versions
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.plants import actuators
from nadia_balance.scripts import command_line

LONGEST = 3600  # [s]
START = 1.0  # start of the measurement, while the robot steps [s]
ROUNDS = 10  # of plant and loop
REPLAYS = 3  # of the push
# The push is the scenario's, times this: 0.7 m/s on Nadia, to the left.
HARDER = 0.7 / 0.45
AFTER = 2.0  # time from its begin [s]


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
            mechanisms=args.mechanisms or MOST,
        )
        if not 0.0 < args.seconds <= LONGEST:
            parser.error(f"seconds = {args.seconds}: must be in (0, {LONGEST}]")
        if args.record is not None:
            recorded(args.record)  # before anything is measured
    figures = measure(scenario, args.seconds) | push_figures(
        scenario.robot, scenario.mechanisms
    )
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
        "--scenario_text",
        help="YAML that overrides single fields of the loop; ticks are those "
        "of its robot in the scenario push",
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
    """Measures plant and loop in turns.

    Args:
        scenario: of the loop.
        seconds: simulated time of the loop after START [s].

    Returns:
        Real-time factors and their ratio, by name.
    """
    plant, loop = plant_alone(scenario), start(HumanoidDiagram(scenario))
    rates = [
        [real_time_factor(plant, end), real_time_factor(loop, end)]
        for end in np.linspace(START, START + seconds, ROUNDS + 1)
    ]
    alone, closed = np.median(rates[1:], axis=0)  # without the way to START
    return {
        "plant_alone_x_real_time": float(alone),
        "closed_loop_x_real_time": float(closed),
        "loop_over_plant_alone": float(closed / alone),
    }


def push_figures(robot: str, mechanisms: str) -> dict[str, float]:
    """Measures the ticks of a push.

    Args:
        robot: robot that is pushed while it steps in place.
        mechanisms: those that are on.

    Returns:
        By name, the control period [ms] and times [us]: of walking before the
        push; from its begin on, all; those of them that move the foothold.
    """
    scenario = load_scenario("push", robot=robot, mechanisms=mechanisms)
    (push,) = scenario.pushes
    assert push.delta_v is not None
    scenario = scenario.with_push(delta_v=HARDER * push.delta_v)
    ticks = record_push(scenario, AFTER)
    times = np.min([replayed(scenario, ticks) for _ in range(REPLAYS)], axis=0)
    walking = times[ticks.walks & ~ticks.pushed]
    pushed = times[ticks.pushed]
    moving = times[ticks.pushed & ticks.moves]
    return {
        "control_period_ms": 1e3 * ticks.period,
        "tick_median_us": 1e6 * float(np.median(walking)),
        "tick_p99_us": 1e6 * float(np.percentile(walking, 99.0)),
        "push_median_us": 1e6 * float(np.median(pushed)),
        "push_p99_us": 1e6 * float(np.percentile(pushed, 99.0)),
        "push_worst_us": 1e6 * float(pushed.max()),
        "moving_median_us": 1e6 * float(np.median(moving)),
        "moving_worst_us": 1e6 * float(moving.max()),
    }


def replayed(scenario: Scenario, ticks: Ticks) -> Array:
    """Replays ticks through a new controller.

    Args:
        scenario: of the controller.
        ticks: as recorded.

    Returns:
        The processor time of each (n,) [s].

    Raises:
        RuntimeError: a torque differs from the recorded one in any bit.
    """
    times, torques = replay(HumanoidDiagram(scenario).controller, ticks)
    if not np.array_equal(torques, ticks.actuation):
        raise RuntimeError(
            "the replayed torques differ by "
            f"{np.abs(torques - ticks.actuation).max():.2g} N m"
        )
    return times


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


def record(path: Path, scenario: Scenario, figures: dict[str, float]) -> None:
    """Adds a row with versions, machine and measurements to a CSV.

    Args:
        path: of the CSV, which is begun if need be.
        scenario: that was measured.
        figures: as `measure` returns them.
    """
    packages = versions()
    # Seven digits of the commit, and a + if files have been changed.
    commit, changed, _ = packages.get("commit", "unknown").partition("+")
    row = {
        "commit": f"{commit[:7]}{changed}",
        "machine": _machine(),
        "python": packages["python"],
        "drake": packages["drake"],
        "daqp": packages["daqp"],
        "numpy": packages["numpy"],
        "robot": scenario.robot,
        "mechanisms": scenario.mechanisms,
        **{name: f"{value:.4g}" for name, value in figures.items()},
    }
    rows = [*recorded(path), row]
    # Rows of today may have columns that older ones lack.
    names = {name: None for each in rows for name in each}
    with appearing(path.parent) as drafts:
        write_csv(drafts / path.name, names, rows)


def recorded(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV that record() has written.

    Args:
        path: of the CSV.

    Returns:
        Its rows; none if there is no such file.

    Raises:
        ValueError: it is another file, or there is no folder for it.
    """
    require(
        path.parent.is_dir(),
        f"record = {path}: must be in a folder that exists",
    )
    if not path.exists():
        return []
    with contextlib.suppress(OSError, UnicodeDecodeError, csv.Error):
        text = path.read_text(encoding="utf-8")
        rows = list(csv.DictReader(text.splitlines()))
        if all(row.get("commit") for row in rows):
            return rows
    raise ValueError(f"record = {path}: must be a CSV of this program")


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
