"""Evaluation of a run: from its log to summary.json."""

import math
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from nadia_balance.core.polygon import halfspaces, minkowski_sum, project
from nadia_balance.core.walking import FootPose, Phase, Side
from nadia_balance.results.log import (
    QP_STATUS,
    Log,
    PushSpan,
    ground_regions,
    icp_error,
    phase_spans,
    pushes,
    signal,
    steps,
    switches,
)
from nadia_balance.systems.walking_state_machine import PHASES
from nadia_balance.systems.whole_body_inverse_dynamics import GIVES_UP_AFTER

ICP_BACK = 0.05  # bound of the ICP error of a recovered robot [m]
SETTLED = 0.5  # time below ICP_BACK at the end of a run without steps [s]
EFFORT_MARGIN = 1e-6  # rounding tolerated above a torque limit [-]
SPEED_MARGIN = 0.02  # overshoot tolerated above a joint's speed limit [-]
ROUNDING = 1e-6  # of times [s]
STANDS = float(PHASES.index(Phase.STANDING))  # in a WalkingSignal
PASSING = 0.1  # soles pass each other if their heights differ by less [m]


@dataclass(frozen=True, kw_only=True)
class Run:
    """Results of a simulation."""

    logs: Log
    fell_at: float | None = None  # [s]
    fall_reason: str = ""
    simulated_time: float = 0.0  # [s]
    cpu_time: float = math.nan  # [s]
    interrupted: bool = False  # by Ctrl-C
    missed_pushes: int = 0  # pushes that had not begun, or not ended
    improper_contacts: tuple[str, ...] = ()  # not of a foot and the ground
    error: str = ""  # error that ended the run early, such as NaN at an input
    until: bool = False  # `until` ended the run (see diagrams.simulation)


@dataclass(frozen=True, kw_only=True)
class RunInfo:
    """Conditions of a run, and the criteria of recovery.

    `direction_deg` and `delta_v` are those of the scenario's first push.
    """

    robot: str
    mechanisms: str
    scenario: str = ""
    plant: str = "humanoid"  # or lipm
    fidelity: str = "realistic"  # or ideal
    engine: str = "drake"  # or mujoco
    seed: int = 0
    direction_deg: float | None = None  # of the push, 0 forward, 90 left [deg]
    delta_v: float | None = None  # of the push [m/s]
    calm_steps: int = 0  # complete steps with small ICP error to recover
    is_long_enough: bool = True  # the run has time for a recovery
    max_torso_tilt_deg: float = 180.0  # bound for a recovery [deg]


def summarize(run: Run, info: RunInfo) -> dict:
    """Returns all results of a run as plain values, None if not available.

    `outcome` is recovered (also of a run without a push), failed, or undecided:
    no failure was found, but the run was too short.  `reason` explains an
    outcome other than recovered.
    """
    log = run.logs
    error, t = icp_error(log), log["t"]
    duration = float(t[-1] - t[0]) if len(t) else 0.0
    outcome, reason = _judge(run, info, error)
    summary = {
        "outcome": outcome,
        "recovered": outcome == "recovered",
        "reason": reason,
        "fell_at": run.fell_at,
        "scenario": info.scenario,
        "robot": info.robot,
        "plant": info.plant,
        "fidelity": info.fidelity,
        "engine": info.engine,
        "mechanisms": info.mechanisms,
        "switched_mechanisms": [
            {"time_s": time, "on": on} for time, on in switches(log)
        ],
        "seed": info.seed,
        "direction_deg": info.direction_deg,
        "delta_v": info.delta_v,
        "pushes": [_push_figures(log, push) for push in pushes(log)],
        "recovery_time_s": recovery_time(log)
        if outcome == "recovered"
        else None,
        "body_sway_deg": _largest(body_sway(log)),
        **_posture_figures(log),
        "duration_s": duration,
        "max_icp_error_m": _largest(error),
        "rms_icp_error_m": math.sqrt(np.mean(error**2)) if len(t) else None,
        "footstep_error_m": _largest(np.array([s.error for s in steps(log)])),
        "swing_durations_s": durations(log, Phase.SWING),
        "transfer_durations_s": durations(log, Phase.TRANSFER),
        "steps_taken": len(steps(log)),
        "steps_after_push": steps_after_push(log),
        "calm_steps": calm_steps(log),
        "required_calm_steps": info.calm_steps,
        "missed_pushes": run.missed_pushes,
        "stance_slip_m": stance_slip(log),
        "non_foot_contact": bool(run.improper_contacts),
        "improper_contacts": list(run.improper_contacts),
        "self_contacts": self_contacts(run),
        "max_torque_ratio": _largest(torque_ratio(log)),
        "max_torque_step": _largest(torque_step(log)),
        "max_joint_speed": _largest(joint_speed(log)),
        "max_joint_speed_ratio": _largest(joint_speed_ratio(log)),
        "max_power_w": _largest(power(log)),
        "positive_power_w": _largest(positive_power(log)),
        **_swing_figures(log),
        "max_impact_body_weights": _largest(foot_force_ratio(log)),
        "min_sole_distance_m": sole_distance(log),
        "min_edge_distances_m": edge_distances(log),
        **_qp_figures(log),
        "real_time_factor": duration / max(run.cpu_time, 1e-9),
        "versions": versions(info.engine),
    }
    return {  # JSON has neither NaN nor infinity
        name: None
        if isinstance(value, float) and not math.isfinite(value)
        else value
        for name, value in summary.items()
    }


