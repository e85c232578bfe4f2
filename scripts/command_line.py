"""Flags shared by the scripts, and their implementation."""

import argparse
import contextlib
import functools
import io
import math
import os
import signal
import sys
import webbrowser
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn, TextIO

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.diagrams import closed_loop, live, simulation, terrain
from nadia_balance.diagrams.scenario import (
    SENSORS,
    Command,
    Scenario,
    load_scenario,
)
from nadia_balance.results import pages
from nadia_balance.results.folder import new_folder
from nadia_balance.results.story import chapter_words, telling_lines
from nadia_balance.results.summary import failure
from nadia_balance.view.scene import set_scene, start_meshcat

DONE, FAILED, BAD_INPUT, UNDECIDED, UNWRITTEN = range(5)
INTERRUPTED = 130  # by Ctrl-C, or SIGTERM
# What reading a broken file of numbers raises.
BROKEN = EOFError, LookupError, TypeError, ValueError, zipfile.BadZipFile
CHAPTER = 120.0  # of a longer run, only the last is written [s]
SHOWN_STEPS = 3  # steps simulated after a recovery, for the replay
CODES = {"recovered": DONE, "failed": FAILED, "undecided": UNDECIDED}
# Exit codes of main_job, for --help.
EXIT_CODES = (
    "1 did not (summary.json says why), 2 bad input, 3 undecided (the run was "
    "too short, or nobody was pushed), 4 cannot write, 130 Ctrl-C or SIGTERM."
)

MECHANISMS = f"to recover by: {', '.join(NAMED)}"  # help of --mechanisms

# Flags that have no effect with --live.
_NOT_LIVE = """no_meshcat out hold duration command direction delta_v at shape
    random controller""".split()


def program(main: Callable[..., int]) -> Callable[..., int]:
    """Makes the `main` of a script end without a traceback, by its exit code.

    Ctrl-C and SIGTERM give the exit code 130.  An OSError, such as a failed
    write, is reported in one line, with exit code 4.  A closed pipe is ignored.
    """

    @functools.wraps(main)
    def run(argv: list[str] | None = None) -> int:
        try:
            # Unless they are ignored, or Python's own handler raises it.
            raises = signal.default_int_handler, signal.SIG_DFL
            with simulation.at_ctrl_c(*raises):
                return main(argv)
        except KeyboardInterrupt:
            return INTERRUPTED
        except OSError as error:
            complain(Path(main.__code__.co_filename).name, error)
            return UNWRITTEN
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
        value = float(text)
        if math.isfinite(value) and text.isascii() and "_" not in text:
            return value
    raise argparse.ArgumentTypeError(f"{text!r}: must be a finite number")


def velocity(text: str) -> tuple[float, ...]:
    """Parses a velocity command: three numbers, for argparse."""
    numbers = tuple(finite(word) for word in text.replace(",", " ").split())
    if len(numbers) != 3:
        why = "must be forward, left [m/s] and turn [rad/s]"
        raise argparse.ArgumentTypeError(f"{text!r}: {why}")
    return numbers


def place(text: str) -> Path:
    """Parses a path; refuses an empty one, which is the present folder."""
    if not text or "\0" in text:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a path")
    return Path(text)


class CommandLine(argparse.ArgumentParser):
    """An ArgumentParser that reports errors on one line."""

    def __init__(self, file: str, about: str, codes: str, **more):
        """Builds the parser of the program in `file`.

        Its help has `about`, of which only the first line unless `more` has a
        formatter, and the exit `codes`.
        """
        about = about if more else about.partition("\n")[0]
        name, codes = Path(file).name, f"Exit code: {codes}" * bool(codes)
        super().__init__(name, description=about, epilog=codes, **more)

    def parse_args(self, args=None, namespace=None):
        """Refuses --flag=-- (an empty list), and a folder that is gone."""
        found = super().parse_args(args, namespace)
        try:
            os.getcwd()
        except OSError:
            self.error("present folder: must exist")
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


