"""Hard limits of the whole-body QP: drives, joints, soles, near links.

The friction of the soles is lowered after a slip.
"""

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from nadia_balance.core.body.model import torque_limits
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.qp import QpProblem
from nadia_balance.core.whole_body.command import PELVIS, TORSO
from nadia_balance.core.whole_body.command import WholeBodyCommand as Command
from nadia_balance.core.whole_body.command import WholeBodyModel as Model
from nadia_balance.core.whole_body.command import WholeBodyTerms as Terms
from nadia_balance.core.whole_body.params import WholeBodyQpParams as Params

NUM_CONE_ROWS = 16


def contact_wrench_cone(length: float, width: float, friction: float) -> Array:
    """Returns U (16, 6) of the cone U [tau, f] <= 0, at the sole's centre.

    tau (3,) [N m] and f (3,) [N] act on the sole, in the sole frame: z up, x
    along `length` [m].  The cone is exact for four corners with a friction
    pyramid |f_x|, |f_y| <= friction * f_z each.  Rows: 4 friction, 4 centre
    of pressure, 8 yaw moment (Caron, Pham, Nakamura, Stability of surface
    contacts for humanoid robots, ICRA 2015, Eqs. 15-19).
    """
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
# Costs of accelerations of joints and trunk beyond their limits [s^4/rad^2].
_JOINT_SLACK, _TILT_SLACK = 1.0, 100.0
_TINY = 1e-9  # a smaller tilt has no direction [rad]
_LOADED = 0.2  # share of the weight below which slips are ignored [-]
_LESS = 0.9  # new estimate over the friction used in a slip [-]
_SIGNS = np.array([[-1.0], [1.0]])


