"""Measurements of a run: a table of functions of its log."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from nadia_balance.core.polygon import halfspaces, minkowski_sum, project
from nadia_balance.core.walking import Array, FootPose, Phase, Side
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
from nadia_balance.results.recovery import calm_steps

PASSING = 0.1  # soles pass each other if their heights differ by less [m]


def measure(log: Log) -> dict[str, Any]:
    """Returns all measurements as plain values, None if not available."""
    return {
        name: _plain(function(log)) if need in log else None
        for name, (need, function) in _MEASUREMENTS.items()
    }


def _plain(value: Any) -> Any:
    """The largest entry of an array; any other value as it is."""
    return largest(value) if isinstance(value, np.ndarray) else value


def largest(values: Array) -> float | None:
    """The largest value; None if there is none."""
    return float(np.max(values)) if values.size else None


def duration(log: Log) -> float:
    """Duration [s] of the log."""
    return float(np.ptp(log["t"])) if len(log["t"]) else 0.0


def _switches(log: Log) -> list[dict[str, Any]]:
    return [{"time_s": time, "on": on} for time, on in switches(log)]


def _rms_icp_error(log: Log) -> float | None:
    error = icp_error(log)
    return math.sqrt(np.mean(error**2)) if error.size else None


def _pushes(log: Log) -> list[dict[str, float]]:
    return [_push_measurements(log, push) for push in pushes(log)]


def _push_measurements(log: Log, push: PushSpan) -> dict[str, float]:
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


def body_sway(log: Log) -> Array:
    """Tilt (n,) [deg] of the line from the midpoint of the soles to the CoM.

    A foot in the air has its last pose on the ground; the height is
    `com_height`.
    """
    feet, com = signal(log, "walking_signal"), signal(log, "com_state").position
    middle = 0.5 * (feet.left[:2] + feet.right[:2])
    away = np.hypot(*(com[:2] - middle))
    return np.degrees(np.arctan2(away, com_height(log)))


def com_height(log: Log) -> Array:
    """Height (n,) [m] of the CoM above the lower one of the soles."""
    height = signal(log, "com_state").position[2]
    if "foot_poses" not in log:
        return height
    soles = signal(log, "foot_poses")
    return height - np.minimum(soles.left[2], soles.right[2])


def _com_sag(log: Log) -> Array:
    """Drop (n,) [m] of the CoM since the start."""
    height = com_height(log)
    return height[:1] - height


def torso_tilt(log: Log) -> Array:
    """Angle (n,) [deg] of the torso against the vertical; empty without one."""
    if "trunk_tilt" not in log:
        return np.zeros(0)
    return np.degrees(signal(log, "trunk_tilt").torso)


def _pelvis_tilt(log: Log) -> Array:
    """Angle (n,) [deg] of the pelvis against the vertical."""
    return np.degrees(signal(log, "trunk_tilt").pelvis)


def _footstep_error(log: Log) -> Array:
    """Distances [m] of achieved from adjusted footholds."""
    return np.array([step.error for step in steps(log)])


def _durations(log: Log, phase: Phase) -> list[float]:
    """Durations [s] of the completed phases of this kind."""
    return [
        round(span.duration, 6)
        for span in phase_spans(log)
        if span.phase is phase and span.complete
    ]


def _steps_after_push(log: Log) -> int:
    """Number of landings since the last push began, or since the start."""
    last = pushes(log)[-1:]
    begin = last[0].start if last else -math.inf
    return sum(step.swing.end > begin for step in steps(log))


def _stance_slip(log: Log) -> float:
    """Largest displacement [m] of a stance foot since its swing phase began.

    In a run without a swing: of either foot, since its phase began.
    """
    spans = phase_spans(log)
    swings = [s for s in spans if s.phase is Phase.SWING]
    slips = [0.0]
    for span in swings or spans:
        feet = signal(log, "foot_poses", slice(span.first, span.last + 1))
        for side in filter(span.carries, Side):
            x, y, _ = getattr(feet, side.value)
            slips.append(np.max(np.hypot(x - x[0], y - y[0])))
    return float(np.max(slips))


def torque_ratio(log: Log) -> Array:
    """|torque| / limit (n, nu) [-]; empty without joints."""
    if "effort_limits" not in log:
        return np.zeros((0, 0))
    return np.abs(log["actuation"]) / log["effort_limits"]


def _torque_step(log: Log) -> Array:
    """|change of commanded torque| (n - 1, nu) [N m] from tick to tick."""
    return np.abs(np.diff(log["actuation"], axis=0))


def joint_speed(log: Log) -> Array:
    """|joint speed| (n, nu) [rad/s]; empty without joints."""
    if "joint_speed_columns" not in log:
        return np.zeros((0, 0))
    return np.abs(log["state"][:, log["joint_speed_columns"]])


def joint_speed_ratio(log: Log) -> Array:
    """|joint speed| / limit (n, nu) [-]; empty without joints."""
    return joint_speed(log) / log.get("joint_speed_limits", np.ones(0))


def _powers(log: Log) -> Array:
    """Mechanical power (n, nu) [W] of each drive; negative while braking."""
    return log["torques"] * log["state"][:, log["joint_speed_columns"]]


def _power(log: Log) -> Array:
    """Net mechanical power (n,) [W]."""
    return np.sum(_powers(log), axis=1)


def _positive_power(log: Log) -> Array:
    """Mechanical power (n,) [W] of the drives that do not brake."""
    return np.sum(np.maximum(_powers(log), 0.0), axis=1)


def _impact(log: Log) -> Array:
    """Force on a foot / weight (n, 2) [-], each the mean of a tick."""
    return log["foot_forces"] / log["weight"]


def _swing_speed(log: Log) -> Array:
    return np.concatenate([np.zeros(0), *_swing_speeds(log)])


def _mean_swing_speed(log: Log) -> Array:
    return np.array([np.mean(speed) for speed in _swing_speeds(log)])


def _swing_speeds(log: Log) -> list[Array]:
    """Speeds [m/s] of the sole's centre, tick by tick, in each swing."""
    speeds = []
    for step in steps(log):
        rows = slice(step.swing.first, step.swing.last + 2)
        feet = signal(log, "foot_poses", rows)
        ways = np.diff(getattr(feet, step.side.value))
        speeds.append(np.linalg.norm(ways, axis=0) / np.diff(log["t"][rows]))
    return speeds


