"""What the whole-body QP needs to know: the robot, its motion, its orders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Rows of WholeBodyTerms: those of the joints come in between.
LEFT_SOLE = slice(0, 6)
RIGHT_SOLE = slice(6, 12)
BASE = slice(12, 18)
TORSO = slice(-6, -3)
PELVIS = slice(-3, None)
SOLES = (LEFT_SOLE, RIGHT_SOLE)


@dataclass(frozen=True, eq=False)
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


class WholeBodyTerms(NamedTuple):
    """The robot's motion; nv = 6 + nj, v = [w_WB, v_WB, joints].

    The floating base B is the pelvis, its velocity expressed in W.

    `rows` (24 + nj, nv + 1) are [A, a] of all that is A vdot + a: the
    accelerations of the left and of the right sole ([w, v] at its centre), the
    generalised forces on base and joints, and the angular accelerations of
    torso and pelvis, all in W.  `velocities` (24 + nj,) are A v.  The forces,
    M vdot + bias with gravity and damping, are per unit of the robot's mass.

    `rotations` (4, 3, 3): R_W of left sole, right sole, torso, pelvis.
    `sole_positions` (2, 3) [m] in W; `positions` (nj,) [rad].
    """

    rows: Array
    velocities: Array
    rotations: Array
    sole_positions: Array
    positions: Array
    v: Array

    @property
    def forces(self) -> Array:
        """[M, bias] (nv, nv + 1), per unit of mass."""
        return self.rows[BASE.start : TORSO.start]


class WholeBodyCommand(NamedTuple):
    """What the robot is to do.

    `momentum_rate` (3,) [N] of the linear momentum in W; `heading` = (yaw,
    yawdot, yawddot) of the torso, and `turn` that of the pelvis on top of it;
    `contacts`: does the (left, right) sole carry, one at least does;
    `max_normal_forces` [N] of the soles; `swing` is the reference (12,) [p, v,
    a, yaw, yawdot, yawddot] of the sole that does not carry.
    """

    momentum_rate: Array
    heading: tuple[float, float, float]
    turn: tuple[float, float, float]
    contacts: tuple[bool, bool]
    max_normal_forces: tuple[float, float]
    swing: Array