class WholeBodyLimits:
    """Inequality rows lower <= C [vdot, wrenches] <= upper of the QP.

    Wrenches [tau, f] and torques are per unit of the robot's mass; only soles
    in contact have wrenches.  Order of the rows: torques, joint accelerations,
    tilt of torso and pelvis, the cone and the normal force of the left and of
    the right sole, avoidance of self-collisions.
    """

    def __init__(self, params: Params, model: Model, period: float):
        """Builds the limits of `model` and `params` for ticks of `period` [s].

        Raises ValueError: the margin leaves no area of the sole.
        """
        self._params, self._mass = params, model.mass
        n = model.num_joints
        self.torque_rows, self._joint_rows = slice(0, n), slice(n, 2 * n)
        self._trunk_rows = slice(2 * n, 2 * n + 2)
        self._joints, self.num_soft = np.eye(n), n + 2
        self._slack_cost = np.diag([_JOINT_SLACK] * n + [_TILT_SLACK] * 2)
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
        self._torques: Array = model.max_torque / model.mass * _SIGNS
        self._positions = np.stack((model.position_lower, model.position_upper))
        self._max_speed, self._drives = model.max_speed, model.drives
        self._speeds = params.max_speed_ratio * model.max_speed * _SIGNS
        if model.drives is not None:
            ticks = model.drives.max_torque_rate * period
            self._torque_steps = ticks * self._torques

    def num_rows(self, num_soles: int, terms: Terms) -> int:
        """Returns the number of rows with `num_soles` in contact."""
        rows = self._trunk_rows.stop + num_soles * _FOOT_ROWS
        return rows + (len(terms.avoidance.limits) if terms.avoidance else 0)

    def fill(
        self,
        C: Array,
        bounds: Array,
        terms: Terms,
        command: Command,
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
        C[self._trunk_rows, :nv], least = self._upright(terms)
        bounds[0, self._trunk_rows], bounds[1, self._trunk_rows] = least, np.inf
        cone = self._usual_cone
        if command.friction != self._params.friction:
            cone = self._cone(command.friction)
        row, column = self._trunk_rows.stop, nv
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

    def relaxed(
        self,
        problem: QpProblem,
        first: int,
        terms: Terms,
        last_torques: Array | None,
    ) -> Iterator[QpProblem]:
        """Yields the `problem` with ever weaker limits, its rows from `first`.

        Joint limits and tilt get a slack s each, lower <= C x + s <= upper,
        with a cost s^2, so that none yields more than it has to.  Then the
        torque rate limits grow by the factors _HASTE, and the link distances
        are dropped: the bounds of `problem` change in place.  The slacks are
        the last variables, in rad/s^2.
        """
        H, g, A, lower, upper = problem
        rows = slice(
            first + self._joint_rows.start, first + self._trunk_rows.stop
        )
        n, soft = g.size, self.num_soft
        H_soft = np.zeros((n + soft, n + soft))
        H_soft[:n, :n], H_soft[n:, n:] = H, self._slack_cost
        A_soft = np.hstack((A, np.zeros((len(A), soft))))
        A_soft[rows, n:] = np.eye(soft)
        g_soft = np.concatenate((g, np.zeros(soft)))
        yield (problem := QpProblem(H_soft, g_soft, A_soft, lower, upper))
        for haste in _HASTE if last_torques is not None else ():
            torques = self.torque_bounds(terms.v[6:], last_torques, haste)
            torques = torques - terms.forces[6:, -1]
            rows = slice(first, first + len(self._joints))
            lower[rows], upper[rows] = torques
            yield problem
        if terms.avoidance and (near := len(terms.avoidance.limits)):
            lower[-near:] = -np.inf
            yield problem

    def _upright(self, terms: Terms) -> tuple[Array, Array]:
        """Returns rows (2, nv) and lower bounds (2,) on the trunk's tilt.

        The rotation e from upright to the torso about a horizontal axis, a
        horizon T ahead at the present velocity, stays within the largest tilt:
        -e / |e| . wdot >= 2 / T^2 (|e| - max).  So does that of the pelvis.
        """
        T = self._params.trunk_tilt_horizon
        most = math.radians(self._params.max_trunk_tilt_deg)
        found, least = [], []
        for body, R in zip((TORSO, PELVIS), terms.rotations[2:], strict=True):
            x, y, z = R[:, 2].tolist()
            wx, wy, _ = terms.velocities[body].tolist()
            sine = math.hypot(x, y)
            scale = math.atan2(sine, z) / sine if sine > _TINY else 1.0
            ex, ey = T * wx - scale * y, T * wy + scale * x
            tilt = max(math.hypot(ex, ey), _TINY)
            row = terms.rows[body][:2].T @ (-ex / tilt, -ey / tilt)
            found.append(row[:-1])
            least.append(2.0 / T**2 * (tilt - most) - row[-1])
        return np.array(found), np.array(least)

    def _cone(self, friction: float) -> Array:
        """Returns the rows of the wrench cone and normal force of a sole.

        Shape (2 * _FOOT_ROWS, 3) in the sole frame: rows for tau and f
        alternate, so that one product rotates both.
        """
        cone = np.zeros((_FOOT_ROWS, 6))
        cone[:NUM_CONE_ROWS] = contact_wrench_cone(*self._sides, friction)
        cone[-1, 5] = 1.0
        return cone.reshape(-1, 3)

    def _braking(self, terms: Terms) -> Array:
        """Bounds (2, nj) [rad/s^2] on vdot from position and speed limits.

        q + T v + T^2/2 vdot stays within the position limits for a horizon T,
        v + T vdot within the speed limits for a shorter one, which come first;
        the bounds are clipped to `max_joint_acceleration`.
        """
        horizon = self._params.joint_limit_horizon
        most = self._params.max_joint_acceleration
        ahead = terms.q[7:] + horizon * terms.v[6:]
        bounds = (self._positions - ahead) * (2.0 / horizon**2)
        room = self._speeds - terms.v[6:]
        room /= self._params.speed_limit_horizon
        np.clip(room, -most, most, out=room)
        return np.asarray(np.minimum(np.maximum(bounds, room[0]), room[1]))


def friction_after(
    last: Sequence[float],
    forces: Array,
    velocities: Array,
    params: Params,
    period: float,
) -> list[float]:
    """Returns the friction and the time [s] under load of each sole, (3,).

    `last` are those a tick ago.  `forces` (2, 3), as shares of the weight, are
    the desired forces on the (left, right) sole in the tick of `period` [s],
    `velocities` (2, 3) [m/s] its velocities, both in the sole frame.  A slip
    lowers the friction to _LESS times what the desired force needed; then it
    returns to that of `params`.
    """
    slip, usual = params.slip, params.friction
    least = min(slip.least_friction, usual)
    friction = min(last[0] + slip.recovery * period, usual)
    loaded = []
    for (x, y, z), velocity, time in zip(
        forces.tolist(), velocities, last[1:], strict=True
    ):
        loaded.append(time + period if z > _LOADED else 0.0)
        used = max(abs(x), abs(y)) / max(z, _LOADED)  # of the pyramid
        if (
            loaded[-1] > slip.settling_time
            and used > least
            and np.hypot(*velocity[:2]) > slip.speed
        ):
            friction = max(min(friction, _LESS * used), least)
    return [friction, *loaded]
