"""A contact-aided invariant Kalman filter: IMU, legs, feet on the ground."""

import math
from typing import NamedTuple

import numpy as np

from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY

# Standard deviations of what the sensors do not tell.
# A standing sole creeps and sinks [m/sqrt(s)], and turns [rad/sqrt(s)].
STANCE_NOISE, TURNING = 0.00025, 0.00015
SINKING = 0.0015  # into level ground, by as much in every step [m]
FLATNESS = 0.0007  # of a sole that stands on it, once a step [rad]
GATE = 23.5  # of a foot's squared innovation: 1e-4 of chi^2 of 4 [-]

THETA, V, P, BIAS = slice(0, 3), slice(3, 6), slice(6, 9), slice(15, 21)
GYRO_BIAS, FORCE_BIAS = slice(15, 18), slice(18, 21)
# Place and heading of each sole, and what the legs measure them from.
FEET, BODY = ([9, 10, 11, 21], [12, 13, 14, 22]), [6, 7, 8, 2]
HEADINGS, GAUGE, SIZE = slice(21, 23), slice(23, 26), 26
_SEEN = np.array([np.eye(SIZE)[foot] - np.eye(SIZE)[BODY] for foot in FEET])
# What GAUGE turns about W's z axis, and moves along x and y.
_ALL = np.zeros((SIZE, 3))
_ALL[[2, 21, 22], 0] = _ALL[[6, 9, 12], 1] = _ALL[[7, 10, 13], 2] = 1.0
# The error of rotation, velocity and position in W, by all of xi.
IN_W = np.eye(9, SIZE)
IN_W[:, GAUGE] = _ALL[:9]
_G = np.array([0.0, 0.0, -GRAVITY])
# skew(a) = a @ _SKEW, reshaped to (3, 3).
_SKEW: Array = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)


def skew(a: Array) -> Array:
    """Matrices of the cross products a x b = S(a) b.

    Args:
        a: vectors (..., 3).

    Returns:
        Matrices S (..., 3, 3).
    """
    return (a @ _SKEW).reshape(*a.shape, 3)


def gammas(phi: Array) -> tuple[Array, Array, Array]:
    """Gamma_m = sum_n skew(phi)^n / (n + m)! (Hartley et al. 2020, appendix).

    Args:
        phi: rotation vector (3,) [rad].

    Returns:
        Gamma_0 (3, 3), the rotation; Gamma_1 (3, 3), its left Jacobian; Gamma_2
        (3, 3).
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


class Legs(NamedTuple):
    """What the joint angles tell of the soles' frames F in I."""

    p: Array  # p_IF (2, 3) [m]
    R: Array  # R_IF (2, 3, 3)
    J: Array  # Jacobians of rotation and place by the angles (2, 6, nj)
    v: Array  # velocities relative to I's, in I, by speeds and gyro (2, 3)


class Estimate(NamedTuple):
    """Mean and covariance of the filter, of the IMU's frame I in W.

    The truth is exp(_ALL xi[23:]) exp(xi) (R, x), bias + xi[15:21] and heading
    + xi[21:23] + xi[23]: xi (26,) ~ N(0, cov) is the right-invariant error, of
    rotation, rows of `x`, biases, headings, and, not corrected, the gauge.
    """

    R: Array  # R_WI (3, 3)
    x: Array  # velocity [m/s], position, left and right sole [m] (4, 3), in W
    bias: Array  # of gyro [rad/s] and specific force [m/s^2] (2, 3), in I
    heading: Array  # of the soles' x axes (2,) [rad]
    cov: Array  # (26, 26)


