"""One trial: the walk to the push, the push, and its result."""

import functools
import os
import threading
import time

from pydrake.systems.framework import Context

from nadia_balance.analysis.lipm_limit import LipmLimit
from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.diagrams import simulation
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.summary import summarize
from nadia_balance.scripts.envelope_sweep import fingerprint
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
        row = _kept.walk(walk, plant).push(delta_v, direction_deg, latest)
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
    robot, asked = load_typed(Scenario, "walk", data=walk).robot, dict(identity)
    files = {"robot_files": fingerprint.robot_hash(robot)}
    for name, value in (fingerprint.this_code() | files).items():
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


class Walk:
    """A robot just before its push, which can be repeated with other sizes."""

    def __init__(self, text: str, plant: str):
        """Reads the scenario; it is simulated by the first `push`."""
        self.scenario = load_typed(Scenario, "walk", data=text)
        self.plant = plant
        self.diagram = DIAGRAMS[plant](self.scenario)
        self._to_push: tuple[Context, simulation.Run] | None = None

    def push(self, delta_v: float, direction_deg: float, latest: float) -> dict:
        """Returns the row of a push of `delta_v` [m/s] in a direction [deg].

        `predicted_at_push` and `predicted_at_touchdowns` are the least numbers
        of steps that capture the point mass, or -1: at the end of the push
        (None before it), and at each touchdown after that.

        Raises:
            TimeoutError: it runs longer than `latest` on the monotonic clock.
        """
        diagram, duration = self.diagram, self.scenario.duration
        if self._to_push is None:
            context, run = simulation.walk_to_push(
                diagram, duration, until=lambda _: time.monotonic() > latest
            )
            _check(run, latest)
            self._to_push = context, run
        context, run = self._to_push
        watch, steps = simulation.RecoveryWatch(diagram), self._steps(context)
        at_push: int | None = None
        at_touchdowns: list[int] = []

        def decided(context: Context) -> bool:
            nonlocal at_push, steps
            before, steps = steps, self._steps(context)
            if at_push is not None:
                if steps > before:
                    at_touchdowns.append(self._least_steps(context))
            elif simulation.push_signal(diagram, context).waiting == 0.0:
                at_push = self._least_steps(context)
            return watch(context) or time.monotonic() > latest

        if run.until:  # the walk did not end before the push
            run = simulation.advance(
                simulation.pushed(diagram, context, delta_v, direction_deg),
                duration,
                stop_at_failure=True,
                until=decided,
            )
            _check(run, latest)
        return self._judged(run) | {
            "predicted_at_push": at_push,
            "predicted_at_touchdowns": at_touchdowns,
        }

    def _judged(self, run: simulation.Run) -> dict:
        info = simulation.run_info(self.scenario, run, self.plant)
        summary = summarize(run, info)
        outcome = summary["outcome"]
        if run.error:
            outcome = "error"
        elif run.fell_at is not None:
            outcome = "fell"
        results = {name: summary[name] for name in FROM_SUMMARY}
        return {"outcome": outcome, **results}

    def _least_steps(self, context: Context) -> int:
        model = self.scenario.point_mass(self.diagram.robot)
        return limit_from(self.diagram, context, model=model).least_steps()

    def _steps(self, context: Context) -> int:
        state = self.diagram.GetOutputPort("walking_state").Eval(context)
        return state.steps_taken


class _Kept(threading.local):
    """The walks of this thread; threads do not share diagrams."""

    def __init__(self):
        self.walk = functools.lru_cache(MOST_WALKS)(Walk)


_kept = _Kept()


def limit_from(
    diagram: simulation.ClosedLoop, context: Context, **more
) -> LipmLimit:
    """The limit of any controller from the state in `context` on."""
    state, icp, swing = (
        diagram.GetOutputPort(name).Eval(context)
        for name in ("walking_state", "icp", "swing_foot_reference")
    )
    scenario = diagram.scenario
    return LipmLimit(
        state=state,
        icp=icp,
        foot=swing[:2],
        timing=scenario.controller.timing_adapter,
        on=NAMED[scenario.mechanisms],
        **more,
    )


def _check(run: simulation.Run, latest: float) -> None:
    """Raises KeyboardInterrupt or TimeoutError of an interrupted run."""
    if run.interrupted:
        raise KeyboardInterrupt
    if run.until and time.monotonic() > latest:
        raise TimeoutError
