"""Flags shared by the scripts, and their implementation."""

import argparse
import contextlib
import functools
import math
import os
import sys
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NoReturn, TextIO

from pydrake.common.yaml import yaml_dump_typed
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from nadia_balance.core.bounds import check
from nadia_balance.core.mechanisms import MECHANISMS, NAMED
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.live import LiveSession, endless
from nadia_balance.diagrams.run_info import run_info
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.diagrams.simulation import (
    ClosedLoop,
    RecoveryWatch,
    advance,
    start,
)
from nadia_balance.diagrams.terrain import COURSES, FLAT
from nadia_balance.results.folder import (
    new_folder,
    start_recording,
    write_run,
)
from nadia_balance.results.live_page import LivePage
from nadia_balance.results.scene import set_scene, start_meshcat
from nadia_balance.results.story import telling_lines
from nadia_balance.results.summary import summarize
from nadia_balance.scripts import INTERRUPTED, interruptible

DONE, FAILED, BAD_INPUT, UNDECIDED = 0, 1, 2, 3
FASTEST = 1000  # largest real-time rate [-]
SHOWN_STEPS = 3  # steps simulated after a recovery, for the replay
CODES = {"recovered": DONE, "failed": FAILED, "undecided": UNDECIDED}
# Exit codes of main_job, for --help.
EXIT_CODES = (
    "1 did not (summary.json says why), 2 bad input, 3 undecided (the run was "
    "too short, or nobody was pushed), 130 Ctrl-C."
)

# Help of --mechanisms for a sweep, and for a single run.
SEVERAL = f"to recover by: {', '.join(MECHANISMS)}"
ONE_OF = f"to recover by: {', '.join(NAMED)} (default: as in the scenario)"


# Flags that have no effect with --live.
_NOT_LIVE = (
    *("no_meshcat", "out", "hold", "duration"),
    *("direction", "delta_v", "at", "shape", "random"),
)

Main = Callable[[list[str] | None], int]


def program(main: Main) -> Main:
    """Makes `main` end without a traceback at Ctrl-C and at OSErrors.

    Ctrl-C gives the exit code 130.  An OSError, such as a failed write, is
    reported in one line, with exit code 1.  A closed pipe of the output is
    ignored.
    """

    @functools.wraps(main)
    def run(argv: list[str] | None = None) -> int:
        try:
            with interruptible():
                return main(argv)
        except KeyboardInterrupt:
            return INTERRUPTED
        except OSError as error:
            name = main.__module__.rpartition(".")[2]
            complain(f"{name}.py", error)
            return FAILED
        finally:
            say()

    return run


def say(*lines: str) -> None:
    """Prints the lines; ignores a closed pipe."""
    _print(sys.stdout, lines)


def complain(name: str, error: Exception) -> None:
    """Prints the error on one line of stderr, after the program's `name`."""
    _print(sys.stderr, [f"{name}: {' '.join(str(error).split())}"])


def _print(stream: TextIO | None, lines: Sequence[str]) -> None:
    try:
        for line in lines:
            print(line, file=stream)
        if stream is not None:
            stream.flush()
    except OSError:  # a closed pipe, a full disk
        # Without this, Python flushes again at its exit and prints an error.
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), stream.fileno())


def finite(text: str) -> float:
    """Parses a finite number, for argparse."""
    with contextlib.suppress(ValueError):
        if math.isfinite(value := float(text)):
            return value
    raise argparse.ArgumentTypeError(f"{text!r}: must be a finite number")


def place(text: str) -> Path:
    """Parses a path; refuses an empty one, which is the present folder."""
    if not text or "\0" in text:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a path")
    return Path(text)


class CommandLine(argparse.ArgumentParser):
    """An ArgumentParser that reports errors on one line."""

    def parse_args(self, args=None, namespace=None):
        """Also refuses --flag=--, which argparse parses as an empty list."""
        found = super().parse_args(args, namespace)
        for name, value in vars(found).items():
            if value == []:
                self.error(f"argument --{name}: must have a value")
        return found

    def error(self, message: str) -> NoReturn:
        """Prints the error and exits."""
        complain(self.prog, ValueError(message))
        self.exit(BAD_INPUT)

    @contextlib.contextmanager
    def refusing(self) -> Iterator[None]:
        """Reports a ValueError or OSError of its block as bad input; exits."""
        try:
            yield
        except (ValueError, OSError) as error:
            self.error(str(error))


