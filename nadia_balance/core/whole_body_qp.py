"""Whole-body inverse dynamics as one quadratic program."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.qp_programs import Mask
from nadia_balance.core.qp_solver import DenseQp, QpResult
from nadia_balance.core.whole_body_limits import WholeBodyLimits
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_tasks import stack_tasks, task_weights
from nadia_balance.core.whole_body_terms import (
    SOLES,
    WholeBodyCommand,
    WholeBodyModel,
    WholeBodyTerms,
)

Array = NDArray[np.float64]

_NUM_EQUALITIES = 18


@dataclass(frozen=True)
class WholeBodySolution:
    """Accelerations, contact wrenches and torques that belong together.

    `vdot` (nv,); `wrenches` (12,) = [tau, f] of the left and the right sole
    at its centre, in W [N m], [N]; `torques` (nj,) [N m].  All are NaN unless
    `qp.solved`.
    """

    vdot: Array
    wrenches: Array
    torques: Array
    qp: QpResult


class WholeBodyQp:
    """Finds joint torques for soft tasks under hard physical limits.

    Variables [vdot (nv), w_left (6), w_right (6)]; inside, all forces,
    torques and M are per unit of the robot's mass.  Minimises the weighted
    squares of the errors of the tasks and of the posture, and of the sole
    wrenches, subject to

    * M vdot + bias = sum J' w in the six rows of the floating base,
    * J vdot + Jdot v = a of a sole that carries, w = 0 of one that does not,
    * the limits of contact wrenches, torques and joints.

    Nadia paper, Sec. III; in the form of Herzog et al., Momentum control with
    hierarchical inverse dynamics on a torque-controlled humanoid, Autonomous
    Robots 40 (2016), with weights for the hierarchy.
    """

    def __init__(self, params: WholeBodyQpParams, model: WholeBodyModel):
        """Builds the program; raises ValueError for parameters out of range."""
        params.validate()
        self._params, self._model = params, model
        self._limits = WholeBodyLimits(params, model)
        self._num_variables = 6 + model.num_joints + 12
        self._qp = DenseQp(
            self._num_variables,
            _NUM_EQUALITIES,
            self._limits.num_rows,
            params.solver,
        )
        self._task_weights = task_weights(params)
        vdot = np.full(6 + model.num_joints, params.acceleration_weight)
        self._posture_weights = np.where(
            model.is_leg_joint,
            params.leg_posture_weight,
            params.posture_weight,
        )
        vdot[6:] += self._posture_weights
        wrench = np.full(6, params.moment_weight)
        wrench[3:5] = params.tangential_weight
        wrench[5] = params.normal_weight
        self._diagonal = np.diag(np.concatenate((vdot, wrench, wrench)))

    @property
    def num_inequalities(self) -> int:
        """Length of the active-set mask."""
        return self._limits.num_rows

    def solve(
        self,
        terms: WholeBodyTerms,
        command: WholeBodyCommand,
        active_guess: Mask | None = None,
    ) -> WholeBodySolution:
        """Solves the QP; `active_guess` is `qp.active` of the last tick.

        Raises:
            ValueError: NaN or infinity in `terms` or `command`.
        """
        nv, mass = terms.v.size, self._model.mass
        limits = self._limits.rows(terms, command)
        qp = self._qp.solve(
            *self._cost(terms, command),
            *self._equalities(terms, command),
            *limits,
            active_guess,
        )
        torque_rows = limits[0][self._limits.torque_rows]
        torques = mass * (torque_rows @ qp.x) + terms.bias[6:]
        return WholeBodySolution(qp.x[:nv], mass * qp.x[nv:], torques, qp)

    def _cost(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> tuple[Array, Array]:
        """Returns H and g of all that is soft."""
        params, nv = self._params, terms.v.size
        S, s = stack_tasks(params, self._model, terms, command)
        weights = self._task_weights[: s.size]
        S *= weights[:, None]
        H = self._diagonal.copy()
        H[:nv, :nv] += S.T @ S
        g = np.zeros(self._num_variables)
        g[:nv] = -((s * weights) @ S)
        kp = params.posture_gain
        kd = 2.0 * params.damping_ratio * math.sqrt(kp)
        error = self._model.posture - terms.positions
        g[6:nv] -= self._posture_weights * (kp * error - kd * terms.v[6:])
        return H, g

    def _equalities(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> tuple[Array, Array]:
        """Returns A_eq and b_eq of the floating base and of the soles."""
        nv, mass = terms.v.size, self._model.mass
        A = np.zeros((_NUM_EQUALITIES, self._num_variables))
        b = np.zeros(_NUM_EQUALITIES)
        A[:6, :nv] = terms.M[:6] / mass
        A[:6, nv:] = -terms.J[:12, :6].T
        b[:6] = terms.bias[:6] / -mass
        for side, sole in enumerate(SOLES):
            rows = slice(6 + sole.start, 6 + sole.stop)
            if command.contacts[side]:
                A[rows, :nv] = terms.J[sole]
                b[rows] = self._hold(terms, side) - terms.Jdot_v[sole]
            else:
                A[rows, nv + sole.start : nv + sole.stop] = np.eye(6)
        return A, b

    def _hold(self, terms: WholeBodyTerms, side: int) -> Array:
        """Acceleration (6,) that brings a carrying sole to rest, and level."""
        hold = -self._params.stance_damping * terms.Jv[SOLES[side]]
        normal = terms.rotations[side][:, 2]
        hold[0] += self._params.stance_tilt_gain * normal[1]
        hold[1] -= self._params.stance_tilt_gain * normal[0]
        return np.asarray(hold)
