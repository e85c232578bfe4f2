"""Evaluation of a run: from its log to summary.json."""

import math
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from nadia_balance.results.estimation import lost_at
from nadia_balance.results.landing import LandingLimits, hard_landing
from nadia_balance.results.log import (
    Log,
    icp_error,
    landings,
    pushes,
    signal_view,
)
from nadia_balance.results.measurements import (
    ICP_BACK,
    SETTLED,
    STANDS,
    calm_steps,
    joint_speed_ratio,
    largest,
    measure,
    recovery_time,
    stands_square,
    torque_ratio,
    trunk_tilts,
)
from nadia_balance.results.versions import versions
from nadia_balance.systems.whole_body import GIVES_UP_AFTER

PATIENCE = 8  # largest number of steps of a recovery [-]
PATIENCE_TIME = 5.0  # for a robot that stands to settle after a push [s]
SLOWEST = 0.02  # command by which a policy steps in place [m/s], [rad/s]
STEADY = 2.0  # time of steps at the end, to walk on without an ICP [s]
EFFORT_MARGIN = 1e-6  # rounding tolerated above a torque limit [-]
SPEED_MARGIN = 0.02  # overshoot tolerated above a joint's speed limit [-]
_TICK_ROUNDING = 1e-6  # of times [s]


@dataclass(frozen=True, kw_only=True)
class RunInfo:
    """Conditions of a run, and the criteria of recovery."""

    robot: str
    mechanisms: str  # or the file of a policy
    scenario: str = ""
    plant: str = "humanoid"  # or lipm
    fidelity: str = "realistic"  # or ideal
    engine: str = "drake"  # or mujoco
    seed: int = 0
    # Direction (0 forward, 90 left) and size [m/s] of the first push.
    direction_deg: float | None = None
    delta_v: float | None = None
    calm_steps: int = 0  # complete steps with small ICP error to recover
    max_torso_tilt_deg: float = 180.0  # bound for a recovery [deg]
    landing: LandingLimits | None = None  # of a recovery


@dataclass(frozen=True, kw_only=True)
class Run:
    """Results of a simulation."""

    logs: Log = field(repr=False)
    fell_at: float | None = None  # [s]
    fall_reason: str = ""
    simulated_time: float = 0.0  # [s]
    cpu_time: float = math.nan  # [s]
    interrupted: bool = False  # by Ctrl-C
    missed_pushes: int = 0  # pushes that had not begun, or not ended
    improper_contacts: tuple[str, ...] = ()  # not of a foot and the ground
    error: str = ""  # error that ended the run early, such as NaN at an input
    until: bool = False  # `until` ended the run (see diagrams.simulation)
    # By default, nothing is required.
    info: RunInfo = field(default=RunInfo(robot="", mechanisms=""), repr=False)

    @property
    def summary(self) -> dict[str, Any]:
        """All results of the run as plain values, None if not available.

        `outcome` is recovered (also of a run without a push), failed, or
        undecided: no failure was found, but the run was too short.  `reason`
        explains an outcome other than recovered.
        """
        outcome, reason = _judge(self)
        recovered = outcome == "recovered"
        measurements = measure(self.logs)
        duration = measurements["duration_s"] or 0.0  # None without rows
        summary = {
            "outcome": outcome,
            "recovered": recovered,
            "reason": reason,
            "fell_at": self.fell_at,
            **{
                name: value
                for name, value in vars(self.info).items()
                if name not in ("calm_steps", "max_torso_tilt_deg", "landing")
            },
            **measurements,
            "duration_s": duration,
            "recovery_time_s": recovery_time(self.logs) if recovered else None,
            "required_calm_steps": self.info.calm_steps,
            "missed_pushes": self.missed_pushes,
            "improper_contacts": list(self.improper_contacts),
            "self_contacts": [
                pair
                for pair in self.improper_contacts
                if not pair.endswith(" - ground") and "::" not in pair
            ],
            "real_time_factor": duration / max(self.cpu_time, 1e-9),
            "versions": versions(self.info.engine),
        }
        return cast(dict[str, Any], _finite(summary))


def _finite(value: Any) -> Any:
    """A tree with None for NaN and infinity, which JSON does not have."""
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    is_none = isinstance(value, float) and not math.isfinite(value)
    return None if is_none else value


def _judge(run: Run) -> tuple[str, str]:
    """The outcome, and the reason of one other than recovered."""
    for outcome, judge in ("failed", failure), ("undecided", _doubt):
        reason = judge(run)
        if reason:
            return outcome, reason
    shortfall = _shortfall(run)
    if not shortfall:
        return "recovered", ""
    if _had_time(run):
        return "failed", shortfall
    return "undecided", f"too short: {shortfall}"


