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
from typing import Any, NoReturn, TextIO, cast

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.diagrams import (
    live,
    own_blocks,
    simulation,
    terrain,
    verdict,
)
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.scenario import (
    SENSORS,
    Command,
    Scenario,
    load_scenario,
)
from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.yaml_reader import one_line
from nadia_balance.policy.contract import Contract, is_text
from nadia_balance.policy.controller import PolicyController
from nadia_balance.results import pages, story
from nadia_balance.results.folder import new_folder
from nadia_balance.results.summary import failure
from nadia_balance.scripts.progress import progress
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


def program(main: Callable[..., int]) -> Callable[..., int]:
    """Makes the `main` of a script end without a traceback, by its exit code.

    Ctrl-C and SIGTERM give the exit code 130.  An OSError, such as a failed
    write, is reported in one line, with exit code 4.  A closed pipe is ignored.

    Args:
        main: takes the command line, or None; returns the exit code.

    Returns:
        The same, decorated.
    """

    @functools.wraps(main)
    def run(argv: list[str] | None = None) -> int:
        try:
            # Unless they are ignored, or Python's own handler raises it.
            with simulation.at_ctrl_c(
                signal.default_int_handler, usual=signal.SIG_DFL
            ):
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
    """Prints lines; ignores a closed pipe.

    Args:
        *lines: what is printed.
    """
    _print(sys.stdout, lines)


def complain(name: str, error: Exception) -> None:
    """Prints an error on one line of stderr.

    Args:
        name: of the program.
        error: what was wrong.
    """
    _print(sys.stderr, [f"{name}: {one_line(error)}"])


def _print(stream: TextIO | None, lines: Sequence[str]) -> None:
    try:
        for line in lines:
            print(line, file=stream)
        if stream is not None:
            stream.flush()
    except OSError:  # a closed pipe, a full disk
        # Without this, Python flushes again at its exit and prints an error.
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), cast(TextIO, stream).fileno())


def finite(text: str) -> float:
    """Parses a finite number.

    Args:
        text: of a flag.

    Returns:
        The number.

    Raises:
        ArgumentTypeError: it is none.
    """
    with contextlib.suppress(ValueError):
        value = float(text)
        if math.isfinite(value) and text.isascii() and "_" not in text:
            return value
    raise argparse.ArgumentTypeError(f"{text!r}: must be a finite number")


def velocity(text: str) -> tuple[float, ...]:
    """Parses a velocity command.

    Args:
        text: of a flag, three numbers.

    Returns:
        Velocities forward, left [m/s] and of turning [rad/s].

    Raises:
        ArgumentTypeError: these are not three finite numbers.
    """
    return three(text, "forward, left [m/s] and turn [rad/s]")


def three(text: str, names: str) -> tuple[float, ...]:
    """Parses three numbers.

    Args:
        text: of a flag.
        names: of the numbers.

    Returns:
        The numbers.

    Raises:
        ArgumentTypeError: these are not three finite numbers.
    """
    numbers = tuple(finite(word) for word in text.replace(",", " ").split())
    if len(numbers) != 3:
        raise argparse.ArgumentTypeError(f"{text!r}: must be {names}")
    return numbers


def place(text: str) -> Path:
    """Parses a path; refuses an empty one, which is the present folder.

    Args:
        text: of a flag.

    Returns:
        The path.

    Raises:
        ArgumentTypeError: it is none.
    """
    if not text or "\0" in text:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a path")
    return Path(text)