def _sole_distance(log: Log) -> float:
    """Least distance [m] in plan view of soles that pass each other.

    Soles pass each other if their heights differ by less than PASSING; 0 if
    one is above the other.
    """
    poses = log["foot_poses"].reshape(-1, 2, 4)  # per foot: p_WF and yaw
    heights, least = poses[:, :, 2], math.inf
    for feet in poses[np.abs(heights[:, 0] - heights[:, 1]) < PASSING]:
        left, right = (
            FootPose(foot[:3], foot[3]).to_world(log["sole"]) for foot in feet
        )
        gap = project(np.zeros(2), minkowski_sum(left, -right))
        least = min(least, float(np.hypot(*gap)))
    return least


def _edge_distances(log: Log) -> list[float]:
    """Distance [m] of each landed sole's nearest corner from its region's edge.

    Negative outside of the region.
    """
    sides = [halfspaces(region) for region in ground_regions(log)]
    soles = [step.achieved.to_world(log["sole"]) for step in steps(log)]
    return [
        float(max(np.min(b - sole @ A.T) for A, b in sides)) for sole in soles
    ]


def _qp_status(log: Log) -> list[Any]:
    present = [name for name in QP_STATUS if name in log and len(log["t"])]
    return [signal(log, name) for name in present]


def _qp_solves(log: Log) -> int:
    return sum(len(qp.solved) for qp in _qp_status(log))


def _qp_fallbacks(log: Log) -> int:
    return sum(int(np.sum(qp.fallback > 0.5)) for qp in _qp_status(log))


def _qp_failures(log: Log) -> int:
    return sum(
        int(max(np.sum(qp.solved < 0.5), qp.failures[-1]))
        for qp in _qp_status(log)
    )


def _qp_violation(log: Log) -> Array:
    all_of = [np.zeros(0), *(qp.violation for qp in _qp_status(log))]
    violation = np.concatenate(all_of)
    return violation[np.isfinite(violation)]


# Name: a signal that is needed, and a function of the log; of an array the
# largest entry counts.
_MEASUREMENTS: dict[str, tuple[str, Callable[[Log], Any]]] = {
    "duration_s": ("t", duration),
    "switched_mechanisms": ("t", _switches),
    "pushes": ("t", _pushes),
    "body_sway_deg": ("com_state", body_sway),
    "max_torso_tilt_deg": ("trunk_tilt", torso_tilt),
    "max_pelvis_tilt_deg": ("trunk_tilt", _pelvis_tilt),
    "com_sag_m": ("com_state", _com_sag),
    "max_icp_error_m": ("icp", icp_error),
    "rms_icp_error_m": ("icp", _rms_icp_error),
    "footstep_error_m": ("t", _footstep_error),
    "swing_durations_s": ("t", lambda log: _durations(log, Phase.SWING)),
    "transfer_durations_s": ("t", lambda log: _durations(log, Phase.TRANSFER)),
    "steps_taken": ("t", lambda log: len(steps(log))),
    "steps_after_push": ("t", _steps_after_push),
    "calm_steps": ("t", calm_steps),
    "stance_slip_m": ("foot_poses", _stance_slip),
    "max_torque_ratio": ("effort_limits", torque_ratio),
    "max_torque_step": ("actuation", _torque_step),
    "max_joint_speed": ("state", joint_speed),
    "max_joint_speed_ratio": ("joint_speed_limits", joint_speed_ratio),
    "max_power_w": ("torques", _power),
    "positive_power_w": ("torques", _positive_power),
    "max_swing_foot_speed": ("foot_poses", _swing_speed),
    "mean_swing_foot_speed": ("foot_poses", _mean_swing_speed),
    "max_impact_body_weights": ("weight", _impact),
    "min_sole_distance_m": ("foot_poses", _sole_distance),
    "min_edge_distances_m": ("ground", _edge_distances),
    "qp_solves": ("t", _qp_solves),
    "qp_failures": ("t", _qp_failures),
    "qp_fallbacks": ("t", _qp_fallbacks),
    "max_qp_violation": ("t", _qp_violation),
}
