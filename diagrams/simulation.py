"""Closed loops of scenarios, their simulation, and how a run is judged."""

import contextlib
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import Command, Scenario, load_scenario
from nadia_balance.policy_controller import PolicyController
from nadia_balance.results.measurements import (
    SETTLED,
    CalmSteps,
    LostWatch,
    StandsWatch,
)
from nadia_balance.results.summary import Run, RunInfo
from nadia_balance.robot.model import load_robot
from nadia_balance.systems.signals import (
    IcpReference,
    PushSignal,
    WalkingSignal,
    read,
)

WATCH_PERIOD = 0.01  # period of the checks for falls and contacts [s]
STEADY_STEPS = 8  # steps after which a policy walks steadily
_SLOWEST = 0.02  # command by which a policy steps in place [m/s]
SHOWN = 0.5  # time of standing for each step that is shown besides [s]
_EARLY = 1e-9  # times of ticks differ by rounding [s]


def closed_loop(
    scenario: Scenario,
    plant: str = "humanoid",
    policy: str | Path = "",
    meshcat: Meshcat | None = None,
) -> ClosedLoop:
    """The diagram of a `scenario`: of the robot, or of the point mass (lipm).

    The robot's controller is the `policy` in an ONNX file, if given.
    """
    if policy:
        return _walked_by(policy, scenario, meshcat)
    make = LipmDiagram if plant == "lipm" else HumanoidDiagram
    return make(scenario, meshcat)


def _walked_by(
    onnx: str | Path, scenario: Scenario, meshcat: Meshcat | None
) -> HumanoidDiagram:
    """The diagram of the policy in the file `onnx`.

    It walks by the scenario's commands, or at the mean velocity of the gait, or
    stands if that has no steps.  Pushes in a phase of its gait are after
    STEADY_STEPS steps.
    """
    gait, step = scenario.gait, scenario.gait.step
    commands = list(scenario.commands)
    if gait.steps or gait.footholds:
        raise ValueError("gait: must have num_steps with a policy")
    if gait.num_steps:
        time = gait.swing_duration + gait.transfer_duration
        speeds = step.length / time, step.sideways / time
        turn = math.radians(step.yaw_deg) / time
        if not any((*speeds, turn)):
            speeds = _SLOWEST, 0.0  # as all zeros are to stand
        forward, left = speeds
        commands = [Command(forward=forward, left=left, turn=turn)]
    robot = load_robot(scenario.robot, scenario.fidelity)
    pushes = [
        replace(push, after_steps=max(push.after_steps, STEADY_STEPS))
        for push in scenario.pushes
    ]
    controller = PolicyController(robot, onnx)
    gait = replace(gait, num_steps=0)
    scenario = replace(scenario, pushes=pushes, commands=commands, gait=gait)
    return HumanoidDiagram(scenario, meshcat, controller)


def start(diagram: ClosedLoop) -> Simulator:
    """Returns a simulator of `diagram` in its initial state."""
    simulator = Simulator(diagram)
    diagram.set_initial_state(simulator.get_mutable_context())
    return simulator


def pushed(
    diagram: ClosedLoop, walked: Context, delta_v: float, direction_deg: float
) -> Simulator:
    """Returns a simulator that continues from a copy of `walked`, with its log.

    The first push has `delta_v` [m/s] and the given direction [deg].
    """
    context = walked.Clone()
    push_context = diagram.push.GetMyMutableContextFromRoot(context)
    diagram.push.set_push(push_context, delta_v, direction_deg)
    return Simulator(diagram, context)


def push_signal(diagram: ClosedLoop, context: Context) -> PushSignal:
    """The push that acts now, see PushSignal."""
    return PushSignal(read(diagram.push.GetOutputPort("push_signal"), context))


def simulate(
    diagram: ClosedLoop | str, duration: float | None = None, **changes: object
) -> Run:
    """Simulates `diagram` from its start for `duration` [s]; see advance.

    By default until it has recovered, at most for its scenario's duration.
    Instead of a diagram, it may be the name of a scenario of the robot, with
    `changes` of its first push (see Scenario.with_push) and of its fields:
    `simulate("push", direction="inward", robot="g1").summary`.

    Raises ValueError: an unknown scenario, or a change invalid or of a diagram.
    """
    name = ""
    if isinstance(diagram, str):
        name = diagram
        push = {
            key: changes.pop(key)
            for key in ("direction", "delta_v", "at", "shape")
            if key in changes
        }
        scenario = load_scenario(name, **changes)
        if push:
            scenario = scenario.with_push(**push)
        diagram = HumanoidDiagram(scenario)
    elif changes:
        raise ValueError(f"{next(iter(changes))}: must be in the scenario")
    ends: dict = {}
    if duration is None:
        duration = diagram.scenario.duration
        ends["until"] = RecoveryWatch(diagram)
    run = advance(start(diagram), duration, **ends)
    return replace(run, info=replace(run.info, scenario=name))


class RecoveryWatch:
    """Detects, called once a tick, the recovery from all pushes.

    The robot has recovered after the complete steps with a small ICP error
    that its scenario requires (see Run.summary), and `more_steps` like them; or
    when it has stood with square feet for SETTLED, and for SHOWN of each of
    `more_steps`.  Without pushes, with commands to come, or without an ICP,
    only the end of the run decides.
    """

    def __init__(self, diagram: ClosedLoop, more_steps: int = 0):
        self._diagram, self._calm = diagram, CalmSteps()
        self._stands, scenario = StandsWatch(), diagram.scenario
        calm = scenario.calm_steps
        self._required = calm + more_steps if calm else math.inf
        self._standing = SETTLED + SHOWN * more_steps
        told = [command.time for command in scenario.commands]
        self._not_before = max(told, default=0.0)
        if not scenario.pushes or not diagram.HasOutputPort("icp"):
            self._not_before = math.inf

    def __call__(self, context: Context) -> bool:
        """True if the robot has recovered."""
        now = context.get_time()
        if now < self._not_before:
            return False
        steps_taken, error = gait_and_error(self._diagram, context)
        waiting = bool(push_signal(self._diagram, context).waiting)
        calm = self._calm.look(now, steps_taken, error, waiting)
        port = self._diagram.controller.GetOutputPort("walking_signal")
        walking = WalkingSignal(read(port, context))
        stood = self._stands.look(now, walking, error, waiting)
        return calm >= self._required or stood >= self._standing


