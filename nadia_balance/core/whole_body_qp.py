"""Whole-body inverse dynamics as one quadratic program."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.qp_programs import Mask, QpProblem
from nadia_balance.core.qp_solver import DenseQp, QpResult
from nadia_balance.core.whole_body_limits import WholeBodyLimits
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_tasks import WholeBodyTasks
from nadia_balance.core.whole_body_terms import (
    BASE,
    LEFT_SOLE,
    RIGHT_SOLE,
    WholeBodyCommand,
    WholeBodyModel,
    WholeBodyTerms,
)

Array = NDArray[np.float64]

# Rows of J of the soles that carry.
_CARRYING = {
    (True, True): slice(0, 12),
    (True, False): LEFT_SOLE,
    (False, True): RIGHT_SOLE,
}


class WholeBodySolution(NamedTuple):
    """Accelerations, contact wrenches and torques that belong together.

    `vdot` (nv,); `wrenches` (12,) = [tau, f] of the left and the right sole
    at its centre, in W [N m], [N], zero if it does not carry; `torques` (nj,)
    [N m].  All others are NaN unless `qp.solved`.
    """

    vdot: Array
    wrenches: Array
    torques: Array
    qp: QpResult


class WholeBodyQp:
    """Finds joint torques for soft tasks under hard physical limits.

    Variables [vdot (nv), w_left (6), w_right (6)], but no wrench of a sole
    that does not carry; inside, all forces, torques and M are per unit of the
    robot's mass.  Minimises the weighted squares of the errors of the tasks
    and of the posture, and of the sole wrenches, subject to

    * J vdot + Jdot v = a of a sole that carries,
    * M vdot + bias = sum J' w in the six rows of the floating base,
    * the limits of contact wrenches, torques and joints; if there is no
      solution, those of the joints are given up.

    Nadia paper, Sec. III; in the form of Herzog et al., Momentum control with
    hierarchical inverse dynamics on a torque-controlled humanoid, Autonomous
    Robots 40 (2016), with weights for the hierarchy.
    """

    def __init__(self, params: WholeBodyQpParams, model: WholeBodyModel):
        """Builds the program; raises ValueError for parameters out of range."""
        params.validate()
        self._params, self._model = params, model
        self._tasks = WholeBodyTasks(params, model)
        self._limits = WholeBodyLimits(params, model)
        nv = 6 + model.num_joints
        self._qps = {
            n: DenseQp(
                nv + 6 * n, 6 + 6 * n, self._limits.num_rows(n), params.solver
            )
            for n in (1, 2)  # soles that carry
        }
        self._rows_of = {c: self._limits.rows_of(c) for c in _CARRYING}
        # The posture's PD law, and the costs that are always the same: those
        # of [vdot, 1], and those of the wrenches.
        weights, kp = _posture_weights(params, model), params.posture_gain
        kd = 2.0 * params.damping_ratio * math.sqrt(kp)
        self._posture_kp, self._posture_kd = weights * kp, weights * kd
        self._vdot_cost = np.diag(
            np.concatenate((np.zeros(6), weights, np.zeros(1)))
            + params.acceleration_weight
        )
        wrench = _wrench_weights(params)
        self._H = np.diag(np.concatenate((np.zeros(nv), wrench, wrench)))

    @property
    def num_inequalities(self) -> int:
        """Length of the active-set mask."""
        return self._limits.num_rows(2)

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
        contacts = command.contacts
        problem, rows = self.problem(terms, command), self._rows_of[contacts]
        guess = None if active_guess is None else active_guess[rows]
        solver = self._qps[sum(contacts)]
        qp = solver.solve(problem, guess)
        if not qp.solved:
            # At the touchdown of a long step, soles, torques and friction may
            # leave no room for braking, which is a wish, not a law.
            self._limits.stop_braking(problem.lower, problem.upper)
            again = solver.solve(problem, guess)
            solves = qp.iterations + again.iterations
            qp = again._replace(iterations=solves, fallback=qp.fallback)
        active = np.zeros(rows.size, dtype=np.int8)
        active[rows] = qp.active
        nv, mass = terms.v.size, self._model.mass
        torques = problem.C[self._limits.torque_rows] @ qp.x
        torques += terms.forces[6:, -1]
        wrenches = np.zeros(12)
        wrenches[_CARRYING[contacts]] = mass * qp.x[nv:]
        return WholeBodySolution(
            qp.x[:nv], wrenches, mass * torques, qp._replace(active=active)
        )

    def problem(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> QpProblem:
        """Returns the QP as plain matrices."""
        nv, soles = terms.v.size, _CARRYING[command.contacts]
        J, n = terms.rows[soles, :nv], sum(command.contacts)
        rows = np.zeros((6 * n + 6 + self._limits.num_rows(n), nv + 6 * n))
        A, C = rows[: 6 * n + 6], rows[6 * n + 6 :]
        rows[: 6 * n, :nv] = J
        # The equations of motion: the base's, and the torques' next to them.
        motion = rows[6 * n : 6 * n + nv]
        motion[:, :nv] = terms.forces[:, :nv]
        motion[:, nv:] = -J.T
        b = -terms.rows[: BASE.stop, -1]
        b[:12] += self._rest(terms)
        b = np.concatenate((b[soles], b[BASE]))
        lower, upper = self._limits.bounds(terms, command, C)
        return QpProblem(*self._cost(terms, command), A, b, C, lower, upper)

    def _rest(self, terms: WholeBodyTerms) -> Array:
        """Accelerations (12,) that bring soles to rest, and level."""
        params = self._params
        rest = -params.stance_damping * terms.velocities[:12]
        tilt = params.stance_tilt_gain * terms.rotations[:2, :2, 2]
        rest[0::6] += tilt[:, 1]
        rest[1::6] -= tilt[:, 0]
        return np.asarray(rest)

    def _cost(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> tuple[Array, Array]:
        """Returns H and g of all that is soft."""
        nv = terms.v.size
        n = nv + 6 * sum(command.contacts)
        tasks = self._tasks.rows(terms, command)
        square = tasks.T @ tasks + self._vdot_cost
        H, g = self._H[:n, :n].copy(), np.zeros(n)
        H[:nv, :nv], g[:nv] = square[:-1, :-1], square[:-1, -1]
        g[6:nv] += self._posture_kp * (terms.positions - self._model.posture)
        g[6:nv] += self._posture_kd * terms.v[6:]
        return H, g


def _posture_weights(params: WholeBodyQpParams, model: WholeBodyModel) -> Array:
    """Returns the weights of the joints' accelerations (nj,)."""
    return np.where(
        model.is_leg_joint, params.leg_posture_weight, params.posture_weight
    )


def _wrench_weights(params: WholeBodyQpParams) -> Array:
    """Returns the weights of [tau, f] of a sole (6,)."""
    weights = np.full(6, params.moment_weight)
    weights[3:5] = params.tangential_weight
    weights[5] = params.normal_weight
    return weights
