"""Runs a diagram until it is done, or the robot has fallen."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from diagrams.ctrl_c import until_ctrl_c

WATCH_PERIOD = 0.01  # looks for a fall so often [s]


@dataclass(frozen=True)
class Run:
    """What came out of a simulation."""

    logs: dict[str, np.ndarray]  # name -> (n, size), and t (n,)
    fell_at: float | None  # [s]
    fall_reason: str
    simulated_time: float  # [s]
    cpu_time: float  # [s]
    interrupted: bool  # by Ctrl-C
    missed_pushes: int = 0  # that never came, or were cut off by the end
    improper_contacts: tuple[str, ...] = ()  # not of a foot and the ground
    error: str = ""  # that ended the run early, such as NaN at an input

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second of processor time."""
        return self.simulated_time / max(self.cpu_time, 1e-9)


def start(diagram) -> Simulator:
    """Returns a simulator of `diagram` that stands at the start."""
    simulator = Simulator(diagram)
    diagram.set_initial_state(simulator.get_mutable_context())
    return simulator


def simulate(
    diagram,
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


def advance(
    simulator: Simulator,
    duration: float,
    realtime_rate: float = 0.0,
    *,
    stop_at_improper_contact: bool = False,
) -> Run:
    """Simulates until `duration` [s], or until the robot falls.

    `realtime_rate` 1 runs no faster than real time, 0 as fast as it can.  The
    first improper contact decides that she has not recovered: who only wants
    to know that stops there.
    Ctrl-C, or an error while running, ends the run early; what was logged
    until then is returned.
    """
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    simulator.set_target_realtime_rate(realtime_rate)
    message = ""
    with until_ctrl_c() as pressed:
        watch = _Watch(diagram, stop_at_improper_contact, pressed)
        simulator.set_monitor(watch.look)
        simulator.Initialize()
        began = time.process_time()
        try:
            simulator.AdvanceTo(duration)
        except KeyboardInterrupt:
            watch.interrupted = True
        except (RuntimeError, ValueError) as error:  # such as NaN at an input
            message = " ".join(str(error).split()) or type(error).__name__
        cpu_time = time.process_time() - began
    return Run(
        logs=diagram.read_logs(context),
        fell_at=watch.fell_at,
        fall_reason=watch.reason,
        simulated_time=context.get_time(),
        cpu_time=cpu_time,
        interrupted=watch.interrupted,
        missed_pushes=_missed_pushes(diagram, context),
        improper_contacts=tuple(sorted(watch.improper_contacts)),
        error=message,
    )


class _Watch:
    """Looks at a running simulation now and then, from outside of it."""

    def __init__(
        self,
        diagram,
        stop_at_improper_contact: bool,
        pressed: Callable[[], bool],
    ):
        self._diagram, self._next_look, self._pressed = diagram, 0.0, pressed
        self._stop_at_improper_contact = stop_at_improper_contact
        self.fell_at: float | None = None
        self.reason = ""
        self.improper_contacts: set[str] = set()
        self.interrupted = False

    def look(self, context: Context) -> EventStatus:
        """Ends the simulation once it is decided."""
        if self._pressed():
            self.interrupted = True
            return EventStatus.ReachedTermination(self._diagram, "Ctrl-C")
        now = context.get_time()
        if now < self._next_look:
            return EventStatus.DidNothing()
        self._next_look = now + WATCH_PERIOD
        self.improper_contacts |= self._diagram.improper_contacts(context)
        self.reason = self._diagram.fall_reason(context)
        if self.reason:
            self.fell_at = now
            return EventStatus.ReachedTermination(self._diagram, self.reason)
        if self._stop_at_improper_contact and self.improper_contacts:
            return EventStatus.ReachedTermination(self._diagram, "contact")
        return EventStatus.DidNothing()


def _missed_pushes(diagram, context: Context) -> int:
    """Number of pushes that never came, or were cut off by the end."""
    source = diagram.GetSubsystemByName("push_source")
    state = source.GetMyContextFromRoot(context).get_discrete_state_vector()
    ticks_left = state.value()[: 2 * len(diagram.scenario.pushes) : 2]
    return int(np.count_nonzero(ticks_left))
