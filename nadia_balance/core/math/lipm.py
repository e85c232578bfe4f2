"""The linear inverted pendulum and its instantaneous capture point (ICP)."""

from __future__ import annotations

import math

import numpy as np

from nadia_balance.core.math.arrays import Array

GRAVITY = 9.81  # [m/s^2]


def natural_frequency(com_height: float) -> float:
    """Returns omega = sqrt(g / z) [rad/s] (Nadia paper, below Eq. 1).

    `com_height` z > 0 [m] is the height of the CoM above the eCMP.

    Raises ValueError: z is not positive (NaN included).
    """
    if not com_height > 0.0:
        raise ValueError(f"com_height = {com_height}: must be > 0")
    return math.sqrt(GRAVITY / com_height)


def icp(com: Array, com_velocity: Array, omega: float) -> Array:
    """Returns the ICP x + xdot / omega (Nadia paper, Eq. 1).

    `com` [m] and `com_velocity` [m/s] have the same shape and frame.
    """
    return np.asarray(com + com_velocity / omega)


def alip_velocity(velocity: Array, momentum: Array, height: float) -> Array:
    """Returns the CoM velocity (2,) [m/s] that the contact's momentum implies.

    The angular momentum about a contact, `height` z [m] below the CoM, is m z
    times this velocity: v + (L_y, -L_x) / (m z), with the `velocity` v (2,)
    [m/s] of the CoM and the angular `momentum` L / m (3,) [m^2/s] about it
    (ALIP: Gong and Grizzle, Zero dynamics, pendulum models, and angular
    momentum in feedback control of bipedal locomotion, 2022).
    """
    x, y, _ = momentum.tolist()
    return np.asarray(velocity + np.array((y, -x)) / height)


def icp_after(icp: Array, ecmp: Array, omega: float, t: float) -> Array:
    """Returns the ICP after `t` [s] at a constant eCMP (Nadia paper, Eq. 3).

    Points (2,) [m] in W; `t` may be negative.
    """
    return np.asarray(ecmp + math.exp(omega * t) * (icp - ecmp))


def com_after(
    com: Array, com_velocity: Array, ecmp: Array, omega: float, t: float
) -> tuple[Array, Array]:
    """Returns CoM and its velocity after `t` [s] at a constant eCMP.

    It solves xddot = omega^2 (x - r_ecmp), Eq. 5 of the Nadia paper at constant
    height.  Points (2,) [m], [m/s] in W.
    """
    c, s = math.cosh(omega * t), math.sinh(omega * t)
    offset = com - ecmp
    return (
        np.asarray(ecmp + c * offset + s / omega * com_velocity),
        np.asarray(omega * s * offset + c * com_velocity),
    )
