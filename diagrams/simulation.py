"""Runs a closed diagram until it is done, or the robot has fallen."""

import contextlib
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.summary import ICP_BACK, Run
from nadia_balance.systems.icp_planner import IcpReference
from nadia_balance.systems.push_source import PushSignal, PushSource

WATCH_PERIOD = 0.01  # looks for a fall so often [s]
_EARLY = 1e-9  # times of ticks differ by rounding [s]


class ClosedLoop(Protocol):
    """What a diagram needs, beside being one, to be simulated here.

    Each `context` is that of the whole diagram.  RecoveryWatch needs its output
    ports walking_state, icp and icp_reference, a sweep swing_foot_reference.
    """

    scenario: Scenario
    push: PushSource  # one of its systems

    def set_initial_state(self, context: Context) -> None:
        """Puts the robot where it starts."""

    def fall_reason(self, context: Context) -> str:
        """Why the robot counts as fallen; empty while it does not."""

    def improper_contacts(self, context: Context) -> set[str]:
        """Contacts that are not those of a foot and the ground, by name."""

    def passed_limit(self, context: Context) -> bool:
        """True if the robot is where no recovery leads."""

    def read_logs(self, context: Context) -> dict[str, np.ndarray]:
        """All that was logged (see nadia_balance.results.log)."""

    def forget_logs(self, context: Context) -> None:
        """Drops all that was logged: a log grows without end."""


def start(diagram: ClosedLoop) -> Simulator:
    """Returns a simulator of `diagram` that stands at the start."""
    simulator = Simulator(diagram)
    diagram.set_initial_state(simulator.get_mutable_context())
    return simulator


def pushed(
    diagram: ClosedLoop, walked: Context, delta_v: float, direction_deg: float
) -> Simulator:
    """Returns a simulator that goes on from a copy of `walked`.

    Its first push is now one of `delta_v` [m/s] in a direction [deg].  What was
    logged on the way is in the copy, too.
    """
    context = walked.Clone()
    push_context = diagram.push.GetMyMutableContextFromRoot(context)
    diagram.push.set_push(push_context, delta_v, direction_deg)
    return Simulator(diagram, context)


def push_signal(diagram: ClosedLoop, context: Context) -> PushSignal:
    """Whether and how the robot is pushed now."""
    port = diagram.push.GetOutputPort("push_signal")
    return PushSignal(port.Eval(diagram.push.GetMyContextFromRoot(context)))


def simulate(
    diagram: ClosedLoop,
    duration: float,
    realtime_rate: float = 0.0,
    *,
    stop_at_failure: bool = False,
) -> Run:
    """Simulates `diagram` from its start for `duration` [s]; see advance."""
    return advance(
        start(diagram),
        duration,
        realtime_rate,
        stop_at_failure=stop_at_failure,
    )


class RecoveryWatch:
    """Sees, asked once a tick, when a robot has recovered from all its pushes.

    That is, once it has taken the whole steps with a small ICP error that its
    scenario requires (see summarize), and `more_steps` like them.  Without
    steps that are required, it is the end of the run that tells.
    """

    def __init__(self, diagram: ClosedLoop, more_steps: int = 0):
        """Watches `diagram`, from any time on."""
        self._diagram = diagram
        calm = diagram.scenario.calm_steps
        self._landings = calm + 1 + more_steps if calm else math.inf
        self._landed, self._steps = 0, 0  # since the error is small; in all

    def __call__(self, context: Context) -> bool:
        """True if it has recovered."""
        diagram = self._diagram
        state, icp, reference = (
            diagram.GetOutputPort(name).Eval(context)
            for name in ("walking_state", "icp", "icp_reference")
        )
        landed = state.steps_taken - self._steps
        self._steps = state.steps_taken
        self._landed += landed
        error = math.dist(icp, IcpReference(reference).icp)
        if error >= ICP_BACK or push_signal(diagram, context).waiting:
            self._landed = 0
        return self._landed >= self._landings


def walk_to_push(
    diagram: ClosedLoop, duration: float, until: Callable[[Context], bool]
) -> tuple[Context, Run]:
    """Simulates `diagram` from its start until its first push is about to be.

    `pushed` goes on from there with any other push, as if it had been that one
    from the start.  The run tells what ended the walk (see advance): that must
    be `until`, or there is no push to come.
    """
    simulator, push = start(diagram), diagram.push
    run = advance(
        simulator,
        duration,
        stop_at_failure=True,
        until=lambda context: (
            until(context) or push.begins(push.GetMyContextFromRoot(context))
        ),
    )
    return simulator.get_context(), run


def advance(
    simulator: Simulator,
    duration: float,
    realtime_rate: float = 0.0,
    *,
    stop_at_failure: bool = False,
    until: Callable[[Context], bool] = lambda context: False,
) -> Run:
    """Simulates until `duration` [s], or until the robot falls.

    `realtime_rate` 1 runs no faster than real time, 0 as fast as it can.
    `stop_at_failure` ends the run with the first improper contact, or limit
    that is passed: either decides that the robot does not recover.  `until` is
    asked once a control period, before its update.
    Ctrl-C, or an error while running, ends the run early; what was logged
    until then is returned.
    """
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    next_look, next_tick, message = 0.0, 0.0, ""
    period = diagram.push.period
    contacts: set[str] = set()
    outcome: dict = {}

    def decided(now: float) -> bool:
        nonlocal next_look, contacts
        if pressed():
            outcome["interrupted"] = True
        elif now >= next_look:
            next_look = now + WATCH_PERIOD
            contacts |= diagram.improper_contacts(context)
            if reason := diagram.fall_reason(context):
                outcome.update(fell_at=now, fall_reason=reason)
            elif stop_at_failure and (
                contacts or diagram.passed_limit(context)
            ):
                return True
        if not outcome and until(context):
            outcome["until"] = True
        return bool(outcome)

    def look(_: Context) -> EventStatus:
        nonlocal next_tick
        now = context.get_time()
        if now < next_tick - _EARLY:
            return EventStatus.DidNothing()
        next_tick = (math.floor(now / period + _EARLY) + 1) * period
        if decided(now):
            return EventStatus.ReachedTermination(diagram, "decided")
        return EventStatus.DidNothing()

    simulator.set_target_realtime_rate(realtime_rate)
    with until_ctrl_c() as pressed:
        simulator.set_monitor(look)
        began = time.process_time()
        try:
            simulator.AdvanceTo(duration)
        except KeyboardInterrupt:
            outcome["interrupted"] = True
        except (RuntimeError, ValueError) as error:  # such as NaN at an input
            message = " ".join(str(error).split()) or type(error).__name__
        cpu_time = time.process_time() - began
    return Run(
        logs=diagram.read_logs(context),
        simulated_time=context.get_time(),
        cpu_time=cpu_time,
        missed_pushes=int(push_signal(diagram, context).waiting),
        improper_contacts=tuple(sorted(contacts)),
        error=message,
        **outcome,
    )


@contextlib.contextmanager
def until_ctrl_c() -> Iterator[Callable[[], bool]]:
    """Yields what tells whether Ctrl-C was pressed.

    Pressed once more, it raises KeyboardInterrupt as ever.  Only the main
    thread is told of it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    pressed: list[bool] = []

    def press(*_: object) -> None:
        pressed.append(True)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, press)
    try:
        yield lambda: bool(pressed)
    finally:
        signal.signal(signal.SIGINT, before)
