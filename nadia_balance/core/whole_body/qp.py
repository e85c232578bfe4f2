"""Whole-body inverse dynamics as a single quadratic program."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.qp import DenseQp, QpProblem, QpResult
from nadia_balance.core.whole_body.command import (
    BASE,
    SOLES,
    WholeBodyCommand,
    WholeBodyModel,
    WholeBodyTerms,
)
from nadia_balance.core.whole_body.limits import TILT_COSTS, WholeBodyLimits
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.tasks import Task, WeightedTasks, usual_tasks

# Rows of J of the soles in contact, by (left, right).
_CARRYING: dict[tuple[bool, ...], slice] = {
    (True, True): slice(0, 12),
    (True, False): SOLES[0],
    (False, True): SOLES[1],
}


class WholeBodySolution(NamedTuple):
    """Consistent accelerations, wrenches, torques; NaN unless `qp.solved`.

    Args:
        vdot: accelerations (nv,).
        wrenches: [tau, f] of each sole at its centre (12,) in W, 0 in the air
            [N m, N].
        torques: of the joints (nj,) [N m].
        qp: result of the QP.
    """

    vdot: Array
    wrenches: Array
    torques: Array
    qp: QpResult


class WholeBodyQp:
    """Whole-body QP: joint torques for soft tasks under hard physical limits.

    Nadia paper, Sec. III, in the form of Herzog et al., Momentum control with
    hierarchical inverse dynamics on a torque-controlled humanoid, Autonomous
    Robots 40 (2016), with weights instead of the hierarchy.  Minimises the
    weighted squares of task errors, posture error and sole wrenches over
    [vdot (nv), w_left (6), w_right (6), s (2)], without the wrench of a sole in
    the air, subject to

    * J vdot + Jdot v = a of each sole in contact, or of its edge, if it rolls,
    * M vdot + bias = sum J' w in the six rows of the floating base,
    * limits on contact wrenches, torques, joints, the trunk's tilt and the
      distances of near links; the last part of the tilt, s, costs, as a limit
      at which it ends would outvote the forces of balance; if the QP is
      infeasible, the limits of joints, tilt, torque rates and distances become
      soft.

    Internally, forces, torques and M are per unit of the robot's mass.

    Args:
        params: weights, gains and limits.
        model: constants of the robot.
        period: of a tick [s].
        tasks: added to those of momentum, trunk and swing foot.

    Raises:
        ValueError: a task's weight < 0, or a margin that leaves no sole.
    """

    def __init__(
        self,
        params: WholeBodyQpParams,
        model: WholeBodyModel,
        period: float,
        tasks: Iterable[Task] = (),
    ) -> None:
        self._params, self._model = params, model
        self._tasks = WeightedTasks([*usual_tasks(params, model), *tasks])
        self._limits = WholeBodyLimits(params, model, period)
        nv = 6 + model.num_joints
        # By the number of variables: with one or two soles in contact; relaxed,
        # with slacks of the torque rate and the distances, or without.
        soft = model.num_joints
        self._qps = {
            hard + slacks: DenseQp(hard + slacks)
            for hard in (nv + 6 + len(TILT_COSTS), nv + 12 + len(TILT_COSTS))
            for slacks in (0, soft, soft + 1, soft + 2)
        }
        # The posture's PD law, and the constant costs of vdot and wrenches.
        weights = np.where(
            model.is_leg_joint, params.leg_posture_weight, params.posture_weight
        )
        kd = 2.0 * params.damping_ratio * math.sqrt(params.posture_gain)
        self._posture_kp = weights * params.posture_gain
        self._posture_kd = weights * kd
        vdot = np.concatenate((np.zeros(6), weights))
        vdot += params.acceleration_weight
        wrench = np.repeat(  # [tau, f] of a sole
            [
                params.moment_weight,
                params.tangential_weight,
                params.normal_weight,
            ],
            (3, 2, 1),
        )
        # H, rows and bounds by the number of soles in contact.
        self._constants = {
            n: (
                np.diag(np.concatenate((vdot, np.tile(wrench, n), TILT_COSTS))),
                *self._limits.constants(n),
            )
            for n in (1, 2)
        }

    def solve(
        self,
        terms: WholeBodyTerms,
        command: WholeBodyCommand,
        last_torques: Array | None = None,
    ) -> WholeBodySolution:
        """Solves the QP of a tick, relaxed if it is infeasible.

        Args:
            terms: kinematics and dynamics.
            command: desired values.
            last_torques: torques of the last tick (nj,), if their rate is
                limited [N m].

        Returns:
            The solution.

        Raises:
            ValueError: NaN or infinity in `terms` or `command`.
        """
        problem = self.problem(terms, command, last_torques)
        num_variables = problem.g.size
        qp = self._qps[num_variables].solve(problem, is_tentative=True)
        first = 6 * sum(command.contacts) + 6  # row of the limits
        if not qp.solved:
            # At the touchdown of a long step, contact, torque and friction
            # limits may make joint braking and torque rates infeasible.
            relaxed = self._limits.relaxed(
                problem, first, terms=terms, last_torques=last_torques
            )
            again = self._qps[relaxed.g.size].solve(relaxed)
            qp = again._replace(
                solves=qp.solves + again.solves,
                fallback=qp.fallback or again.fallback,
            )
        nv, mass = terms.v.size, self._model.mass
        x = qp.x[:num_variables]
        torques = (
            problem.A[first:][self._limits.torque_rows] @ x
            + terms.forces[6:, -1]
        )
        wrenches = np.zeros(12)
        wrenches[_CARRYING[command.contacts]] = mass * x[nv : -len(TILT_COSTS)]
        return WholeBodySolution(
            vdot=x[:nv], wrenches=wrenches, torques=mass * torques, qp=qp
        )

    def damping_torques(
        self, terms: WholeBodyTerms, last: Array | None = None
    ) -> Array:
        """The damping torques of a tick without a solution.

            torques = -failure_damping M v, within the limits,

        where M is the joints' block of the mass matrix; the damping is low
        enough for drives with a lag.

        Args:
            terms: kinematics and dynamics.
            last: torques of the last tick (nj,), at which the rate limit
                starts, so that the load is not dropped [N m].

        Returns:
            The torques (nj,) [N m].
        """
        M, v = terms.forces[6:, 6:-1], terms.v[6:]
        lower, upper = self._limits.torque_bounds(v, last)
        damping = -self._params.failure_damping * (M @ v)
        return np.asarray(
            self._model.mass * np.minimum(np.maximum(damping, lower), upper)
        )

    def problem(
        self,
        terms: WholeBodyTerms,
        command: WholeBodyCommand,
        last_torques: Array | None = None,
    ) -> QpProblem:
        """The matrices and bounds of the QP of a tick.

            minimise 1/2 x'Hx + g'x subject to lower <= A x <= upper,

        x = [vdot, wrenches, s].  Rows: accelerations of the soles in contact
        (or of their edges), motion of the base, limits.

        Args:
            terms: kinematics and dynamics.
            command: desired values.
            last_torques: torques of the last tick (nj,), if their rate is
                limited [N m].

        Returns:
            The problem.
        """
        nv, num_soles = terms.v.size, sum(command.contacts)
        H, rows, bounds = self._constants[num_soles]
        near = len(terms.avoidance.limits) if terms.avoidance else 0
        if near:
            rows = np.concatenate((rows, np.zeros((near, len(H)))))
            bounds = np.concatenate((bounds, np.zeros((2, near))), axis=1)
        else:
            rows, bounds = rows.copy(), bounds.copy()
        contacts = 6 * num_soles  # number of rows
        J = terms.rows[_CARRYING[command.contacts], :nv]
        rows[:contacts, :nv] = J
        # Equations of motion: rows of the base, followed by the torque rows.
        motion = rows[contacts : contacts + nv]
        motion[:, :nv] = terms.forces[:, :nv]
        np.negative(J.T, out=motion[:, nv : nv + contacts])
        b = self._right_sides(terms, command)
        first = contacts + 6  # row of the limits
        self._limits.fill(
            C=rows[first:],
            bounds=bounds[:, first:],
            terms=terms,
            command=command,
            last_torques=last_torques,
        )
        H, g = self._cost(terms, command, H)
        if num_soles == 2:
            for side, edge in enumerate(command.edges):
                if edge:
                    sole = SOLES[side]
                    rows[sole], b[sole], roll, rest = self._rolling(
                        terms, side, edge=edge, A=rows[sole], b=b[sole]
                    )
                    # To keep the sole flat is a soft task, as in a swing.
                    weight = self._params.swing_orientation_weight
                    H[:nv, :nv] += weight * np.outer(roll, roll)
                    g[:nv] -= weight * rest * roll
        bounds[:, :first] = b
        return QpProblem(H, g, rows, lower=bounds[0], upper=bounds[1])

    def _rolling(
        self, terms: WholeBodyTerms, side: int, edge: float, A: Array, b: Array
    ) -> tuple[Array, Array, Array, float]:
        """Returns the rows of a sole that rolls, in place of A x = b.

        The line at x = `edge` [m] in the sole frame is kept at rest, the sole
        does not rotate about its x and z axes, and the moment about the edge
        is zero.  The results are the new A (6, nv + 14) and b (6,), the row
        (nv,) of the angular acceleration about the edge, and its value that
        keeps the sole flat.
        """
        sole, nv = SOLES[side], terms.v.size
        x, y, z = terms.rotations[side].T
        moved, velocities = terms.at_point(side, edge * x)
        turn, rest = A[:3, :nv], b[:3]
        rows, values = np.zeros(A.shape), np.zeros(6)
        rows[:3, :nv] = moved[3:, :nv]
        values[:3] = (
            -self._params.stance_damping * velocities[3:] - moved[3:, -1]
        )
        axes = np.stack((x, z))
        rows[3:5, :nv], values[3:5] = axes @ turn, axes @ rest
        wrench = rows[5, nv + sole.start : nv + sole.stop]
        # The moment about the axis, y . (tau - p x f).
        wrench[:3], wrench[3:] = y, edge * z
        return rows, values, y @ turn, y @ rest

    def _right_sides(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> Array:
        """Accelerations less biases (6 n + 6,) of soles in contact and base.

        The accelerations damp, align and sink the soles.
        """
        damping = self._params.stance_damping
        biases = terms.rows[: BASE.stop, -1].tolist()
        velocities = terms.velocities[: BASE.start].tolist()
        axes = (
            self._params.stance_tilt_gain * terms.rotations[:2, :, 2]
        ).tolist()
        normals = command.normals.tolist()
        b: list[float] = []
        for side, carries in enumerate(command.contacts):
            if carries:
                wx, wy, wz, vx, vy, vz = velocities[SOLES[side]]
                bwx, bwy, bwz, bx, by, bz = biases[SOLES[side]]
                x, y, z = axes[side]
                nx, ny, nz = normals[side]
                down = damping * command.sinking[side]
                b += (
                    y * nz - z * ny - damping * wx - bwx,
                    z * nx - x * nz - damping * wy - bwy,
                    x * ny - y * nx - damping * wz - bwz,
                    -damping * vx - down * nx - bx,
                    -damping * vy - down * ny - by,
                    -damping * vz - down * nz - bz,
                )
        return np.array(b + [-bias for bias in biases[BASE]])

    def _cost(
        self, terms: WholeBodyTerms, command: WholeBodyCommand, H: Array
    ) -> tuple[Array, Array]:
        """Returns H and g of the cost of all soft tasks, `H` the constant."""
        nv = terms.v.size
        tasks = self._tasks.rows(terms, command)
        square = tasks.T.dot(tasks)
        H, g = H.copy(), np.zeros(len(H))
        H[:nv, :nv] += square[:-1, :-1]
        g[:nv] = square[:-1, -1]
        g[6:nv] += (
            self._posture_kp * (terms.q[7:] - self._model.posture)
            + self._posture_kd * terms.v[6:]
        )
        return H, g
