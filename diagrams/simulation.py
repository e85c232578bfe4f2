"""Runs a closed diagram until it is done, or the robot has fallen."""

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.summary import Run
from nadia_balance.systems.push_source import PushSignal, PushSource

WATCH_PERIOD = 0.01  # looks for a fall so often [s]


class ClosedLoop(Protocol):
    """What a diagram needs, beside being one, to be simulated here.

    Each `context` is that of the whole diagram.  A sweep also needs its output
    ports walking_state, icp and swing_foot_reference; LiveSession (see
    nadia_balance.diagrams.live) also icp_reference.
    """

    scenario: Scenario
    push: PushSource  # one of its systems

    def set_initial_state(self, context: Context) -> None:
        """Puts the robot where it starts."""

    def fall_reason(self, context: Context) -> str:
        """Why the robot counts as fallen; empty while it does not."""

    def improper_contacts(self, context: Context) -> set[str]:
        """Contacts that are not those of a foot and the ground, by name."""

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
    stop_at_improper_contact: bool = False,
) -> Run:
    """Simulates `diagram` from its start for `duration` [s]; see advance."""
    return advance(
        start(diagram),
        duration,
        realtime_rate,
        stop_at_improper_contact=stop_at_improper_contact,
    )


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
        stop_at_improper_contact=True,
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
    stop_at_improper_contact: bool = False,
    until: Callable[[Context], bool] = lambda context: False,
) -> Run:
    """Simulates until `duration` [s], or until the robot falls.

    `realtime_rate` 1 runs no faster than real time, 0 as fast as it can.  The
    first improper contact decides that it has not recovered: who only wants
    to know that stops there.  `until` is asked after every step of the plant.
    Ctrl-C, or an error while running, ends the run early; what was logged
    until then is returned.
    """
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    next_look, message = 0.0, ""
    contacts: set[str] = set()
    outcome: dict = {}

    def decided() -> bool:
        nonlocal next_look, contacts
        if pressed():
            outcome["interrupted"] = True
        elif (now := context.get_time()) >= next_look:
            next_look = now + WATCH_PERIOD
            contacts |= diagram.improper_contacts(context)
            if reason := diagram.fall_reason(context):
                outcome.update(fell_at=now, fall_reason=reason)
            elif stop_at_improper_contact and contacts:
                return True
        if not outcome and until(context):
            outcome["until"] = True
        return bool(outcome)

    def look(_: Context) -> EventStatus:
        if decided():
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
