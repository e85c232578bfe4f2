"""Hard limits of the whole-body QP: drives, joints, soles, near links.

The friction of the soles is lowered after a slip.
"""

import math
from collections.abc import Sequence

import numpy as np

from nadia_balance.core.body.model import torque_limits
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.qp import QpProblem
from nadia_balance.core.whole_body.command import (
    PELVIS,
    TORSO,
    WholeBodyCommand,
    WholeBodyModel,
    WholeBodyTerms,
)
from nadia_balance.core.whole_body.params import WholeBodyQpParams

NUM_CONE_ROWS = 16


def contact_wrench_cone(length: float, width: float, friction: float) -> Array:
    """The cone U [tau, f] <= 0 of the wrenches of a sole in contact.

    It is exact for four corners with a friction pyramid |f_x|, |f_y| <=
    friction * f_z each.  Rows: 4 friction, 4 centre of pressure, 8 yaw moment
    (Caron, Pham, Nakamura, Stability of surface contacts for humanoid robots,
    ICRA 2015, Eqs. 15-19).

    Args:
        length: of the sole, along x [m].
        width: of the sole, along y [m].
        friction: coefficient of the pyramid [-].

    Returns:
        U (16, 6), for tau (3,) [N m] and f (3,) [N] on the sole at its centre,
        in the sole frame: z up.
    """
    x, y, mu = 0.5 * length, 0.5 * width, friction
    signs = (1.0, -1.0)
    force = [[0, 0, 0, s, 0, -mu] for s in signs]
    force += [[0, 0, 0, 0, s, -mu] for s in signs]
    pressure = [[s, 0, 0, 0, 0, -y] for s in signs]
    pressure += [[0, s, 0, 0, 0, -x] for s in signs]
    # tau_z <= mu (x + y) f_z - |y f_x + mu tau_x| - |x f_y + mu tau_y|, and
    # -tau_z <= mu (x + y) f_z - |y f_x - mu tau_x| - |x f_y - mu tau_y|.
    yaw = [
        [s * a * mu, s * b * mu, s, a * y, b * x, -mu * (x + y)]
        for s in signs
        for a in signs
        for b in signs
    ]
    return np.array(force + pressure + yaw)


_FOOT_ROWS = NUM_CONE_ROWS + 1  # the cone and the size of the normal force
# Costs of a tilt of torso and pelvis in its margin, per acceleration towards
# upright that is missing [s^4/rad^2].
TILT_COSTS = 100.0, 100.0
_NUM_TILTS = len(TILT_COSTS)
# Costs of what limits yield if they must: accelerations of joints [s^4/rad^2],
# of links [s^4/m^2], and the torque rate, per its limit [-].
_JOINT_SLACK = 1.0
_DISTANCE_SLACK = 100.0
_RATE_SLACK = 1e4
_TINY = 1e-9  # a smaller tilt has no direction [rad]
_LOADED = 0.2  # share of the weight below which slips are ignored [-]
_LESS = 0.9  # new estimate over the friction used in a slip [-]
_SIGNS = np.array([[-1.0], [1.0]])
_ANY = np.inf * _SIGNS