class InvariantEkf:
    """x+ = f(x, IMU), then x+ = exp(K (R p_IF - (d - p))) x for each stance F.

    The right-invariant extended Kalman filter of Hartley, Ghaffari, Eustice
    and Grizzle (2020, "Contact-aided invariant extended Kalman filtering for
    robot state estimation", IJRR 39(4)), with biases, and with the soles'
    headings.  Neither the transition of the error nor its measurement depends
    on the estimate, but for the biases.  Legs cannot tell turn and horizontal
    place of the whole in W: what these were at the last landing is Schmidt's
    considered gauge, in the covariance only.  Equations: see docs/sensors.md.

    Args:
        sensors: whose measurements are filtered.
        period: of the measurements [s].
    """

    def __init__(self, sensors: SensorParams, period: float):
        self._period = T = period
        self._joint_var = sensors.joint_noise**2
        self._gyro_var = sensors.gyro_noise**2 * T
        self._noise = np.zeros(SIZE)
        self._noise[V] = sensors.force_noise**2 * T
        self._noise[9:15] = STANCE_NOISE**2 * T
        self._noise[HEADINGS] = TURNING**2 * T
        self._noise[BIAS] = T * np.repeat(
            np.square((sensors.gyro_walk, sensors.force_walk)), 3
        )
        self._biases = sensors.gyro_bias, sensors.force_bias
        # The transition of the error without biases: exp(A T), Eq. (3).
        self._Phi = np.eye(SIZE)
        self._Phi[V, THETA] = skew(_G) * T
        self._Phi[P, THETA] = skew(_G) * (0.5 * T**2)
        self._Phi[P, V] = np.eye(3) * T

    def begin(self, R: Array, p: Array, error: Array) -> Estimate:
        """The estimate of a robot at rest, told where it is.

        Args:
            R: rotation R_WI (3, 3).
            p: position p_WI (3,) [m].
            error: standard deviations in W (3, 3), a row each of rotation
                [rad], velocity [m/s] and position [m].

        Returns:
            The estimate; the soles follow by `touch`.
        """
        x = np.vstack((np.zeros(3), p, p, p))
        others = np.repeat((0.0, *self._biases, 0.0), (6, 3, 3, SIZE - 21))
        cov = np.diag(np.square(np.concatenate((error.ravel(), others))))
        # The error of the position itself, not that of a rotation about W.
        A = np.eye(SIZE)
        A[3:9, THETA] = skew(x[:2]).reshape(6, 3)
        return Estimate(
            R=R,
            x=x,
            bias=np.zeros((2, 3)),
            heading=np.zeros(2),
            cov=A @ cov @ A.T,
        )

    def predict(self, last: Estimate, imu: Array) -> Estimate:
        """The estimate a period later, Eqs. (1) to (4).

        Args:
            last: estimate at the beginning of the period.
            imu: mean angular velocity [rad/s] and specific force [m/s^2] in I
                over the period (6,).

        Returns:
            The estimate at its end.
        """
        T, R, x = self._period, last.R, last.x
        w, f = imu.reshape(2, 3) - last.bias
        turned, mean, double = gammas(w * T)
        RG = R @ mean
        moved = x.copy()
        moved[0] += (RG @ f + _G) * T
        moved[1] += (x[0] + (R @ double @ f) * T + _G * (0.5 * T)) * T
        Phi = self._Phi.copy()
        spread = np.concatenate(
            (np.eye(3), skew(0.5 * (x + moved)).reshape(12, 3))
        )
        Phi[V, FORCE_BIAS] = -T * RG
        Phi[:15, GYRO_BIAS] = spread @ (-T * RG)
        Phi[P, FORCE_BIAS] = (-(T**2)) * (R @ double)
        # Gravity turns with the error that the bias makes within the period.
        Phi[V, GYRO_BIAS] += self._Phi[P, THETA] @ -R
        Phi[P, GYRO_BIAS] -= (0.5 * T**2) * (skew(x[0]) @ R)
        cov = Phi @ last.cov @ Phi.T
        cov[:15, :15] += self._gyro_var * (spread @ spread.T)
        cov.ravel()[:: SIZE + 1] += self._noise
        return last._replace(R=R @ turned, x=moved, cov=cov)

    def touch(self, last: Estimate, i: int, legs: Legs) -> Estimate:
        """The estimate after a sole has landed: it is where the leg says.

        Eq. (6); the sole's former place is forgotten, and the errors of yaw
        and horizontal place go to the gauge, Eq. (8).

        Args:
            last: estimate before.
            i: the sole, 0 left, 1 right.
            legs: what the joint angles tell.

        Returns:
            The estimate with the new place and heading of the sole.
        """
        x, heading, cov = last.x.copy(), last.heading.copy(), last.cov.copy()
        place, ahead = seen(last, legs)
        x[2 + i], heading[i] = place[i], ahead[i]
        foot = FEET[i]
        cov[foot] = cov[BODY]
        cov[:, foot] = cov[:, BODY]
        cov[np.ix_(foot, foot)] += self._leg_noise(last, [i], legs)
        yaw_and_place = np.eye(SIZE)[[2, 6, 7]]
        A = np.eye(SIZE) - _ALL @ yaw_and_place
        A[GAUGE] += yaw_and_place
        return last._replace(x=x, heading=heading, cov=A @ cov @ A.T)

    def level(
        self, last: Estimate, i: int, height: float, legs: Legs
    ) -> Estimate:
        """The estimate with a sole flat on level ground.

        Eq. (7), once a step: how the sole lies does not change within one.
        A sole above GATE stands on an edge: it tells nothing.

        Args:
            last: estimate before.
            i: the sole, 0 left, 1 right.
            height: of the ground in W [m].
            legs: what the joint angles tell.

        Returns:
            The estimate; `last` above GATE.
        """
        d, H = last.x[2 + i], np.zeros((3, SIZE))
        H[0, :2], H[0, FEET[i][2]] = (d[1], -d[0]), 1.0
        H[1, 1], H[2, 0] = 1.0, -1.0
        RJ = last.R @ legs.J[i, :3]
        noise = np.diag(np.square((SINKING, FLATNESS, FLATNESS)))
        noise[1:, 1:] += self._joint_var * (H[1:, :3] @ RJ @ RJ.T @ H[1:, :3].T)
        r = np.array((height - d[2], *(-last.R @ legs.R[i, :, 2])[:2]))
        HP = H @ last.cov
        corrected, distance = _corrected(last, HP=HP, S=HP @ H.T + noise, r=r)
        return corrected if distance <= GATE else last

    def correct(self, last: Estimate, stands: Array, legs: Legs) -> Estimate:
        """The estimate with the legs' measurement of the soles, Eq. (5).

        A sole whose squared innovation is above GATE has slipped: it has landed
        anew.

        Args:
            last: estimate before.
            stands: whether each sole is on the ground (2,).
            legs: what the joint angles tell.

        Returns:
            The estimate; `last` if no sole stands.
        """
        rows: list[int] = np.flatnonzero(stands).tolist()
        corrected, distance = self._corrected(last, rows, legs)
        if distance <= GATE:  # that of each is less
            return corrected
        slipped = [
            i for i in rows if self._corrected(last, [i], legs)[1] > GATE
        ]
        corrected, _ = self._corrected(
            last, [i for i in rows if i not in slipped], legs
        )
        for i in slipped:
            corrected = self.touch(corrected, i, legs)
        return corrected

    def _corrected(
        self, last: Estimate, rows: list[int], legs: Legs
    ) -> tuple[Estimate, float]:
        """The estimate with the soles `rows`, and their squared innovation."""
        if not rows:
            return last, 0.0
        place, ahead = seen(last, legs)
        turn = np.remainder(ahead - last.heading + math.pi, 2.0 * math.pi)
        r = np.column_stack((place - last.x[2:], turn - math.pi))[rows].ravel()
        H = _SEEN[rows].reshape(-1, SIZE)
        HP = H @ last.cov
        return _corrected(
            last, HP=HP, S=HP @ H.T + self._leg_noise(last, rows, legs), r=r
        )

    def _leg_noise(self, last: Estimate, rows: list[int], legs: Legs) -> Array:
        """Covariance of place and heading of the soles `rows` by the legs."""
        RJ = last.R @ legs.J[rows].reshape(-1, 2, 3, legs.J.shape[-1])
        RJ = np.concatenate((RJ[:, 1], RJ[:, 0, 2:]), axis=1).reshape(
            4 * len(rows), -1
        )
        return self._joint_var * (RJ @ RJ.T)


