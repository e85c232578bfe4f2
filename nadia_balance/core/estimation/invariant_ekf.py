"""A contact-aided invariant Kalman filter: IMU, legs, feet on the ground."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY

# Standard deviations of what the sensors do not tell.
# A standing sole creeps and sinks [m/sqrt(s)].  With less, legs tell the yaw of
# the past, and the place of a robot far from where it began jumps with it.
STANCE_NOISE = 0.003
SINKING = 0.0005  # into level ground, once a step [m]
FLATNESS = 0.001  # of a sole that stands on it, once a step [rad]
GATE = 21.1  # of a foot's squared innovation: 1e-4 of chi^2 of 3 [-]

THETA, V, P, BIAS = slice(0, 3), slice(3, 6), slice(6, 9), slice(15, 21)
GYRO_BIAS, FORCE_BIAS = slice(15, 18), slice(18, 21)
FEET = slice(9, 12), slice(12, 15)
SIZE = 21
_G = np.array([0.0, 0.0, -GRAVITY])
# skew(a) = a @ _SKEW, reshaped to (3, 3).
_SKEW = np.zeros((3, 9))
for _axis, _plus, _minus in ((0, 7, 5), (1, 2, 6), (2, 3, 1)):
    _SKEW[_axis, _plus], _SKEW[_axis, _minus] = 1.0, -1.0


def skew(a: Array) -> Array:
    """Matrices (..., 3, 3) of the cross products with `a` (..., 3)."""
    return (a @ _SKEW).reshape(*a.shape, 3)


def gammas(phi: Array) -> tuple[Array, Array, Array]:
    """Returns Gamma_m = sum_n skew(phi)^n / (n + m)!, m = 0, 1, 2 (3, 3).

    Gamma_0 is the rotation by `phi` (3,) [rad], Gamma_1 its left Jacobian
    (Hartley et al. 2020, appendix).
    """
    K = skew(phi)
    K2, t2 = K @ K, float(phi @ phi)
    t = math.sqrt(t2)
    if t < 0.05:  # the next terms are below 1e-11; the others would cancel
        s1, s2, s3, s4 = (
            (1.0 - t2 / a * (1.0 - t2 / b)) / c
            for a, b, c in ((6, 20, 1), (12, 30, 2), (20, 42, 6), (30, 56, 24))
        )
    else:
        s1, s2 = math.sin(t) / t, (1.0 - math.cos(t)) / t2
        s3 = (1.0 - s1) / t2
        s4 = (0.5 - s2) / t2
    unit = np.eye(3)
    return (
        unit + s1 * K + s2 * K2,
        unit + s2 * K + s3 * K2,
        0.5 * unit + s3 * K + s4 * K2,
    )


class Estimate(NamedTuple):
    """Mean and covariance of the filter, of the IMU's frame I in W.

    The truth is exp(xi) (R, x), bias + xi[15:]: xi (21,) ~ N(0, cov) is the
    right-invariant error, of rotation, rows of `x`, biases.
    """

    R: Array  # R_WI (3, 3)
    x: Array  # velocity [m/s], position, left and right sole [m] (4, 3), in W
    bias: Array  # of gyro [rad/s] and specific force [m/s^2] (2, 3), in I
    cov: Array  # (21, 21)


class InvariantEkf:
    """x+ = f(x, IMU), then x+ = exp(K (R p_IF - (d - p))) x for each stance F.

    The right-invariant extended Kalman filter of Hartley, Ghaffari, Eustice
    and Grizzle (2020, "Contact-aided invariant extended Kalman filtering for
    robot state estimation", IJRR 39(4)), with biases.  Neither the transition
    of the error nor its measurement depends on the estimate, but for the
    biases.  Equations are numbered as in docs/sensors.md.
    """

    def __init__(self, sensors: SensorParams, period: float):
        """Filters the measurements of `sensors`, one every `period` [s]."""
        self._period = T = period
        self._joint_var = sensors.joint_noise**2
        self._gyro_var = sensors.gyro_noise**2 * T
        walks = sensors.gyro_walk, sensors.force_walk
        self._noise = np.zeros(SIZE)
        self._noise[V] = sensors.force_noise**2 * T
        self._noise[9:15] = STANCE_NOISE**2 * T
        self._noise[BIAS] = np.repeat(np.square(walks), 3) * T
        self._biases = sensors.gyro_bias, sensors.force_bias
        # The transition of the error without biases: exp(A T), Eq. (3).
        self._Phi = np.eye(SIZE)
        self._Phi[V, THETA] = skew(_G) * T
        self._Phi[P, THETA] = skew(_G) * (0.5 * T**2)
        self._Phi[P, V] = np.eye(3) * T

    def begin(self, R: Array, p: Array, error: Array) -> Estimate:
        """The estimate of a robot at rest, told where it is; soles: see touch.

        `error` (3,) are standard deviations of the rotation [rad], of velocity
        [m/s] and position [m].
        """
        x = np.vstack((np.zeros(3), p, p, p))
        cov = np.diag(
            np.square(np.repeat((*error, 0.0, 0.0, *self._biases), 3))
        )
        start = Estimate(R, x, np.zeros((2, 3)), cov)
        # The error of the position itself, not that of a rotation about W.
        A = np.eye(SIZE)
        A[3:9, THETA] = skew(x[:2]).reshape(6, 3)
        for foot in FEET:
            A[foot] = A[P]
        return start._replace(cov=A @ cov @ A.T)

    def predict(self, last: Estimate, imu: Array) -> Estimate:
        """The estimate a period later, Eqs. (1) to (4).

        `imu` (6,) are the mean angular velocity [rad/s] and specific force
        [m/s^2] in I over the period.
        """
        T, (R, x, bias, cov) = self._period, last
        w, f = imu.reshape(2, 3) - bias
        turned, mean, double = gammas(w * T)
        RG = R @ mean
        moved = x.copy()
        moved[0] += (RG @ f + _G) * T
        moved[1] += (x[0] + (R @ double @ f) * T + _G * (0.5 * T)) * T
        Phi = self._Phi.copy()
        cross = skew(0.5 * (x + moved))
        Phi[THETA, GYRO_BIAS] = Phi[V, FORCE_BIAS] = -T * RG
        Phi[3:15, GYRO_BIAS] = (cross @ (-T * RG)).reshape(12, 3)
        Phi[P, FORCE_BIAS] = (-(T**2)) * (R @ double)
        # Gravity turns with the error that the bias makes within the period.
        Phi[V, GYRO_BIAS] += self._Phi[P, THETA] @ -R
        Phi[P, GYRO_BIAS] -= (0.5 * T**2) * (skew(x[0]) @ R)
        cov = Phi @ cov @ Phi.T
        spread = np.vstack((np.eye(3), cross.reshape(12, 3)))
        cov[:15, :15] += self._gyro_var * (spread @ spread.T)
        cov.ravel()[:: SIZE + 1] += self._noise
        return Estimate(R @ turned, moved, bias, cov)

    def touch(self, last: Estimate, i: int, p_IF: Array, J: Array) -> Estimate:
        """The estimate after sole `i` has landed: it is where the leg says.

        Eq. (6); the sole's former place is forgotten.  `p_IF` (3,) [m] and its
        Jacobian `J` (3, nj) by joint angles are in I.
        """
        x, cov, foot = last.x.copy(), last.cov.copy(), FEET[i]
        x[2 + i] = x[1] + last.R @ p_IF
        cov[foot] = cov[P]
        cov[:, foot] = cov[:, P]
        RJ = last.R @ J
        cov[foot, foot] += self._joint_var * (RJ @ RJ.T)
        return last._replace(x=x, cov=cov)

    def level(
        self, last: Estimate, i: int, height: float, up: Array, J: Array
    ) -> Estimate:
        """The estimate with sole `i` flat on ground of known `height` [m].

        Eq. (7), once a step: how the sole lies does not change within one.
        `up` (3,) is the normal of the sole in I, `J` (3, nj) the Jacobian of
        its rotation.  A sole above GATE stands on an edge: it tells nothing.
        """
        d, H = last.x[2 + i], np.zeros((3, SIZE))
        H[0, :2], H[0, FEET[i].stop - 1] = (d[1], -d[0]), 1.0
        H[1, 1], H[2, 0] = 1.0, -1.0
        RJ = last.R @ J
        noise = np.diag(np.square((SINKING, FLATNESS, FLATNESS)))
        noise[1:, 1:] += self._joint_var * (H[1:, :3] @ RJ @ RJ.T @ H[1:, :3].T)
        r = np.array((height - d[2], *(-last.R @ up)[:2]))
        HP = H @ last.cov
        found, distance = _corrected(last, HP, HP @ H.T + noise, r)
        return found if distance <= GATE else last

    def correct(
        self, last: Estimate, stands: Array, p_IF: Array, J: Array
    ) -> tuple[Estimate, list[int]]:
        """The estimate with the legs' measurement of the soles, Eq. (5).

        `stands` (2,) are the soles on the ground, `p_IF` (2, 3) [m] their
        measured positions and `J` (2, 3, nj) the Jacobians.  One whose squared
        innovation is above GATE has slipped: it has landed anew.  The second
        result are these.
        """
        rows: list[int] = np.flatnonzero(stands).tolist()
        found, distance = self._corrected(last, rows, p_IF, J)
        if distance <= GATE:  # that of each is less
            return found, []
        slipped = [
            i for i in rows if self._corrected(last, [i], p_IF, J)[1] > GATE
        ]
        rows = [i for i in rows if i not in slipped]
        found, _ = self._corrected(last, rows, p_IF, J)
        for i in slipped:
            found = self.touch(found, i, p_IF[i], J[i])
        return found, slipped

    def _corrected(
        self, last: Estimate, rows: list[int], p_IF: Array, J: Array
    ) -> tuple[Estimate, float]:
        """The estimate with the soles `rows`, and their squared innovation."""
        if not rows:
            return last, 0.0
        R, x, _, cov = last
        r = (p_IF[rows] @ R.T - (x[2:][rows] - x[1])).ravel()
        HP = np.concatenate([cov[FEET[i]] - cov[P] for i in rows])
        S = np.concatenate([HP[:, FEET[i]] - HP[:, P] for i in rows], axis=1)
        RJ = (R @ J[rows]).reshape(len(r), -1)
        S += self._joint_var * (RJ @ RJ.T)
        return _corrected(last, HP, S, r)


def _corrected(
    last: Estimate, HP: Array, S: Array, r: Array
) -> tuple[Estimate, float]:
    """The estimate exp(K r) `last`, and r' S^-1 r of the innovation `r`."""
    K = np.linalg.solve(S, np.column_stack((HP, r)))
    xi, cov = r @ K[:, :-1], last.cov - HP.T @ K[:, :-1]
    turned, mean, _ = gammas(xi[THETA])
    x = last.x @ turned.T + xi[3:15].reshape(4, 3) @ mean.T
    bias = last.bias + xi[BIAS].reshape(2, 3)
    moved = Estimate(turned @ last.R, x, bias, 0.5 * (cov + cov.T))
    return moved, float(r @ K[:, -1])