def scenario_flags(parser: argparse.ArgumentParser, name: str | None) -> None:
    """Adds the flags that choose and change the scenario, or the controller.

    `name` is what its help calls the default; None: the flag is required.
    """
    add = parser.add_argument_group("scenario").add_argument
    default = f" (default: {name})" if name else ""
    add("--scenario_file", type=place, help="YAML with named scenarios")
    about = f"one of the package, or of --scenario_file{default}"
    add("--scenario_name", required=not name, help=about)
    add("--scenario_text", help="YAML that overrides single fields")
    add("--robot", help="a model's name, or a robot.yaml")
    about = "realistic, or ideal: drives and feet as fast as need be"
    add("--fidelity", help=about)
    add("--engine", help="drake, or mujoco: what moves the robot")
    about = "whether it is given the state, or estimates it from noisy sensors"
    add("--sensors", help=f"{', '.join(SENSORS)}: {about}")
    add("--mechanisms", help=MECHANISMS)
    about = "walk at this velocity, in the place of any steps: forward, left "
    about += '[m/s], turn [rad/s], such as "0.3 0 0.2"'
    add("--command", type=velocity, metavar="V", help=about)
    about = "push.py takes the scenario of this name, if there is one"
    places = ", ".join((terrain.FLAT, *terrain.COURSES))
    add("--terrain", help=f"{places}, or a YAML file of regions; {about}")
    add("--duration", type=finite, help="[s]")
    add("--seed", type=int, help="of the noise, the biases, 10 um of the start")
    which = {"choices": ("humanoid", "lipm"), "default": "humanoid"}
    about = "the robot, or the point mass it stands for"
    add("--plant", **which, help=about)
    about = "file of a learned policy that walks instead (docs/policy.md)"
    add("--controller", type=place, metavar="ONNX", help=about)