class WholeBodyLimits:
    """Inequality rows lower <= C [vdot, wrenches, s] <= upper of the QP.

    Wrenches [tau, f] and torques are per unit of the robot's mass; only soles
    in contact have wrenches; s (2,) is by how much the accelerations of torso
    and pelvis towards upright fall short where their tilt costs.  Order of the
    rows: torques, joint accelerations, tilt of torso and pelvis, s, the cone
    and the normal force of the left and of the right sole, avoidance of
    self-collisions.

    Args:
        params: margins and horizons.
        model: limits of the joints, size of the sole.
        period: of a tick [s].

    Raises:
        ValueError: the margin leaves no area of the sole.
    """

    def __init__(
        self, params: WholeBodyQpParams, model: WholeBodyModel, period: float
    ) -> None:
        n = model.num_joints
        self._params, self._model = params, model
        self.torque_rows, self._joint_rows = slice(0, n), slice(n, 2 * n)
        self._trunk_rows = slice(2 * n, 2 * n + _NUM_TILTS)
        self._slack_rows = slice(
            self._trunk_rows.stop, self._trunk_rows.stop + _NUM_TILTS
        )
        self._given = list(model.given)
        self._softened = np.eye(model.num_joints)
        self._softened[self._given] = 0.0
        self._slack_costs = np.array([_JOINT_SLACK] * n + [_RATE_SLACK])
        # Acceleration back to upright per tilt [1/s^2], see _upright; the tilt
        # that costs nothing, and the largest acceleration that is missing.
        self._tilt_gain = 2.0 / params.trunk_tilt_horizon**2
        self._free_tilt = math.radians(
            params.max_trunk_tilt_deg - params.trunk_tilt_margin_deg
        )
        self._most_missing = self._tilt_gain * math.radians(
            params.trunk_tilt_margin_deg
        )
        margin = 2.0 * params.sole_margin
        self._sole_length = model.sole_length - margin
        self._sole_width = model.sole_width - margin
        if min(self._sole_length, self._sole_width) <= 0.0:
            raise ValueError(
                f"sole_margin = {params.sole_margin}: must leave some of the "
                "sole"
            )
        # The cone is friction * slope + the rest.
        self._cone_rest = self._cone(0.0)
        self._cone_slope = self._cone(1.0) - self._cone_rest
        # The first axis of all bounds is (lower, upper).
        self._wrench = np.repeat([[-np.inf], [0.0]], _FOOT_ROWS, axis=1)
        self._wrench[0, -1] = params.min_normal_force / model.mass
        self._torques: Array = model.max_torque / model.mass * _SIGNS
        self._positions = np.stack((model.position_lower, model.position_upper))
        self._horizons = np.where(
            model.is_knee, params.knee_limit_horizon, params.joint_limit_horizon
        )
        self._speeds = params.max_speed_ratio * model.max_speed * _SIGNS
        if model.drives is not None:
            ticks = model.drives.max_torque_rate * period
            self._torque_steps = ticks * self._torques

    def constants(self, num_soles: int) -> tuple[Array, Array]:
        """The rows of a QP without near links, with what is constant.

        Args:
            num_soles: number of soles in contact.

        Returns:
            Rows C (m, n) and their bounds (2, m), 0 where they vary; these
            limits come after 6 rows for each sole and 6 for the base.
        """
        nv, first = 6 + self._model.num_joints, 6 * num_soles + 6
        soles, slacks = first + self._slack_rows.stop, nv + 6 * num_soles
        C = np.zeros((soles + num_soles * _FOOT_ROWS, slacks + _NUM_TILTS))
        C[first:][self._joint_rows, 6:nv] = np.eye(nv - 6)
        C[first:][self._trunk_rows, slacks:] = np.eye(_NUM_TILTS)
        C[first:][self._slack_rows, slacks:] = np.eye(_NUM_TILTS)
        bounds = np.zeros((2, len(C)))
        bounds[1, first:][self._trunk_rows] = np.inf
        bounds[1, first:][self._slack_rows] = self._most_missing
        bounds[:, soles:] = np.tile(self._wrench, num_soles)
        return C, bounds

    def fill(
        self,
        C: Array,
        bounds: Array,
        terms: WholeBodyTerms,
        command: WholeBodyCommand,
        last_torques: Array | None = None,
    ) -> None:
        """Writes the bounds, and completes the rows.

        Args:
            C: rows (m, n); on entry, the torque rows, M vdot - sum J' w, and
                the `constants`; those of near links last.
            bounds: lower and upper bounds (2, m); on entry, the `constants`.
            terms: kinematics and dynamics.
            command: contacts, friction and force bounds.
            last_torques: torques of the last tick (nj,), if their rate is
                limited [N m].
        """
        np.subtract(
            self.torque_bounds(terms.v[6:], last_torques),
            terms.forces[6:, -1],
            out=bounds[:, self.torque_rows],
        )
        self._braking(terms, out=bounds[:, self._joint_rows])
        if self._given:
            # Their motion is given: vdot = 0, whatever torque that takes.
            bounds[:, self.torque_rows][:, self._given] = _ANY
            bounds[:, self._joint_rows][:, self._given] = 0.0
        self._upright(terms, C=C, lower=bounds[0])
        cone = command.friction * self._cone_slope
        cone += self._cone_rest
        row, column = self._slack_rows.stop, terms.v.size
        least, mass = self._wrench[0, -1], self._model.mass
        for side, carries in enumerate(command.contacts):
            if carries:
                end = row + _FOOT_ROWS
                R_FW = terms.rotations[side].T
                C[row:end, column : column + 6] = cone.dot(R_FW).reshape(-1, 6)
                bounds[1, end - 1] = max(
                    command.max_normal_forces[side] / mass, least
                )
                row, column = end, column + 6
        if terms.avoidance and len(terms.avoidance.limits):
            nv, limits = terms.v.size, terms.avoidance.limits
            C[row:, :nv] = limits[:, :-1]
            np.negative(limits[:, -1], out=bounds[0, row:])
            bounds[1, row:] = np.inf

    def torque_bounds(self, speed: Array, last: Array | None) -> Array:
        """The least and the largest torques, per unit of the robot's mass.

        They follow from the torque rate limit and from the torque-speed line
        of the drives, which overrides it.

        Args:
            speed: of the joints (nj,) [rad/s].
            last: torques of the last tick (nj,), whose change is limited if
                they are given [N m].

        Returns:
            The bounds (2, nj) [m^2/s^2].
        """
        if self._model.drives is None:
            return self._torques
        bounds = torque_limits(
            speed=speed,
            max_torque=self._torques[1],
            max_speed=self._model.max_speed,
            corner_speed=self._model.corner_speed,
        )
        if last is None:
            return bounds
        lower, upper = bounds
        near = (
            np.minimum(np.maximum(last / self._model.mass, lower), upper)
            + self._torque_steps
        )
        return np.asarray(np.minimum(np.maximum(near, lower), upper))

    def relaxed(
        self,
        problem: QpProblem,
        first: int,
        terms: WholeBodyTerms,
        last_torques: Array | None,
    ) -> QpProblem:
        """The problem whose limits of joints, tilt, rate and distances yield.

            lower <= C x + j <= upper of joint accelerations,
            |torques - last torques| <= (1 + h) steps, within those of drives,
            A x + d >= lower of the link distances,

        and no largest s, with a cost of j^2, h^2 and d^2, so that none yields
        more than it has to; none is physical.  The variables are [x, j, h, d],
        h and d where there is such a limit.  Given joints do not yield.

        Args:
            problem: that of the tick, infeasible.
            first: first row of these limits in it.
            terms: kinematics and dynamics.
            last_torques: torques of the last tick (nj,), if their rate is
                limited [N m].

        Returns:
            The problem.
        """
        n, soft = problem.g.size, self._model.num_joints
        pairs = len(terms.avoidance.limits) if terms.avoidance else 0
        has_rate = self._model.drives is not None and last_torques is not None
        costs = self._slack_costs[: soft + 1 if has_rate else soft]
        if pairs:
            costs = np.append(costs, _DISTANCE_SLACK)
        H = np.zeros((n + costs.size, n + costs.size))
        H[:n, :n] = problem.H
        H[range(n, len(H)), range(n, len(H))] = costs
        A = np.zeros((len(problem.A), len(H)))
        A[:, :n] = problem.A
        A[first:][self._joint_rows, n : n + soft] = self._softened
        if pairs:
            A[-pairs:, -1] = 1.0
        upper = problem.upper.copy()
        upper[first:][self._slack_rows] = np.inf
        softened = QpProblem(
            H=H,
            g=np.concatenate((problem.g, np.zeros(costs.size))),
            A=A,
            lower=problem.lower,
            upper=upper,
        )
        if not has_rate:
            return softened
        rows = slice(first, first + self._model.num_joints)
        drives = self.torque_bounds(terms.v[6:], None) - terms.forces[6:, -1]
        drives[:, self._given] = _ANY
        return self._with_haste(softened, rows, n + soft, drives)

    def _with_haste(
        self, problem: QpProblem, rows: slice, haste: int, drives: Array
    ) -> QpProblem:
        """The problem with torque rates that variable `haste` lets grow.

        Its torque `rows`, bounded by the rate, get the bounds `drives` (2, nj);
        behind all rows there are one-sided ones for the rate.
        """
        free = np.full(rows.stop - rows.start, np.inf)
        A = np.concatenate((problem.A, problem.A[rows], problem.A[rows]))
        steps: Array = self._torque_steps[1]
        A[len(problem.A) :, haste] = np.concatenate((steps, -steps))
        lower = np.concatenate((problem.lower, problem.lower[rows], -free))
        upper = np.concatenate((problem.upper, free, problem.upper[rows]))
        lower[rows], upper[rows] = drives
        return problem._replace(A=A, lower=lower, upper=upper)

    def _upright(self, terms: WholeBodyTerms, C: Array, lower: Array) -> None:
        """Writes rows and lower bounds on the trunk's tilt.

        The rotation e from upright to the torso about a horizontal axis, a
        horizon T ahead at the present velocity, stays within the largest tilt,
        at a cost of s^2 beyond the margin below it:

            -e / |e| . wdot + s >= 2 / T^2 (|e| - (max - margin)),
            0 <= s <= 2 / T^2 margin.

        So does that of the pelvis.
        """
        first, nv = self._trunk_rows.start, terms.v.size
        x, y, least = self._leaning(terms, 2, TORSO)
        row = terms.rows[TORSO][:2].T.dot((x, y))
        C[first, :nv] = row[:-1]
        lower[first] = least - row[-1]
        # The pelvis is the base: its angular acceleration is in vdot.
        C[first + 1, 0], C[first + 1, 1], least = self._leaning(
            terms, 3, PELVIS
        )
        lower[first + 1] = least

    def _leaning(
        self, terms: WholeBodyTerms, body: int, rows: slice
    ) -> tuple[float, float, float]:
        """The direction (x, y) back to upright, and the least acceleration."""
        T = self._params.trunk_tilt_horizon
        x, y, z = terms.rotations[body, :, 2].tolist()
        wx, wy, _ = terms.velocities[rows].tolist()
        sine = math.hypot(x, y)
        scale = math.atan2(sine, z) / sine if sine > _TINY else 1.0
        ex, ey = T * wx - scale * y, T * wy + scale * x
        tilt = max(math.hypot(ex, ey), _TINY)
        return (
            -ex / tilt,
            -ey / tilt,
            self._tilt_gain * (tilt - self._free_tilt),
        )

    def _cone(self, friction: float) -> Array:
        """Returns the rows of the wrench cone and normal force of a sole.

        Shape (2 * _FOOT_ROWS, 3) in the sole frame: rows for tau and f
        alternate, so that one product rotates both.
        """
        cone = contact_wrench_cone(
            self._sole_length, self._sole_width, friction
        )
        return np.vstack((cone, np.eye(6)[5])).reshape(-1, 3)

    def _braking(self, terms: WholeBodyTerms, out: Array) -> None:
        """Writes bounds (2, nj) [rad/s^2] on vdot for positions and speeds.

        q + T v + T^2/2 vdot stays within the position limits for a horizon T,
        v + T vdot within the speed limits for a shorter one, which come first;
        the bounds are clipped to `max_joint_acceleration`.
        """
        v, horizon = terms.v[6:], self._horizons
        bounds = self._positions - (terms.q[7:] + horizon * v)
        bounds *= 2.0 / horizon**2
        room = self._speeds - v
        room /= self._params.speed_limit_horizon
        clip = self._params.max_joint_acceleration
        # As numpy.clip does, in half of its time.
        np.minimum(np.maximum(room, -clip, out=room), clip, out=room)
        np.maximum(bounds, room[0], out=bounds)
        np.minimum(bounds, room[1], out=out)


