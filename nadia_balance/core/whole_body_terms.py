"""What the whole-body QP needs to know: the robot, its motion, its orders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Rows of the stacked Jacobian J, and of Jdot_v.
LEFT_SOLE = slice(0, 6)
RIGHT_SOLE = slice(6, 12)
TORSO = slice(12, 15)
SOLES = (LEFT_SOLE, RIGHT_SOLE)


@dataclass(frozen=True)
class WholeBodyModel:
    """Constants of a robot with nj joints, in the plant's order.

    `mass` [kg]; `posture`, `position_lower`, `position_upper` (nj,) [rad];
    `max_torque` (nj,) [N m]; `is_leg_joint` (nj,); sole size [m].
    """

    mass: float
    sole_length: float
    sole_width: float
    posture: Array
    position_lower: Array
    position_upper: Array
    max_torque: Array
    is_leg_joint: NDArray[np.bool_]

    @property
    def num_joints(self) -> int:
        """Number of joints, all actuated."""
        return self.posture.size


@dataclass(frozen=True)
class WholeBodyTerms:
    """The robot's motion; nv = 6 + nj, v = [w_WB, v_WB, joints].

    The floating base B is the pelvis, its velocity expressed in W.

    Equations of motion: M vdot + bias = B u + sum J' wrench, with M (nv, nv)
    and bias (nv,), with gravity and damping.  J (15, nv), Jdot_v (15,), and
    Jv (15,) = J v: rows of both soles ([w, v] at the sole's centre) and of the
    torso's angular velocity, in W.  `rotations` (4, 3, 3): R_W of left sole,
    right sole, torso, pelvis.  `sole_positions` (2, 3) [m] in W; `positions`
    (nj,) [rad].
    """

    M: Array
    bias: Array
    J: Array
    Jdot_v: Array
    Jv: Array
    rotations: Array
    sole_positions: Array
    positions: Array
    v: Array


@dataclass(frozen=True)
class WholeBodyCommand:
    """What the robot is to do.

    `momentum_rate` (3,) [N] of the linear momentum in W; `heading` = [yaw,
    yawdot, yawddot] of pelvis and torso; `contacts`: does the (left, right)
    sole carry; `max_normal_forces` [N] of the soles; `swing` is the reference
    (12,) [p, v, a, yaw, yawdot, yawddot] of the sole that does not carry.
    """

    momentum_rate: Array
    heading: Array
    contacts: tuple[bool, bool]
    max_normal_forces: tuple[float, float]
    swing: Array
