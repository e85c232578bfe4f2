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
_SIGNS = np.array([[-1.0], [1.0]])


class WholeBodyLimits:
    """Rows lower <= C [vdot, wrenches] <= upper.

    Wrenches [tau, f] and torques are per unit of the robot's mass; there are
    wrenches of those soles only that carry.  In this order: torques, joint
    accelerations, the cone and the normal force of the left and of the right
    sole.
    """

    def __init__(self, params: WholeBodyQpParams, model: WholeBodyModel):
        """The limits of `model`, as tightened by `params`.

        Raises:
            ValueError: the margin leaves nothing of the sole.
        """
        self._params, self._mass = params, model.mass
        n = model.num_joints
        self.torque_rows, self._joint_rows = slice(0, n), slice(n, 2 * n)
        self._joints = np.eye(n)
        margin = 2.0 * params.sole_margin
        sides = model.sole_length - margin, model.sole_width - margin
        if min(sides) <= 0.0:
            raise ValueError(
                f"sole_margin = {params.sole_margin}: must leave some of the "
                "sole"
            )
        cone = np.zeros((_FOOT_ROWS, 6))
        cone[:NUM_CONE_ROWS] = contact_wrench_cone(*sides, params.friction)
        cone[-1, 5] = 1.0
        self._cone = cone.reshape(-1, 3)  # tau and f in turn, to rotate both
        # The first axis of all bounds is lower, upper.
        self._wrench = np.zeros((2, _FOOT_ROWS))
        self._wrench[0, :-1] = -np.inf
        self._wrench[:, -1] = params.min_normal_force / model.mass
        self._torques = (
            params.max_effort_ratio / model.mass * model.max_torque * _SIGNS
        )
        self._positions = np.stack((model.position_lower, model.position_upper))

    def num_rows(self, num_soles: int) -> int:
        """Returns how many rows there are if so many soles carry."""
        return self._joint_rows.stop + num_soles * _FOOT_ROWS

    def rows_of(self, contacts: tuple[bool, bool]) -> NDArray[np.bool_]:
        """Marks those of all rows that there are with these `contacts`."""
        marks = np.ones(self.num_rows(2), dtype=bool)
        for carries, rows in zip(
            contacts, marks[self._joint_rows.stop :].reshape(2, -1), strict=True
        ):
            rows[:] = carries
        return marks

    def bounds(
        self, terms: WholeBodyTerms, command: WholeBodyCommand, C: Array
    ) -> tuple[Array, Array]:
        """Returns lower and upper (m,), and completes the rows `C` (m, n).

        Those of the torques, M vdot - sum J' w, are there already; all others
        are zero.
        """
        bounds = np.empty((2, len(C)))
        bounds[:, self.torque_rows] = self._torques - terms.forces[6:, -1]
        bounds[:, self._joint_rows] = self._braking(terms)
        nv = terms.v.size
        C[self._joint_rows, 6:nv] = self._joints
        row, column = self._joint_rows.stop, nv
        for side, carries in enumerate(command.contacts):
            if carries:
                rows = slice(row, row + _FOOT_ROWS)
                C[rows, column : column + 6] = self._rotated_cone(terms, side)
                bounds[:, rows] = self._wrench
                most = command.max_normal_forces[side] / self._mass
                bounds[1, rows.stop - 1] = max(most, self._wrench[0, -1])
                row, column = rows.stop, column + 6
        return bounds[0], bounds[1]

    def stop_braking(self, lower: Array, upper: Array) -> None:
        """Widens `lower` and `upper` (m,) in place: no joint brakes early."""
        most = self._params.max_joint_acceleration
        lower[self._joint_rows], upper[self._joint_rows] = -most, most

    def _rotated_cone(self, terms: WholeBodyTerms, side: int) -> Array:
        """Rows (_FOOT_ROWS, 6) for the wrench of a sole, which is in W."""
        R_FW = terms.rotations[side].T
        return np.asarray((self._cone @ R_FW).reshape(_FOOT_ROWS, 6))

    def _braking(self, terms: WholeBodyTerms) -> Array:
        """Bounds (2, nj) of joint accelerations that keep position limits.

        Each q + T v + T^2/2 vdot stays within the limits for a horizon T,
        unless that takes more than the acceleration allowed for it.
        """
        horizon, most = (
            self._params.joint_limit_horizon,
            self._params.max_joint_acceleration,
        )
        ahead = terms.positions + horizon * terms.v[6:]
        bounds = (self._positions - ahead) * (2.0 / horizon**2)
        return np.asarray(np.minimum(np.maximum(bounds, -most), most))
