"""The recovery from pushes: whole steps with a small ICP error."""

import numpy as np

from nadia_balance.results.log import Log, PushSpan, icp_error, pushes, steps

ICP_BACK = 0.05  # bound of the ICP error of a recovered robot [m]


class CalmSteps:
    """Counts, tick by tick, the whole steps with a small ICP error.

    They follow the last push; from one landing to the next the error is always
    below ICP_BACK.  `since` [s] and `taken` are the time of the last large
    error or push, and the number of steps taken until then.
    """

    def __init__(self) -> None:
        """Counts from the first call of `look`."""
        self.since, self.taken = 0.0, 0

    def look(
        self, time: float, steps_taken: int, error: float, pushed: bool
    ) -> int:
        """Returns the number of calm steps at `time` [s].

        `error` [m] is the ICP error; `pushed` is true while a push acts.
        """
        if pushed or not error < ICP_BACK:
            self.since, self.taken = time, steps_taken
        return max(steps_taken - self.taken - 1, 0)


def calm_steps(log: Log) -> int:
    """Number of calm steps (see CalmSteps) at the end of the log."""
    last = pushes(log)[-1:]
    begin = recovered_at(log, last[0] if last else None)
    landings = [step.swing.end for step in steps(log)]
    return max(sum(time > begin for time in landings) - 1, 0)


def recovered_at(log: Log, push: PushSpan | None) -> float:
    """Time [s] of the last ICP error above ICP_BACK, or the end of `push`."""
    begin = push.end if push else 0.0
    after = log["t"] >= begin
    large = np.flatnonzero(after & (icp_error(log) >= ICP_BACK))
    return float(log["t"][large[-1]]) if len(large) else begin


def recovery_time(log: Log) -> float | None:
    """Time [s] from the start of the last push to `recovered_at`, if any."""
    last = pushes(log)[-1:]
    return recovered_at(log, last[0]) - last[0].start if last else None
