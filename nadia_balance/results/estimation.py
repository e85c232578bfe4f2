"""The errors of the state estimate in a run, and when it was lost."""

import math

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.results.log import Log

# The signals that tell the errors of the estimate.
ESTIMATE = ("state", "estimated_state", "estimate_covariance")
# The estimator is lost when the NEES of its 9 errors, 9 on average [-], has
# been above LOST_NEES for LOST_AFTER [s].
LOST_NEES, LOST_AFTER = 90.0, 0.2
_INITIAL = 1.0  # errors of the estimate count from here on [s]


def estimation_errors(log: Log) -> Array:
    """Returns the errors of the pelvis, truth less estimate in W.

    The angle is the small rotation between them, twice the vector part of the
    quaternion q conj(q_estimate).

    Args:
        log: log of a run, with the signals ESTIMATE.

    Returns:
        Angle [rad], velocity [m/s] and position [m], (n, 9).
    """
    truth, estimate = log["state"], log["estimated_state"]
    nq = (truth.shape[1] + 1) // 2  # of 7 + nj positions, 6 + nj velocities
    a, u = truth[:, :1], truth[:, 1:4]
    b, w = estimate[:, :1], estimate[:, 1:4]
    turn = b * u - a * w - np.cross(u, w)
    # q and -q are the same rotation.
    turn *= 2.0 * np.sign(
        np.sum(truth[:, :4] * estimate[:, :4], axis=1, keepdims=True)
    )
    differences = truth - estimate
    return np.concatenate(
        (turn, differences[:, nq + 3 : nq + 6], differences[:, 4:7]), axis=1
    )


def nees(log: Log) -> Array:
    """Returns the NEES e' P^-1 e of the `estimation_errors`.

    Args:
        log: log of a run, with the signals ESTIMATE.

    Returns:
        The NEES (n,) [-]; 9 on average if P is true.
    """
    e = estimation_errors(log)
    P = log["estimate_covariance"].reshape(-1, 9, 9)
    return np.asarray(
        np.sum(e * np.linalg.solve(P, e[:, :, None])[:, :, 0], axis=1)
    )


class LostWatch:
    """Tells, tick by tick, whether the NEES has been out for LOST_AFTER."""

    _since = math.inf  # [s]

    def update(self, time: float, squared_error: float) -> bool:
        """Tells whether it has.

        Args:
            time: now [s].
            squared_error: NEES now [-].

        Returns:
            True if it has.
        """
        self._since = (
            min(self._since, time) if squared_error > LOST_NEES else math.inf
        )
        return time - self._since >= LOST_AFTER - 1e-9  # times are rounded


def lost_at(log: Log) -> float | None:
    """Returns when the estimator was lost (see LostWatch).

    Args:
        log: log of a run.

    Returns:
        The time [s]; None if it never was, or without an estimate.
    """
    if not {*ESTIMATE} <= {*log}:
        return None
    watch, ticks = LostWatch(), zip(log["t"], nees(log), strict=True)
    return next((float(t) for t, e in ticks if watch.update(t, e)), None)


def measure_estimate(log: Log) -> dict[str, float] | None:
    """Returns the errors of the estimate after the start.

    Args:
        log: log of a run, with the signals ESTIMATE.

    Returns:
        Values by name; None for a run that short.
    """
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
