"""A complementary filter: IMU and legs, with gains that are fixed."""

from __future__ import annotations

import math

import numpy as np

from nadia_balance.core.estimation import invariant_ekf as ekf
from nadia_balance.core.estimation.invariant_ekf import Estimate, Legs
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY

# Bandwidths [1/s]: of gravity's direction beside the gyro, of a sole's velocity
# beside the accelerometer (IHMC: 2 Hz), and of its place (IHMC: 11.8 Hz).
TILT, SPEED, PLACE = 0.2, 2.0 * math.pi * 2.0, 2.0 * math.pi * 11.8
# Standard deviations: rotation [rad], velocity [m/s], position [m].
ERROR = 0.03, 0.1, 0.3


class Complementary:
    """Estimates by fixed gains, with the methods of an InvariantEkf.

    Orientation is by the passive filter of Mahony, Hamel and Pflimlin (2008,
    "Nonlinear complementary filters on the special orthogonal group", IEEE
    TAC 53(5)), velocity and place by IMU and standing feet as on IHMC's robots.
    The covariance is not estimated: it is that of ERROR.
    """

    def __init__(self, sensors: SensorParams, period: float):
        """Filters measurements, one every `period` [s], of any `sensors`."""
        del sensors
        self._period = period
        self._speed = 1.0 - math.exp(-SPEED * period)
        self._place = 1.0 - math.exp(-PLACE * period)

    def begin(self, R: Array, p: Array, error: Array) -> Estimate:
        """The estimate of a robot at rest, told where it is (see touch)."""
        del error
        x, cov = np.vstack((np.zeros(3), p, p, p)), np.zeros((ekf.SIZE,) * 2)
        np.fill_diagonal(cov[:9, :9], np.repeat(np.square(ERROR), 3))
        return Estimate(R, x, np.zeros((2, 3)), np.zeros(2), cov)

    def predict(self, last: Estimate, imu: Array) -> Estimate:
        """The estimate a period later, by `imu` (6,) as for an InvariantEkf."""
        T, (R, x, bias, _, _) = self._period, last
        w, f = imu.reshape(2, 3)
        wrong = ekf.skew(f / np.linalg.norm(f)) @ R[2]  # of R, in I [rad]
        turned, mean, _ = ekf.gammas((w - bias[0] + TILT * wrong) * T)
        a = R @ mean @ f - (0.0, 0.0, GRAVITY)
        x, bias = x.copy(), bias.copy()
        x[1] += (x[0] + 0.5 * T * a) * T
        x[0] += T * a
        bias[0] -= (0.25 * TILT**2 * T) * wrong  # damped critically
        return last._replace(R=R @ turned, x=x, bias=bias)

    def touch(self, last: Estimate, i: int, legs: Legs) -> Estimate:
        """The estimate after sole `i` has landed: it is where the leg says."""
        x, heading = last.x.copy(), last.heading.copy()
        place, ahead = ekf.seen(last, legs)
        x[2 + i], heading[i] = place[i], ahead[i]
        return last._replace(x=x, heading=heading)

    def level(
        self, last: Estimate, i: int, height: float, legs: Legs
    ) -> Estimate:
        """The estimate with sole `i` on ground of known `height` [m]."""
        del legs
        x = last.x.copy()
        x[1:, 2] += height - x[2 + i, 2]
        return last._replace(x=x)

    def correct(self, last: Estimate, stands: Array, legs: Legs) -> Estimate:
        """The estimate with the legs that stand, as `stands` (2,) says."""
        if not stands.any():
            return last
        place, ahead = ekf.seen(last, legs)
        speed = legs.v + legs.p @ ekf.skew(last.bias[0])
        off = np.remainder(last.heading - ahead + math.pi, 2.0 * math.pi)
        turn = self._place * np.mean(off[stands] - math.pi)
        x = last.x.copy()
        x[0] -= self._speed * (x[0] + np.mean(speed[stands], axis=0) @ last.R.T)
        x[1] += self._place * np.mean((x[2:] - place)[stands], axis=0)
        turned, _, _ = ekf.gammas(np.array((0.0, 0.0, turn)))
        return last._replace(R=turned @ last.R, x=x)
