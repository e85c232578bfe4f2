"""Measurements of a run: a table of functions of its log."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

import nadia_balance.results.log as logs
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import halfspaces
from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.results.live_watches import VelocityWatch
from nadia_balance.results.log import Log, icp_error, pushes, signal, steps
from nadia_balance.systems.signals import PHASES

ICP_BACK = 0.05  # bound of the ICP error of a recovered robot [m]
SETTLED = 0.5  # time below ICP_BACK of a robot that stands or walks again [s]
# Feet of a robot that stands: one ahead of the other, and turned, by less.
SQUARE, SQUARE_DEG = 0.1, 10.0  # [m]
STANDS = float(PHASES.index(Phase.STANDING))  # in a WalkingSignal
PASSING = 0.1  # soles pass each other if their heights differ by less [m]
# The estimator is lost when the NEES of its 9 errors, 9 on average [-], has
# been above LOST_NEES for LOST_AFTER [s].
ESTIMATE = "state estimated_state estimate_covariance"
LOST_NEES, LOST_AFTER = 90.0, 0.2
_INITIAL = 1.0  # errors of the estimate count from here on [s]


class CalmSteps:
    """Counts, tick by tick, the whole steps with a small ICP error.

    They follow the last push; from one landing to the next the error is always
    below ICP_BACK.  `since` [s] and `taken` are the time of the last large
    error or push, and the number of steps taken until then.
    """

    since, taken = 0.0, 0

    def look(self, time: float, steps_taken: int, error: float, pushed) -> int:
        """Returns the calm steps at `time` [s]; `error` [m] is the ICP's."""
        if pushed or not error < ICP_BACK:
            self.since, self.taken = time, steps_taken
        return max(steps_taken - self.taken - 1, 0)


class StandsWatch:
    """Tells, tick by tick, for how long the robot has stood, feet square.

    It does with a small ICP error after the last push, in the phase STANDING.
    """

    _since = math.inf  # [s]

    def look(
        self, time: float, walking: Any, error: float, pushed: Any
    ) -> float:
        """Returns the time [s] it has stood; `walking` is a WalkingSignal."""
        stands = bool(walking.phase == STANDS) and is_square(walking)
        if pushed or not error < ICP_BACK or not stands:
            self._since = math.inf
            return 0.0
        self._since = min(self._since, time)
        return time - self._since


def is_square(walking: Any) -> bool:
    """True if the feet of a WalkingSignal, in one row, are side by side."""
    x, y, yaw = walking.right - walking.left
    heading = _heading(walking)
    ahead = x * math.cos(heading) + y * math.sin(heading)
    turned = math.degrees(math.remainder(yaw, math.tau))
    return abs(ahead) < SQUARE and abs(turned) < SQUARE_DEG


def _heading(walking: Any) -> float:
    """The heading [rad] of the frame between the feet, in one row."""
    turn = math.remainder(walking.right[2] - walking.left[2], math.tau)
    return float(walking.left[2] + 0.5 * turn)


def walked_velocity(log: Log) -> tuple[Array, float] | None:
    """Returns the velocity (n, 3) walked, and the time [s] of its means.

    It is the mean of two steps, as in a live session (see VelocityWatch), of
    the CoM, in the frame between the feet.  None without these, or steps.
    """
    landings = logs.landings(log)
    if not {"walking_signal", "com_state"} <= {*log} or len(landings) < 2:
        return None
    window = 2.0 * float(np.median(np.diff(landings)))
    watch, velocity = VelocityWatch(window), []
    places = signal(log, "com_state").position[:2].T
    for row, (time, place) in enumerate(zip(log["t"], places, strict=True)):
        heading = _heading(signal(log, "walking_signal", row))
        velocity.append(watch.look(float(time), place, heading))
    return np.array(velocity), window


