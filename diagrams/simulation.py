"""Closed loops of scenarios, and their simulation."""

import contextlib
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any, cast

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, System

from nadia_balance.diagrams import own_blocks
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import Command, Scenario, load_scenario
from nadia_balance.diagrams.verdict import (
    Monitor,
    RecoveryWatch,
    push_signal,
    run_info,
)
from nadia_balance.parameters.bounds import check_number, require
from nadia_balance.parameters.yaml_reader import error_text
from nadia_balance.policy.controller import PolicyController
from nadia_balance.results.summary import SLOWEST, Run
from nadia_balance.robot.model import load_robot

PUSH = ("direction", "delta_v", "at", "shape")  # arguments of with_push
PLANTS = ("humanoid", "lipm")
WALKS_STEADILY = 8  # steps after which a policy does
LONGEST = 86400.0  # simulation [s]


def closed_loop(
    scenario: Scenario,
    plant: str = "humanoid",
    controller: str | Path = "",
    meshcat: Meshcat | None = None,
    blocks: Mapping[str, str] | None = None,
    contract: Sequence[str] = (),
) -> ClosedLoop:
    """Returns the diagram of a scenario.

    Args:
        scenario: what is simulated.
        plant: "humanoid", or "lipm": the point mass that it stands for.
        controller: ONNX file of a policy, or `module:Class` of a controller of
            the user's; "": ours.
        meshcat: where it is drawn, if given.
        blocks: `module:Class` by role: those that replace blocks of ours (see
            own_blocks.made).
        contract: of a policy, files and fields (see policy.contract).

    Returns:
        A diagram that can be simulated.

    Raises:
        ValueError: a controller or block cannot be made, or does not fit.
    """
    require(
        plant in PLANTS,
        f"plant = {plant!r}: must be one of {', '.join(PLANTS)}",
    )
    is_lipm = plant == "lipm"
    require(
        not (is_lipm and controller),
        f"controller = {str(controller)!r}: must not come with plant = lipm",
    )
    systems: dict[str, Any] = own_blocks.all_made(
        blocks or {}, scenario, scenario.period(plant)
    )
    if controller:
        require(
            not blocks,
            f"controller = {str(controller)!r}: must not come with blocks",
        )
        system = _controller(str(controller), scenario, contract)
        return _walked_by(system, scenario, meshcat)
    if is_lipm:
        return LipmDiagram(scenario, meshcat, **systems)
    return HumanoidDiagram(scenario, meshcat, **systems)


def _controller(
    name: str, scenario: Scenario, contract: Sequence[str]
) -> System:
    """The controller of an ONNX file, or of a class."""
    if own_blocks.names_class(name):
        period = scenario.controller.control_period
        systems = own_blocks.all_made({"controller": name}, scenario, period)
        return cast(System, systems["controller"])
    robot = load_robot(scenario.robot, scenario.fidelity)
    return PolicyController(robot, name, contract)


def _walked_by(
    controller: System, scenario: Scenario, meshcat: Meshcat | None
) -> HumanoidDiagram:
    """The diagram of a controller of another's.

    One without a walking state walks by the scenario's commands, or at the mean
    velocity of the gait, or stands if that has no steps.  Pushes in a phase of
    its gait are after WALKS_STEADILY steps.
    """
    if controller.HasOutputPort("walking_state"):
        return HumanoidDiagram(scenario, meshcat, controller)
    gait, step = scenario.gait, scenario.gait.step
    commands = list(scenario.commands)
    require(
        not gait.steps and not gait.footholds,
        "gait: must have num_steps with a policy",
    )
    if gait.num_steps:
        duration = gait.swing_duration + gait.transfer_duration
        command = Command(
            forward=step.length / duration,
            left=step.sideways / duration,
            turn=math.radians(step.yaw_deg) / duration,
        )
        if not (command.forward or command.left or command.turn):
            command.forward = SLOWEST  # as all zeros are to stand
        commands = [command]
    scenario = replace(
        scenario,
        commands=commands,
        gait=replace(gait, num_steps=0),
        pushes=[
            replace(push, after_steps=max(push.after_steps, WALKS_STEADILY))
            for push in scenario.pushes
        ],
    )
    return HumanoidDiagram(scenario, meshcat, controller)


def start(diagram: ClosedLoop) -> Simulator:
    """Returns a simulator of a diagram in its initial state.

    Args:
        diagram: what is simulated.

    Returns:
        A simulator at time 0.

    Raises:
        RuntimeError: a block has no value there, such as NaN.
    """
    simulator = Simulator(diagram)
    diagram.set_initial_state(simulator.get_mutable_context())
    return simulator


def pushed(
    diagram: ClosedLoop, walked: Context, delta_v: float, direction_deg: float
) -> Simulator:
    """Returns a simulator that goes on from a copy of a Context, with its log.

    Args:
        diagram: what is simulated.
        walked: just before the first push (see walk_to_push).
        delta_v: of that push [m/s].
        direction_deg: of that push [deg].

    Returns:
        A simulator at the time of the push.
    """
    context = walked.Clone()
    diagram.push.set_push(
        diagram.push.GetMyMutableContextFromRoot(context),
        delta_v,
        direction_deg,
    )
    return Simulator(diagram, context)


