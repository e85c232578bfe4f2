"""Whole-body inverse dynamics as a single quadratic program."""

import itertools
import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from nadia_balance.core.joint_drives import torque_limits
from nadia_balance.core.qp import DenseQp, QpProblem, QpResult
from nadia_balance.core.walking import Array
from nadia_balance.core.whole_body_command import (
    BASE,
    LEFT_SOLE,
    RIGHT_SOLE,
    SOLES,
    WholeBodyCommand,
    WholeBodyModel,
    WholeBodyTerms,
)
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.core.whole_body_tasks import (
    MomentumTask,
    SwingFootTask,
    Task,
    TrunkTask,
)

NUM_CONE_ROWS = 16


def contact_wrench_cone(length: float, width: float, friction: float) -> Array:
    """Returns U (16, 6) of the cone U [tau, f] <= 0, at the sole's centre.

    tau (3,) [N m] and f (3,) [N] act on the sole, in the sole frame: z up, x
    along `length` [m].  The cone is exact for four corners with a friction
    pyramid |f_x|, |f_y| <= friction * f_z each.  Rows: 4 friction, 4 centre
    of pressure, 8 yaw moment (Caron, Pham, Nakamura, Stability of surface
    contacts for humanoid robots, ICRA 2015, Eqs. 15-19).

    Raises:
        ValueError: an argument is not positive.
    """
    for name, value in (
        ("length", length),
        ("width", width),
        ("friction", friction),
    ):
        if not value > 0.0:
            raise ValueError(f"{name} = {value}: must be > 0")
    x, y, mu = 0.5 * length, 0.5 * width, friction
    signs = list(itertools.product((1.0, -1.0), repeat=2))
    force = [[0, 0, 0, s, 0, -mu] for s in (1.0, -1.0)]
    force += [[0, 0, 0, 0, s, -mu] for s in (1.0, -1.0)]
    pressure = [[s, 0, 0, 0, 0, -y] for s in (1.0, -1.0)]
    pressure += [[0, s, 0, 0, 0, -x] for s in (1.0, -1.0)]
    # tau_z <= mu (x + y) f_z - |y f_x + mu tau_x| - |x f_y + mu tau_y|, and
    # -tau_z <= mu (x + y) f_z - |y f_x - mu tau_x| - |x f_y - mu tau_y|.
    yaw = [
        [s * a * mu, s * b * mu, s, a * y, b * x, -mu * (x + y)]
        for s in (1.0, -1.0)
        for a, b in signs
    ]
    return np.array(force + pressure + yaw)


_FOOT_ROWS = NUM_CONE_ROWS + 1  # the cone and the size of the normal force
_HASTE = (2.0, 4.0, math.inf)  # relaxation of the torque rate limit, in order
_SIGNS = np.array([[-1.0], [1.0]])


