"""The linear inverted pendulum and its instantaneous capture point (ICP)."""

import math

import numpy as np

from nadia_balance.core.math.arrays import Array

GRAVITY = 9.81  # [m/s^2]


def natural_frequency(com_height: float) -> float:
    """Natural frequency sqrt(g / z) (Nadia paper, below Eq. 1).

    Args:
        com_height: height z of the CoM above the eCMP [m], positive.

    Returns:
        omega [rad/s].

    Raises:
        ValueError: z is not positive (NaN included).
    """
    if not com_height > 0.0:
        raise ValueError(f"com_height = {com_height}: must be > 0")
    return math.sqrt(GRAVITY / com_height)


def icp(com: Array, com_velocity: Array, omega: float) -> Array:
    """ICP x + xdot / omega (Nadia paper, Eq. 1).

    Args:
        com: CoM x [m].
        com_velocity: xdot [m/s], of the same shape and frame.
        omega: natural frequency [rad/s].

    Returns:
        ICP [m], of the shape and frame of `com`.
    """
    return np.asarray(com + com_velocity / omega)


def alip_velocity(velocity: Array, momentum: Array, height: float) -> Array:
    """CoM velocity v + (L_y, -L_x) / (m z), implied by a contact's momentum.

    The angular momentum about a contact, z below the CoM, is m z times this
    velocity (ALIP: Gong and Grizzle, Zero dynamics, pendulum models, and
    angular momentum in feedback control of bipedal locomotion, 2022).

    Args:
        velocity: velocity v of the CoM (2,) in W [m/s].
        momentum: angular momentum about the CoM over the mass, L / m (3,) in W
            [m^2/s].
        height: z, of the CoM above the contact [m].

    Returns:
        Velocity (2,) in W [m/s].
    """
    x, y, _ = momentum.tolist()
    return np.asarray(velocity + np.array((y, -x)) / height)


def icp_after(icp: Array, ecmp: Array, omega: float, t: float) -> Array:
    """ICP at a constant eCMP: r + exp(omega t) (icp - r) (Nadia paper, Eq. 3).

    Args:
        icp: present ICP (2,) in W [m].
        ecmp: eCMP r (2,) in W [m].
        omega: natural frequency [rad/s].
        t: time from now [s]; it may be negative.

    Returns:
        ICP after `t` (2,) in W [m].
    """
    return np.asarray(ecmp + math.exp(omega * t) * (icp - ecmp))


def com_after(
    com: Array, com_velocity: Array, ecmp: Array, omega: float, t: float
) -> tuple[Array, Array]:
    """CoM at a constant eCMP: the solution of xddot = omega^2 (x - r_ecmp).

    This is Eq. 5 of the Nadia paper at constant height.

    Args:
        com: present CoM x (2,) in W [m].
        com_velocity: present xdot (2,) in W [m/s].
        ecmp: r_ecmp (2,) in W [m].
        omega: natural frequency [rad/s].
        t: time from now [s]; it may be negative.

    Returns:
        CoM (2,) in W [m] and its velocity (2,) in W [m/s] after `t`.
    """
    c, s = math.cosh(omega * t), math.sinh(omega * t)
    offset = com - ecmp
    return (
        np.asarray(ecmp + c * offset + s / omega * com_velocity),
        np.asarray(omega * s * offset + c * com_velocity),
    )