def simulate(
    diagram: ClosedLoop | str, duration: float | None = None, **changes: Any
) -> Run:
    """Simulates a diagram from its start; see advance.

    For example `simulate("push", direction="inward", robot="g1").summary`.

    Args:
        diagram: a diagram, or the name of a scenario of the robot.
        duration: of the run [s]; None: until the robot has recovered, at most
            that of the scenario.
        **changes: of the scenario that is named: of its first push (see
            Scenario.with_push) and of its fields.

    Returns:
        What happened, with the log.

    Raises:
        ValueError: an unknown scenario, a change that is invalid or of a
            diagram, or a bad duration.
        RuntimeError: as `start`; later errors are those of the Run.
    """
    name = ""
    if isinstance(diagram, str):
        name = diagram
        push = {key: changes.pop(key) for key in PUSH if key in changes}
        scenario = load_scenario(name, **changes)
        if push:
            scenario = scenario.with_push(**push)
        diagram = HumanoidDiagram(scenario)
    elif not isinstance(diagram, ClosedLoop):
        raise ValueError(
            f"diagram = {diagram!r}: must be a ClosedLoop, or a scenario's name"
        )
    elif changes:
        raise ValueError(f"{next(iter(changes))}: must be in the scenario")
    run = (
        advance(
            start(diagram),
            diagram.scenario.duration,
            until=RecoveryWatch(diagram),
        )
        if duration is None
        else advance(start(diagram), duration)
    )
    return replace(run, info=replace(run.info, scenario=name))


def walk_to_push(diagram: ClosedLoop) -> tuple[Context, Run]:
    """Simulates a diagram from its start until just before its first push.

    `pushed` continues from this Context with any other push; the result is that
    of a run with that push.

    Args:
        diagram: what is simulated.

    Returns:
        The Context and the run until then.  Unless that ended by `until` (see
        advance), the Context is not that of a push.
    """
    simulator, push = start(diagram), diagram.push
    run = advance(
        simulator,
        diagram.scenario.duration,
        stop_at_failure=True,
        until=lambda root: push.begins(push.GetMyContextFromRoot(root)),
    )
    return simulator.get_context(), run


def advance(
    simulator: Simulator,
    duration: float,
    *,
    stop_at_failure: bool = False,
    until: Callable[[Context], bool] = lambda context: False,
) -> Run:
    """Simulates until a time, a fall, or the loss of the estimate.

    Ctrl-C, or an error in the simulation, ends the run with the log so far.

    Args:
        simulator: of a ClosedLoop (see start).
        duration: time at which it ends [s].
        stop_at_failure: ends the run at the first improper contact or exceeded
            limit: either means that the robot does not recover.
        until: called once a control period, before its update, with the
            diagram's Context; True ends the run.

    Returns:
        What happened, with the log.

    Raises:
        ValueError: the duration is negative, or no number.
    """
    check_number("duration", duration, least=0.0, most=LONGEST, unit="s")
    diagram = cast(ClosedLoop, simulator.get_system())
    context = simulator.get_mutable_context()
    with until_ctrl_c() as pressed:
        monitor = Monitor(diagram, stop_at_failure, until, pressed)
        simulator.set_monitor(monitor.look)
        began = time.process_time()
        try:
            simulator.AdvanceTo(duration)
        except KeyboardInterrupt:
            monitor.outcome["interrupted"] = True
        except Exception as error:  # of any block, such as NaN at an input
            monitor.outcome["error"] = error_text(error)
        cpu_time = time.process_time() - began
    return Run(
        logs=diagram.read_logs(context),
        info=run_info(diagram),
        simulated_time=context.get_time(),
        cpu_time=cpu_time,
        missed_pushes=int(push_signal(diagram, context).waiting),
        improper_contacts=tuple(sorted(monitor.contacts)),
        **monitor.outcome,
    )


@contextlib.contextmanager
def until_ctrl_c() -> Iterator[Callable[[], bool]]:
    """Yields a function that returns True after Ctrl-C, or SIGTERM.

    A second one raises KeyboardInterrupt.  Outside of the main thread the
    function always returns False.

    Yields:
        The function.
    """
    pressed: list[bool] = []

    def press(number: int, _: FrameType | None) -> None:
        pressed.append(True)
        signal.signal(number, signal.default_int_handler)

    with at_ctrl_c(press):
        yield lambda: bool(pressed)


Handler = Callable[[int, FrameType | None], Any] | int | None


@contextlib.contextmanager
def at_ctrl_c(handler: Handler, usual: Handler = None) -> Iterator[None]:
    """Calls a handler at Ctrl-C or SIGTERM, in a block of the main thread.

    So it does when a terminal is hung up (SIGHUP), unless nohup ignores that.

    Args:
        handler: as of signal.signal.
        usual: only signals that have this handler are handled; None: all.

    Yields:
        Nothing.
    """
    is_main = threading.current_thread() is threading.main_thread()
    numbers = [signal.SIGINT, signal.SIGTERM] if is_main else []
    if is_main and signal.getsignal(signal.SIGHUP) == signal.SIG_DFL:
        numbers.append(signal.SIGHUP)
    with contextlib.ExitStack() as restored:
        for number in numbers:
            if usual in (None, signal.getsignal(number)):
                restored.callback(
                    signal.signal, number, signal.signal(number, handler)
                )
        yield
