"""Forces of the ground on the soles, from the torques that the joints feel."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.math.arrays import Array

BANDWIDTH = 100.0  # of the observer [1/s]
# A foot carries above this share of the weight on it, and does down to the
# second: five and two standard deviations of a swing foot's noise.
CARRIES, CARRIED = 0.1, 0.05
# Standard deviations: torques of a drive, as a share of its limit, and the
# weight, as a share of that of the model.
TORQUE_ERROR, WEIGHT_ERROR = 0.005, 0.05


class SoleTerms(NamedTuple):
    """Dynamics of a robot on two soles; nv = 6 + nj, v = [w_WB, v_WB, joints].

    All is expressed in one frame, whichever.

    Args:
        M: mass matrix (nv, nv).
        J: Jacobians of the (left, right) sole, [w, v] at its centre (2, 6, nv).
        up: direction against gravity (3,).
        legs: velocities of the joints of the (left, right) leg (2, k).
    """

    M: Array
    J: Array
    up: Array
    legs: NDArray[np.intp]


def observer_share(period: float) -> float:
    """The share 1 - exp(-BANDWIDTH period) of a new value in the observer's.

    Args:
        period: time from one value to the next [s].

    Returns:
        The share [-].
    """
    return -math.expm1(-BANDWIDTH * period)


def observed(last: Array, residual: Array, period: float) -> Array:
    """The momentum observer a period later.

        r+ = r + (1 - exp(-K T)) (residual - r)

    is the observer r = K (p - int (tau + C'v - g + r) dt) of the generalised
    momentum p = M v, in steps of the period T: there the mean of dp/dt - (tau +
    C'v - g) is what inverse dynamics, at the mean state and with the mean
    acceleration, says of external forces, but for T^2.

    Args:
        last: r (nv,).
        residual: generalised forces that the joints' torques do not explain,
            in the mean over the period (nv,) [N m, N].
        period: T [s].

    Returns:
        The observed external forces r+ (nv,).

    Source: De Luca and Mattone, Sensorless robot collision detection and hybrid
    force/motion control, ICRA 2005; Haddadin, De Luca and Albu-Schaeffer, Robot
    collisions: a survey, IEEE T-RO 33(6), 2017.
    """
    return np.asarray(last + observer_share(period) * (residual - last))


def sole_forces(
    external: Array,
    terms: SoleTerms,
    weight: float,
    acceleration_noise: float,
    torque_noise: Array,
) -> Array:
    """The vertical forces on the soles, from legs and base.

    Each leg tells the force z_i on its sole, as r_leg = J_leg' [tau, f]; the
    base tells the sum s of both.  The forces F minimise

        sum_i (F_i - z_i)^2 / var(z_i) + (F_left + F_right - s)^2 / var(s).

    So a straight leg, whose torques hardly change with the force on it, is
    given what the other leg does not carry.  A push at the trunk changes no
    z_i, and s only if it is vertical.

    Args:
        external: observed external forces (nv,) [N m, N].
        terms: dynamics of the robot.
        weight: of the robot [N].
        acceleration_noise: of each joint, standard deviation in `external`
            [rad/s^2].
        torque_noise: of each joint, likewise (nv,) [N m].

    Returns:
        The forces (left, right) (2,) [N]; those of a foot in the air are noise.
    """
    z, variances = np.zeros(2), np.zeros(2)
    lift = np.concatenate((np.zeros(3), terms.up))
    for i, leg in enumerate(terms.legs):
        share, *_ = np.linalg.lstsq(terms.J[i][:, leg], lift, rcond=None)
        z[i] = share @ external[leg]
        inertia = acceleration_noise * (share @ terms.M[leg, 6:])
        torques = share * torque_noise[leg]
        variances[i] = inertia @ inertia + torques @ torques
    inertia = acceleration_noise * (terms.up @ terms.M[3:6, 6:])
    variance = inertia @ inertia + (WEIGHT_ERROR * weight) ** 2
    missing = terms.up @ external[3:6] - z.sum()
    return np.asarray(z + variances * (missing / (variances.sum() + variance)))


def carrying(forces: Array, carried: Array, weight: float) -> Array:
    """The feet that carry, with hysteresis: touchdown and lift-off.

    Args:
        forces: on the (left, right) sole (2,) [N].
        carried: above 0 for each foot that carried before (2,).
        weight: of the robot [N].

    Returns:
        1 for each foot that carries, 0 for the others (2,).
    """
    least = np.where(carried > 0.0, CARRIED, CARRIES) * weight
    return np.where(forces > least, 1.0, 0.0)