def _judge(run: Run, info: RunInfo, error: np.ndarray) -> tuple[str, str]:
    """The outcome, and the reason of one other than recovered."""
    if reason := _failure(run, info, error):
        return "failed", reason
    if reason := _doubt(run):
        return "undecided", reason
    if not (reason := _shortfall(run.logs, info, error)):
        return "recovered", ""
    if info.is_long_enough:
        return "failed", reason
    return "undecided", f"too short: {reason}"


def _failure(run: Run, info: RunInfo, error: np.ndarray) -> str:
    """The first failure that is found; empty if there is none."""
    log = run.logs
    if run.error:
        return f"stopped: {run.error}"
    gave_up = "the controller gave up" if _gave_up(log) else ""
    if run.fell_at is not None:
        why = ", ".join(filter(None, (run.fall_reason, gave_up)))
        return f"fell: {why}" if why else "fell"
    if run.interrupted or len(error) == 0:
        return "interrupted"
    if gave_up:
        return gave_up
    if run.improper_contacts:
        return f"contact of {', '.join(run.improper_contacts)}"
    tilt = _posture_figures(log)["max_torso_tilt_deg"]
    if tilt is not None and tilt > info.max_torso_tilt_deg:
        return f"tilted: the torso by {tilt:.0f} deg"
    return _overload(log)


def _doubt(run: Run) -> str:
    """The reason why the run is too short to judge; empty if it is not."""
    log = run.logs
    if run.missed_pushes:
        return "not pushed: the push did not come before the end"
    for push in pushes(log)[-1:]:
        if (left := log["t"][-1] - push.end) < SETTLED - ROUNDING:
            return f"too short: the run ended {left:.2f} s after the push"
    return ""


def _shortfall(log: Log, info: RunInfo, error: np.ndarray) -> str:
    """The criterion of recovery that is not met at the end; empty if none."""
    if info.calm_steps and calm_steps(log) >= info.calm_steps:
        return ""
    walks = signal(log, "walking_signal", -1).phase != STANDS
    if info.calm_steps and walks:
        return (
            f"the ICP error did not stay below {ICP_BACK} m for "
            f"{info.calm_steps} whole steps"
        )
    settled = log["t"] >= log["t"][-1] - SETTLED
    if not np.all(error[settled] < ICP_BACK):
        return f"the ICP error did not stay below {ICP_BACK} m"
    return ""


def calm_steps(log: Log) -> int:
    """Number of complete steps at the end with small ICP errors.

    They follow the last push; from one landing to the next the error is always
    below ICP_BACK.
    """
    last = pushes(log)[-1:]
    begin = recovered_at(log, last[0] if last else None)
    landings = [step.swing.end for step in steps(log)]
    return max(sum(time > begin for time in landings) - 1, 0)