class WholeBodyLimits:
    """Inequality rows lower <= C [vdot, wrenches] <= upper of the QP.

    Wrenches [tau, f] and torques are per unit of the robot's mass; only soles
    in contact have wrenches.  Order of the rows: torques, joint accelerations,
    the cone and the normal force of the left and of the right sole, avoidance
    of self-collisions.
    """

    def __init__(
        self, params: WholeBodyQpParams, model: WholeBodyModel, period: float
    ):
        """Builds the limits of `model` and `params` for ticks of `period` [s].

        Raises:
            ValueError: the margin leaves no area of the sole.
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
        self._sides = sides
        self._usual_cone = self._cone(params.friction)
        # The first axis of all bounds is (lower, upper).
        self._least_force = params.min_normal_force / model.mass
        self._wrench = np.zeros((2, _FOOT_ROWS))
        self._wrench[0] = -np.inf
        self._wrench[0, -1] = self._least_force
        self._torques: Array = (
            params.max_effort_ratio / model.mass * model.max_torque * _SIGNS
        )
        self._positions = np.stack((model.position_lower, model.position_upper))
        self._max_speed, self._drives = model.max_speed, model.drives
        self._speeds = params.max_speed_ratio * model.max_speed * _SIGNS
        if model.drives is not None:
            ticks = model.drives.max_torque_rate * period
            self._torque_steps = ticks * self._torques

    def num_rows(self, num_soles: int, terms: WholeBodyTerms) -> int:
        """Returns the number of rows with `num_soles` in contact."""
        rows = self._joint_rows.stop + num_soles * _FOOT_ROWS
        return rows + (len(terms.avoidance.limits) if terms.avoidance else 0)

    def fill(
        self,
        C: Array,
        bounds: Array,
        terms: WholeBodyTerms,
        command: WholeBodyCommand,
        last_torques: Array | None = None,
    ) -> None:
        """Writes lower and upper `bounds` (2, m), and completes `C` (m, n).

        On entry, `C` holds the torque rows, M vdot - sum J' w, and zeros.
        """
        torques = self.torque_bounds(terms.v[6:], last_torques)
        bounds[:, self.torque_rows] = torques - terms.forces[6:, -1]
        bounds[:, self._joint_rows] = self._braking(terms)
        nv = terms.v.size
        C[self._joint_rows, 6:nv] = self._joints
        cone = self._usual_cone
        if command.friction != self._params.friction:
            cone = self._cone(command.friction)
        row, column = self._joint_rows.stop, nv
        for side, carries in enumerate(command.contacts):
            if carries:
                rows = slice(row, row + _FOOT_ROWS)
                R_FW = terms.rotations[side].T
                C[rows, column : column + 6] = (cone @ R_FW).reshape(-1, 6)
                bounds[:, rows] = self._wrench
                most = command.max_normal_forces[side] / self._mass
                bounds[1, rows.stop - 1] = max(most, self._least_force)
                row, column = rows.stop, column + 6
        if row < len(C) and terms.avoidance:
            limits = terms.avoidance.limits
            C[row:, :nv] = limits[:, :-1]
            bounds[0, row:], bounds[1, row:] = -limits[:, -1], np.inf

    def torque_bounds(
        self, speed: Array, last: Array | None, haste: float = 1.0
    ) -> Array:
        """Least and largest torques (2, nj), per unit of the robot's mass.

        The bounds hold for the joints' `speed` (nj,) [rad/s] and limit the
        change from the `last` torques (nj,) [N m], if given, to the torque rate
        limit times `haste` ticks.
        """
        if self._drives is None:
            return self._torques
        lower, upper = bounds = torque_limits(
            speed, self._torques[1], self._max_speed, self._drives.corner_speed
        )
        if last is None or math.isinf(haste):
            return bounds
        # The speed-dependent limit overrides the rate limit.
        near = np.minimum(np.maximum(last / self._mass, lower), upper)
        near = near + haste * self._torque_steps
        return np.asarray(np.minimum(np.maximum(near, lower), upper))

    def freed(
        self,
        terms: WholeBodyTerms,
        last_torques: Array | None,
        lower: Array,
        upper: Array,
    ) -> Iterator[None]:
        """Relaxes `lower` and `upper` (m,) in place, one step per iteration.

        Order: joint limits, torque rate limits by the factors _HASTE, link
        distances.
        """
        most = self._params.max_joint_acceleration
        lower[self._joint_rows], upper[self._joint_rows] = -most, most
        yield
        for haste in _HASTE if last_torques is not None else (math.inf,):
            torques = self.torque_bounds(terms.v[6:], last_torques, haste)
            torques = torques - terms.forces[6:, -1]
            lower[self.torque_rows], upper[self.torque_rows] = torques
            yield
        if terms.avoidance and (near := len(terms.avoidance.limits)):
            lower[-near:] = -np.inf
            yield

    def _cone(self, friction: float) -> Array:
        """Returns the rows of the wrench cone and normal force of a sole.

        Shape (2 * _FOOT_ROWS, 3) in the sole frame: rows for tau and f
        alternate, so that one product rotates both.
        """
        cone = np.zeros((_FOOT_ROWS, 6))
        cone[:NUM_CONE_ROWS] = contact_wrench_cone(*self._sides, friction)
        cone[-1, 5] = 1.0
        return cone.reshape(-1, 3)

    def _braking(self, terms: WholeBodyTerms) -> Array:
        """Bounds (2, nj) [rad/s^2] on vdot from position and speed limits.

        q + T v + T^2/2 vdot stays within the position limits for a horizon T,
        v + T vdot within the speed limits for a shorter one; the bounds are
        clipped to `max_joint_acceleration`.
        """
        horizon, most = (
            self._params.joint_limit_horizon,
            self._params.max_joint_acceleration,
        )
        ahead = terms.q[7:] + horizon * terms.v[6:]
        bounds = (self._positions - ahead) * (2.0 / horizon**2)
        room = self._speeds - terms.v[6:]
        room /= self._params.speed_limit_horizon
        bounds[0] = np.maximum(bounds[0], room[0])
        bounds[1] = np.minimum(bounds[1], room[1])
        return np.asarray(np.minimum(np.maximum(bounds, -most), most))


def _root(task: Task) -> Array:
    """Returns the root of a task's weight, (1, 1) or (n, 1)."""
    weight = np.atleast_1d(np.asarray(task.weight, dtype=float))
    if not (weight >= 0.0).all():
        raise ValueError(f"weight of {task.name} = {task.weight}: must be >= 0")
    return np.asarray(np.sqrt(weight)[:, None])