class CommandLine(argparse.ArgumentParser):
    """An ArgumentParser that reports errors on one line."""

    def __init__(self, file: str, about: str | None, codes: str, **more: Any):
        """Builds the parser of a program.

        Args:
            file: of the program, which is called by its name.
            about: its docstring, of which the help has only the first line
                unless `more` has a formatter.
            codes: the exit codes, for the help.
            **more: arguments of ArgumentParser.
        """
        super().__init__(
            Path(file).name,
            description=about if more else (about or "").partition("\n")[0],
            epilog=f"Exit code: {codes}" if codes else "",
            **more,
        )
        # Flags that have no effect with --live.
        self.not_live: list[argparse.Action] = []

    def refuse_with_live(self, args: argparse.Namespace) -> None:
        """Refuses the flags that have no effect with --live.

        Args:
            args: what was parsed.

        Raises:
            ValueError: such a flag was given.
        """
        for flag in self.not_live:
            value = getattr(args, flag.dest)
            require(
                value == flag.default,
                f"{flag.dest} = {value}: must not come with --live",
            )

    def parse_args(  # type: ignore[override]
        self,
        args: Sequence[str] | None = None,
        namespace: argparse.Namespace | None = None,
    ) -> argparse.Namespace:
        """Refuses --flag=-- (an empty list), and a folder that is gone.

        Args:
            args: the words; None: those of the process.
            namespace: as of ArgumentParser.

        Returns:
            The values of the flags.
        """
        parsed = super().parse_args(args, namespace)
        try:
            os.getcwd()
        except OSError:
            self.error("present folder: must exist")
        for name, value in vars(parsed).items():
            if value == []:
                self.error(f"argument --{name}: must have a value")
        return parsed

    def error(self, message: str) -> NoReturn:
        """Prints an error and exits.

        Args:
            message: without the program's name.
        """
        complain(self.prog, ValueError(message))
        self.exit(BAD_INPUT)

    @contextlib.contextmanager
    def refusing(self) -> Iterator[None]:
        """Reports a ValueError or OSError of its block as bad input; exits.

        Yields:
            Nothing.
        """
        try:
            yield
        except (ValueError, OSError) as error:
            self.error(str(error))


