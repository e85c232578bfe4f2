"""The flags that the scripts share, and what they do."""

import argparse
import math
import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path

from diagrams.humanoid import HumanoidDiagram
from diagrams.lipm import LipmDiagram
from diagrams.replay import (
    set_scene,
    start_meshcat,
    start_recording,
    write_replay,
)
from diagrams.run_folder import prepare_folder, write_run
from diagrams.scenario import MECHANISMS, Scenario, load_scenario
from diagrams.simulation import Run, simulate
from diagrams.story import telling_lines

RECOVERED, FELL, BAD_INPUT = 0, 1, 2
# What bad input raises, by us or by the operating system.
INPUT_ERRORS = (ValueError, OSError)


def finite(text: str) -> float:
    """A finite number, for argparse."""
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text}: must be a finite number")
    return value


def scenario_flags(parser: argparse.ArgumentParser, name: str | None) -> None:
    """Adds the flags that choose and change the scenario."""
    group = parser.add_argument_group("scenario")
    group.add_argument(
        "--scenario_file", type=Path, help="YAML with named scenarios"
    )
    group.add_argument(
        "--scenario_name",
        default=name,
        required=name is None,
        help="one of the package, or of --scenario_file",
    )
    group.add_argument(
        "--scenario_text", help="YAML that overrides single fields"
    )
    group.add_argument("--robot", help="a model's name, or a robot.yaml")
    group.add_argument(
        "--mechanisms", help=f"to recover by: {', '.join(MECHANISMS)}"
    )
    group.add_argument("--duration", type=finite, help="[s]")
    group.add_argument("--seed", type=int, help="shifts the start by <= 10 um")
    group.add_argument(
        "--plant",
        choices=("humanoid", "lipm"),
        default="humanoid",
        help="the robot, or the point mass it stands for",
    )


def output_flags(parser: argparse.ArgumentParser) -> None:
    """Adds the flags that choose what is shown and written."""
    group = parser.add_argument_group("output")
    group.add_argument("--out", type=Path, help="folder for the results")
    group.add_argument(
        "--no-meshcat", action="store_true", help="no tab and no replay.html"
    )
    group.add_argument("--port", type=int, help="of Meshcat, from 7000 on")
    group.add_argument("--open", action="store_true", help="open the tab")
    group.add_argument(
        "--hold", action="store_true", help="keep the tab until Enter"
    )
    group.add_argument(
        "--realtime-rate",
        type=finite,
        default=0.0,
        help="1 is real time, 0 as fast as possible",
    )
    group.add_argument(
        "--graphviz", type=Path, help="write the diagram as SVG or dot"
    )


def scenario_from(args: argparse.Namespace) -> Scenario:
    """Returns the scenario that the flags ask for, checked."""
    scenario = load_scenario(
        args.scenario_name, args.scenario_file, args.scenario_text
    )
    for name in ("robot", "mechanisms", "duration", "seed"):
        value = getattr(args, name)
        if value is not None:
            setattr(scenario, name, value)
    scenario.validate()
    return scenario


def main_job(
    parser: argparse.ArgumentParser,
    argv: list[str] | None,
    make_scenario: Callable[[argparse.Namespace], Scenario],
) -> int:
    """Parses, checks, simulates, tells and writes; returns the exit code."""
    args = parser.parse_args(argv)
    try:
        scenario = make_scenario(args)
        folder = prepare_folder(args.out, scenario)
        meshcat = None
        if not args.no_meshcat and args.plant == "humanoid":
            meshcat, message = start_meshcat(args.port)
            if message:
                print(message)
        diagram = (
            LipmDiagram(scenario)
            if args.plant == "lipm"
            else HumanoidDiagram(scenario, meshcat)
        )
    except INPUT_ERRORS as error:
        print(f"{parser.prog}: {one_line(error)}", file=sys.stderr)
        return BAD_INPUT
    return _run(args, scenario, folder, diagram, meshcat)


def one_line(error: Exception) -> str:
    """The message of `error`, on one line."""
    return " ".join(str(error).split())


def _run(args, scenario, folder, diagram, meshcat) -> int:
    if args.graphviz:
        args.graphviz.write_text(diagram.GetGraphvizString(max_depth=2))
    if meshcat is not None:
        print(f"Meshcat: {meshcat.web_url()}", flush=True)
        set_scene(meshcat)
        if args.open:
            webbrowser.open(meshcat.web_url())
        start_recording(meshcat, live=args.open or args.hold)
    run = simulate(diagram, scenario.duration, args.realtime_rate)
    if meshcat is not None:
        write_replay(meshcat, folder / "replay.html")
    summary = write_run(folder, run, scenario, diagram)
    for line in telling_lines(run.logs, summary):
        print(line)
    names = ", ".join(sorted(path.name for path in folder.iterdir()))
    print(f"wrote {folder}/{{{names}}}")
    if args.hold and meshcat is not None:
        input(f"Meshcat: {meshcat.web_url()}  (Enter ends) ")
    return exit_code(run, summary)


def exit_code(run: Run, summary: dict) -> int:
    """0 if the robot recovered, else 1."""
    return RECOVERED if summary["recovered"] else FELL
