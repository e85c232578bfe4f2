"""The flags that the scripts share, and what they do."""

import argparse
import contextlib
import math
import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from pydrake.common.yaml import yaml_dump_typed
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from diagrams.humanoid import HumanoidDiagram
from diagrams.lipm import LipmDiagram
from diagrams.mechanisms import AS_IN_PARAMETERS, MECHANISMS
from diagrams.meshcat_scene import set_scene, start_meshcat
from diagrams.replay import start_recording
from diagrams.run_folder import prepare_folder, write_run
from diagrams.run_info import run_info
from diagrams.scenario import Scenario, load_scenario
from diagrams.simulation import advance, start
from diagrams.story import telling_lines
from diagrams.summary import summarize

RECOVERED, NOT_RECOVERED, BAD_INPUT = 0, 1, 2

# Help of --mechanisms, for a sweep and for a single run.
SEVERAL = f"to recover by: {', '.join(MECHANISMS)}"
ONE_OF = (
    f"{SEVERAL}, or {AS_IN_PARAMETERS}, what the scenario's parameters say "
    "(default: as in the scenario)"
)


def finite(text: str) -> float:
    """A finite number, for argparse."""
    with contextlib.suppress(ValueError):
        if math.isfinite(value := float(text)):
            return value
    raise argparse.ArgumentTypeError(f"{text!r}: must be a finite number")


class CommandLine(argparse.ArgumentParser):
    """Says on one line what is wrong with the command line."""

    def error(self, message: str) -> NoReturn:
        """Ends the program."""
        self.exit(BAD_INPUT, f"{self.prog}: {message}\n")


def scenario_flags(
    parser: argparse.ArgumentParser,
    name: str | None,
    mechanisms: str = SEVERAL,
) -> None:
    """Adds the flags that choose and change the scenario.

    `name` is the default scenario; None: one must be named.  `mechanisms` is
    the help of that flag.
    """
    group = parser.add_argument_group("scenario")
    group.add_argument(
        "--scenario_file", type=Path, help="YAML with named scenarios"
    )
    group.add_argument(
        "--scenario_name",
        default=name,
        required=name is None,
        help="one of the package, or of --scenario_file"
        + (f" (default: {name})" if name else ""),
    )
    group.add_argument(
        "--scenario_text", help="YAML that overrides single fields"
    )
    group.add_argument("--robot", help="a model's name, or a robot.yaml")
    group.add_argument("--mechanisms", help=mechanisms)
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
    group.add_argument(
        "--out",
        type=Path,
        help="folder for the results (default: runs/<date>_<time>_<scenario>)",
    )
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
        "--graphviz", type=Path, help="write the diagram as Graphviz dot"
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
        _check_output(args)
        scenario = make_scenario(args)
        meshcat = _meshcat(args)
        diagram = (
            LipmDiagram(scenario)
            if args.plant == "lipm"
            else HumanoidDiagram(scenario, meshcat)
        )
        simulator = start(diagram)
        folder = prepare_folder(args.out, args.scenario_name)
        if args.graphviz:
            _write_graph(diagram, args.graphviz)
    except (ValueError, OSError) as error:
        message = " ".join(str(error).split())
        print(f"{parser.prog}: {message}", file=sys.stderr)
        return BAD_INPUT
    return _run(args, scenario, folder, simulator, meshcat)


def _check_output(args: argparse.Namespace) -> None:
    """Raises ValueError for an output flag that can have no effect."""
    if args.realtime_rate < 0.0:
        raise ValueError(f"realtime_rate = {args.realtime_rate}: must be >= 0")
    for name in ("open", "hold"):
        if getattr(args, name) and (reason := _no_tab(args)):
            raise ValueError(
                f"{name} = True: must not come with {reason}, there is no tab"
            )


def _no_tab(args: argparse.Namespace) -> str:
    """The flag that leaves no tab to look at; empty if there is one."""
    if args.no_meshcat:
        return "--no-meshcat"
    return "--plant lipm" if args.plant == "lipm" else ""


def _write_graph(diagram: Diagram, path: Path) -> None:
    try:
        path.write_text(diagram.GetGraphvizString(max_depth=2))
    except OSError as error:
        raise ValueError(
            f"graphviz = {path}: must be a file to write to ({error.strerror})"
        ) from error


def _meshcat(args: argparse.Namespace) -> Meshcat | None:
    """The tab, unless it is not wanted or there is no robot to see."""
    if _no_tab(args):
        return None
    meshcat, message = start_meshcat(args.port)
    if message:
        print(message)
    print(f"Meshcat: {meshcat.web_url()}", flush=True)
    set_scene(meshcat)
    return meshcat


def _run(
    args: argparse.Namespace,
    scenario: Scenario,
    folder: Path,
    simulator: Simulator,
    meshcat: Meshcat | None,
) -> int:
    if meshcat is not None:
        if args.open:
            webbrowser.open(meshcat.web_url())
        start_recording(meshcat, live=args.open or args.hold)
    run = advance(simulator, scenario.duration, args.realtime_rate)
    summary = summarize(
        run.logs, run_info(scenario, run, args.plant, args.scenario_name)
    )
    for line in telling_lines(run.logs, summary):
        print(line)
    text = yaml_dump_typed(scenario, child_name=args.scenario_name)
    written = write_run(folder, run.logs, summary, text, meshcat)
    print(f"wrote {folder}/{{{', '.join(written)}}}", flush=True)
    if args.hold and meshcat is not None:
        _hold(meshcat)
    return RECOVERED if summary["recovered"] else NOT_RECOVERED


def _hold(meshcat: Meshcat) -> None:
    """Keeps the tab alive until Enter, Ctrl-C or the end of the input."""
    print(f"Meshcat: {meshcat.web_url()}  (Enter ends)", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        sys.stdin.readline()