def _push_figures(log: Log, push: PushSpan) -> dict:
    """Data of one push, with its impulse and the work done on the CoM."""
    felt = push.rows
    before = np.maximum(felt - 1, 0)
    force = signal(log, "push_signal", felt).force
    impulses = force * (log["t"][felt] - log["t"][before])
    com = signal(log, "com_state").velocity
    work = np.sum(impulses * 0.5 * (com[:, before] + com[:, felt]))
    return {
        "time_s": push.start,
        "duration_s": push.end - push.start,
        "delta_v": push.delta_v,
        "direction_deg": push.direction_deg,
        "force_n": float(np.linalg.norm(push.force)),
        "impulse_n_s": float(np.linalg.norm(np.sum(impulses, axis=1))),
        "absorbed_energy_j": float(work),
    }


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


def body_sway(log: Log) -> np.ndarray:
    """Tilt (n,) [deg] of the line from the midpoint of the soles to the CoM.

    A foot in the air has its last pose on the ground; the height is
    `com_height`.
    """
    feet, com = signal(log, "walking_signal"), signal(log, "com_state").position
    middle = 0.5 * (feet.left[:2] + feet.right[:2])
    away = np.hypot(*(com[:2] - middle))
    return np.degrees(np.arctan2(away, com_height(log)))


def com_height(log: Log) -> np.ndarray:
    """Height (n,) [m] of the CoM above the lower one of the soles."""
    height = signal(log, "com_state").position[2]
    if "foot_poses" not in log:
        return height
    soles = signal(log, "foot_poses")
    return height - np.minimum(soles.left[2], soles.right[2])


def _posture_figures(log: Log) -> dict:
    """Largest tilts [deg] of torso and pelvis, and drop [m] of the CoM."""
    tilts = [np.zeros(0), np.zeros(0)]
    if "trunk_tilt" in log:
        tilts = [np.degrees(tilt) for tilt in signal(log, "trunk_tilt")]
    height = com_height(log)
    return {
        "max_torso_tilt_deg": _largest(tilts[0]),
        "max_pelvis_tilt_deg": _largest(tilts[1]),
        "com_sag_m": _largest(height[:1] - height),
    }


def _overload(log: Log) -> str:
    """The joint limit that was exceeded; empty if none was."""
    ratio = _largest(torque_ratio(log))
    if ratio is not None and not ratio <= 1.0 + EFFORT_MARGIN:
        return "a torque was above its limit"
    ratio = _largest(joint_speed_ratio(log))
    if ratio is not None and not ratio <= 1.0 + SPEED_MARGIN:
        return f"too fast: a joint at {100.0 * ratio:.1f} % of its limit"
    return ""


def _gave_up(log: Log) -> bool:
    """True if the whole-body QP failed throughout the last GIVES_UP_AFTER."""
    if "whole_body_qp_status" not in log:
        return False
    t, solved = log["t"], signal(log, "whole_body_qp_status").solved > 0.5
    late = t > t[-1:] - GIVES_UP_AFTER - ROUNDING
    return not np.all(late) and not np.any(solved[late])


def durations(log: Log, phase: Phase) -> list[float]:
    """Durations [s] of the completed phases of this kind."""
    return [
        round(span.duration, 6)
        for span in phase_spans(log)
        if span.phase is phase and span.complete
    ]


def steps_after_push(log: Log) -> int:
    """Number of landings since the last push began, or since the start."""
    last = pushes(log)[-1:]
    begin = last[0].start if last else -math.inf
    return sum(step.swing.end > begin for step in steps(log))


