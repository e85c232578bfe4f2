"""The figures of a run: from its log to summary.json."""

import math
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from nadia_balance.core.walking import Phase, Side
from nadia_balance.results.log import (
    QP_STATUS,
    Log,
    icp_error,
    phase_spans,
    pushes,
    signal,
    steps,
    switches,
)

ICP_BACK = 0.05  # the ICP error of a robot that has recovered [m]
SETTLED = 0.5  # for so long at the end it must be below that [s]
EFFORT_MARGIN = 1e-6  # rounding allowed on top of a torque limit [-]


@dataclass(frozen=True, kw_only=True)
class Run:
    """What came out of a simulation."""

    logs: Log
    fell_at: float | None = None  # [s]
    fall_reason: str = ""
    simulated_time: float = 0.0  # [s]
    cpu_time: float = math.nan  # [s]
    interrupted: bool = False  # by Ctrl-C
    missed_pushes: int = 0  # that never came, or were cut off by the end
    improper_contacts: tuple[str, ...] = ()  # not of a foot and the ground
    error: str = ""  # that ended the run early, such as NaN at an input
    until: bool = False  # it was ended from outside (see diagrams.simulation)


@dataclass(frozen=True, kw_only=True)
class RunInfo:
    """What was simulated, and what is required of it."""

    robot: str
    mechanisms: str
    scenario: str = ""
    plant: str = "humanoid"  # or lipm
    seed: int = 0
    direction_deg: float | None = None  # of the push, 0 forward, 90 left [deg]
    delta_v: float | None = None  # of the push [m/s]
    required_steps: int = 0  # to be taken after the push
    wanted_steps: int = 0  # what would be required of a longer run


def summarize(run: Run, info: RunInfo) -> dict:
    """Returns all figures of a run as plain values, None if there is none.

    `reason` tells why the run does not count as recovered or, if it does, with
    what reservation.
    """
    log = run.logs
    error, t = icp_error(log), log["t"]
    duration = float(t[-1] - t[0]) if len(t) else 0.0
    failure = _failure(run, info, error)
    summary = {
        "recovered": not failure,
        "reason": failure or _reservation(info),
        "fell_at": run.fell_at,
        "scenario": info.scenario,
        "robot": info.robot,
        "plant": info.plant,
        "mechanisms": info.mechanisms,
        "switched_mechanisms": [
            {"time_s": time, "on": on} for time, on in switches(log)
        ],
        "seed": info.seed,
        "direction_deg": info.direction_deg,
        "delta_v": info.delta_v,
        "pushes": [
            {"time_s": push.start, "delta_v": push.delta_v}
            for push in pushes(log)
        ],
        "duration_s": duration,
        "max_icp_error_m": _largest(error),
        "rms_icp_error_m": math.sqrt(np.mean(error**2)) if len(t) else None,
        "footstep_error_m": _largest(np.array([s.error for s in steps(log)])),
        "swing_durations_s": durations(log, Phase.SWING),
        "transfer_durations_s": durations(log, Phase.TRANSFER),
        "steps_taken": len(steps(log)),
        "steps_after_push": steps_after_push(log),
        "required_steps": info.required_steps,
        "missed_pushes": run.missed_pushes,
        "stance_slip_m": stance_slip(log),
        "non_foot_contact": bool(run.improper_contacts),
        "improper_contacts": list(run.improper_contacts),
        "max_torque_ratio": _largest(torque_ratio(log)),
        "max_joint_speed": _largest(joint_speed(log)),
        "max_joint_speed_limit": joint_speed_limit(log),
        **_qp_figures(log),
        "real_time_factor": duration / max(run.cpu_time, 1e-9),
        "versions": versions(),
    }
    return {  # JSON knows neither NaN nor infinity
        name: None
        if isinstance(value, float) and not math.isfinite(value)
        else value
        for name, value in summary.items()
    }