def seen(last: Estimate, legs: Legs) -> tuple[Array, Array]:
    """Where the soles are by the legs: d = p + R p_IF.

    Args:
        last: estimate of the IMU's pose in W.
        legs: what the joint angles tell.

    Returns:
        Places d (2, 3) in W [m] and headings (2,) [rad].
    """
    x, y, _ = last.R @ legs.R[:, :, 0].T
    return last.x[1] + legs.p @ last.R.T, np.arctan2(y, x)


def _corrected(
    last: Estimate, *, HP: Array, S: Array, r: Array
) -> tuple[Estimate, float]:
    """The estimate exp(K r) `last`, and r' S^-1 r of the innovation `r`."""
    K = np.linalg.solve(S, np.column_stack((HP, r)))
    xi = r @ K[:, :-1]
    cov = last.cov - HP.T @ K[:, :-1]
    cov[GAUGE, GAUGE] = last.cov[GAUGE, GAUGE]  # Schmidt's: K = 0 there
    turned, mean, _ = gammas(xi[THETA])
    return Estimate(
        R=turned @ last.R,
        x=last.x @ turned.T + xi[3:15].reshape(4, 3) @ mean.T,
        bias=last.bias + xi[BIAS].reshape(2, 3),
        heading=last.heading + xi[HEADINGS],
        cov=0.5 * (cov + cov.T),
    ), float(r @ K[:, -1])
