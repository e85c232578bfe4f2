"""Measures the speed of the closed loop, and of each block of the controller.

Everything is measured in one run, so that the ratios hold on any machine.

Examples:
    python scripts/benchmark.py
    python scripts/benchmark.py --json --seconds 10
    python scripts/benchmark.py --mechanisms all_with_cross_over
    python scripts/benchmark.py --scenario_text "{robot: my/robot.yaml}"
"""

import json
import sys
import time

import numpy as np
from pydrake.systems.analysis import Simulator

from diagrams.block_times import block_times
from diagrams.command_line import BAD_INPUT, ONE_OF, CommandLine, finite
from diagrams.humanoid import HumanoidDiagram
from diagrams.plant_alone import plant_alone
from diagrams.scenario import Scenario, load_scenario

START = 1.0  # when the measurement begins: she steps [s]


def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; 0 done, 2 bad input."""
    parser = CommandLine(
        prog="benchmark.py",
        description=__doc__.partition("\n")[0],
        epilog="Exit code: 0 done, 2 bad input.",
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
    args = parser.parse_args(argv)
    try:
        scenario = load_scenario(args.scenario_name, text=args.scenario_text)
        scenario.mechanisms = args.mechanisms or scenario.mechanisms
        scenario.validate()
        if not args.seconds > 0.0:
            raise ValueError(f"seconds = {args.seconds}: must be > 0")
    except ValueError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return BAD_INPUT
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


def real_time_factor(simulator: Simulator, end: float) -> float:
    """Simulated seconds per second of processor time until `end` [s]."""
    simulated = end - simulator.get_context().get_time()
    start = time.process_time()
    simulator.AdvanceTo(end)
    return simulated / (time.process_time() - start)


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
