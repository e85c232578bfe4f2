"""What the controller's capture regions predict of a run, from its log.

The n of a prediction is the least number of further steps that capture the
point mass, 0 to N (`num_steps` of the step adjuster), or -1: lost.

- 0 steps: the CoP can hold the ICP in the usable part of what stands: of the
  stance foot in a swing, of the hull of both feet in a transfer.  Usable is
  what the adjuster counts on for C_1: the sole less its `foot_front`,
  `foot_back`, `foot_inside` and `foot_outside`.  Hips count for nothing.
- n steps: some foothold within reach is in C_n = C_1 + (-D_n), by the very
  functions and parameters of the step adjuster, and the foot can be there in
  time.  The adjuster's `margin` is a wish, not a condition: it is left out.
  So are the shares and thresholds by which the clock is advanced.
- Within reach is the base region, with cross-over also the two others, less
  what the stance foot blocks, and the foothold as planned.  If steps are not
  adjusted, or it is too late for it (`freeze_time`), it is the foothold as it
  is; if they are not, all later footholds are the planned ones, too.
- The foot may take the load from the planned end of the swing on, until
  `waiting_time` after it.  If the swing can be shortened, it may as soon as
  the timing adapter lets it, but not before it can be there (its largest
  acceleration, round the stance foot).
- In a transfer the CoP can be anywhere in the usable hull of both feet, until
  the foot is lifted: when the transfer is planned to end or, if it can be
  shortened, at the earliest end.  Then the same is asked of the swing.
- Steps after the next one last as long as the adjuster counts on
  (`shortest_transfer`, `shortest_swing`: by default as long as planned), so a
  hurry is reckoned with in the next step only.

So the regions promise less than the robot has, and most that they got wrong
in our trials were false alarms: the rest of the sole, the hips and a hurry in
later steps recovered what they had given up.

What is not in the log, sides, durations and footholds of the steps to come,
is that of the gait, moved within reach as the state machine does it.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from diagrams.run_log import (
    DURATION,
    STEPS_TAKEN,
    TARGET,
    TIME_IN_PHASE,
    Log,
    phase_spans,
    pushes,
    sole_pose,
)
from diagrams.scenario import Scenario
from diagrams.start import initial_walking_state
from nadia_balance.core.capturability import least_steps
from nadia_balance.core.footstep_plan import within_reach
from nadia_balance.core.next_step import NextStep, next_step, usable_support
from nadia_balance.core.walking import (
    Adjustment,
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.robot import RobotModel

_ROUNDING = 1e-6  # of times in the log [s]
_UNKNOWN = ReferencePoint(*np.zeros((3, 2)))  # no region depends on it


@dataclass(frozen=True)
class Predictions:
    """The least number of steps that capture the robot, or -1."""

    at_push: int | None  # when the last push ends; None: it does not
    at_touchdowns: tuple[int, ...]  # each after that


def predictions(log: Log, scenario: Scenario, robot: RobotModel) -> Predictions:
    """Returns the predictions for the run of `scenario` that is in `log`.

    Those of a run without a push are empty.
    """
    felt = pushes(log)[-1:]
    if not felt:
        return Predictions(None, ())
    end = int(np.searchsorted(log["t"], felt[0].end - _ROUNDING))
    reader = Reader(log, scenario, robot)
    touchdowns = [
        after.first
        for swing, after in itertools.pairwise(reader.spans)
        if swing.phase is Phase.SWING and after.first >= end
    ]
    return Predictions(
        reader.prediction(end) if end < len(log["t"]) else None,
        tuple(map(reader.prediction, touchdowns)),
    )


class Reader:
    """Puts the walking state together again, row by row."""

    def __init__(self, log: Log, scenario: Scenario, robot: RobotModel):
        """Reads the `log` of a run of `scenario`."""
        self.spans = phase_spans(log)
        self._log, self._robot = log, robot
        self._params = scenario.controller_params()
        self._commanded = initial_walking_state(scenario).schedule.footsteps

    def prediction(self, row: int) -> int:
        """The least number of steps at this row of the log, or -1."""
        state, robot = self.state(row), self._robot
        adjuster = self._params.step_adjuster
        return least_steps(
            self._log["icp"][row],
            usable_support(state.schedule, robot.sole, adjuster),
            lambda: self._next_step(row, state),
            robot.omega,
            self._params.swing_foot.detour,
        )

    def _next_step(self, row: int, state: WalkingState) -> NextStep | None:
        schedule = state.schedule
        if not schedule.footsteps:
            return None
        if schedule.phase is Phase.SWING:
            reference = self._log["swing_foot_reference"][row]
            foot, velocity = reference[:2], reference[3:5]
        else:
            swing = schedule.support_side.other
            foot, velocity = schedule.feet[swing].p_WF[:2], np.zeros(2)
        return next_step(
            state,
            foot,
            velocity,
            self._robot.sole,
            self._robot.omega,
            self._params.step_adjuster,
            self._params.timing_adapter,
        )

    def state(self, row: int) -> WalkingState:
        """The walking state at this row, as far as a region depends on it."""
        i = next(i for i, span in enumerate(self.spans) if row <= span.last)
        signal, span = self._log["walking_signal"], self.spans[i]
        steps, adjustment = self._footsteps(row, i), None
        if steps and span.phase is Phase.SWING:
            pose = steps[0].pose
            nominal = replace(steps[0], pose=_target(signal[span.first]))
            adjustment = Adjustment(nominal, pose)
        # Not 0 in the first row of the log, which is one tick after the start.
        begun = signal[span.first, TIME_IN_PHASE]
        schedule = ContactSchedule(
            phase=span.phase,
            support_side=span.support,
            duration=float(signal[row, DURATION]),
            feet=_feet(self._log, row),
            footsteps=steps,
            start=_UNKNOWN,
        )
        return WalkingState(
            schedule,
            time_in_phase=float(signal[row, TIME_IN_PHASE]),
            elapsed=float(begun + self._log["t"][row] - span.start),
            adjustment=adjustment,
        )

    def _footsteps(self, row: int, i: int) -> tuple[Footstep, ...]:
        """The queue at this row, which is in span `i`, the first adjusted.

        The others were moved within reach when the present transfer, or the
        one before the present swing, began.
        """
        signal, span = self._log["walking_signal"], self.spans[i]
        if span.phase is Phase.SWING and i:
            span = self.spans[i - 1]
        taken = int(signal[row, STEPS_TAKEN])
        reach = self._params.step_adjuster.reachability
        feet = _feet(self._log, span.first)
        landed = self._commanded[taken - 1] if taken else None
        steps = within_reach(self._commanded[taken:], feet, reach, landed)
        if not steps:
            return ()
        return replace(steps[0], pose=_target(signal[row])), *steps[1:]


def _feet(log: Log, row: int) -> FootPoses:
    return FootPoses(*(sole_pose(log, row, side) for side in Side))


def _target(signal: np.ndarray) -> FootPose:
    """Where the foot in the air, or the next one, is going to land."""
    x, y, yaw = signal[TARGET]
    return FootPose(np.array([x, y, 0.0]), float(yaw))
