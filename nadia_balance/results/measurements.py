"""Measurements of a run: a table of functions of its log."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from nadia_balance.core.body.reachability import distance_between
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import halfspaces
from nadia_balance.core.walking.state import FootPose, Phase, Side
from nadia_balance.results.estimation import ESTIMATE, measure_estimate
from nadia_balance.results.live_watches import VelocityWatch
from nadia_balance.results.log import (
    QP_STATUS,
    Log,
    PushSpan,
    foot_part,
    ground_regions,
    icp_error,
    landings,
    phase_spans,
    pushes,
    signal_view,
    steps,
)
from nadia_balance.systems.signals import PHASES, WalkingSignal

ICP_BACK = 0.05  # bound of the ICP error of a recovered robot [m]
SETTLED = 0.5  # time below ICP_BACK of a robot that stands or walks again [s]
# Feet of a robot that stands: one ahead of the other, and turned, by less.
SQUARE, SQUARE_DEG = 0.1, 10.0  # [m]
STANDS = float(PHASES.index(Phase.STANDING))  # in a WalkingSignal
_NO_JOINTS = np.zeros((0, 0))  # of a log without them
PASSING = 0.1  # soles pass each other if their heights differ by less [m]


class CalmSteps:
    """Counts, tick by tick, the whole steps with a small ICP error.

    They follow the last push; from one landing to the next the error is always
    below ICP_BACK.  `taken` is the number of steps taken until the last large
    error or push.
    """

    taken = 0

    def update(
        self, steps_taken: int, error: float, pushed: bool | float
    ) -> int:
        """Returns the number of calm steps until now.

        Args:
            steps_taken: number of steps that have landed.
            error: ICP error [m].
            pushed: whether a push acts, or is still to come.

        Returns:
            The number.
        """
        if pushed or not error < ICP_BACK:
            self.taken = steps_taken
        return max(steps_taken - self.taken - 1, 0)


class StandsWatch:
    """Tells, tick by tick, for how long the robot has stood, feet square.

    It does with a small ICP error after the last push, in the phase STANDING.
    """

    _since = math.inf  # [s]

    def update(
        self,
        time: float,
        walking: WalkingSignal,
        error: float,
        pushed: bool | float,
    ) -> float:
        """Returns for how long it has stood.

        Args:
            time: now [s].
            walking: walking signal now.
            error: ICP error [m].
            pushed: whether a push acts, or is still to come.

        Returns:
            The time [s].
        """
        if (
            pushed
            or not error < ICP_BACK
            or walking.phase != STANDS
            or not is_square(walking)
        ):
            self._since = math.inf
            return 0.0
        self._since = min(self._since, time)
        return time - self._since


def is_square(walking: WalkingSignal) -> bool:
    """Tells whether the feet are side by side.

    Args:
        walking: walking signal in one row.

    Returns:
        True if one foot is less than SQUARE ahead of the other, and turned by
        less than SQUARE_DEG.
    """
    x, y, yaw = walking.right - walking.left
    heading = _heading(walking)
    ahead = x * math.cos(heading) + y * math.sin(heading)
    turned = math.degrees(math.remainder(yaw, math.tau))
    return abs(ahead) < SQUARE and abs(turned) < SQUARE_DEG


def _heading(walking: WalkingSignal) -> float:
    """The heading [rad] of the frame between the feet, in one row."""
    left, right = walking.left[2], walking.right[2]
    return float(left + 0.5 * math.remainder(right - left, math.tau))


def walked_velocity(log: Log) -> tuple[Array, float] | None:
    """Returns the velocity that was walked.

    It is the mean of two steps, as in a live session (see VelocityWatch), of
    the CoM, in the frame between the feet.

    Args:
        log: log of a run.

    Returns:
        Forward, left [m/s] and turn [rad/s], (n, 3), and the time of the means
        [s]; None without CoM, feet or two steps.
    """
    times = landings(log)
    if not {"walking_signal", "com_state"} <= {*log} or len(times) < 2:
        return None
    window = 2.0 * float(np.median(np.diff(times)))
    watch = VelocityWatch(window)
    places = signal_view(log, "com_state").position[:2].T
    velocity = [
        watch.update(
            float(time),
            place=places[row],
            heading=_heading(signal_view(log, "walking_signal", row)),
        )
        for row, time in enumerate(log["t"])
    ]
    return np.array(velocity), window


def stands_square(log: Log) -> bool:
    """Tells whether the robot stands at the end, feet square.

    Args:
        log: log of a run.

    Returns:
        True if it does; on regions of ground its feet may be anywhere.
    """
    walking = signal_view(log, "walking_signal", -1)
    return bool(walking.phase == STANDS) and (
        "ground" in log or is_square(walking)
    )


def calm_steps(log: Log) -> int:
    """Returns the number of calm steps (see CalmSteps) at the end.

    Args:
        log: log of a run.

    Returns:
        The number.
    """
    begin = recovered_at(log, next(reversed(pushes(log)), None))
    return max(sum(s.swing.end > begin for s in steps(log)) - 1, 0)


def recovered_at(log: Log, push: PushSpan | None) -> float:
    """Returns when the ICP error was last not below ICP_BACK.

    Args:
        log: log of a run.
        push: last push, if any.

    Returns:
        The time [s], at least that of the end of the push; 0 without one.
    """
    begin = push.end if push else 0.0
    large = np.flatnonzero((log["t"] >= begin) & (icp_error(log) >= ICP_BACK))
    return float(log["t"][large[-1]]) if len(large) else begin


def recovery_time(log: Log) -> float | None:
    """Returns the time from the start of the last push to `recovered_at`.

    Args:
        log: log of a run.

    Returns:
        The time [s]; None without a push or an ICP.
    """
    last = pushes(log)[-1:] if "icp" in log else []
    return recovered_at(log, last[0]) - last[0].start if last else None


def measure(log: Log) -> dict[str, Any]:
    """Returns all measurements of a run.

    Args:
        log: log of the run.

    Returns:
        Plain values by name, None if not available.
    """
    values: dict[str, Any] = {}
    for name, (needs, function) in _MEASUREMENTS.items():
        value = function(log) if {*needs} <= {*log} else None
        values[name] = (
            largest(value) if isinstance(value, np.ndarray) else value
        )
    return values


def largest(values: Array) -> float | None:
    """Returns the largest value.

    Args:
        values: of any shape.

    Returns:
        The value; None if there is none.
    """
    return float(np.max(values)) if values.size else None


def _measure_push(log: Log, push: PushSpan) -> dict[str, Any]:
    """Data of one push, with its impulse and the work done on the CoM."""
    felt = push.rows
    before = np.maximum(felt - 1, 0)
    impulses = signal_view(log, "push_signal", felt).force * (
        log["t"][felt] - log["t"][before]
    )
    work = None
    if "com_state" in log:
        com = signal_view(log, "com_state").velocity
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
    """Returns the tilt of the line from the midpoint of the soles to the CoM.

    A foot in the air has its last pose on the ground; the height: `com_height`.

    Args:
        log: log of a run.

    Returns:
        The angle to the vertical (n,) [deg].
    """
    feet = signal_view(log, "walking_signal")
    middle = 0.5 * (feet.left[:2] + feet.right[:2])
    away = np.hypot(*(signal_view(log, "com_state").position[:2] - middle))
    return np.asarray(np.degrees(np.arctan2(away, com_height(log))))


def com_height(log: Log) -> Array:
    """Returns the height of the CoM above the lower one of the soles.

    Args:
        log: log of a run.

    Returns:
        The height (n,) [m]; of a point mass, that in W.
    """
    height: Array = signal_view(log, "com_state").z
    if "foot_poses" not in log:
        return height
    soles = signal_view(log, "foot_poses")
    return np.asarray(height - np.minimum(soles.left_z, soles.right_z))


def _touchdowns(log: Log) -> list[dict[str, float | str]]:
    """Each Touchdown, with how long before the end of its swing it was [s]."""
    rows: list[dict[str, float | str]] = []
    for row in range(len(log["touchdowns"])):
        touchdown = signal_view(log, "touchdowns", row)
        values = dict(zip(touchdown.get_fields(), touchdown[:], strict=True))
        values["side"] = Side.of_sign(touchdown.side).value
        values["early"] = _early(log, touchdown)
        rows.append(values)
    return rows


def _early(log: Log, touchdown: Any) -> float:
    """Time [s] left in the swing of the foot at its touchdown; 0 outside."""
    tick = max(int(np.searchsorted(log["t"], touchdown.time)) - 1, 0)
    if "walking_signal" not in log:
        return 0.0
    walking = signal_view(log, "walking_signal", tick)
    swings = walking.phase == PHASES.index(Phase.SWING)
    if not swings or walking.target_side != touchdown.side:
        return 0.0
    return float(walking.duration - walking.time_in_phase)


def trunk_tilts(log: Log) -> Array:
    """Returns the angles of torso and pelvis to the vertical.

    Args:
        log: log of a run.

    Returns:
        The angles (2, n) [deg]; n = 0 if they are not logged.
    """
    return np.asarray(np.degrees(log.get("trunk_tilt", np.zeros((0, 2))).T))


def _durations(log: Log, phase: Phase) -> list[float]:
    """Durations [s] of the completed phases of this kind."""
    return [
        round(span.duration, 6)
        for span in phase_spans(log)
        if span.complete and span.phase is phase
    ]


def _steps_after_push(log: Log) -> int:
    """Number of landings since the last push began, or since the start."""
    begin = max((push.start for push in pushes(log)[-1:]), default=-math.inf)
    return sum(time > begin for time in landings(log))


def _stance_slip(log: Log) -> float:
    """Largest displacement [m] of a stance foot since its swing phase began.

    In a run without a swing: of either foot, since its phase began.
    """
    spans = phase_spans(log)
    swings = [s for s in spans if s.phase is Phase.SWING]
    slips = [0.0]
    for span in swings or spans:
        feet = signal_view(log, "foot_poses", slice(span.first, span.last + 1))
        for side in filter(span.carries, Side):
            x, y, _ = foot_part(feet, side)
            slips.append(np.max(np.hypot(x - x[0], y - y[0])))
    return float(np.max(slips))


def torque_ratio(log: Log) -> Array:
    """Returns the commanded torques per limit.

    Args:
        log: log of a run.

    Returns:
        |torque| / limit (n, nu) [-]; empty without joints.
    """
    if "effort_limits" not in log:
        return _NO_JOINTS
    return np.abs(log["actuation"]) / log["effort_limits"]


def torque_step_ratio(log: Log) -> float | None:
    """Returns how much the torques of the drives change from tick to tick.

    Args:
        log: log of a run, with the drives' torques.

    Returns:
        Step of the worst joint in a tick over its limit, the median of all
        ticks [-]; None of a single one.
    """
    steps = np.abs(np.diff(log["torques"], axis=0)) / log["effort_limits"]
    return float(np.median(steps.max(axis=1))) if len(steps) else None


def joint_speed(log: Log) -> Array:
    """Returns the speeds of the joints.

    Args:
        log: log of a run.

    Returns:
        |joint speed| (n, nu) [rad/s]; empty without joints.
    """
    if "joint_speed_columns" not in log:
        return _NO_JOINTS
    return np.abs(log["state"][:, log["joint_speed_columns"]])


def joint_speed_ratio(log: Log) -> Array:
    """Returns the speeds of the joints per limit.

    Args:
        log: log of a run.

    Returns:
        |joint speed| / limit (n, nu) [-]; empty without joints or limits.
    """
    if "joint_speed_limits" not in log:
        return _NO_JOINTS
    return joint_speed(log) / log["joint_speed_limits"]


def positive_power(log: Log) -> Array:
    """The power of the drives that do not brake.

    Args:
        log: log of a run.

    Returns:
        The sum over all joints (n,) [W].
    """
    return np.asarray(_powers(log).clip(0.0).sum(axis=1))


def _powers(log: Log) -> Array:
    """Mechanical power (n, nu) [W] of each drive; negative while braking."""
    return np.asarray(
        log["torques"] * log["state"][:, log["joint_speed_columns"]]
    )


def _swing_speeds(log: Log) -> Array:
    """Mean speed (k,) [m/s] of the sole's centre in each swing."""
    speeds = []
    for step in steps(log):
        rows = slice(step.swing.first, step.swing.last + 2)
        place = foot_part(signal_view(log, "foot_poses", rows), step.side)
        moved = np.linalg.norm(np.diff(place), axis=0)
        speeds.append(np.mean(moved / np.diff(log["t"][rows])))
    return np.array(speeds)


