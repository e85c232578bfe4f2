"""What the drives of the joints can do: torque at speed, lag, torque rate."""

import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.bounds import bounded
from nadia_balance.core.walking import Array


@dataclass(kw_only=True)
class JointDriveParams:
    """Figures that all drives of a robot share; limits are in the URDF."""

    # Of the torque, a first-order lag.
    bandwidth: float = bounded(40.0, above=0.0, unit="Hz")
    # Up to this share of the speed limit the full torque is there; from then
    # on it falls, to nothing at the limit.
    corner_speed: float = bounded(0.5, above=0.0, below=1.0)
    # How fast the controller changes a torque, in shares of its limit.
    max_torque_rate: float = bounded(50.0, above=0.0, unit="1/s", of="")

    @property
    def lag(self) -> float:
        """By how much [s] a slowly changing torque is late."""
        return 1.0 / (2.0 * math.pi * self.bandwidth)


def torque_limits(
    speed: Array, max_torque: Array, max_speed: Array, corner_speed: float
) -> Array:
    """Returns the least and the largest torque (2, n) [N m] of n drives.

    At `speed` (n,), with limits `max_torque` (n,) [N m] and `max_speed` (n,)
    [rad/s]: the torque-speed line bounds what drives a joint, never what
    brakes it.
    """
    # In place, as it is asked for in every step of the plant.
    limits = np.empty((2, speed.size))
    np.add(max_speed, speed, out=limits[0])
    np.subtract(max_speed, speed, out=limits[1])
    limits /= (1.0 - corner_speed) * max_speed
    np.minimum(np.maximum(limits, 0.0, out=limits), 1.0, out=limits)
    limits *= max_torque
    np.negative(limits[0], out=limits[0])
    return limits


def lag_share(bandwidth: float, period: float) -> float:
    """Which share of a step in torque is there after `period` [s].

    Of a first-order lag that is 3 dB down at `bandwidth` [Hz].
    """
    return -math.expm1(-2.0 * math.pi * bandwidth * period)
