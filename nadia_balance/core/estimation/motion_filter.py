"""A filter of measured joints and rates, which knows what was commanded."""

from typing import NamedTuple

import numpy as np

from nadia_balance.core.math.arrays import Array

# Standard deviation of the accelerations that are expected, where nothing
# unexpected happens [rad/s^2].
ACCELERATION_ERROR = 1.0
LARGE = 3.0  # deviations of more standard deviations are no noise
_CONVERGED = 2000  # steps of the covariance's recursion


class MotionFilter(NamedTuple):
    """Gains and noise of positions and velocities, (2, n) each, or (2, 2, n).

    Args:
        gain: K of the corrections of (position, velocity), in columns those by
            the deviations of (position, velocity) (2, 2, n).
        noise: standard deviations of the measured (positions, velocities)
            (2, n) [rad], [rad/s].
    """

    gain: Array
    noise: Array

    def corrected(self, expected: Array, measured: Array) -> Array:
        """The motion between what was expected and what is measured.

            x = x_e + K c + (e - c),    e = x_m - x_e,

        with c = e within LARGE standard deviations of the noise: what is more
        is no noise but a push or an impact, and is believed at once.  So x is
        never farther from what is measured.

        Args:
            expected: (positions, velocities) (2, n).
            measured: likewise.

        Returns:
            The filtered motion (2, n).
        """
        deviation = measured - expected
        bound = LARGE * self.noise
        small = np.clip(deviation, -bound, bound)
        correction = self.gain[:, 0] * small[0] + self.gain[:, 1] * small[1]
        return np.asarray(expected + (deviation - small) + correction)


def motion_filter(noise: Array, period: float) -> MotionFilter:
    """The steady Kalman filter of q+ = q + T v + T^2/2 a, v+ = v + T a.

    The acceleration a is the expected one, but for white noise of
    ACCELERATION_ERROR.

    Args:
        noise: standard deviations of the measured (positions, velocities)
            (2, n) [rad], [rad/s]; infinite: not measured.
        period: T [s].

    Returns:
        The filter.
    """
    kinds, kind = np.unique(noise, axis=1, return_inverse=True)
    gains = [_steady_gain(column, period) for column in kinds.T]
    return MotionFilter(
        gain=np.stack(gains, axis=-1)[:, :, kind.ravel()], noise=noise
    )


def _steady_gain(noise: Array, period: float) -> Array:
    """The gain (2, 2) for one coordinate."""
    A = np.array([[1.0, period], [0.0, 1.0]])
    error = ACCELERATION_ERROR * np.array([0.5 * period**2, period])
    H = np.eye(2)[np.isfinite(noise)]
    R = np.diag(np.square(noise[np.isfinite(noise)]))
    P, K = np.eye(2), H.T
    for _ in range(_CONVERGED):
        P = A @ P @ A.T + np.outer(error, error)
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        P = P - K @ H @ P
    return np.asarray(K @ H)
