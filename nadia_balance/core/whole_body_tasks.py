"""Soft tasks of the whole-body QP: desired accelerations and their rows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_terms import (
    SOLES,
    TORSO,
    WholeBodyCommand,
    WholeBodyModel,
    WholeBodyTerms,
)

Array = NDArray[np.float64]

GRAVITY = 9.81  # [m/s^2]

# Rows of the stacked tasks.
_LINEAR = slice(0, 3)
_ANGULAR = slice(3, 6)
_TORSO = slice(6, 9)
_PELVIS = slice(9, 12)
_SWING_TURN = slice(12, 15)
_SWING_MOVE = slice(15, 18)
_NUM_ROWS = 18


def task_weights(params: WholeBodyQpParams) -> Array:
    """Returns the square roots of the weights of the stacked rows (18,)."""
    weights = np.empty(_NUM_ROWS)
    weights[_LINEAR] = params.momentum_weight
    weights[_LINEAR.stop - 1] = params.height_weight
    weights[_ANGULAR] = params.angular_momentum_weight
    weights[_TORSO] = params.torso_weight
    weights[_PELVIS] = params.pelvis_weight
    weights[_SWING_TURN] = params.swing_orientation_weight
    weights[_SWING_MOVE] = params.swing_position_weight
    return np.sqrt(weights)


def stack_tasks(
    params: WholeBodyQpParams,
    model: WholeBodyModel,
    terms: WholeBodyTerms,
    command: WholeBodyCommand,
) -> tuple[Array, Array]:
    """Returns S (18 or 12, nv) and s, so that S vdot = s is wished for.

    Rows: linear and angular momentum per mass (about the CoM), torso and
    pelvis orientation, and the pose of the sole that swings, if one does.
    """
    swinging = not all(command.contacts)
    S = np.zeros((_NUM_ROWS if swinging else _SWING_TURN.start, terms.v.size))
    s = np.empty(S.shape[0])
    _momentum(params, model, terms, command, S, s)
    S[_TORSO] = terms.J[TORSO]
    S[_PELVIS, :3] = np.eye(3)
    upright = _orientation(params, terms, command)
    s[_TORSO] = upright[0] - terms.Jdot_v[TORSO]
    s[_PELVIS] = upright[1]
    if swinging:
        sole = SOLES[command.contacts.index(False)]
        S[_SWING_TURN.start :] = terms.J[sole]
        s[_SWING_TURN.start :] = (
            _swing(params, terms, command) - terms.Jdot_v[sole]
        )
    return S, s


def _momentum(
    params: WholeBodyQpParams,
    model: WholeBodyModel,
    terms: WholeBodyTerms,
    command: WholeBodyCommand,
    S: Array,
    s: Array,
) -> None:
    """Fills in the rows of the momentum about the CoM, per mass.

    The base rows of M vdot + bias are the moment about the base and the
    force on the robot, since the base's velocity is expressed in W; and
    M[0:3, 3:6] is mass times the cross-product matrix of the CoM.
    """
    base = terms.M[:6] / model.mass
    bias = terms.bias[:6] / model.mass
    arm = base[:3, 3:6]  # of the CoM about the base, as a cross product
    S[_LINEAR] = base[3:]
    s[_LINEAR] = command.momentum_rate / model.mass - bias[3:]
    s[_LINEAR.stop - 1] += GRAVITY  # which is no rate of momentum wished for
    S[_ANGULAR] = base[:3] - arm @ base[3:]
    damping = params.angular_momentum_damping * (S[_ANGULAR] @ terms.v)
    s[_ANGULAR] = -damping - (bias[:3] - arm @ bias[3:])


def _orientation(
    params: WholeBodyQpParams,
    terms: WholeBodyTerms,
    command: WholeBodyCommand,
) -> Array:
    """Desired angular accelerations (2, 3) of torso and pelvis, upright."""
    yaw, rate, acceleration = command.heading
    kp = params.orientation_gain
    kd = 2.0 * params.damping_ratio * math.sqrt(kp)
    desired = np.empty((2, 3))
    desired[0] = kp * rotation_error(yaw, terms.rotations[2])
    desired[1] = kp * rotation_error(yaw, terms.rotations[3])
    desired[0] -= kd * terms.Jv[TORSO]
    desired[1] -= kd * terms.v[:3]
    desired[:, 2] += kd * rate + acceleration
    return desired


def _swing(
    params: WholeBodyQpParams,
    terms: WholeBodyTerms,
    command: WholeBodyCommand,
) -> Array:
    """Desired acceleration [angular, linear] (6,) of the swing sole."""
    side = command.contacts.index(False)
    p, v, a, (yaw, rate, acceleration) = command.swing.reshape(4, 3)
    motion = terms.Jv[SOLES[side]]
    desired = np.empty(6)
    kp = params.swing_orientation_gain
    kd = 2.0 * params.damping_ratio * math.sqrt(kp)
    desired[:3] = kp * rotation_error(yaw, terms.rotations[side])
    desired[:3] -= kd * motion[:3]
    desired[2] += kd * rate + acceleration
    kp = params.swing_position_gain
    kd = 2.0 * params.damping_ratio * math.sqrt(kp)
    desired[3:] = a + kp * (p - terms.sole_positions[side])
    desired[3:] += kd * (v - motion[3:])
    return desired


def rotation_error(yaw: float, R: Array) -> Array:
    """Rotation vector (3,) in W from R (3, 3) to upright at `yaw` [rad].

    Its length is the sine of the angle, right to third order: half the
    antisymmetric part of R_upright R'.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, _) = R.tolist()
    return 0.5 * np.array(
        (
            yz - s * zx - c * zy,
            c * zx - s * zy - xz,
            s * (xx + yy) + c * (xy - yx),
        )
    )
