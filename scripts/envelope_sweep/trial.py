"""One trial: the walk to the push, the push, and its result."""

import functools
import os
import threading
import time

from pydrake.systems.framework import Context

from nadia_balance.analysis.lipm_limit import LipmLimit
from nadia_balance.core.mechanisms import NAMED
from nadia_balance.core.walking import WalkingState
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.diagrams.simulation import (
    RecoveryWatch,
    Run,
    advance,
    push_signal,
    pushed,
    run_info,
    walk_to_push,
)
from nadia_balance.results.summary import summarize
from nadia_balance.scripts.envelope_sweep.fingerprint import (
    robot_hash,
    this_code,
)
from nadia_balance.typed_yaml import load_typed

DIAGRAMS = {"humanoid": HumanoidDiagram, "lipm": LipmDiagram}
FROM_SUMMARY = (
    "reason",
    "steps_after_push",
    "max_icp_error_m",
    "max_torque_ratio",
    "max_joint_speed",
    "max_torso_tilt_deg",
    "max_pelvis_tilt_deg",
    "com_sag_m",
    "positive_power_w",
    "qp_failures",
)
GRACE = 10.0  # time after a trial's timeout at which its process exits [s]
MOST_WALKS = 32  # walks that a thread keeps, about 10 MB each


def run_trial(
    identity: dict,
    walk: str,
    plant: str,
    delta_v: float,
    direction_deg: float,
    timeout: float,
) -> dict:
    """Simulates one push, and returns its row as plain JSON.

    The verdict is that of push.py, at the first instant at which it is certain:
    an improper contact, an exceeded limit, or a recovery.  `outcome` is
    recovered, fell, failed (upright, but not recovered), undecided (the run
    ended too early), hung or error.  Errors of the simulation are not raised
    but reported in the row.  `cpu_s` is the processor time [s], with that of
    the walk in its first trial, `wall_s` the wall time [s].

    A process that does not notice the timeout itself is ended.

    Args:
        identity: what the trial is of (see Sweep.identity)
        walk: the scenario (see Sweep.walk) as YAML, with a zero push
        plant: humanoid or lipm
        delta_v: size of the push [m/s]
        direction_deg: direction of the push, 0 forward, 90 left [deg]
        timeout: wall time after which the trial counts as hung [s]

    Raises:
        ValueError: the code of this process, or the robot's files, differ from
            the `identity`.
        KeyboardInterrupt: the user interrupted the trial.
    """
    _check_identity(walk, frozenset(identity.items()))
    cpu, began = time.thread_time(), time.monotonic()
    latest = began + timeout
    guard = threading.Timer(timeout + GRACE, os._exit, [1])
    guard.daemon = True
    guard.start()
    try:
        row = _walk(walk, plant, latest).push(delta_v, direction_deg, latest)
    except TimeoutError:
        row = row_without_run("hung", f"no result after {timeout:g} s")
    except Exception as error:
        text = " ".join(str(error).split())
        row = row_without_run("error", f"{type(error).__name__}: {text}")
    finally:
        guard.cancel()
    return row | {
        "cpu_s": time.thread_time() - cpu,
        "wall_s": time.monotonic() - began,
    }


@functools.lru_cache
def _check_identity(walk: str, identity: frozenset) -> None:
    scenario, asked = load_typed(Scenario, "walk", data=walk), dict(identity)
    ours = {**this_code(), "robot_files": robot_hash(scenario.robot)}
    for name, value in ours.items():
        if asked.get(name, value) != value:
            raise ValueError(
                f"{name} = {value}: must be {asked[name]}, as when the sweep "
                "began"
            )


def row_without_run(outcome: str, reason: str) -> dict:
    """Returns the row of a trial without a result."""
    return {
        "outcome": outcome,
        **dict.fromkeys(FROM_SUMMARY),
        "reason": reason,
        "predicted_at_push": None,
        "predicted_at_touchdowns": [],
        "cpu_s": None,
        "wall_s": None,
    }


class _Kept(threading.local):
    """The walks of this thread; threads do not share diagrams."""

    def __init__(self):
        self.walks: dict[tuple[str, str], Walk] = {}  # least recent first


_kept = _Kept()