def stands_square(log: Log) -> bool:
    """True if the robot stands at the end; on regions of ground, anywhere."""
    walking = signal(log, "walking_signal", -1)
    if walking.phase != STANDS:
        return False
    return "ground" in log or is_square(walking)


def calm_steps(log: Log) -> int:
    """Number of calm steps (see CalmSteps) at the end of the log."""
    begin = recovered_at(log, next(reversed(pushes(log)), None))
    return max(sum(s.swing.end > begin for s in steps(log)) - 1, 0)


def recovered_at(log: Log, push: logs.PushSpan | None) -> float:
    """Time [s] of the last ICP error above ICP_BACK, or the end of `push`."""
    begin = push.end if push else 0.0
    after = log["t"] >= begin
    large = np.flatnonzero(after & (icp_error(log) >= ICP_BACK))
    return float(log["t"][large[-1]]) if len(large) else begin


def recovery_time(log: Log) -> float | None:
    """Time [s] from the start of the last push to `recovered_at`, if any."""
    last = pushes(log)[-1:] if "icp" in log else []
    return recovered_at(log, last[0]) - last[0].start if last else None


def measure(log: Log) -> dict[str, Any]:
    """Returns all measurements as plain values, None if not available."""
    found: dict[str, Any] = {}
    for name, (needs, function) in _MEASUREMENTS.items():
        value = function(log) if {*needs.split()} <= {*log} else None
        found[name] = largest(value) if isinstance(value, np.ndarray) else value
    return found


def largest(values: Array) -> float | None:
    """The largest value; None if there is none."""
    return float(np.max(values)) if values.size else None


def _measure_push(log: Log, push: logs.PushSpan) -> dict[str, Any]:
    """Data of one push, with its impulse and the work done on the CoM."""
    felt = push.rows
    before = np.maximum(felt - 1, 0)
    force = signal(log, "push_signal", felt).force
    impulses = force * (log["t"][felt] - log["t"][before])
    work = None
    if "com_state" in log:
        com = signal(log, "com_state").velocity
        work = float(np.sum(impulses * 0.5 * (com[:, before] + com[:, felt])))
    return {
        "time_s": push.start,
        "duration_s": push.end - push.start,
        "delta_v": push.delta_v,
        "direction_deg": push.direction_deg,
        "force_n": float(np.linalg.norm(push.force)),
        "impulse_n_s": float(np.linalg.norm(np.sum(impulses, axis=1))),
        "absorbed_energy_j": work,
    }


def body_sway(log: Log) -> Array:
    """Tilt (n,) [deg] of the line from the midpoint of the soles to the CoM.

    A foot in the air has its last pose on the ground; the height: `com_height`.
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


def trunk_tilts(log: Log) -> Array:
    """Angles (2, n) [deg] of torso and pelvis to the vertical; n = 0: none."""
    return np.degrees(log.get("trunk_tilt", np.zeros((0, 2))).T)


def _durations(log: Log, phase: Phase) -> list[float]:
    """Durations [s] of the completed phases of this kind."""
    ended = (span for span in logs.phase_spans(log) if span.complete)
    return [round(span.duration, 6) for span in ended if span.phase is phase]


def _steps_after_push(log: Log) -> int:
    """Number of landings since the last push began, or since the start."""
    last = pushes(log)[-1:]
    begin = last[0].start if last else -math.inf
    return sum(time > begin for time in logs.landings(log))


def _stance_slip(log: Log) -> float:
    """Largest displacement [m] of a stance foot since its swing phase began.

    In a run without a swing: of either foot, since its phase began.
    """
    spans = logs.phase_spans(log)
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


def _swing_speeds(log: Log) -> Array:
    """Mean speed (k,) [m/s] of the sole's centre in each swing."""
    speeds = []
    for step in steps(log):
        rows = slice(step.swing.first, step.swing.last + 2)
        feet = signal(log, "foot_poses", rows)
        ways = np.diff(getattr(feet, step.side.value))
        speed = np.linalg.norm(ways, axis=0) / np.diff(log["t"][rows])
        speeds.append(np.mean(speed))
    return np.array(speeds)