def _sole_distance(log: Log) -> float:
    """Least distance [m] in plan view of PASSING soles; 0: one is above."""
    poses = log["foot_poses"].reshape(-1, 2, 4)  # per foot: p_WF and yaw
    heights = poses[:, :, 2]
    passing = poses[np.abs(heights[:, 0] - heights[:, 1]) < PASSING]
    soles = (
        [FootPose(foot[:3], foot[3]).to_world(log["sole"]) for foot in feet]
        for feet in passing
    )
    return min((distance_between(*feet) for feet in soles), default=math.inf)


def _edge_distances(log: Log) -> list[float]:
    """Distance [m] of each landed sole to its region's edge; < 0: outside."""
    sides = [halfspaces(region) for region in ground_regions(log)]
    return [
        float(
            max(
                np.min(b - step.achieved.to_world(log["sole"]) @ A.T)
                for A, b in sides
            )
        )
        for step in steps(log)
    ]


def _qps(log: Log) -> list[Any]:
    return [
        signal_view(log, name)
        for name in QP_STATUS
        if name in log and len(log["t"])
    ]


def _qp_failures(log: Log) -> int:
    return sum(
        int(max(np.sum(qp.solved < 0.5), qp.failures[-1])) for qp in _qps(log)
    )


def _qp_fallbacks(log: Log) -> int:
    return sum(int(np.sum(qp.fallback > 0.5)) for qp in _qps(log))