def _walk(text: str, plant: str, latest: float) -> "Walk":
    """Returns the walk of this scenario, from the cache or new."""
    walks, key = _kept.walks, (text, plant)
    walk = walks.pop(key, None)
    if walk is None:
        scenario = load_typed(Scenario, "scenario", data=text)
        walk = Walk(scenario, plant, latest)
        if len(walks) == MOST_WALKS:
            del walks[next(iter(walks))]
    walks[key] = walk
    return walk


class Walk:
    """A robot just before its push, which can be repeated with other sizes."""

    def __init__(self, scenario: Scenario, plant: str, latest: float):
        """Simulates `scenario` on `plant` up to its first push.

        Raises:
            TimeoutError: it runs longer than `latest` on the monotonic clock.
        """
        self.scenario, self.plant = scenario, plant
        self.diagram = DIAGRAMS[plant](scenario)
        self._context, self._run = walk_to_push(
            self.diagram,
            scenario.duration,
            until=lambda context: time.monotonic() > latest,
        )
        _check(self._run, latest)
        # Number of steps before the push.
        self.taken = walking_state(self.diagram, self._context).steps_taken

    def push(self, delta_v: float, direction_deg: float, latest: float) -> dict:
        """Returns the row of a push of `delta_v` [m/s] in a direction [deg].

        Raises:
            TimeoutError: it runs longer than `latest` on the monotonic clock.
        """
        observer = Observer(self, latest)
        if not self._run.until:  # the walk ended before the push
            return self._row(self._run, observer)
        simulator = pushed(self.diagram, self._context, delta_v, direction_deg)
        run = advance(
            simulator,
            self.scenario.duration,
            stop_at_failure=True,
            until=observer,
        )
        _check(run, latest)
        return self._row(run, observer)

    def _row(self, run: Run, observer: "Observer") -> dict:
        summary = summarize(run, run_info(self.scenario, run, self.plant))
        outcome = summary["outcome"]
        if run.error:
            outcome = "error"
        elif run.fell_at is not None:
            outcome = "fell"
        return {
            "outcome": outcome,
            **{name: summary[name] for name in FROM_SUMMARY},
            "predicted_at_push": observer.at_push,
            "predicted_at_touchdowns": observer.at_touchdowns.copy(),
        }


def walking_state(diagram, context: Context) -> WalkingState:
    """The walking state in a `context` of the whole diagram."""
    return diagram.GetOutputPort("walking_state").Eval(context)


class Observer:
    """Observes a pushed robot; ends the simulation once it has recovered.

    `at_push` and `at_touchdowns` are the least numbers of steps that capture
    the point mass, or -1: at the end of the push (None before it), and at
    each touchdown after that.
    """

    def __init__(self, walk: Walk, latest: float):
        """Observes a simulation that continues `walk`."""
        self._walk, self._latest, self._steps = walk, latest, walk.taken
        self.at_push: int | None = None
        self.at_touchdowns: list[int] = []
        self._watch = RecoveryWatch(walk.diagram)

    def __call__(self, context: Context) -> bool:
        """True if the robot has recovered, or the time is up."""
        walk = self._walk
        steps = walking_state(walk.diagram, context).steps_taken
        landed, self._steps = steps > self._steps, steps
        if self.at_push is not None:
            if landed:
                self.at_touchdowns.append(self._foretell(context))
        elif push_signal(walk.diagram, context).waiting == 0.0:
            self.at_push = self._foretell(context)
        return self._watch(context) or time.monotonic() > self._latest

    def _foretell(self, context: Context) -> int:
        scenario, diagram = self._walk.scenario, self._walk.diagram
        state, icp, swing = (
            diagram.GetOutputPort(name).Eval(context)
            for name in ("walking_state", "icp", "swing_foot_reference")
        )
        limit = LipmLimit(
            state=state,
            icp=icp,
            foot=swing[:2],
            model=scenario.point_mass(diagram.robot),
            timing=scenario.controller.timing_adapter,
            on=NAMED[scenario.mechanisms],
        )
        return limit.least_steps()


def _check(run: Run, latest: float) -> None:
    """Raises KeyboardInterrupt or TimeoutError of an interrupted run."""
    if run.interrupted:
        raise KeyboardInterrupt
    if run.until and time.monotonic() > latest:
        raise TimeoutError