def gait_and_error(diagram: ClosedLoop, context: Context) -> tuple[int, float]:
    """The number of steps taken, and the ICP error [m]."""
    state, icp, reference = (
        diagram.GetOutputPort(name).Eval(context)
        for name in ("walking_state", "icp", "icp_reference")
    )
    return state.steps_taken, math.dist(icp, IcpReference(reference).icp)


def walk_to_push(diagram: ClosedLoop) -> tuple[Context, Run]:
    """Simulates `diagram` from its start until just before its first push.

    `pushed` continues from this Context with any other push; the result is that
    of a run with that push.  Unless the run ended by `until` (see advance), the
    Context is not that of a push.
    """
    simulator, push = start(diagram), diagram.push
    ends = {"until": lambda all_: push.begins(push.GetMyContextFromRoot(all_))}
    duration = diagram.scenario.duration
    run = advance(simulator, duration, stop_at_failure=True, **ends)
    return simulator.get_context(), run


def advance(
    simulator: Simulator,
    duration: float,
    *,
    stop_at_failure: bool = False,
    until: Callable[[Context], bool] = lambda context: False,
) -> Run:
    """Simulates until `duration` [s], a fall, or the loss of the estimate.

    `stop_at_failure` ends the run at the first improper contact or exceeded
    limit: either means that the robot does not recover.  `until` is called
    once a control period, before its update; True ends the run.
    Ctrl-C, or an error in the simulation, ends the run with the log so far.
    """
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    next_look, next_tick = 0.0, 0.0
    period = diagram.push.period
    contacts: set[str] = set()
    estimator = LostWatch()
    outcome: dict = {}

    def look(_: Context) -> EventStatus:
        nonlocal next_look, next_tick, contacts
        now, ends = context.get_time(), False
        if now < next_tick - _EARLY:
            return EventStatus.DidNothing()
        next_tick = (math.floor(now / period + _EARLY) + 1) * period
        if pressed():
            outcome["interrupted"] = True
        elif now >= next_look:
            next_look = now + WATCH_PERIOD
            contacts |= diagram.improper_contacts(context)
            if reason := diagram.fall_reason(context):
                outcome.update(fell_at=now, fall_reason=reason)
            elif stop_at_failure:
                ends = bool(contacts) or diagram.passed_limit(context)
        if not (outcome or ends) and until(context):
            outcome["until"] = True
        if estimator.look(now, diagram.nees(context)) or outcome or ends:
            return EventStatus.ReachedTermination(diagram, "decided")
        return EventStatus.DidNothing()

    with until_ctrl_c() as pressed:
        simulator.set_monitor(look)
        began = time.process_time()
        try:
            simulator.AdvanceTo(duration)
        except KeyboardInterrupt:
            outcome["interrupted"] = True
        except (RuntimeError, ValueError) as error:  # such as NaN at an input
            message = " ".join(str(error).split())
            outcome["error"] = message or type(error).__name__
        cpu_time = time.process_time() - began
    logs = diagram.read_logs(context)
    return Run(
        logs=logs,
        info=_run_info(diagram),
        simulated_time=context.get_time(),
        cpu_time=cpu_time,
        missed_pushes=int(push_signal(diagram, context).waiting),
        improper_contacts=tuple(sorted(contacts)),
        **outcome,
    )


@contextlib.contextmanager
def until_ctrl_c() -> Iterator[Callable[[], bool]]:
    """Yields a function that returns True after Ctrl-C, or SIGTERM.

    A second one raises KeyboardInterrupt.  Outside of the main thread the
    function always returns False.
    """
    pressed: list[bool] = []

    def press(number: int, _: object) -> None:
        pressed.append(True)
        signal.signal(number, signal.default_int_handler)

    with at_ctrl_c(press):
        yield lambda: bool(pressed)


@contextlib.contextmanager
def at_ctrl_c(handler: Callable, usual: object = None) -> Iterator[None]:
    """Calls `handler` at Ctrl-C or SIGTERM, in a block of the main thread.

    Only for those that have the `usual` handler, if there is one.
    """
    is_main = threading.current_thread() is threading.main_thread()
    with contextlib.ExitStack() as restored:
        for number in (signal.SIGINT, signal.SIGTERM) if is_main else ():
            if usual in (None, signal.getsignal(number)):
                old = signal.signal(number, handler)
                restored.callback(signal.signal, number, old)
        yield


def _run_info(diagram: ClosedLoop) -> RunInfo:
    """The conditions of a run, by which it is judged."""
    scenario = diagram.scenario
    same = ["robot", "fidelity", "engine", "seed"]
    if scenario.fidelity == "realistic":
        same.append("max_torso_tilt_deg")
    policy = getattr(diagram.controller, "file", "")
    push = scenario.pushes[0] if scenario.pushes else None
    return RunInfo(
        **{name: getattr(scenario, name) for name in same},
        direction_deg=push.direction_deg if push else None,
        delta_v=push.delta_v if push else None,
        mechanisms=policy or scenario.mechanisms,
        plant=diagram.PLANT,
        calm_steps=scenario.calm_steps,
    )