# Rows of J of the soles in contact, by (left, right).
_CARRYING = {
    (True, True): slice(0, 12),
    (True, False): LEFT_SOLE,
    (False, True): RIGHT_SOLE,
}


class WholeBodySolution(NamedTuple):
    """Consistent accelerations, contact wrenches and torques.

    `vdot` (nv,); `wrenches` (12,) = [tau, f] of the left and the right sole
    at its centre, in W [N m], [N], zero without contact; `torques` (nj,)
    [N m].  All other entries are NaN unless `qp.solved`.
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
    [vdot (nv), w_left (6), w_right (6)], without the wrench of a sole in the
    air, subject to

    * J vdot + Jdot v = a of each sole in contact, or of its edge, if it rolls,
    * M vdot + bias = sum J' w in the six rows of the floating base,
    * limits on contact wrenches, torques, joints and the distances of near
      links; if the QP is infeasible, joint limits, torque rate limits and link
      distances are dropped in this order.

    Internally, forces, torques and M are per unit of the robot's mass.
    """

    def __init__(
        self,
        params: WholeBodyQpParams,
        model: WholeBodyModel,
        period: float,
        tasks: Iterable[Task] = (),
    ):
        """Builds the QP for `model`, to be solved every `period` [s].

        `tasks` are added to those of momentum, trunk and swing foot.

        Raises:
            ValueError: a task's weight is negative, or the margin leaves no
                area of the sole.
        """
        self._params, self._model = params, model
        all_tasks: list[Task] = [
            MomentumTask(params, model),
            TrunkTask("torso", params),
            TrunkTask("pelvis", params),
            SwingFootTask(params),
            *tasks,
        ]
        self._tasks = [(task, _root(task)) for task in all_tasks]
        self._limits = WholeBodyLimits(params, model, period)
        nv = 6 + model.num_joints
        self._qps = {
            n: DenseQp(nv + 6 * n)
            for n in (1, 2)  # soles in contact
        }
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
        self,
        terms: WholeBodyTerms,
        command: WholeBodyCommand,
        last_torques: Array | None = None,
    ) -> WholeBodySolution:
        """Returns the solution of the QP, relaxed if it is infeasible.

        `last_torques` (nj,) [N m], if given, are the start of the torque rate
        limit.

        Raises:
            ValueError: NaN or infinity in `terms` or `command`.
        """
        contacts = command.contacts
        problem = self.problem(terms, command, last_torques)
        solver = self._qps[sum(contacts)]
        qp = solver.solve(problem)
        # At the touchdown of a long step, contact, torque and friction limits
        # may make joint braking and torque rate limits infeasible.  These are
        # not physical and may be relaxed.
        limits = slice(6 * sum(contacts) + 6, None)
        freed = self._limits.freed(
            terms, last_torques, problem.lower[limits], problem.upper[limits]
        )
        while not qp.solved and next(freed, True) is None:
            again = solver.solve(problem)
            solves, helped = qp.solves + again.solves, qp.fallback
            qp = again._replace(
                solves=solves, fallback=helped or again.fallback
            )
        nv, mass = terms.v.size, self._model.mass
        torques = problem.A[limits][self._limits.torque_rows] @ qp.x
        torques += terms.forces[6:, -1]
        wrenches = np.zeros(12)
        wrenches[_CARRYING[contacts]] = mass * qp.x[nv:]
        return WholeBodySolution(qp.x[:nv], wrenches, mass * torques, qp)

    def damping_torques(
        self, terms: WholeBodyTerms, last: Array | None = None
    ) -> Array:
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
        self,
        terms: WholeBodyTerms,
        command: WholeBodyCommand,
        last_torques: Array | None = None,
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
        b[:12] += self._rest(terms, command.normals)
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
        terms: WholeBodyTerms,
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
        px, py, pz = p = edge * x
        cross = np.array([[0.0, -pz, py], [pz, 0.0, -px], [-py, px, 0.0]])
        turn, move = A[sole, :nv].reshape(2, 3, nv)
        # At the edge: a + alpha x p + w x (w x p).
        w = terms.velocities[sole][:3]
        rest, bias = b[sole].copy(), -terms.rows[sole, -1]
        slip = terms.velocities[sole][3:] + np.cross(w, p)
        rows, values = np.zeros((6, A.shape[1])), np.zeros(6)
        rows[:3, :nv] = move - cross @ turn
        values[:3] = bias[3:] - cross @ bias[:3]
        values[:3] -= np.cross(w, np.cross(w, p))
        values[:3] -= self._params.stance_damping * slip
        axes = np.stack((x, z))
        rows[3:5, :nv], values[3:5] = axes @ turn, axes @ rest[:3]
        roll, weight = y @ turn, self._params.swing_orientation_weight
        H[:nv, :nv] += weight * np.outer(roll, roll)
        g[:nv] -= weight * (y @ rest[:3]) * roll
        wrench = rows[5, nv + sole.start : nv + sole.stop]
        wrench[:3], wrench[3:] = y, -y @ cross
        A[sole], b[sole] = rows, values

    def _rest(self, terms: WholeBodyTerms, normals: Array) -> Array:
        """Accelerations (12,) that damp and align soles to `normals`."""
        params = self._params
        rest = -params.stance_damping * terms.velocities[:12]
        x, y, z = params.stance_tilt_gain * terms.rotations[:2, :, 2].T
        nx, ny, nz = normals.T
        rest[0::6] += y * nz - z * ny
        rest[1::6] -= x * nz - z * nx
        rest[2::6] += x * ny - y * nx
        return np.asarray(rest)

    def _cost(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> tuple[Array, Array]:
        """Returns H and g of the cost of all soft tasks."""
        nv = terms.v.size
        n = nv + 6 * sum(command.contacts)
        parts: list[Array] = []
        for task, root in self._tasks:
            motion = task.motion(terms, command)
            if motion is not None:
                rows = motion.rows.copy()
                rows[:, -1] -= motion.acceleration
                rows *= root
                parts.append(rows)
        if terms.avoidance:
            parts.append(terms.avoidance.braking)
        tasks = np.concatenate(parts)
        square = tasks.T @ tasks
        H, g = self._H[:n, :n].copy(), np.zeros(n)
        H[:nv, :nv] += square[:-1, :-1]
        g[:nv] = square[:-1, -1]
        g[6:nv] += (
            self._posture_kp * (terms.q[7:] - self._model.posture)
            + self._posture_kd * terms.v[6:]
        )
        return H, g