def _output_flags(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("output").add_argument
    about = "folder for the results (default: runs/<date>_<time>_<scenario>)"
    add("--out", type=place, help=about)
    add("--no-meshcat", action="store_true", help="and no replay.html")
    add("--port", type=int, help="of Meshcat, from 7000 on")
    add("--open", action="store_true", help="show Meshcat in a browser")
    add("--hold", action="store_true", help="keep Meshcat until Enter")
    about = "stand until it is told to walk, or pushed, in the page of a "
    about += "browser; writes nothing"
    add("--live", action="store_true", help=about)


def scenario_from(args: argparse.Namespace) -> Scenario:
    """Returns the checked scenario of the flags."""
    same = "robot fidelity engine sensors mechanisms duration seed".split()
    changes = {name: getattr(args, name) for name in same}
    file, text = args.scenario_file, args.scenario_text
    scenario = load_scenario(args.scenario_name, file, text, **changes)
    if args.command is not None:
        scenario = _walking_by(args.command, scenario)
    if scenario.robot.endswith((".yaml", ".yml")):
        # It may be read again, or simulated, in another folder.
        robot = str(Path(scenario.robot).resolve())
        scenario = scenario.changed(robot=robot)
    if args.terrain is not None:
        named = replace(scenario.terrain, name=args.terrain)
        scenario = scenario.changed(terrain=named)
    return scenario


def _walking_by(velocity: Sequence[float], scenario: Scenario) -> Scenario:
    """With this command in the place of the scenario's steps.

    Raises ValueError: --scenario_text has steps.
    """
    for name in ("num_steps", "steps", "footholds"):
        if scenario.sources.get(f"gait.{name}") == "scenario_text":
            value = getattr(scenario.gait, name)
            raise ValueError(
                f"gait.{name} = {value!r}: must not come with commands"
            )
    forward, left, turn = velocity
    command = Command(forward=forward, left=left, turn=turn)
    return scenario.walking_by(command)


def main_job(parser: CommandLine, argv, make_scenario: Callable) -> int:
    """Parses, simulates, prints and writes; returns the exit code.

    `make_scenario` returns the Scenario of the parsed `argv`.
    """
    _output_flags(parser)
    args = parser.parse_args(argv)
    with contextlib.ExitStack() as held:
        with parser.refusing():
            shown = _shows_meshcat(args)
            scenario = make_scenario(args)
            if args.live:
                scenario = live.endless(scenario)
            meshcat = _meshcat(args.port) if shown else None
            system = args.plant, policy_of(args), meshcat
            diagram = simulation.closed_loop(scenario, *system)
            if not args.live:
                simulator = simulation.start(diagram)
                folder = new_folder(args.out, args.scenario_name, pages.FILES)
                folder = held.enter_context(folder)
        say(*(f"robot: {remark}" for remark in diagram.remarks()))
        if args.live:
            return _live(diagram, meshcat, args)
        return _run(simulator, meshcat, folder, args)


def _run(simulator: Simulator, meshcat, folder: Path, args) -> int:
    """Simulates, by chapters, prints and writes; returns the exit code."""
    diagram = simulator.get_system()
    scenario = diagram.scenario
    if meshcat is not None and args.open:
        webbrowser.open(meshcat.web_url())
    watch = simulation.RecoveryWatch(diagram, more_steps=SHOWN_STEPS)
    end = 0.0
    while True:
        if meshcat is not None:
            pages.start_recording(meshcat, live=args.open or args.hold)
        end = min(end + CHAPTER, scenario.duration)
        run = simulation.advance(simulator, end, until=watch)
        summary = run.summary | {"scenario": args.scenario_name}
        if run.until or failure(run) or end == scenario.duration:
            break
        say(f"t={end:.0f} s  {chapter_words(summary)}")
        diagram.forget_logs(simulator.get_mutable_context())
    text = scenario.as_yaml(args.scenario_name)
    try:
        written = pages.write_run(folder, run.logs, summary, text, meshcat)
    finally:
        say(*telling_lines(run.logs, summary))
    say(f"wrote {folder}/{{{', '.join(written)}}}")
    if args.hold:
        _hold(meshcat)
    return INTERRUPTED if run.interrupted else CODES[summary["outcome"]]


def policy_of(args: argparse.Namespace) -> str:
    """Returns the file of the learned policy, or "" for our controller.

    Raises ValueError: a flag is of our own controller only.
    """
    if args.controller is None:
        return ""
    if args.plant == "lipm" or args.mechanisms is not None:
        why = "must not come with plant = lipm or mechanisms"
        raise ValueError(f"controller = {str(args.controller)!r}: {why}")
    return str(args.controller.resolve())


def _shows_meshcat(args: argparse.Namespace) -> bool:
    """True with Meshcat; ValueError: an output flag has no effect."""
    if args.live:
        for name in _NOT_LIVE:
            if (value := getattr(args, name, None)) not in (None, False):
                raise ValueError(f"{name} = {value}: must not come with --live")
        return True
    reason = "--plant lipm" if args.plant == "lipm" else ""
    reason = "--no-meshcat" if args.no_meshcat else reason
    for name in ("open", "hold", "port"):
        value = getattr(args, name)
        if reason and value not in (None, False):
            why = f"must not come with {reason}: no Meshcat"
            raise ValueError(f"{name} = {value}: {why}")
    return not reason


def _meshcat(port: int | None) -> Meshcat:
    meshcat, message = start_meshcat(port)
    say(*filter(None, [message]), f"Meshcat: {meshcat.web_url()}")
    set_scene(meshcat)
    return meshcat


def _live(diagram: closed_loop.ClosedLoop, meshcat: Meshcat, args) -> int:
    session = live.LiveSession(diagram, meshcat, say)
    with pages.LivePage(meshcat) as page:
        say(f"Live: {page.url}  (Stop in the page, or Ctrl-C, ends)")
        if args.open:
            webbrowser.open(page.url)
        interrupted = session.run(page.show)
    return INTERRUPTED if interrupted else DONE


def _hold(meshcat: Meshcat) -> None:
    """Keeps Meshcat alive until Enter, Ctrl-C or the end of the input."""
    say(f"Meshcat: {meshcat.web_url()}  (Enter ends)")
    with contextlib.suppress(KeyboardInterrupt):
        (sys.stdin or io.StringIO()).readline()  # it may be closed
