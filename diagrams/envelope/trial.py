"""One trial: a push in one cell of the envelope, and what comes of it."""

import copy
import time

from diagrams.envelope.capturability import predictions
from diagrams.envelope.sweep_plan import Cell
from diagrams.humanoid import HumanoidDiagram
from diagrams.lipm import LipmDiagram
from diagrams.run_info import run_info
from diagrams.scenario import Scenario
from diagrams.simulation import Run, simulate
from diagrams.summary import summarize

DIAGRAMS = {"humanoid": HumanoidDiagram, "lipm": LipmDiagram}
FROM_SUMMARY = (
    "reason",
    "steps_after_push",
    "max_icp_error_m",
    "max_torque_ratio",
    "max_joint_speed",
    "qp_failures",
)


def trial_scenario(
    sweep_scenario: Scenario,
    cell: Cell,
    delta_v: float,
    replica: int,
    period: float,
) -> Scenario:
    """Returns the scenario of a trial; `sweep_scenario` is left as it is.

    It has the mechanisms of the `cell`, and its first push is that of the
    cell, of `delta_v` [m/s].  Replica 0 is just what the flags of push.py ask
    for; each other one starts a little elsewhere (its seed), and every second
    one is pushed one control `period` [s] later.

    Raises:
        ValueError: a field is out of range.
    """
    scenario = copy.deepcopy(sweep_scenario)
    scenario.mechanisms = cell.mechanisms
    scenario.seed += replica
    push, moment = scenario.pushes[0], cell.moment
    push.delta_v, push.force = delta_v, None
    push.direction_deg = cell.direction_deg
    push.time, push.phase = None, moment.phase
    push.side, push.fraction = moment.side, moment.fraction
    push.delay += (replica % 2) * period
    scenario.validate()
    return scenario


def run_trial(scenario: Scenario, plant: str) -> dict:
    """Simulates `scenario` on `plant`, and returns its row as plain JSON.

    The verdict is that of push.py, but the run ends with the first improper
    contact, after which it cannot be good any more.  `outcome` is recovered,
    fell, failed (upright, but not recovered) or error; `cpu_s` the processor
    time [s] of everything.  No error is raised, whatever it is: a trial is
    one of hundreds, and its row tells.

    Raises:
        KeyboardInterrupt: the user interrupted it, so that there is no row.
    """
    began = time.process_time()
    try:
        row = _row(scenario, plant)
    except Exception as error:
        text = " ".join(str(error).split())
        row = row_without_run("error", f"{type(error).__name__}: {text}")
    return row | {"cpu_s": time.process_time() - began}


def row_without_run(outcome: str, reason: str) -> dict:
    """Returns the row of a trial of which there is nothing to measure."""
    return {
        "outcome": outcome,
        **dict.fromkeys(FROM_SUMMARY),
        "reason": reason,
        "predicted_at_push": None,
        "predicted_at_touchdowns": [],
        "cpu_s": None,
    }


def _row(scenario: Scenario, plant: str) -> dict:
    diagram = DIAGRAMS[plant](scenario)
    run = simulate(diagram, scenario.duration, stop_at_improper_contact=True)
    if run.interrupted:
        raise KeyboardInterrupt
    summary = summarize(run.logs, run_info(scenario, run, plant))
    predicted = predictions(run.logs, scenario, diagram.robot)
    return {
        "outcome": _outcome(run, summary),
        **{name: summary[name] for name in FROM_SUMMARY},
        "predicted_at_push": predicted.at_push,
        "predicted_at_touchdowns": list(predicted.at_touchdowns),
    }


def _outcome(run: Run, summary: dict) -> str:
    if summary["recovered"]:
        return "recovered"
    if run.error:
        return "error"
    return "failed" if run.fell_at is None else "fell"
