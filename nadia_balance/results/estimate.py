"""How well the state was estimated: errors of a run, and their NEES."""

import math

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.results.log import Log

SIGNALS = "state estimated_state estimate_covariance"
LOST_NEES = 90.0  # ten times what 9 errors have on average [-]
LOST_AFTER = 0.2  # time above it [s]
_SETTLED = 1.0  # errors count from here on [s]


def errors(log: Log) -> Array:
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
    """Normalized squared error e' P^-1 e (n,) of `errors`; 9 on average."""
    e = errors(log)
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
    if not {*SIGNALS.split()} <= {*log}:
        return None
    watch, ticks = LostWatch(), zip(log["t"], nees(log), strict=True)
    return next((float(t) for t, e in ticks if watch.look(t, e)), None)


def measure(log: Log) -> dict[str, float] | None:
    """Errors of the estimate after the start; None for a run that short."""
    late = log["t"] >= _SETTLED
    if not late.any():
        return None
    error = errors(log)[late]
    return {
        "rms_velocity_m_s": math.sqrt(np.mean(error[:, 3:6] ** 2) * 3.0),
        "max_tilt_deg": math.degrees(np.max(np.hypot(*error[:, :2].T))),
        "last_horizontal_m": math.hypot(*error[-1, 6:8]),
        "max_height_m": float(np.max(np.abs(error[:, 8]))),
        "mean_nees": float(np.mean(nees(log)[late])),  # 9 if P is true
    }