def _qp_violations(log: Log) -> Array:
    """Violations (n,) of the constraints in the solves that succeeded."""
    return np.concatenate(
        [qp.violation[np.isfinite(qp.violation)] for qp in _qps(log)] or [[]]
    )


# Name: the signals that are needed, and a function of a log; of an array the
# largest entry counts.  Units are in the names, or as of the functions.
_MEASUREMENTS: dict[str, tuple[tuple[str, ...], Callable[[Log], Any]]] = {
    "duration_s": (("t",), lambda x: x["t"] - x["t"][:1]),
    "pushes": (("t",), lambda x: [_measure_push(x, p) for p in pushes(x)]),
    "body_sway_deg": (("com_state",), body_sway),
    "max_torso_tilt_deg": (("trunk_tilt",), lambda x: trunk_tilts(x)[0]),
    "max_pelvis_tilt_deg": (("trunk_tilt",), lambda x: trunk_tilts(x)[1]),
    "com_sag_m": (("com_state",), lambda x: com_height(x)[:1] - com_height(x)),
    "max_icp_error_m": (("icp",), icp_error),
    "footstep_error_m": (
        ("t",),
        lambda x: np.array([step.error for step in steps(x)]),
    ),
    "swing_durations_s": (("t",), lambda x: _durations(x, Phase.SWING)),
    "transfer_durations_s": (("t",), lambda x: _durations(x, Phase.TRANSFER)),
    "steps_taken": (("t",), lambda x: len(landings(x))),
    "steps_after_push": (("t",), _steps_after_push),
    "calm_steps": (("icp",), calm_steps),
    "touchdowns": (("touchdowns",), _touchdowns),
    "max_landing_speed": (
        ("touchdowns",),
        lambda x: signal_view(x, "touchdowns").speed_along,
    ),
    "max_landing_force": (
        ("touchdowns",),
        lambda x: signal_view(x, "touchdowns").mean_force,
    ),
    "stance_slip_m": (("foot_poses", "walking_signal"), _stance_slip),
    "max_torque_ratio": (("effort_limits",), torque_ratio),
    # From tick to tick, of the commands [N m].
    "max_torque_step": (
        ("actuation",),
        lambda x: abs(np.diff(x["actuation"].T)),
    ),
    "torque_step_ratio": (("torques", "effort_limits"), torque_step_ratio),
    "max_joint_speed": (("state",), joint_speed),
    "max_joint_speed_ratio": (("joint_speed_limits",), joint_speed_ratio),
    "max_power_w": (("torques",), lambda x: _powers(x).sum(axis=1)),
    "positive_power_w": (("torques",), positive_power),
    "mean_swing_foot_speed": (("foot_poses",), _swing_speeds),
    # Each force is the mean of a tick.
    "max_impact_body_weights": (
        ("weight",),
        lambda x: x["foot_forces"] / x["weight"],
    ),
    "estimate": (ESTIMATE, measure_estimate),
    "min_sole_distance_m": (("foot_poses",), _sole_distance),
    "min_edge_distances_m": (("ground",), _edge_distances),
    "qp_failures": (("t",), _qp_failures),
    "qp_fallbacks": (("t",), _qp_fallbacks),
    "max_qp_violation": (("t",), _qp_violations),
}