def _sole_distance(log: Log) -> float:
    """Least distance [m] in plan view of PASSING soles; 0: one is above.

    Of convex polygons it is their largest gap, seen along edges and across,
    or along lines between corners of both.
    """
    poses = log["foot_poses"].reshape(-1, 2, 4)  # per foot: p_WF and yaw
    heights = poses[:, :, 2]
    poses = poses[np.abs(heights[:, 0] - heights[:, 1]) < PASSING]
    # The plane as complex numbers: corners (n, k) of each foot.
    turns = np.exp(1j * poses[:, :, 3:]) * (log["sole"] @ [1.0, 1j])
    soles = turns + poses[:, :, :1] + 1j * poses[:, :, 1:2]
    left, right = np.moveaxis(soles, 1, 0)
    edges = 1j * (np.roll(soles, -1, axis=2) - soles).reshape(len(soles), -1)
    between = left[:, :, None] - right[:, None]
    gaps = np.zeros(len(soles))
    ways = np.hstack((edges, -edges, between.reshape(edges.shape[0], -1)))
    for way in ways.T:
        along = (way / np.maximum(np.abs(way), 1e-12)).conj()[:, None]
        a, b = (left * along).real, (right * along).real
        gaps = np.maximum(gaps, a.min(axis=1) - b.max(axis=1))
    return float(np.min(gaps, initial=math.inf))


def _edge_distances(log: Log) -> list[float]:
    """Distance [m] of each landed sole to its region's edge; < 0: outside."""
    sides = [halfspaces(region) for region in logs.ground_regions(log)]
    soles = [step.achieved.to_world(log["sole"]) for step in steps(log)]
    inside = ([np.min(b - sole @ A.T) for A, b in sides] for sole in soles)
    return [float(max(distances)) for distances in inside]


def estimation_errors(log: Log) -> Array:
    """Errors (n, 9) of the pelvis: angle [rad], velocity [m/s], position [m].

    Truth less estimate in W; the angle is the small rotation between them.
    """
    truth, told = log["state"], log["estimated_state"]
    nq = (truth.shape[1] + 1) // 2  # of 7 + nj positions, 6 + nj velocities
    # Vector part of the quaternion q conj(q_told), twice.
    (a, u), (b, w) = ((q[:, :1], q[:, 1:4]) for q in (truth, told))
    turn = b * u - a * w - np.cross(u, w)
    dot = np.sum(truth[:, :4] * told[:, :4], axis=1, keepdims=True)
    turn *= 2.0 * np.sign(dot)  # q and -q are the same rotation
    move = (truth - told)[:, 4:7]
    speed = (truth - told)[:, nq + 3 : nq + 6]
    return np.concatenate((turn, speed, move), axis=1)


def nees(log: Log) -> Array:
    """The NEES e' P^-1 e (n,) [-] of these errors; 9 on average."""
    e = estimation_errors(log)
    P = log["estimate_covariance"].reshape(-1, 9, 9)
    return np.sum(e * np.linalg.solve(P, e[:, :, None])[:, :, 0], axis=1)


class LostWatch:
    """Tells, tick by tick, whether the NEES has been out for LOST_AFTER."""

    _since = math.inf  # [s]

    def look(self, time: float, squared_error: float) -> bool:
        """True if it has, by the NEES at `time` [s]."""
        out = squared_error > LOST_NEES
        self._since = min(self._since, time) if out else math.inf
        return time - self._since >= LOST_AFTER - 1e-9  # times are rounded


def lost_at(log: Log) -> float | None:
    """Time [s] at which the estimator was lost (see LostWatch); None: never."""
    if not {*ESTIMATE.split()} <= {*log}:
        return None
    watch, ticks = LostWatch(), zip(log["t"], nees(log), strict=True)
    return next((float(t) for t, e in ticks if watch.look(t, e)), None)