def scenario_flags(parser: CommandLine, name: str | None) -> None:
    """Adds the flags that choose and change the scenario, or the controller.

    Args:
        parser: of the program.
        name: what its help calls the default; None: the flag is required.
    """
    group = parser.add_argument_group("scenario")
    group.add_argument(
        "--scenario_file", type=place, help="YAML with named scenarios"
    )
    group.add_argument(
        "--scenario_name",
        required=not name,
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
    group.add_argument(
        "--sensors",
        help=f"{', '.join(SENSORS)}: whether it is given the state, or "
        "estimates it from noisy sensors",
    )
    group.add_argument("--mechanisms", help=MECHANISMS)
    parser.not_live.append(
        group.add_argument(
            "--command",
            type=velocity,
            metavar="V",
            help="walk at this velocity, in the place of any steps: forward, "
            'left [m/s], turn [rad/s], such as "0.3 0 0.2"',
        )
    )
    group.add_argument(
        "--terrain",
        help=f"{', '.join((terrain.FLAT, *terrain.COURSES))}, or a YAML file "
        "of regions; push.py takes the scenario of this name, if there is one",
    )
    parser.not_live.append(
        group.add_argument("--duration", type=finite, help="[s]")
    )
    group.add_argument(
        "--seed", type=int, help="of the noise, the biases, 10 um of the start"
    )
    group.add_argument(
        "--plant",
        choices=simulation.PLANTS,
        default="humanoid",
        help="the robot, or the point mass it stands for",
    )
    group.add_argument(
        "--controller",
        type=place,
        metavar="ONNX",
        help="file of a learned policy that walks instead (docs/policy.md), or "
        "module:Class of a controller of yours",
    )
    group.add_argument(
        "--contract",
        action="append",
        metavar="FILE",
        help="what the policy was trained with, if no file beside it says so: "
        "a deploy.yaml or a policy.yaml, or single fields, such as "
        '"{action_scale: [0.5]}"; may come several times',
    )
    group.add_argument(
        "--block",
        action="append",
        metavar="ROLE=MODULE:CLASS",
        help="a block of yours in the place of ours (docs/own_blocks.md); may "
        "come several times",
    )


def _output_flags(parser: CommandLine) -> None:
    group = parser.add_argument_group("output")
    parser.not_live += [
        group.add_argument(
            "--out",
            type=place,
            help="folder for the results (default: "
            "runs/<date>_<time>_<scenario>)",
        ),
        group.add_argument(
            "--no-meshcat", action="store_true", help="and no replay.html"
        ),
    ]
    group.add_argument("--port", type=int, help="of Meshcat, from 7000 on")
    group.add_argument(
        "--open", action="store_true", help="show Meshcat in a browser"
    )
    parser.not_live.append(
        group.add_argument(
            "--hold", action="store_true", help="keep Meshcat until Enter"
        )
    )
    group.add_argument(
        "--live",
        action="store_true",
        help="stand until it is told to walk, or pushed, in the page of a "
        "browser; writes nothing",
    )


def scenario_from(args: argparse.Namespace) -> Scenario:
    """The checked scenario of the flags.

    Args:
        args: those of scenario_flags.

    Returns:
        The scenario.

    Raises:
        ValueError: a flag is invalid; it is named.
    """
    scenario = load_scenario(
        args.scenario_name,
        args.scenario_file,
        args.scenario_text,
        robot=args.robot,
        fidelity=args.fidelity,
        engine=args.engine,
        sensors=args.sensors,
        mechanisms=args.mechanisms,
        duration=args.duration,
        seed=args.seed,
    )
    if args.command is not None:
        forward, left, turn = args.command
        scenario = scenario.walking_by(
            Command(forward=forward, left=left, turn=turn)
        )
    if scenario.robot.endswith((".yaml", ".yml")):
        # It may be read again, or simulated, in another folder.
        scenario = replace(scenario, robot=str(Path(scenario.robot).resolve()))
    if args.terrain is not None:
        scenario = scenario.changed(
            terrain=replace(scenario.terrain, name=args.terrain)
        )
    return scenario


def main_job(
    parser: CommandLine,
    argv: list[str] | None,
    make_scenario: Callable[[argparse.Namespace], Scenario],
) -> int:
    """Parses, simulates, prints and writes.

    Args:
        parser: with the flags of the scenario; those of the output are added.
        argv: the command line; None: that of the process.
        make_scenario: returns the scenario of the parsed flags; a ValueError
            of it is bad input.

    Returns:
        The exit code.
    """
    _output_flags(parser)
    args = parser.parse_args(argv)
    with contextlib.ExitStack() as stack:
        with parser.refusing():
            is_shown = _shows_meshcat(parser, args)
            scenario = make_scenario(args)
            if args.live:
                scenario = live.endless(scenario)
            controller, contract_texts = controller_of(args), contract_of(args)
            blocks = own_blocks.parsed_blocks(args.block or ())
            # Last, as others see it.
            meshcat = _meshcat(args.port) if is_shown else None
            diagram = simulation.closed_loop(
                scenario,
                args.plant,
                controller,
                meshcat,
                blocks=blocks,
                contract=contract_texts,
            )
            contract = _contract(diagram)
            if not args.live:
                simulator = simulation.start(diagram)
                folder = stack.enter_context(
                    new_folder(args.out, args.scenario_name, pages.FILES)
                )
        say(*(f"robot: {remark}" for remark in diagram.remarks()))
        if contract:
            say(*(f"policy: {line}" for line in contract.lines()))
        return (
            _live(diagram, cast(Meshcat, meshcat), args)
            if args.live
            else _run(simulator, meshcat, folder, args)
        )


def _run(
    simulator: Simulator,
    meshcat: Meshcat | None,
    folder: Path,
    args: argparse.Namespace,
) -> int:
    """Simulates, by chapters, prints and writes; returns the exit code."""
    diagram = cast(ClosedLoop, simulator.get_system())
    scenario, contract = diagram.scenario, _contract(diagram)
    if meshcat is not None and args.open:
        webbrowser.open(meshcat.web_url())
    end = 0.0
    with progress(diagram, sys.stderr) as show:
        watch = verdict.RecoveryWatch(diagram, more_steps=SHOWN_STEPS)

        def until(context: Context) -> bool:
            show(context)
            return watch(context)

        while True:
            if meshcat is not None:
                pages.start_recording(meshcat, live=args.open or args.hold)
            end = min(end + CHAPTER, scenario.duration)
            run = simulation.advance(simulator, end, until=until)
            summary = run.summary | {"scenario": args.scenario_name}
            if run.until or failure(run) or end == scenario.duration:
                break
            say(f"t={end:.0f} s  {story.chapter_words(summary)}")
            diagram.forget_logs(simulator.get_mutable_context())
    # A first Ctrl-C does not lose what is being written.
    with simulation.until_ctrl_c() as pressed:
        try:
            files = pages.write_run(
                folder,
                run.logs,
                summary,
                scenario.as_yaml(args.scenario_name),
                meshcat,
                contract.as_yaml() if contract else "",
            )
        finally:
            say(*story.telling_lines(run.logs, summary))
        say(f"wrote {folder}/{{{', '.join(files)}}}")
        if pressed():
            return INTERRUPTED
    if meshcat is not None and args.hold:
        _hold(meshcat)
    return INTERRUPTED if run.interrupted else CODES[summary["outcome"]]


def controller_of(args: argparse.Namespace) -> str:
    """The file of the learned policy, or a class; "" for our controller.

    Args:
        args: those of scenario_flags.

    Returns:
        Its path, or `module:Class`.

    Raises:
        ValueError: a flag is of our own controller only.
    """
    if args.controller is None:
        return ""
    name = str(args.controller)
    is_class = own_blocks.names_class(name)
    require(
        args.plant != "lipm" and (is_class or args.mechanisms is None),
        f"controller = {name!r}: must not come with plant = lipm or mechanisms",
    )
    return name if is_class else str(args.controller.resolve())


def contract_of(args: argparse.Namespace) -> tuple[str, ...]:
    """The files and fields of the contract of a policy.

    Args:
        args: those of scenario_flags.

    Returns:
        Absolute paths, and YAML in braces, in their order.

    Raises:
        ValueError: there is no policy.
    """
    given = args.contract or []
    require("" not in given, "contract = '': must be a file, or YAML in braces")
    policy = args.controller is not None and not own_blocks.names_class(
        str(args.controller)
    )
    require(
        policy or not given,
        f"contract = {', '.join(given)}: must come with the ONNX file of a "
        "policy as --controller",
    )
    return tuple(
        text if is_text(text) else str(Path(text).resolve()) for text in given
    )


def _contract(diagram: ClosedLoop) -> Contract | None:
    controller = diagram.controller
    if not isinstance(controller, PolicyController):
        return None
    return controller.contract


def _shows_meshcat(parser: CommandLine, args: argparse.Namespace) -> bool:
    """True with Meshcat; ValueError: an output flag has no effect."""
    if args.live:
        parser.refuse_with_live(args)
        return True
    if not args.no_meshcat and args.plant != "lipm":
        return True
    reason = "--no-meshcat" if args.no_meshcat else "--plant lipm"
    for name in ("open", "hold", "port"):
        value = getattr(args, name)
        require(
            value in (None, False),
            f"{name} = {value}: must not come with {reason}: no Meshcat",
        )
    return False


def _meshcat(port: int | None) -> Meshcat:
    meshcat, message = start_meshcat(port)
    say(*filter(None, [message]), f"Meshcat: {meshcat.web_url()}")
    set_scene(meshcat)
    return meshcat


def _live(
    diagram: ClosedLoop, meshcat: Meshcat, args: argparse.Namespace
) -> int:
    session = live.LiveSession(diagram, meshcat, say)
    with pages.LivePage(meshcat) as page:
        say(f"Live: {page.url}  (Stop in the page, or Ctrl-C, ends)")
        if args.open:
            webbrowser.open(page.url)
        is_interrupted = session.run(page.show)
    return INTERRUPTED if is_interrupted else DONE


def _hold(meshcat: Meshcat) -> None:
    """Keeps Meshcat alive until Enter, Ctrl-C or the end of the input."""
    say(f"Meshcat: {meshcat.web_url()}  (Enter ends)")
    with contextlib.suppress(KeyboardInterrupt):
        (sys.stdin or io.StringIO()).readline()  # it may be closed