def failure(run: Run) -> str:
    """Returns the first failure of a run.

    Args:
        run: a run, at its end or before.

    Returns:
        The reason in words; "" if there is no failure.
    """
    log = run.logs
    if run.error:
        return f"stopped: {run.error}"
    lost = lost_at(log)
    if lost is not None:
        return f"estimator lost: at {lost:.2f} s"
    gave_up = "the controller gave up" if _gave_up(log) else ""
    if run.fell_at is not None:
        causes = ", ".join(filter(None, (run.fall_reason, gave_up)))
        return f"fell: {causes}" if causes else "fell"
    if run.interrupted or len(log["t"]) == 0:
        return "interrupted"
    if gave_up:
        return gave_up
    if run.improper_contacts:
        return f"contact of {', '.join(run.improper_contacts)}"
    tilt = largest(trunk_tilts(log)[0])
    if tilt is not None and tilt > run.info.max_torso_tilt_deg:
        return f"tilted: the torso by {tilt:.0f} deg"
    return _overload(log) or hard_landing(log, run.info.landing)


def _doubt(run: Run) -> str:
    """The reason why the run is too short to judge; empty if it is not."""
    log = run.logs
    if run.missed_pushes:
        return "not pushed: the push did not come before the end"
    for push in pushes(log)[-1:]:
        left = log["t"][-1] - push.end
        if left < SETTLED - _TICK_ROUNDING:
            return f"too short: the run ended {left:.2f} s after the push"
    return ""


def _shortfall(run: Run) -> str:
    """The criterion of recovery that is not met at the end; empty if none."""
    log, required = run.logs, run.info.calm_steps
    if "icp" not in log:
        return _policy_shortfall(log)
    if required and calm_steps(log) >= required:
        return ""
    shortfall = f"the ICP error did not stay below {ICP_BACK} m"
    stands = signal_view(log, "walking_signal", -1).phase == STANDS
    if required and not stands:
        return f"{shortfall} for {required} whole steps"
    late = log["t"] >= log["t"][-1] - SETTLED
    if not np.all(icp_error(log)[late] < ICP_BACK):
        return shortfall
    if stands and not stands_square(log):
        return "it stands, but its feet are not side by side"
    return ""


def _policy_shortfall(log: Log) -> str:
    """The criterion without an ICP: it steps, if it is told to walk.

    Told to step in place, it may as well be held still.
    """
    late = sum(time > log["t"][-1] - STEADY for time in landings(log))
    command = log.get("velocity_command", np.zeros((1, 3)))[-1]
    if late > 1 or np.all(np.abs(command) <= SLOWEST):
        return ""
    return f"it did not step in the last {STEADY:g} s"


def _had_time(run: Run) -> bool:
    """True if a robot that recovers would have, by the end of the run.

    It has taken PATIENCE steps since the last push, or since the start; or it
    stands, or waits in a transfer, and had PATIENCE_TIME.
    """
    log = run.logs
    begin = max((push.end for push in pushes(log)[-1:]), default=0.0)
    left = log["t"][-1] - begin
    if "icp" not in log:
        return bool(left >= STEADY)
    walking = signal_view(log, "walking_signal", -1)
    stays = walking.phase == STANDS or _waits(log)
    taken = sum(time > begin for time in landings(log))
    return taken >= PATIENCE or bool(stays and left >= PATIENCE_TIME)


def _waits(log: Log) -> bool:
    """True if it has waited in a transfer for PATIENCE_TIME."""
    late = log["t"] >= log["t"][-1] - PATIENCE_TIME
    waiting = signal_view(log, "walking_signal").waiting
    return bool(np.all(waiting[late] > 0.5))


def _overload(log: Log) -> str:
    """The joint limit that was exceeded; empty if none was."""
    if not np.all(torque_ratio(log) <= 1.0 + EFFORT_MARGIN):
        return "a torque was above its limit"
    speeds = joint_speed_ratio(log)
    if not np.all(speeds <= 1.0 + SPEED_MARGIN):
        return f"too fast: a joint at {100.0 * speeds.max():.1f} % of its limit"
    return ""


def _gave_up(log: Log) -> bool:
    """True if the whole-body QP failed throughout the last GIVES_UP_AFTER."""
    if "whole_body_qp_status" not in log:
        return False
    t, solved = log["t"], signal_view(log, "whole_body_qp_status").solved > 0.5
    late = t > t[-1:] - GIVES_UP_AFTER - _TICK_ROUNDING
    return not np.all(late) and not np.any(solved[late])
