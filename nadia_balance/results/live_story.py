"""Events of a live run as lines of text: pushes, steps, recovery, fall."""

import math

import numpy as np

from nadia_balance.core.walking import FootPose, Phase, Side, WalkingState
from nadia_balance.results.story import told_move
from nadia_balance.results.summary import ICP_BACK
from nadia_balance.systems.push_source import PushSignal

QUIET = 1.0  # time of small ICP error to recover without steps [s]


class LiveStory:
    """Detects pushes, adjusted steps, recoveries and falls.

    `last_push` and `result` describe the last push and its result in words.
    """

    def __init__(self, calm_steps: int):
        """A recovery requires `calm_steps` full steps of small ICP error."""
        self._calm_steps = calm_steps
        self.last_push = self.result = ""
        self._number = 0.0  # number of the push at the last call of look()
        # Steps taken before the push; None: no push, or recovered.
        self._pushed_after: int | None = None
        # Start of the small ICP error: time [s] and steps taken until then.
        self._back: tuple[float, int] | None = None
        self._step: tuple[int, Side, FootPose, FootPose] | None = None

    def look(
        self, time: float, state: WalkingState, push: PushSignal, error: float
    ) -> list[str]:
        """Returns lines about the events since the last call.

        `error` [m] is the ICP error at `time` [s].
        """
        told = [*self._look_at_push(state, push), *self._look_at_step(state)]
        if self._pushed_after is None:
            return told
        if push.number > 0 or error >= ICP_BACK:
            self._back = None
        elif self._back is None:
            self._back = time, state.steps_taken
        if self._back is not None:
            since, steps = self._back
            enough = time - since >= QUIET
            if self._calm_steps and state.commanded:
                enough = state.steps_taken - steps > self._calm_steps
            if enough:
                taken = steps - self._pushed_after
                self.result = f"RECOVERED in {_steps(taken)}"
                self._pushed_after = None
                told.append(self.result)
        return told

    def fell(self, reason: str) -> str:
        """Records a fall and returns the line that reports it."""
        self._pushed_after, self.result = None, f"FELL: {reason}"
        return self.result

    def _look_at_push(self, state: WalkingState, push: PushSignal) -> list[str]:
        new = push.number > 0 and push.number != self._number
        self._number = float(push.number)
        if not new:
            return []
        yaw = state.schedule.feet[state.schedule.support_side].yaw
        angle = math.degrees(math.atan2(push.force[1], push.force[0]) - yaw)
        self.last_push = (
            f"{push.delta_v:.2f} m/s at {round(angle) % 360} deg, "
            f"{np.linalg.norm(push.force):.0f} N, {phase_text(state)}"
        )
        self._pushed_after, self._back = state.steps_taken, None
        self.result = "pushed"
        return [f"pushed {self.last_push}"]

    def _look_at_step(self, state: WalkingState) -> list[str]:
        """Returns a line if a step has landed on an adjusted foothold."""
        told, last, self._step = [], self._step, None
        if last is not None and last[0] != state.steps_taken:
            _, side, wanted, found = last
            move = told_move(side, wanted, (found.p_WF - wanted.p_WF)[:2])
            if move and self._pushed_after is not None:
                told.append(f"stepped ({side.value}) {move}")
            last = None
        if state.schedule.footsteps:
            step = state.schedule.footsteps[0]
            wanted = step.pose if last is None else last[2]
            self._step = state.steps_taken, step.side, wanted, step.pose
        return told


def phase_text(state: WalkingState) -> str:
    """The point of the gait in the syntax of push.py's --at."""
    schedule = state.schedule
    if schedule.phase is Phase.STANDING:
        return "standing"
    share = state.time_in_phase / schedule.duration
    swing = schedule.support_side.other
    return f"{swing.value} {schedule.phase.value} {100.0 * share:.0f} %"


def _steps(count: int) -> str:
    return f"{count} step{'' if count == 1 else 's'}"
