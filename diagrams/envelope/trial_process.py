"""Trials in a process of their own: one that dies costs only its own row."""

import atexit
import json
import threading

from diagrams.envelope.trial import row_without_run
from diagrams.envelope.trial_child import TrialChild

# Drake never frees a diagram that has systems in Python: 6 MB for each trial.
# A new child takes a second. [-]
TRIALS_PER_CHILD = 50

_this_thread = threading.local()


def run_in_process(
    scenario_yaml: str, plant: str, timeout: float, identity: dict
) -> dict:
    """TrialProcess.run, of the one that belongs to the calling thread."""
    if not hasattr(_this_thread, "process"):
        give_to_this_thread(process := TrialProcess())
        atexit.register(process.close)
    return _this_thread.process.run(scenario_yaml, plant, timeout, identity)


def give_to_this_thread(process: "TrialProcess") -> None:
    """Makes run_in_process use this one; who gives it closes it."""
    _this_thread.process = process


class TrialProcess:
    """Runs one trial after the other in a child, renewed when need be."""

    def __init__(self):
        self._child: TrialChild | None = None  # the first trial starts it
        self._closed = False
        self._starting = threading.Lock()

    def run(
        self, scenario_yaml: str, plant: str, timeout: float, identity: dict
    ) -> dict:
        """Returns the row of a trial (see run_trial), whatever happens to it.

        If the child dies, `outcome` is crashed, and `reason` tells how and the
        last line of its stderr; if it is late, it is killed: hung.

        Args:
            scenario_yaml: a whole Scenario; a robot.yaml by its absolute path
            plant: humanoid or lipm
            timeout: on the clock on the wall, a start of the child included [s]
            identity: of the sweep (Sweep.identity), for the child to compare

        Raises:
            RuntimeError: it was closed, or the child does not begin with the
                trial: it dies before, has other code or another robot.
            OSError: no child can be started.
        """
        child = self._ready_child()
        request = {
            "scenario": scenario_yaml,
            "plant": plant,
            "timeout": timeout,
            "identity": identity,
        }
        try:
            reply = child.ask(request, timeout)
        except TimeoutError:
            child.close()
            return row_without_run("hung", f"no result after {timeout:g} s")
        if not reply:
            return row_without_run("crashed", child.death())
        return json.loads(reply)

    @property
    def pid(self) -> int | None:
        """The child's, or that of the last one; None before the first."""
        return self._child.process.pid if self._child else None

    def kill(self) -> None:
        """Ends the child, also in mid-trial, for good; from any thread."""
        with self._starting:
            self._closed = True
            if self._child:
                self._child.process.kill()

    def close(self) -> None:
        """Ends the child for good, when no other thread is in `run`."""
        self.kill()
        if self._child:
            self._child.close()

    def _ready_child(self) -> TrialChild:
        child = self._child
        if child and child.is_alive and child.trials < TRIALS_PER_CHILD:
            return child
        if child:
            child.close()
        with self._starting:
            if self._closed:
                raise RuntimeError("the process for trials has been closed")
            self._child = TrialChild()
        return self._child