def friction_after(
    last: Sequence[float],
    forces: Array,
    velocities: Array,
    params: WholeBodyQpParams,
    period: float,
) -> list[float]:
    """The estimate of the friction, and the times under load, after a tick.

    A slip lowers the friction to _LESS times what the desired force needed;
    then it returns to that of `params`.

    Args:
        last: result of a tick ago (3,).
        forces: desired forces on the (left, right) sole (2, 3) in the sole
            frame, as shares of the weight [-].
        velocities: of the (left, right) sole (2, 3) in the sole frame [m/s].
        params: usual friction, and the reaction to a slip.
        period: of the tick [s].

    Returns:
        The friction [-] and the times of the (left, right) sole [s] (3,).
    """
    slip, usual = params.slip, params.friction
    least = min(slip.least_friction, usual)
    friction = min(last[0] + slip.recovery * period, usual)
    loaded = []
    for (x, y, z), velocity, time in zip(
        forces.tolist(), velocities.tolist(), last[1:], strict=True
    ):
        loaded.append(time + period if z > _LOADED else 0.0)
        used = max(abs(x), abs(y)) / max(z, _LOADED)  # of the pyramid
        if (
            loaded[-1] > slip.settling_time
            and used > least
            and math.hypot(velocity[0], velocity[1]) > slip.speed
        ):
            friction = max(min(friction, _LESS * used), least)
    return [friction, *loaded]
