"""The flags that the scripts share, and what they do."""

import argparse
import contextlib
import math
import sys
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

from pydrake.common.yaml import yaml_dump_typed
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from nadia_balance.core.bounds import check
from nadia_balance.core.courses import COURSES
from nadia_balance.core.mechanisms import MECHANISMS, NAMED
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.run_info import run_info
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import advance, start
from nadia_balance.diagrams.terrain import FLAT
from nadia_balance.results.folder import (
    prepare_folder,
    start_recording,
    write_run,
)
from nadia_balance.results.scene import set_scene, start_meshcat
from nadia_balance.results.story import telling_lines
from nadia_balance.results.summary import summarize

RECOVERED, NOT_RECOVERED, BAD_INPUT = 0, 1, 2

# Help of --mechanisms, for a sweep and for a single run.
SEVERAL = f"to recover by: {', '.join(MECHANISMS)}"
ONE_OF = f"to recover by: {', '.join(NAMED)} (default: as in the scenario)"


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

    @contextlib.contextmanager
    def refusing(self) -> Iterator[None]:
        """Takes errors of the input in this block for its end."""
        try:
            yield
        except (ValueError, OSError) as error:
            self.error(" ".join(str(error).split()))


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
    group.add_argument(
        "--fidelity",
        help="realistic, or ideal: any torque at any speed, at once",
    )
    group.add_argument("--mechanisms", help=mechanisms)
    group.add_argument(
        "--terrain",
        help=f"{', '.join((FLAT, *COURSES))}, or a YAML file of regions; "
        "push.py takes the scenario of this name, if there is one",
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
    group.add_argument(
        "--out",
        type=Path,
        help="folder for the results (default: runs/<date>_<time>_<scenario>)",
    )
    group.add_argument(
        "--no-meshcat", action="store_true", help="and no replay.html"
    )
    group.add_argument("--port", type=int, help="of Meshcat, from 7000 on")
    group.add_argument(
        "--open", action="store_true", help="show Meshcat in a browser"
    )
    group.add_argument(
        "--hold", action="store_true", help="keep Meshcat until Enter"
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
        args.scenario_name,
        args.scenario_file,
        args.scenario_text,
        robot=args.robot,
        fidelity=args.fidelity,
        mechanisms=args.mechanisms,
        duration=args.duration,
        seed=args.seed,
    )
    if args.terrain is not None:
        scenario.terrain.name = args.terrain
        check(scenario)
    return scenario


def main_job(
    parser: CommandLine,
    argv: list[str] | None,
    make_scenario: Callable[[argparse.Namespace], Scenario],
) -> int:
    """Parses, checks, simulates, tells and writes.

    Returns the exit code; bad input ends the program.
    """
    args = parser.parse_args(argv)
    with parser.refusing():
        shown = _shows_meshcat(args)
        scenario = make_scenario(args)
        meshcat = _meshcat(args.port) if shown else None
        diagram = (
            LipmDiagram(scenario)
            if args.plant == "lipm"
            else HumanoidDiagram(scenario, meshcat)
        )
        simulator = start(diagram)
        folder = prepare_folder(args.out, args.scenario_name)
        if args.graphviz:
            _write_graph(diagram, args.graphviz)
    if meshcat is not None:
        if args.open:
            webbrowser.open(meshcat.web_url())
        start_recording(meshcat, live=args.open or args.hold)
    run = advance(simulator, scenario.duration, args.realtime_rate)
    info = run_info(scenario, run, args.plant, args.scenario_name)
    summary = summarize(run, info)
    for line in telling_lines(run.logs, summary):
        print(line)
    text = yaml_dump_typed(scenario, child_name=args.scenario_name)
    written = write_run(folder, run.logs, summary, text, meshcat)
    print(f"wrote {folder}/{{{', '.join(written)}}}", flush=True)
    if args.hold:
        _hold(meshcat)
    return RECOVERED if summary["recovered"] else NOT_RECOVERED


def _shows_meshcat(args: argparse.Namespace) -> bool:
    """Whether there is Meshcat: it is wanted, and there is a robot to see.

    Raises:
        ValueError: an output flag can have no effect.
    """
    if args.realtime_rate < 0.0:
        raise ValueError(f"realtime_rate = {args.realtime_rate}: must be >= 0")
    reason = "--plant lipm" if args.plant == "lipm" else ""
    reason = "--no-meshcat" if args.no_meshcat else reason
    for name in ("open", "hold"):
        if reason and getattr(args, name):
            raise ValueError(
                f"{name} = True: must not come with {reason}: no Meshcat"
            )
    return not reason


def _write_graph(diagram: Diagram, path: Path) -> None:
    try:
        path.write_text(diagram.GetGraphvizString(max_depth=2))
    except OSError as error:
        raise ValueError(
            f"graphviz = {path}: must be a file to write to ({error.strerror})"
        ) from error


def _meshcat(port: int | None) -> Meshcat:
    """Meshcat with its scene; says where it is."""
    meshcat, message = start_meshcat(port)
    if message:
        print(message)
    print(f"Meshcat: {meshcat.web_url()}", flush=True)
    set_scene(meshcat)
    return meshcat


def _hold(meshcat: Meshcat) -> None:
    """Keeps Meshcat alive until Enter, Ctrl-C or the end of the input."""
    print(f"Meshcat: {meshcat.web_url()}  (Enter ends)", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        sys.stdin.readline()