def stance_slip(log: Log) -> float | None:
    """Largest displacement [m] of a stance foot since its swing phase began.

    In a run without a swing: of either foot, since its phase began.
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


def torque_step(log: Log) -> np.ndarray:
    """|change of commanded torque| (n - 1, nu) [N m] from tick to tick."""
    return np.abs(np.diff(log.get("actuation", np.zeros((0, 0))), axis=0))


def joint_speed(log: Log) -> np.ndarray:
    """|joint speed| (n, nu) [rad/s]; empty without joints."""
    return np.abs(_joint_velocity(log))


def _joint_velocity(log: Log) -> np.ndarray:
    if "joint_speed_columns" not in log:
        return np.zeros((0, 0))
    return log["state"][:, log["joint_speed_columns"]]


def joint_speed_ratio(log: Log) -> np.ndarray:
    """|joint speed| / limit (n, nu) [-]; empty without joints."""
    return joint_speed(log) / log.get("joint_speed_limits", np.ones(0))


def power(log: Log) -> np.ndarray:
    """Net mechanical power (n,) [W]: braking drives count as negative."""
    return np.sum(_powers(log), axis=1)


def positive_power(log: Log) -> np.ndarray:
    """Mechanical power (n,) [W] of the drives that do not brake."""
    return np.sum(np.maximum(_powers(log), 0.0), axis=1)


def _powers(log: Log) -> np.ndarray:
    """Mechanical power (n, nu) [W] of each drive."""
    if "torques" not in log:
        return np.zeros((0, 0))
    return log["torques"] * _joint_velocity(log)


def foot_force_ratio(log: Log) -> np.ndarray:
    """Force on a foot / weight (n, 2) [-], each the mean of a tick."""
    if "weight" not in log:
        return np.zeros((0, 2))
    return log["foot_forces"] / log["weight"]


def _swing_figures(log: Log) -> dict:
    """Largest instantaneous and largest mean speed [m/s] of swing feet.

    The mean speed of a swing is the mean over its ticks, of the sole's centre.
    """
    speeds = [np.zeros(0)]
    if "foot_poses" in log:
        for step in steps(log):
            rows = slice(step.swing.first, step.swing.last + 2)
            feet = signal(log, "foot_poses", rows)
            ways = np.diff(getattr(feet, step.side.value))
            times = np.diff(log["t"][rows])
            speeds.append(np.linalg.norm(ways, axis=0) / times)
    means = np.array([np.mean(speed) for speed in speeds[1:]])
    return {
        "max_swing_foot_speed": _largest(np.concatenate(speeds)),
        "mean_swing_foot_speed": _largest(means),
    }


def sole_distance(log: Log) -> float | None:
    """Least distance [m] in plan view of soles that pass each other.

    Soles pass each other if their heights differ by less than PASSING; 0 if
    one is above the other.
    """
    if "foot_poses" not in log:
        return None
    poses = log["foot_poses"].reshape(-1, 2, 4)  # per foot: p_WF and yaw
    heights, least = poses[:, :, 2], math.inf
    for feet in poses[np.abs(heights[:, 0] - heights[:, 1]) < PASSING]:
        left, right = (
            FootPose(foot[:3], foot[3]).to_world(log["sole"]) for foot in feet
        )
        gap = project(np.zeros(2), minkowski_sum(left, -right))
        least = min(least, float(np.hypot(*gap)))
    return least


def edge_distances(log: Log) -> list[float] | None:
    """Distance [m] of each landed sole's nearest corner from its region's edge.

    Negative outside of the region; None without regions.
    """
    sides = [halfspaces(region) for region in ground_regions(log)]
    if not sides:
        return None
    soles = [step.achieved.to_world(log["sole"]) for step in steps(log)]
    return [
        float(max(np.min(b - sole @ A.T) for A, b in sides)) for sole in soles
    ]


def self_contacts(run: Run) -> list[str]:
    """The improper contacts between two of the robot's own links."""
    return [
        pair
        for pair in run.improper_contacts
        if not pair.endswith(" - ground") and "::" not in pair
    ]


def _qp_figures(log: Log) -> dict:
    """Numbers of solves, failures and fallbacks, and largest violation."""
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


def versions(engine: str = "drake") -> dict[str, str]:
    """The versions of Python and of the packages that determine a run."""
    found = {"python": platform.python_version()}
    packages = "nadia_balance", "drake", "daqp", "numpy", engine
    for package in dict.fromkeys(packages):
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from a checkout
            found[package] = "not installed"
    return found


def _largest(values: np.ndarray) -> float | None:
    return float(np.max(values)) if values.size else None
