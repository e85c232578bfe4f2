"""Hard limits of the whole-body QP: contact wrenches, torques, joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.contact_wrench_cone import (
    NUM_CONE_ROWS,
    contact_wrench_cone,
)
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_terms import (
    WholeBodyCommand,
    WholeBodyModel,
    WholeBodyTerms,
)

Array = NDArray[np.float64]

_FOOT_ROWS = NUM_CONE_ROWS + 1  # the cone and the size of the normal force


class WholeBodyLimits:
    """Rows lower <= C [vdot, w_left, w_right] <= upper.

    Wrenches w = [tau, f] and torques are per unit of the robot's mass.  In
    this order: the cone and the normal force of the left and of the right
    sole, torques, joint accelerations.
    """

    def __init__(self, params: WholeBodyQpParams, model: WholeBodyModel):
        """The limits of `model`, as tightened by `params`."""
        self._params, self._model = params, model
        n = model.num_joints
        self.torque_rows = slice(2 * _FOOT_ROWS, 2 * _FOOT_ROWS + n)
        self.num_rows = 2 * _FOOT_ROWS + 2 * n
        margin = 2.0 * params.sole_margin
        self._cone = np.zeros((_FOOT_ROWS, 6))
        self._cone[:NUM_CONE_ROWS] = contact_wrench_cone(
            model.sole_length - margin,
            model.sole_width - margin,
            params.friction,
        )
        self._cone[-1, 5] = 1.0
        self._max_torque = params.max_effort_ratio * model.max_torque
        self._positions = np.stack((model.position_lower, model.position_upper))
        self._constant = np.zeros((self.num_rows, 6 + n + 12))
        self._constant[self.torque_rows.stop :, 6 : 6 + n] = np.eye(n)

    def rows(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> tuple[Array, Array, Array]:
        """Returns C (m, nv + 12), lower and upper (m,)."""
        nv, mass = terms.v.size, self._model.mass
        C = self._constant.copy()
        lower = np.full(self.num_rows, -np.inf)
        upper = np.full(self.num_rows, np.inf)
        for side, carries in enumerate(command.contacts):
            if carries:
                self._limit_wrench(terms, command, side, C, lower, upper)
        torque = self.torque_rows
        C[torque, :nv] = terms.M[6:] / mass
        C[torque, nv:] = -terms.J[:12, 6:].T
        lower[torque] = (-self._max_torque - terms.bias[6:]) / mass
        upper[torque] = (self._max_torque - terms.bias[6:]) / mass
        lower[torque.stop :], upper[torque.stop :] = self._braking(terms)
        return C, lower, upper

    def _limit_wrench(
        self,
        terms: WholeBodyTerms,
        command: WholeBodyCommand,
        side: int,
        C: Array,
        lower: Array,
        upper: Array,
    ) -> None:
        rows = slice(side * _FOOT_ROWS, (side + 1) * _FOOT_ROWS)
        start, R_FW = terms.v.size + 6 * side, terms.rotations[side].T
        C[rows, start : start + 3] = self._cone[:, :3] @ R_FW
        C[rows, start + 3 : start + 6] = self._cone[:, 3:] @ R_FW
        upper[rows] = 0.0
        least, most = self._params.min_normal_force, command.max_normal_forces
        lower[rows.stop - 1] = least / self._model.mass
        upper[rows.stop - 1] = max(most[side], least) / self._model.mass

    def _braking(self, terms: WholeBodyTerms) -> tuple[Array, Array]:
        """Bounds (nj,) of joint accelerations that keep position limits.

        Each q + T v + T^2/2 vdot stays within the limits for a horizon T,
        unless that takes more than the acceleration allowed for it.
        """
        horizon, most = (
            self._params.joint_limit_horizon,
            self._params.max_joint_acceleration,
        )
        ahead = terms.positions + horizon * terms.v[6:]
        bounds = (self._positions - ahead) * (2.0 / horizon**2)
        lower, upper = np.minimum(np.maximum(bounds, -most), most)
        return lower, upper