def _failure(run: Run, info: RunInfo, error: np.ndarray) -> str:
    """Why the run does not count as recovered; empty if it does."""
    log = run.logs
    if run.error:
        return f"stopped: {run.error}"
    if run.fell_at is not None:
        return f"fell: {run.fall_reason}" if run.fall_reason else "fell"
    if run.interrupted or len(error) == 0:
        return "interrupted"
    if run.improper_contacts:
        return f"contact of {', '.join(run.improper_contacts)}"
    if run.missed_pushes:
        return "not pushed: the push did not come before the end"
    settled = log["t"] >= log["t"][-1] - SETTLED
    if not np.all(error[settled] < ICP_BACK):
        return f"the ICP error did not stay below {ICP_BACK} m"
    if failure := _overload(log):
        return failure
    if steps_after_push(log) < info.required_steps:
        failure = f"fewer than {info.required_steps} steps after the push"
        return ", ".join(filter(None, (failure, _reservation(info))))
    return ""


def _reservation(info: RunInfo) -> str:
    """That less was required than was wanted; empty if it was not."""
    if info.required_steps >= info.wanted_steps:
        return ""
    return (
        f"the run is too short for {info.wanted_steps} more steps, "
        f"{info.required_steps} were required"
    )


def _overload(log: Log) -> str:
    """Which limit of the joints was passed; empty if none was."""
    ratio = _largest(torque_ratio(log))
    if ratio is not None and not ratio <= 1.0 + EFFORT_MARGIN:
        return "a torque was above its limit"
    speed, limit = _largest(joint_speed(log)), joint_speed_limit(log)
    if speed is not None and limit is not None and not speed <= limit:
        return f"too fast: a joint at {speed:.2f} rad/s, limit {limit:g} rad/s"
    return ""


def durations(log: Log, phase: Phase) -> list[float]:
    """How long [s] each phase of this kind lasted that has ended."""
    return [
        round(span.duration, 6)
        for span in phase_spans(log)
        if span.phase is phase and span.complete
    ]


def steps_after_push(log: Log) -> int:
    """Number of steps landed since the last push began, or in all."""
    last = pushes(log)[-1:]
    begin = last[0].start if last else -math.inf
    return sum(step.swing.end > begin for step in steps(log))


def stance_slip(log: Log) -> float | None:
    """Largest way [m] of a stance foot from where its swing phase began.

    In a run without a swing, of either foot from where it stood at first.
    """
    if "foot_poses" not in log:
        return None
    spans = phase_spans(log)
    swings = [s for s in spans if s.phase is Phase.SWING]
    slips = [0.0]
    for span in swings or spans:
        feet = signal(log, "foot_poses", slice(span.first, span.last + 1))
        for side in filter(span.carries, Side):
            x, y, _ = getattr(feet, side.value)
            slips.append(np.max(np.hypot(x - x[0], y - y[0])))
    return float(np.max(slips))


def torque_ratio(log: Log) -> np.ndarray:
    """|torque| / limit (n, nu) [-]; empty without joints."""
    if "actuation" not in log or "effort_limits" not in log:
        return np.zeros((0, 0))
    return np.abs(log["actuation"]) / log["effort_limits"]


def joint_speed(log: Log) -> np.ndarray:
    """|joint speed| (n, nv - 6) [rad/s]; empty without joints."""
    if "state" not in log or "num_positions" not in log:
        return np.zeros((0, 0))
    floating_base = 6
    return np.abs(log["state"][:, int(log["num_positions"]) + floating_base :])


def joint_speed_limit(log: Log) -> float | None:
    """What no joint may be faster than [rad/s]; None without joints."""
    limit = log.get("joint_speed_limit")
    return None if limit is None else float(limit)


def _qp_figures(log: Log) -> dict:
    """Solves, failures, fallbacks, largest violation, of both QPs together."""
    present = [name for name in QP_STATUS if name in log and len(log["t"])]
    qps = [signal(log, name) for name in present]
    violation = np.concatenate([np.zeros(0), *(qp.violation for qp in qps)])
    return {
        "qp_solves": sum(len(qp.solved) for qp in qps),
        "qp_failures": sum(
            int(max(np.sum(qp.solved < 0.5), qp.failures[-1])) for qp in qps
        ),
        "qp_fallbacks": sum(int(np.sum(qp.fallback > 0.5)) for qp in qps),
        "max_qp_violation": _largest(violation[np.isfinite(violation)]),
    }


def versions() -> dict[str, str]:
    """The versions that the figures depend on."""
    found = {"python": platform.python_version()}
    for package in ("nadia_balance", "drake", "numpy"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from a checkout
            found[package] = "not installed"
    return found


def _largest(values: np.ndarray) -> float | None:
    return float(np.max(values)) if values.size else None
