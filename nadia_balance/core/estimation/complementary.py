"""A complementary filter: IMU and legs, with gains that are fixed."""

import math

import numpy as np

from nadia_balance.core.estimation.invariant_ekf import (
    SIZE,
    Estimate,
    Legs,
    gammas,
    seen,
    skew,
)
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY

# Bandwidths [1/s]: of gravity's direction beside the gyro, of a sole's velocity
# beside the accelerometer (IHMC: 2 Hz), and of its place (IHMC: 11.8 Hz).
TILT, SPEED, PLACE = 0.2, 2.0 * math.pi * 2.0, 2.0 * math.pi * 11.8
# Standard deviations: rotation [rad], velocity [m/s], position [m].
ERROR = 0.03, 0.1, 0.3
FALLING = 0.1 * GRAVITY  # specific force below which it tells no tilt [m/s^2]


def gravity_direction(last: Array, imu: Array, period: float) -> Array:
    """The direction against gravity in I, a period after `last`.

    By the gyro, and slowly by the specific force, unless it falls freely: a
    passive filter.

    Args:
        last: unit vector in I (3,); at first any of that direction.
        imu: mean angular velocity [rad/s] and specific force [m/s^2] in I over
            the period, and more (n,).
        period: since then [s].

    Returns:
        The unit vector in I (3,).

    Source: Mahony, Hamel and Pflimlin, IEEE TAC 53(5), 2008.
    """
    turned, _, _ = gammas(-period * imu[:3])
    up = turned @ last
    size = np.linalg.norm(imu[3:6])
    if size < FALLING:
        return np.asarray(up)
    up = up + TILT * period * (imu[3:6] / size - up)
    return np.asarray(up / np.linalg.norm(up))


class Complementary:
    """Estimates by fixed gains, with the methods of an InvariantEkf.

    Orientation is by the passive filter of Mahony, Hamel and Pflimlin (2008,
    "Nonlinear complementary filters on the special orthogonal group", IEEE
    TAC 53(5)), velocity and place by IMU and standing feet as on IHMC's robots.
    The covariance is not estimated: it is that of ERROR.

    Args:
        sensors: not used: any sensors.
        period: of the measurements [s].
    """

    def __init__(self, sensors: SensorParams, period: float):
        self._period = period
        self._speed = 1.0 - math.exp(-SPEED * period)
        self._place = 1.0 - math.exp(-PLACE * period)

    def begin(self, R: Array, p: Array, error: Array) -> Estimate:
        """The estimate of a robot at rest, told where it is.

        Args:
            R: rotation R_WI (3, 3).
            p: position p_WI (3,) [m].
            error: not used.

        Returns:
            The estimate; the soles follow by `touch`.
        """
        variances = np.repeat((*np.square(ERROR), 0.0), (3, 3, 3, SIZE - 9))
        return Estimate(
            R=R,
            x=np.vstack((np.zeros(3), p, p, p)),
            bias=np.zeros((2, 3)),
            heading=np.zeros(2),
            cov=np.diag(variances),
        )

    def predict(self, last: Estimate, imu: Array) -> Estimate:
        """The estimate a period later: x+ = f(x, IMU).

        R+ = R exp((w - b + TILT e) T) with the error e of gravity's direction.

        Args:
            last: estimate at the beginning of the period.
            imu: mean angular velocity w [rad/s] and specific force [m/s^2] in
                I over the period (6,).

        Returns:
            The estimate at its end.
        """
        T = self._period
        w, f = imu.reshape(2, 3)
        size = max(float(np.linalg.norm(f)), FALLING)
        tilt = skew(f / size) @ last.R[2]  # error of R, in I [rad]
        turned, mean, _ = gammas((w - last.bias[0] + TILT * tilt) * T)
        a = last.R @ mean @ f - (0.0, 0.0, GRAVITY)
        x, bias = last.x.copy(), last.bias.copy()
        x[1] += (x[0] + 0.5 * T * a) * T
        x[0] += T * a
        bias[0] -= (0.25 * TILT**2 * T) * tilt  # damped critically
        return last._replace(R=last.R @ turned, x=x, bias=bias)

    def touch(self, last: Estimate, i: int, legs: Legs) -> Estimate:
        """The estimate after a sole has landed: it is where the leg says.

        Args:
            last: estimate before.
            i: the sole, 0 left, 1 right.
            legs: what the joint angles tell.

        Returns:
            The estimate with the new place and heading of the sole.
        """
        x, heading = last.x.copy(), last.heading.copy()
        place, ahead = seen(last, legs)
        x[2 + i], heading[i] = place[i], ahead[i]
        return last._replace(x=x, heading=heading)

    def level(
        self, last: Estimate, i: int, height: float, legs: Legs
    ) -> Estimate:
        """The estimate with a sole on level ground.

        Args:
            last: estimate before.
            i: the sole, 0 left, 1 right.
            height: of the ground in W [m].
            legs: not used.

        Returns:
            The estimate, all heights moved.
        """
        x = last.x.copy()
        x[1:, 2] += height - x[2 + i, 2]
        return last._replace(x=x)

    def correct(self, last: Estimate, stands: Array, legs: Legs) -> Estimate:
        """The estimate with the measurement of the legs that stand.

        x+ = x + k (mean of the legs' measurements - x), k = 1 - exp(-w T) with
        the bandwidths w of velocity and place.

        Args:
            last: estimate before.
            stands: whether each sole is on the ground (2,).
            legs: what the joint angles tell.

        Returns:
            The estimate; `last` if no sole stands.
        """
        if not stands.any():
            return last
        place, ahead = seen(last, legs)
        speed = legs.v + legs.p @ skew(last.bias[0])
        off = np.remainder(last.heading - ahead + math.pi, 2.0 * math.pi)
        turn = self._place * np.mean(off[stands] - math.pi)
        x = last.x.copy()
        x[0] -= self._speed * (x[0] + np.mean(speed[stands], axis=0) @ last.R.T)
        x[1] += self._place * np.mean((x[2:] - place)[stands], axis=0)
        turned, _, _ = gammas(np.array((0.0, 0.0, turn)))
        return last._replace(R=turned @ last.R, x=x)
