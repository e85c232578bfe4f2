"""Soft tasks of the whole-body QP: desired accelerations and their rows."""

import math

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.lipm import GRAVITY
from nadia_balance.core.walking import Array, tilt
from nadia_balance.core.whole_body_command import (
    BASE,
    PELVIS,
    SOLES,
    TORSO,
    WholeBodyCommand,
    WholeBodyModel,
    WholeBodyQpParams,
    WholeBodyTerms,
)

# Row indices of the tasks.
_LINEAR = slice(0, 3)
_HORIZONTAL = slice(0, 2)
_ANGULAR = slice(3, 6)
_TORSO = slice(6, 9)
_PELVIS = slice(9, 12)
_SWING_TURN = slice(12, 15)
_SWING_MOVE = slice(15, 18)
_NUM_ROWS = 18

_MOMENT = slice(BASE.start, BASE.start + 3)
_FORCE = slice(BASE.start + 3, BASE.stop)
_NOTHING = (0.0,) * 6  # the momentum has no error, and no desired velocity


class WholeBodyTasks:
    """Rows [S, r] of the soft tasks S vdot + r = 0.

    Order of the rows: linear momentum and angular momentum about the CoM, per
    mass, the orientations of torso and pelvis, and in a swing the pose of the
    swing sole.  Each task is a PD law.
    """

    def __init__(self, params: WholeBodyQpParams, model: WholeBodyModel):
        """Builds the tasks of `model` with weights and gains of `params`."""
        self._params, self._mass = params, model.mass
        # Selection of the tasks from the rows of WholeBodyTerms.
        trunk = np.zeros((_NUM_ROWS, 24 + model.num_joints))
        weights, kp = np.zeros(_NUM_ROWS), np.zeros(_NUM_ROWS)
        p = params
        for task, picked, weight, gain in (
            (_LINEAR, _FORCE, p.momentum_weight, 0.0),
            (_ANGULAR, _MOMENT, p.angular_momentum_weight, 0.0),
            (_TORSO, TORSO, p.torso_weight, p.orientation_gain),
            (_PELVIS, PELVIS, p.pelvis_weight, p.orientation_gain),
        ):
            trunk[task, picked] = np.eye(3)
            weights[task], kp[task] = weight, gain
        weights[_LINEAR.stop - 1] = p.height_weight
        weights[_SWING_TURN] = p.swing_orientation_weight
        weights[_SWING_MOVE] = p.swing_position_weight
        kp[_SWING_TURN] = p.swing_orientation_gain
        kp[_SWING_MOVE] = p.swing_position_gain
        self._weights, self._kp = np.sqrt(weights)[:, None], kp
        self._kd = 2.0 * p.damping_ratio * np.sqrt(kp)
        self._kd[_ANGULAR] = p.angular_momentum_damping
        # Selections without a swing sole, and with the left or right one.
        self._trunk = trunk[: _SWING_TURN.start]
        self._trunk_and_sole = [trunk.copy(), trunk.copy()]
        for selection, sole in zip(self._trunk_and_sole, SOLES, strict=True):
            selection[_SWING_TURN.start :, sole] = np.eye(6)

    def rows(self, terms: WholeBodyTerms, command: WholeBodyCommand) -> Array:
        """Returns [S, r] (n, nv + 1), scaled by the roots of the weights.

        n is 18, or 12 without a swing.
        """
        if all(command.contacts):
            selection = self._trunk.copy()
        else:
            swing = command.contacts.index(False)
            selection = self._trunk_and_sole[swing].copy()
        # The moment about the CoM: minus the lever arm times the force.  The
        # arm is in M, since the base's velocity is expressed in W.
        selection[_ANGULAR, _FORCE] = -terms.rows[_MOMENT, 3:6]
        # The task is the direction of the force, from the eCMP to the CoM, at
        # any magnitude.  With a task for the horizontal force itself, a sinking
        # robot would tilt, and a braking one would jump.
        share = command.momentum_rate[:2] / (self._mass * GRAVITY)
        selection[_HORIZONTAL, _FORCE.stop - 1] -= share
        rows = selection @ terms.rows
        error, velocity, acceleration = self._wanted(terms, command)
        kp, kd = self._kp[: error.size], self._kd[: error.size]
        rows[:, -1] -= (
            acceleration
            + kp * error
            + kd * (velocity - selection @ terms.velocities)
        )
        rows *= self._weights[: error.size]
        return rows

    def braking(self, terms: WholeBodyTerms, far: NDArray[np.bool_]) -> Array:
        """Returns [S, r], as in `rows`, of the early braking of links.

        The mask `far` (k,) selects from the distances of `terms`.
        """
        of, params = terms.distance_rows[far], self._params
        least = params.link_braking(terms.distances[far], of @ terms.v)
        rows = np.concatenate((of, -least[:, None]), axis=1)
        return np.asarray(math.sqrt(params.arm_weight) * rows)

    def _wanted(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> Array:
        """Returns [error, velocity, acceleration] (3, n) of all tasks."""
        z = float(command.momentum_rate[2]) / self._mass
        yaw, rate, acceleration = command.heading
        turn, turn_rate, turn_acceleration = command.turn
        error = [
            *_NOTHING,
            *rotation_error(yaw, terms.rotations[2]),
            *rotation_error(yaw + turn, terms.rotations[3]),
        ]
        velocity = [*_NOTHING, 0.0, 0.0, rate, 0.0, 0.0, rate + turn_rate]
        # The force also carries the weight, which is no rate of momentum.
        wanted = [0.0, 0.0, z + GRAVITY, 0.0, 0.0, 0.0]
        wanted += 0.0, 0.0, acceleration
        wanted += 0.0, 0.0, acceleration + turn_acceleration
        if not all(command.contacts):
            side = command.contacts.index(False)
            p, v, a, foot_yaw = command.swing.reshape(4, 3).tolist()
            px, py, pz = terms.sole_positions[side].tolist()
            R_WT = tilt(command.normals[side])
            R_TF = R_WT.T @ terms.rotations[side]
            error += (R_WT @ rotation_error(foot_yaw[0], R_TF)).tolist()
            error += p[0] - px, p[1] - py, p[2] - pz
            velocity += 0.0, 0.0, foot_yaw[1], *v
            wanted += 0.0, 0.0, foot_yaw[2], *a
        return np.array((error, velocity, wanted))


def rotation_error(yaw: float, R: Array) -> tuple[float, float, float]:
    """Rotation vector in W from R (3, 3) to upright at `yaw` [rad].

    It is the antisymmetric part of R_upright R' as a vector, with the sine of
    the angle as its length: accurate to third order.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, _) = R.tolist()
    return (
        0.5 * (yz - s * zx - c * zy),
        0.5 * (c * zx - s * zy - xz),
        0.5 * (s * (xx + yy) + c * (xy - yx)),
    )
