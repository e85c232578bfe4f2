"""The figures of a run: from its log to summary.json."""

import math
import platform
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from diagrams.run_log import (
    FAILURES,
    FALLBACK,
    QP_STATUS,
    SOLVED,
    VIOLATION,
    Log,
    icp_error,
    phase_spans,
    pushes,
    steps,
    switches,
)
from nadia_balance.core.walking import Phase, Side

ICP_BACK = 0.05  # the ICP error of a robot that has recovered [m]
SETTLED = 0.5  # for so long at the end it must be below that [s]
EFFORT_MARGIN = 1e-6  # rounding allowed on top of a torque limit [-]


@dataclass(frozen=True, kw_only=True)
class RunInfo:
    """What the log of a run does not say."""

    robot: str
    mechanisms: str
    scenario: str = ""
    plant: str = "humanoid"  # or lipm
    seed: int = 0
    direction_deg: float | None = None  # of the push, 0 forward, 90 left [deg]
    delta_v: float | None = None  # of the push [m/s]
    fell_at: float | None = None  # [s]
    fall_reason: str = ""
    error: str = ""  # that ended the run early
    interrupted: bool = False  # by the user
    missed_pushes: int = 0  # that never came, or were cut off by the end
    improper_contacts: tuple[str, ...] = ()  # not of a foot and the ground
    cpu_time: float = math.nan  # of the simulation [s]
    required_steps: int = 0  # to be taken after the push
    wanted_steps: int = 0  # what would be required of a longer run


def summarize(log: Log, info: RunInfo) -> dict:
    """Returns all figures of a run as plain values, None if there is none.

    `reason` tells why the run does not count as recovered or, if it does, with
    what reservation.
    """
    error = icp_error(log)
    failure = _failure(log, info, error)
    summary = {
        "recovered": not failure,
        "reason": failure or _reservation(info),
        "fell_at": info.fell_at,
        "scenario": info.scenario,
        "robot": info.robot,
        "plant": info.plant,
        "mechanisms": info.mechanisms,
        "switched_mechanisms": switched_mechanisms(log),
        "seed": info.seed,
        "direction_deg": info.direction_deg,
        "delta_v": info.delta_v,
        "duration_s": _duration(log),
        "max_icp_error_m": _largest(error),
        "rms_icp_error_m": _rms(error),
        "footstep_error_m": _largest(np.array([s.error for s in steps(log)])),
        "swing_durations_s": durations(log, Phase.SWING),
        "transfer_durations_s": durations(log, Phase.TRANSFER),
        "steps_taken": len(steps(log)),
        "steps_after_push": steps_after_push(log),
        "required_steps": info.required_steps,
        "missed_pushes": info.missed_pushes,
        "stance_slip_m": stance_slip(log),
        "non_foot_contact": bool(info.improper_contacts),
        "improper_contacts": list(info.improper_contacts),
        "max_torque_ratio": _largest(torque_ratio(log)),
        "max_joint_speed": _largest(joint_speed(log)),
        "max_joint_speed_limit": joint_speed_limit(log),
        **qp_figures(log),
        "real_time_factor": _duration(log) / max(info.cpu_time, 1e-9),
        "versions": versions(),
    }
    return {name: _plain(value) for name, value in summary.items()}


def _failure(log: Log, info: RunInfo, error: np.ndarray) -> str:
    """Why the run does not count as recovered; empty if it does."""
    if info.error:
        return f"stopped: {info.error}"
    if info.fell_at is not None:
        return f"fell: {info.fall_reason}" if info.fall_reason else "fell"
    if info.interrupted or len(error) == 0:
        return "interrupted"
    if info.improper_contacts:
        return f"contact of {', '.join(info.improper_contacts)}"
    if info.missed_pushes:  # who was not pushed has not recovered from it
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


def switched_mechanisms(log: Log) -> list[dict]:
    """What was on from which time [s] on, once it was switched in the tab."""
    return [
        {"time_s": time, "on": [name for name, on in asdict(m).items() if on]}
        for time, m in switches(log)
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
        for side, first in ((Side.LEFT, 0), (Side.RIGHT, 3)):
            if span.carries(side):
                rows = slice(span.first, span.last + 1)
                xy = log["foot_poses"][rows, first : first + 2]
                slips.append(np.max(np.linalg.norm(xy - xy[0], axis=1)))
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


def qp_figures(log: Log) -> dict:
    """Solves, failures, fallbacks, largest violation, of both QPs together."""
    status = [log[name] for name in QP_STATUS if name in log and len(log["t"])]
    violation = np.concatenate(
        [np.zeros(0), *(s[:, VIOLATION] for s in status)]
    )
    return {
        "qp_solves": sum(len(s) for s in status),
        "qp_failures": sum(
            int(max(np.sum(s[:, SOLVED] < 0.5), s[-1, FAILURES]))
            for s in status
        ),
        "qp_fallbacks": sum(int(np.sum(s[:, FALLBACK] > 0.5)) for s in status),
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


def _duration(log: Log) -> float:
    t = log["t"]
    # The last row, too, stands for one period.
    return float(t[-1] - t[0] + t[1] - t[0]) if len(t) > 1 else 0.0


def _largest(values: np.ndarray) -> float | None:
    return float(np.max(values)) if values.size else None


def _rms(values: np.ndarray) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _plain(value: object) -> object:
    """JSON knows neither NaN nor infinity."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
