"""Limits of the joint drives: torque-speed line, lag, torque rate."""

import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.bounds import bounded


@dataclass(kw_only=True)
class JointDriveParams:
    """Parameters of all drives; other torque and speed limits: see URDF."""

    # Bandwidth of the torque, a first-order lag.
    bandwidth: float = bounded(40.0, above=0.0, unit="Hz")
    # Share of the speed limit up to which the full torque is available; above
    # it the torque limit decreases linearly to 0 at the speed limit.
    corner_speed: float = bounded(0.5, above=0.0, below=1.0)
    # Largest rate of a commanded torque, in shares of its limit.
    max_torque_rate: float = bounded(50.0, above=0.0, unit="1/s", of="")
    # Torque limits [N m] by joint, in place of those of the URDF.
    max_torque: dict[str, float] = bounded(dict, above=0.0, unit="N m")

    @property
    def lag(self) -> float:
        """Lag [s] of a slowly changing torque."""
        return 1.0 / (2.0 * math.pi * self.bandwidth)


def torque_limits(
    speed: Array, max_torque: Array, max_speed: Array, corner_speed: float
) -> Array:
    """Returns the least and the largest torque (2, n) [N m] of n drives.

    `speed` (n,) [rad/s], with limits `max_torque` (n,) [N m] and `max_speed`
    (n,) [rad/s]: the torque-speed line bounds driving, not braking torques.
    """
    # In place for speed: called in every step of the plant.
    limits = np.empty((2, speed.size))
    np.add(max_speed, speed, out=limits[0])
    np.subtract(max_speed, speed, out=limits[1])
    limits /= (1.0 - corner_speed) * max_speed
    np.minimum(np.maximum(limits, 0.0, out=limits), 1.0, out=limits)
    limits *= max_torque
    np.negative(limits[0], out=limits[0])
    return limits


def lag_share(bandwidth: float, period: float) -> float:
    """Returns the step response [-] of the torque after `period` [s].

    The drive is a first-order lag with the 3 dB `bandwidth` [Hz].
    """
    return -math.expm1(-2.0 * math.pi * bandwidth * period)
