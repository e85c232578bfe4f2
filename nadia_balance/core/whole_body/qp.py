"""Whole-body inverse dynamics as a single quadratic program."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.qp import DenseQp, QpProblem, QpResult
from nadia_balance.core.whole_body.command import BASE, SOLES
from nadia_balance.core.whole_body.command import WholeBodyCommand as Command
from nadia_balance.core.whole_body.command import WholeBodyModel as Model
from nadia_balance.core.whole_body.command import WholeBodyTerms as Terms
from nadia_balance.core.whole_body.limits import WholeBodyLimits
from nadia_balance.core.whole_body.params import WholeBodyQpParams as Params
from nadia_balance.core.whole_body.tasks import Task, WeightedTasks, usual_tasks

# Rows of J of the soles in contact, by (left, right).
_CARRYING: dict[tuple[bool, ...], slice] = {
    (True, True): slice(0, 12),
    (True, False): SOLES[0],
    (False, True): SOLES[1],
}


class WholeBodySolution(NamedTuple):
    """Consistent accelerations, wrenches, torques; NaN unless `qp.solved`."""

    vdot: Array  # (nv,)
    # (12,): [tau, f] of each sole at its centre in W [N m], [N]; 0 in the air.
    wrenches: Array
    torques: Array  # (nj,) [N m]
    qp: QpResult


class WholeBodyQp:
    """Whole-body QP: joint torques for soft tasks under hard physical limits.

    Nadia paper, Sec. III, in the form of Herzog et al., Momentum control with
    hierarchical inverse dynamics on a torque-controlled humanoid, Autonomous
    Robots 40 (2016), with weights instead of the hierarchy.  Minimises the
    weighted squares of task errors, posture error and sole wrenches over
    [vdot (nv), w_left (6), w_right (6)], without the wrench of a sole in the
    air, subject to

    * J vdot + Jdot v = a of each sole in contact, or of its edge, if it rolls,
    * M vdot + bias = sum J' w in the six rows of the floating base,
    * limits on contact wrenches, torques, joints, the trunk's tilt and the
      distances of near links; if the QP is infeasible, the limits of joints and
      tilt become soft, then torque rate limits and link distances are dropped.

    Internally, forces, torques and M are per unit of the robot's mass.
    """

    def __init__(
        self,
        params: Params,
        model: Model,
        period: float,
        tasks: Iterable[Task] = (),
    ):
        """Builds the QP for `model`, to be solved every `period` [s].

        `tasks` are added to those of momentum, trunk and swing foot.

        Raises ValueError: a task's weight < 0, or a margin that leaves no sole.
        """
        self._params, self._model = params, model
        self._tasks = WeightedTasks([*usual_tasks(params, model), *tasks])
        self._limits = WholeBodyLimits(params, model, period)
        nv = 6 + model.num_joints
        # By the number of variables, with one or two soles in contact.
        sizes = [nv + 6 * n for n in (1, 2)]
        sizes += [size + self._limits.num_soft for size in sizes]
        self._qps = {size: DenseQp(size) for size in sizes}
        # The posture's PD law, and the constant costs of vdot and wrenches.
        weights = np.where(
            model.is_leg_joint, params.leg_posture_weight, params.posture_weight
        )
        kp = params.posture_gain
        kd = 2.0 * params.damping_ratio * math.sqrt(kp)
        self._posture_kp, self._posture_kd = weights * kp, weights * kd
        vdot = np.concatenate((np.zeros(6), weights))
        vdot += params.acceleration_weight
        wrench = np.full(6, params.moment_weight)  # [tau, f] of a sole
        wrench[3:5] = params.tangential_weight
        wrench[5] = params.normal_weight
        self._H = np.diag(np.concatenate((vdot, wrench, wrench)))

    def solve(
        self, terms: Terms, command: Command, last_torques: Array | None = None
    ) -> WholeBodySolution:
        """Returns the solution of the QP, relaxed if it is infeasible.

        `last_torques` (nj,) [N m], if given, are those of the rate limit.

        Raises ValueError: NaN or infinity in `terms` or `command`.
        """
        contacts = command.contacts
        problem = self.problem(terms, command, last_torques)
        num_variables = problem.g.size
        qp = self._qps[num_variables].solve(problem)
        # At the touchdown of a long step, contact, torque and friction limits
        # may make joint braking and torque rate limits infeasible.  These are
        # not physical and may be relaxed.
        first = 6 * sum(contacts) + 6  # row of the limits
        torque_rows = problem.A[first:][self._limits.torque_rows]
        if not qp.solved:
            for weaker in self._limits.relaxed(
                problem, first, terms, last_torques
            ):
                again = self._qps[weaker.g.size].solve(weaker)
                qp = again._replace(
                    solves=qp.solves + again.solves,
                    fallback=qp.fallback or again.fallback,
                )
                if qp.solved:
                    break
        nv, mass = terms.v.size, self._model.mass
        x = qp.x[:num_variables]
        torques = torque_rows @ x + terms.forces[6:, -1]
        wrenches = np.zeros(12)
        wrenches[_CARRYING[contacts]] = mass * x[nv:]
        return WholeBodySolution(x[:nv], wrenches, mass * torques, qp)

    def damping_torques(self, terms: Terms, last: Array | None = None) -> Array:
        """Returns the damping torques -d M v (nj,) [N m], within limits.

        M is the joints' block of the mass matrix; d is low enough for drives
        with a lag.  The torque rate limit starts at the `last` torques, so that
        a single tick without a solution does not drop the load.
        """
        M, v = terms.forces[6:, 6:-1], terms.v[6:]
        lower, upper = self._limits.torque_bounds(v, last)
        wanted = -self._params.failure_damping * (M @ v)
        torques = np.minimum(np.maximum(wanted, lower), upper)
        return np.asarray(self._model.mass * torques)

    def problem(
        self, terms: Terms, command: Command, last_torques: Array | None = None
    ) -> QpProblem:
        """Returns the matrices and bounds of the QP."""
        nv, soles = terms.v.size, _CARRYING[command.contacts]
        J, n = terms.rows[soles, :nv], sum(command.contacts)
        num_rows = self._limits.num_rows(n, terms)
        rows = np.zeros((6 * n + 6 + num_rows, nv + 6 * n))
        bounds = np.empty((2, len(rows)))
        A, C = rows[: 6 * n + 6], rows[6 * n + 6 :]
        A[: 6 * n, :nv] = J
        # Equations of motion: rows of the base, followed by the torque rows.
        motion = rows[6 * n : 6 * n + nv]
        motion[:, :nv] = terms.forces[:, :nv]
        motion[:, nv:] = -J.T
        b = -terms.rows[: BASE.stop, -1]
        b[:12] += self._rest(terms, command)
        b = np.concatenate((b[soles], b[BASE]))
        limits = bounds[:, len(A) :]
        self._limits.fill(C, limits, terms, command, last_torques)
        H, g = self._cost(terms, command)
        if all(command.contacts):
            for side, edge in enumerate(command.edges):
                if edge:
                    self._let_roll(terms, side, edge, A, b, H, g)
        bounds[:, : len(A)] = b
        return QpProblem(H, g, rows, *bounds)

    def _let_roll(
        self,
        terms: Terms,
        side: int,
        edge: float,
        A: Array,
        b: Array,
        H: Array,
        g: Array,
    ) -> None:
        """Changes the rows of A x = b of a sole to rolling about its edge.

        The line at x = `edge` [m] in the sole frame is kept at rest, the sole
        does not rotate about its x and z axes, and the moment about the edge
        is zero.  Keeping the sole flat is a soft task in H and g instead, with
        the weight of a swing foot.
        """
        sole, nv = SOLES[side], terms.v.size
        x, y, z = terms.rotations[side].T
        moved, velocities = terms.at_point(side, edge * x)
        turn, rest = A[sole, :nv][:3], b[sole][:3].copy()
        rows, values = np.zeros((6, A.shape[1])), np.zeros(6)
        rows[:3, :nv] = moved[3:, :nv]
        values[:3] = -self._params.stance_damping * velocities[3:]
        values[:3] -= moved[3:, -1]
        axes = np.stack((x, z))
        rows[3:5, :nv], values[3:5] = axes @ turn, axes @ rest
        roll, weight = y @ turn, self._params.swing_orientation_weight
        H[:nv, :nv] += weight * np.outer(roll, roll)
        g[:nv] -= weight * (y @ rest) * roll
        wrench = rows[5, nv + sole.start : nv + sole.stop]
        # The moment about the axis, y . (tau - p x f).
        wrench[:3], wrench[3:] = y, edge * z
        A[sole], b[sole] = rows, values

    def _rest(self, terms: Terms, command: Command) -> Array:
        """Accelerations (12,) that damp, align and sink the soles."""
        params = self._params
        rest = -params.stance_damping * terms.velocities[:12]
        x, y, z = params.stance_tilt_gain * terms.rotations[:2, :, 2].T
        nx, ny, nz = command.normals.T
        for side, speed in enumerate(command.sinking):
            if speed:
                down = params.stance_damping * speed * command.normals[side]
                rest[SOLES[side]][3:] -= down
        rest[0::6] += y * nz - z * ny
        rest[1::6] -= x * nz - z * nx
        rest[2::6] += x * ny - y * nx
        return np.asarray(rest)

    def _cost(self, terms: Terms, command: Command) -> tuple[Array, Array]:
        """Returns H and g of the cost of all soft tasks."""
        nv = terms.v.size
        n = nv + 6 * sum(command.contacts)
        tasks = self._tasks.rows(terms, command)
        square = tasks.T @ tasks
        H, g = self._H[:n, :n].copy(), np.zeros(n)
        H[:nv, :nv] += square[:-1, :-1]
        g[:nv] = square[:-1, -1]
        g[6:nv] += (
            self._posture_kp * (terms.q[7:] - self._model.posture)
            + self._posture_kd * terms.v[6:]
        )
        return H, g