def scenario_flags(
    parser: argparse.ArgumentParser,
    name: str | None,
    mechanisms: str = SEVERAL,
) -> None:
    """Adds the flags that choose and change the scenario.

    `name` is the default scenario; None: the flag is required.  `mechanisms` is
    the help of that flag.
    """
    group = parser.add_argument_group("scenario")
    group.add_argument(
        "--scenario_file", type=place, help="YAML with named scenarios"
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
        help="realistic, or ideal: drives and feet as fast as need be",
    )
    group.add_argument(
        "--engine", help="drake, or mujoco: what moves the robot"
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
    """Adds the flags of Meshcat and of the output files."""
    group = parser.add_argument_group("output")
    group.add_argument(
        "--out",
        type=place,
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
        "--live",
        action="store_true",
        help="walk until it is stopped, pushed by the user; writes nothing",
    )
    group.add_argument(
        "--realtime-rate",
        type=finite,
        default=0.0,
        help="1 is real time, 0 as fast as possible",
    )
    group.add_argument(
        "--graphviz", type=place, help="write the diagram as Graphviz dot"
    )


def scenario_from(args: argparse.Namespace) -> Scenario:
    """Returns the checked scenario of the flags."""
    scenario = load_scenario(
        args.scenario_name,
        args.scenario_file,
        args.scenario_text,
        robot=args.robot,
        fidelity=args.fidelity,
        engine=args.engine,
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
    """Parses, checks, simulates, prints and writes.

    Returns the exit code; bad input exits.
    """
    args = parser.parse_args(argv)
    with parser.refusing():
        shown = _shows_meshcat(args)
        scenario = make_scenario(args)
        if args.live:
            scenario = endless(scenario)
        meshcat = _meshcat(args.port) if shown else None
        make = LipmDiagram if args.plant == "lipm" else HumanoidDiagram
        diagram = make(scenario, meshcat)
        if args.graphviz:
            _write_graph(diagram, args.graphviz)
        if not args.live:
            simulator = start(diagram)
            folder = new_folder(args.out, args.scenario_name)
    for remark in diagram.robot.remarks:
        print(f"robot: {remark}")
    if args.live:
        return _live(diagram, meshcat, args)
    if meshcat is not None:
        if args.open:
            webbrowser.open(meshcat.web_url())
        start_recording(meshcat, live=args.open or args.hold)
    run = advance(
        simulator,
        scenario.duration,
        args.realtime_rate,
        until=RecoveryWatch(diagram, more_steps=SHOWN_STEPS),
    )
    info = run_info(scenario, run, args.plant, args.scenario_name)
    summary = summarize(run, info)
    text = yaml_dump_typed(scenario, child_name=args.scenario_name)
    try:
        written = write_run(folder, run.logs, summary, text, meshcat)
    finally:
        say(*telling_lines(run.logs, summary))
    say(f"wrote {folder}/{{{', '.join(written)}}}")
    if args.hold:
        _hold(meshcat)
    return INTERRUPTED if run.interrupted else CODES[summary["outcome"]]


def _shows_meshcat(args: argparse.Namespace) -> bool:
    """True if Meshcat is shown: unless --no-meshcat, or --plant lipm.

    With --live it is always shown.

    Raises:
        ValueError: an output flag has no effect.
    """
    if not 0.0 <= args.realtime_rate <= FASTEST:
        raise ValueError(
            f"realtime_rate = {args.realtime_rate}: must be in [0, {FASTEST}]"
        )
    if args.live:
        for name in _NOT_LIVE:
            if (value := getattr(args, name, None)) not in (None, False):
                raise ValueError(f"{name} = {value}: must not come with --live")
        return True
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
    """Starts Meshcat with its scene and prints its address."""
    meshcat, message = start_meshcat(port)
    say(*filter(None, [message]), f"Meshcat: {meshcat.web_url()}")
    set_scene(meshcat)
    return meshcat


def _live(diagram: ClosedLoop, meshcat: Meshcat, args) -> int:
    """Lets the user push the robot until it is stopped."""
    session = LiveSession(diagram, meshcat, say, args.realtime_rate or 1.0)
    with LivePage(meshcat) as page:
        say(f"Live: {page.url}  (Stop in the page, or Ctrl-C, ends)")
        if args.open:
            webbrowser.open(page.url)
        interrupted = session.run(page.show)
    return INTERRUPTED if interrupted else DONE


def _hold(meshcat: Meshcat) -> None:
    """Keeps Meshcat alive until Enter, Ctrl-C or the end of the input."""
    say(f"Meshcat: {meshcat.web_url()}  (Enter ends)")
    with contextlib.suppress(KeyboardInterrupt):
        sys.stdin.readline()
