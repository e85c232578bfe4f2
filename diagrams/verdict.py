"""How a run is judged while it is simulated."""

import math
from collections.abc import Callable
from typing import Any

from pydrake.systems.framework import Context, EventStatus

from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.results.estimation import LostWatch
from nadia_balance.results.measurements import SETTLED, CalmSteps, StandsWatch
from nadia_balance.results.summary import RunInfo
from nadia_balance.systems.signals import (
    IcpReference,
    PushSignal,
    WalkingSignal,
    read,
)

WATCH_PERIOD = 0.01  # period of the checks for falls and contacts [s]
SHOWN = 0.5  # time of standing for each step that is shown besides [s]
EARLY = 1e-9  # times of ticks differ by rounding [s]


def push_signal(diagram: ClosedLoop, context: Context) -> PushSignal:
    """Returns the push that acts now.

    Args:
        diagram: what is simulated.
        context: that of the diagram.

    Returns:
        Its force, direction and progress.
    """
    return PushSignal(read(diagram.push.GetOutputPort("push_signal"), context))


def gait_and_error(diagram: ClosedLoop, context: Context) -> tuple[int, float]:
    """Returns the number of steps taken, and the ICP error.

    Args:
        diagram: what is simulated.
        context: that of the diagram.

    Returns:
        The steps, and the distance of the ICP from its reference [m].
    """
    icp = read(diagram.signals["icp"], context)
    reference = IcpReference(read(diagram.signals["icp_reference"], context))
    state = read(diagram.signals["walking_state"], context)
    return state.steps_taken, math.dist(icp, reference.icp)


class RecoveryWatch:
    """Detects, called once a tick, the recovery from all pushes.

    The robot has recovered after the complete steps with a small ICP error
    that its scenario requires (see Run.summary), and `more_steps` like them; or
    when it has stood with square feet for SETTLED, and for SHOWN of each of
    `more_steps`.  Without pushes, with commands to come, or without an ICP,
    only the end of the run decides.
    """

    def __init__(self, diagram: ClosedLoop, more_steps: int = 0):
        """Begins before the first push.

        Args:
            diagram: what is simulated.
            more_steps: whole steps that are simulated after the recovery.
        """
        self._diagram, self._calm = diagram, CalmSteps()
        self._stands, scenario = StandsWatch(), diagram.scenario
        calm_steps = scenario.calm_steps
        self._required = calm_steps + more_steps if calm_steps else math.inf
        self._standing = SETTLED + SHOWN * more_steps
        self._not_before = max(
            (command.time for command in scenario.commands), default=0.0
        )
        if not scenario.pushes or not diagram.HasOutputPort("icp"):
            self._not_before = math.inf

    def __call__(self, context: Context) -> bool:
        """True if the robot has recovered."""
        now = context.get_time()
        if now < self._not_before:
            return False
        steps_taken, error = gait_and_error(self._diagram, context)
        waiting = bool(push_signal(self._diagram, context).waiting)
        calm = self._calm.update(steps_taken, error, waiting)
        walking = WalkingSignal(
            read(self._diagram.signals["walking_signal"], context)
        )
        stood = self._stands.update(now, walking, error, waiting)
        return calm >= self._required or stood >= self._standing


class Monitor:
    """Ends a simulation when it is decided (see simulation.advance).

    `outcome` are the fields of the Run by which it ended, `contacts` the
    improper ones until now.
    """

    def __init__(
        self,
        diagram: ClosedLoop,
        stop_at_failure: bool,
        until: Callable[[Context], bool],
        interrupted: Callable[[], bool],
    ):
        """Begins at time 0.

        Args:
            diagram: what is simulated.
            stop_at_failure: a failure ends the run.
            until: called with the diagram's Context; True ends the run.
            interrupted: True ends the run.
        """
        self._diagram, self._stops = diagram, stop_at_failure
        self._until, self._interrupted = until, interrupted
        self._next_look, self._next_tick = 0.0, 0.0
        self._estimate = LostWatch()
        self.contacts: set[str] = set()
        self.outcome: dict[str, Any] = {}

    def look(self, context: Context) -> EventStatus:
        """Looks once a control period, before its update.

        Args:
            context: that of the diagram, whose outputs it evaluates.

        Returns:
            Whether the simulation ends.
        """
        now, period = context.get_time(), self._diagram.push.period
        if now < self._next_tick - EARLY:
            return EventStatus.DidNothing()
        self._next_tick = (math.floor(now / period + EARLY) + 1) * period
        failed = False
        if self._interrupted():
            self.outcome["interrupted"] = True
        elif now >= self._next_look:
            self._next_look = now + WATCH_PERIOD
            failed = self._fails(context)
        if not self.outcome and not failed and self._until(context):
            self.outcome["until"] = True
        lost = self._estimate.update(now, self._diagram.nees(context))
        if lost or self.outcome or failed:
            return EventStatus.ReachedTermination(self._diagram, "decided")
        return EventStatus.DidNothing()

    def _fails(self, context: Context) -> bool:
        """Looks for a fall; True if another failure ends the run."""
        self.contacts |= self._diagram.improper_contacts(context)
        reason = self._diagram.fall_reason(context)
        if reason:
            self.outcome["fell_at"] = context.get_time()
            self.outcome["fall_reason"] = reason
            return False
        return self._stops and (
            self._diagram.passed_limit(context) or bool(self.contacts)
        )


def run_info(diagram: ClosedLoop) -> RunInfo:
    """Returns the conditions of a run, by which it is judged.

    Args:
        diagram: what is simulated.

    Returns:
        The conditions, as in its summary.
    """
    scenario = diagram.scenario
    mechanisms = ", ".join([scenario.mechanisms, *diagram.replaced])
    push = scenario.pushes[0] if scenario.pushes else None
    return RunInfo(
        robot=scenario.robot,
        fidelity=scenario.fidelity,
        engine=scenario.engine,
        seed=scenario.seed,
        direction_deg=push.direction_deg if push else None,
        delta_v=push.delta_v if push else None,
        mechanisms=getattr(diagram.controller, "file", mechanisms),
        plant=diagram.PLANT,
        calm_steps=scenario.calm_steps,
        max_torso_tilt_deg=(
            180.0
            if scenario.fidelity == "ideal"
            else scenario.max_torso_tilt_deg
        ),
        landing=None if scenario.fidelity == "ideal" else scenario.landing,
    )
