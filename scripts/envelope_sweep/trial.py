"""One trial: the walk to the push, the push, and its result."""

import functools
import threading
import time

from pydrake.systems.framework import Context

from nadia_balance.analysis.lipm_limit import LipmLimit
from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.diagrams import simulation
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.summary import Run
from nadia_balance.scripts.envelope_sweep.sweep import of_process
from nadia_balance.typed_yaml import load_typed

FROM_SUMMARY = (
    *("reason", "steps_after_push", "max_icp_error_m", "max_torque_ratio"),
    *("max_joint_speed", "max_torso_tilt_deg", "max_pelvis_tilt_deg"),
    *("com_sag_m", "positive_power_w", "qp_failures"),
)
MOST_WALKS = 32  # walks that a process keeps, about 10 MB each


def run_trial(
    identity: dict,
    walk: str,
    system: tuple[str, str],
    delta_v: float,
    direction_deg: float,
) -> dict:
    """Simulates one push, and returns the results of its row.

    The verdict is that of push.py, at the first instant at which it is certain:
    an improper contact, an exceeded limit, or a recovery.  `outcome` is
    recovered, fell, failed (upright, but not recovered), undecided (the run
    ended too early) or error.  Errors of the simulation are not raised but
    reported in the row.  `cpu_s` is the processor time [s], with that of the
    walk in its first trial.

    `identity` is that of the sweep, `walk` the scenario of Sweep.walk as YAML,
    `system` its plant and controller; the push has `delta_v` [m/s], 0 deg is
    forward, 90 left.

    Raises ValueError: this process has another code or robot.
    """
    began = time.thread_time()
    same = frozenset(identity.items())
    walked = _walked(same, walk, *system, threading.get_ident())
    try:
        row = _pushed(*walked, delta_v, direction_deg)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        row = {"outcome": "error", "reason": reason}
    return row | {"cpu_s": time.thread_time() - began}


@functools.lru_cache(MOST_WALKS)
def _walked(
    identity: frozenset, text: str, plant: str, controller: str, thread: int
) -> tuple[ClosedLoop, Context, Run]:
    """Walks to the push; threads do not share diagrams."""
    scenario, asked = load_typed(Scenario, "walk", data=text), dict(identity)
    for name, value in of_process(scenario, controller).items():
        if asked.get(name, value) != value:
            raise ValueError(
                f"{name} = {value}: must be {asked[name]}, as when the sweep "
                "began"
            )
    diagram = simulation.closed_loop(scenario, plant, controller)
    return diagram, *simulation.walk_to_push(diagram)


def _pushed(
    diagram: ClosedLoop,
    walked: Context,
    run: Run,
    delta_v: float,
    direction_deg: float,
) -> dict:
    """Returns the row of a push, unless the `run` ended before it.

    `predicted_at_push` is the least number of steps that capture the point mass
    at the end of the push, -1 for none; None if the push did not end, or for a
    policy, which has no plan.
    """
    scenario, watch = diagram.scenario, simulation.RecoveryWatch(diagram)
    plans = diagram.HasOutputPort("walking_state")
    at_push: int | None = None

    def decided(context: Context) -> bool:
        nonlocal at_push
        signal = simulation.push_signal(diagram, context)
        if plans and at_push is None and signal.waiting == 0.0:
            model = scenario.point_mass(diagram.robot)
            limit = limit_from(diagram, context, model=model)
            at_push = limit.least_steps()
        return watch(context)

    if run.until:
        run = simulation.advance(
            simulation.pushed(diagram, walked, delta_v, direction_deg),
            scenario.duration,
            stop_at_failure=True,
            until=decided,
        )
    summary = run.summary
    outcome = "fell" if run.fell_at is not None else summary["outcome"]
    return {
        "outcome": "error" if run.error else outcome,
        **{name: summary[name] for name in FROM_SUMMARY},
        "predicted_at_push": at_push,
    }


def limit_from(diagram: ClosedLoop, context: Context, **more) -> LipmLimit:
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