def measure_estimate(log: Log) -> dict[str, float] | None:
    """Errors of the estimate after the start; None for a run that short."""
    late = log["t"] >= _INITIAL
    if not late.any():
        return None
    error = estimation_errors(log)[late]
    return {
        "rms_velocity_m_s": math.sqrt(np.mean(error[:, 3:6] ** 2) * 3.0),
        "max_tilt_deg": math.degrees(np.max(np.hypot(*error[:, :2].T))),
        "last_horizontal_m": math.hypot(*error[-1, 6:8]),
        "max_height_m": float(np.max(np.abs(error[:, 8]))),
        "mean_nees": float(np.mean(nees(log)[late])),  # 9 if P is true
    }


def _qps(log: Log) -> list[Any]:
    present = [name for name in logs.QP_STATUS if name in log and len(log["t"])]
    return [signal(log, name) for name in present]


def _qp_failures(log: Log) -> int:
    several = (max(np.sum(q.solved < 0.5), q.failures[-1]) for q in _qps(log))
    return sum(map(int, several))


# Name: the signals that are needed, and a function of a log; of an array the
# largest entry counts.  Units are in the names, or as of the functions.
_MEASUREMENTS: dict[str, tuple[str, Callable[[Log], Any]]] = {
    "duration_s": ("t", lambda x: x["t"] - x["t"][:1]),
    "pushes": ("t", lambda x: [_measure_push(x, p) for p in pushes(x)]),
    "body_sway_deg": ("com_state", body_sway),
    "max_torso_tilt_deg": ("trunk_tilt", lambda x: trunk_tilts(x)[0]),
    "max_pelvis_tilt_deg": ("trunk_tilt", lambda x: trunk_tilts(x)[1]),
    "com_sag_m": ("com_state", lambda x: com_height(x)[:1] - com_height(x)),
    "max_icp_error_m": ("icp", icp_error),
    "footstep_error_m": ("t", lambda x: np.array([s.error for s in steps(x)])),
    "swing_durations_s": ("t", lambda x: _durations(x, Phase.SWING)),
    "transfer_durations_s": ("t", lambda x: _durations(x, Phase.TRANSFER)),
    "steps_taken": ("t", lambda x: len(logs.landings(x))),
    "steps_after_push": ("t", _steps_after_push),
    "calm_steps": ("icp", calm_steps),
    "stance_slip_m": ("foot_poses walking_signal", _stance_slip),
    "max_torque_ratio": ("effort_limits", torque_ratio),
    # From tick to tick, of the commands [N m].
    "max_torque_step": ("actuation", lambda x: abs(np.diff(x["actuation"].T))),
    "max_joint_speed": ("state", joint_speed),
    "max_joint_speed_ratio": ("joint_speed_limits", joint_speed_ratio),
    "max_power_w": ("torques", lambda x: _powers(x).sum(axis=1)),
    # Power of the drives that do not brake.
    "positive_power_w": ("torques", lambda x: _powers(x).clip(0.0).sum(axis=1)),
    "mean_swing_foot_speed": ("foot_poses", _swing_speeds),
    # Each force is the mean of a tick.
    "max_impact_body_weights": (
        "weight",
        lambda x: x["foot_forces"] / x["weight"],
    ),
    "estimate": (ESTIMATE, measure_estimate),
    "min_sole_distance_m": ("foot_poses", _sole_distance),
    "min_edge_distances_m": ("ground", _edge_distances),
    "qp_failures": ("t", _qp_failures),
    "qp_fallbacks": (
        "t",
        lambda x: sum(int(np.sum(q.fallback > 0.5)) for q in _qps(x)),
    ),
    "max_qp_violation": (
        "t",
        lambda x: np.concatenate(
            [q.violation[np.isfinite(q.violation)] for q in _qps(x)] or [[]]
        ),
    ),
}
