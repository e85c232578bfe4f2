"""Soft tasks of the whole-body QP."""

import math
from collections.abc import Iterable
from typing import NamedTuple, Protocol

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import tilt
from nadia_balance.core.whole_body.command import (
    BASE,
    PELVIS,
    TORSO,
    WholeBodyCommand,
    WholeBodyModel,
    WholeBodyTerms,
)
from nadia_balance.core.whole_body.params import WholeBodyQpParams


class Motion(NamedTuple):
    """The task J vdot + b = a, of n rows.

    Args:
        rows: [J, b] (n, nv + 1), as in WholeBodyTerms.
        acceleration: a (n,).
    """

    rows: Array
    acceleration: Array


class Task(Protocol):
    """A soft task: the QP minimises weight * |J vdot + b - a|^2.

    `name` is for messages, `weight` a number or (n,), constant.  A task must
    not remember anything from one tick to the next.
    """

    @property
    def name(self) -> str:
        """The name of the task."""

    @property
    def weight(self) -> float | Array:
        """The weight of its squared error."""

    def motion(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> Motion | None:
        """The desired motion of this tick.

        Args:
            terms: kinematics and dynamics.
            command: desired values.

        Returns:
            The motion; None: any.
        """


class MomentumTask:
    """Linear momentum, and angular momentum about the CoM, per mass.

    The task for the horizontal force is its direction, from the eCMP to the
    CoM, at any magnitude.  With a task for the horizontal force itself, a
    sinking robot would tilt, a braking one jump.  Angular momentum is damped.

    Args:
        params: weights and damping.
        model: mass of the robot.
    """

    name = "momentum"

    def __init__(
        self, params: WholeBodyQpParams, model: WholeBodyModel
    ) -> None:
        self.weight = np.repeat(
            [
                params.momentum_weight,
                params.height_weight,
                params.angular_momentum_weight,
            ],
            (2, 1, 3),
        )
        self._damping = params.angular_momentum_damping
        self._mass = model.mass
        self._weight = model.mass * GRAVITY
        self._selection: Array = np.eye(6)[[3, 4, 5, 0, 1, 2]]

    def motion(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> Motion:
        """The motion of the linear and the angular momentum.

        Args:
            terms: kinematics and dynamics.
            command: desired rate of the momentum.

        Returns:
            Rows (6, nv + 1) of force and moment about the CoM, per mass.
        """
        selection, base = self._selection.copy(), terms.rows[BASE]
        # The moment about the CoM: minus the lever arm times the force.  The
        # arm is in M, since the base's velocity is expressed in W.
        np.negative(base[:3, 3:6], out=selection[3:, 3:6])
        fx, fy, fz = command.momentum_rate.tolist()
        selection[0, 5] = -fx / self._weight
        selection[1, 5] = -fy / self._weight
        momentum = selection[3:].dot(terms.velocities[BASE])
        mx, my, mz = (-self._damping * momentum).tolist()
        # The force also carries the weight, which is no rate of momentum.
        vertical = fz / self._mass + GRAVITY
        acceleration = np.array((0.0, 0.0, vertical, mx, my, mz))
        return Motion(selection.dot(base), acceleration)


class TrunkTask:
    """PD law for the orientation of torso or pelvis: upright, by the heading.

    The pelvis is turned relative to the heading (see crossing_turn).

    Args:
        name: "torso" or "pelvis".
        params: weight, gain and damping ratio.
    """

    def __init__(self, name: str, params: WholeBodyQpParams) -> None:
        self.name = name
        self._is_pelvis = name == "pelvis"
        self.weight: Array = np.repeat(
            params.pelvis_weight if self._is_pelvis else params.torso_weight, 3
        )
        self._rows = PELVIS if self._is_pelvis else TORSO
        self._body = 3 if self._is_pelvis else 2  # of `rotations`
        self._kp = params.orientation_gain
        self._kd = 2.0 * params.damping_ratio * math.sqrt(self._kp)

    def motion(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> Motion:
        """The motion of the body's orientation.

            wdot = kp error + kd (w_desired - w) + wdot_desired

        Args:
            terms: kinematics and dynamics.
            command: heading, and turn of the pelvis.

        Returns:
            Rows (3, nv + 1) of the angular acceleration in W.
        """
        yaw, yawdot, yawddot = command.heading
        if self._is_pelvis:
            turn, turndot, turnddot = command.turn
            yaw, yawdot = yaw + turn, yawdot + turndot
            yawddot += turnddot
        x, y, z = rotation_error(yaw, terms.rotations[self._body])
        wx, wy, wz = terms.velocities[self._rows].tolist()
        kp, kd = self._kp, self._kd
        wdot = (
            kp * x - kd * wx,
            kp * y - kd * wy,
            kp * z + yawddot + kd * (yawdot - wz),
        )
        return Motion(terms.rows[self._rows], np.array(wdot))


class SwingFootTask:
    """PD laws for the sole's orientation and the ankle's position.

    The ankle is to be where the reference of the sole has it, and as much
    higher as the lowest corner of a tilted sole is below its centre: a corner
    that is too low lands early, while the foot is fast.  So the leg moves the
    foot, and not a tilt of the sole, whose orientation has little weight until
    it lands: it is times the command's `flatness`.  The height has a weight of
    its own: at the end of a long step the torques do not suffice for all.

    Args:
        params: weights, gains and damping ratio.
        model: ankles.
    """

    name = "swing_foot"

    def __init__(
        self, params: WholeBodyQpParams, model: WholeBodyModel
    ) -> None:
        self.weight = np.repeat(
            [
                params.swing_orientation_weight,
                params.swing_position_weight,
                params.swing_height_weight,
            ],
            (3, 2, 1),
        )
        self._ankles = model.ankles
        self._half_sole = 0.5 * model.sole_length, 0.5 * model.sole_width
        # Gains of the orientation and of the position.
        self._kp = params.swing_orientation_gain, params.swing_position_gain
        self._kd = (
            2.0 * params.damping_ratio * math.sqrt(self._kp[0]),
            2.0 * params.damping_ratio * math.sqrt(self._kp[1]),
        )

    def motion(
        self, terms: WholeBodyTerms, command: WholeBodyCommand
    ) -> Motion | None:
        """The motion of the foot in the air.

            [wdot, vdot] = [kp, kp_position] error + kd rate error + desired

        Args:
            terms: kinematics and dynamics.
            command: reference and normal of the swing sole.

        Returns:
            Rows (6, nv + 1) of the sole's orientation and the ankle's position
            in W; None if both feet carry.
        """
        if all(command.contacts):
            return None
        side = command.contacts.index(False)
        yaw, yawdot, yawddot = command.swing[9:].tolist()
        R_WT, R_WF = tilt(command.normals[side]), terms.rotations[side]
        R_TF = R_WT.T.dot(R_WF)
        turn = R_WT.dot(rotation_error(yaw, R_TF))
        # The reference of the ankle, and the arm to it from the sole's centre.
        ankle = command.swing[:9].reshape(3, 3) + (
            self._turned(side, yaw=yaw, rate=yawdot, acceleration=yawddot).dot(
                R_WT.T
            )
        )
        arm = R_WF.dot(self._ankles[side])
        ankle[0] -= terms.sole_positions[side]
        ankle[0] -= arm
        # The lowest corner is as high as the centre is to be.
        length, width = self._half_sole
        depth = length * abs(R_TF[2, 0]) + width * abs(R_TF[2, 1])
        ankle[0] += depth * R_WT[:, 2]
        (x, y, z), (vx, vy, vz), (ax, ay, az) = ankle.tolist()
        tx, ty, tz = turn.tolist()
        rows, velocity = terms.at_point(side, arm)
        wx, wy, wz, ux, uy, uz = velocity.tolist()
        root = math.sqrt(command.flatness)
        rows[:3] *= root
        (kp, kp_position), (kd, kd_position) = self._kp, self._kd
        acceleration = (
            root * (kp * tx - kd * wx),
            root * (kp * ty - kd * wy),
            root * (yawddot + kp * tz + kd * (yawdot - wz)),
            ax + kp_position * x + kd_position * (vx - ux),
            ay + kp_position * y + kd_position * (vy - uy),
            az + kp_position * z + kd_position * (vz - uz),
        )
        return Motion(rows, np.array(acceleration))

    def _turned(
        self, side: int, yaw: float, rate: float, acceleration: float
    ) -> Array:
        """Rows p, v, a (3, 3) of the ankle relative to a sole that turns."""
        x, y, z = self._ankles[side].tolist()
        c, s = math.cos(yaw), math.sin(yaw)
        x, y = c * x - s * y, s * x + c * y
        square = rate * rate
        return np.array(
            (
                x, y, z,
                -rate * y, rate * x, 0.0,
                -acceleration * y - square * x,
                acceleration * x - square * y,
                0.0,
            )
        ).reshape(3, 3)  # fmt: skip


def usual_tasks(params: WholeBodyQpParams, model: WholeBodyModel) -> list[Task]:
    """The tasks of the momentum, the trunk and the swing foot.

    Args:
        params: weights and gains.
        model: mass and ankles.

    Returns:
        The tasks.
    """
    return [
        MomentumTask(params, model),
        TrunkTask("torso", params),
        TrunkTask("pelvis", params),
        SwingFootTask(params, model),
    ]


class WeightedTasks:
    """Tasks as rows [S, r], scaled by the roots of their weights.

    The cost of S vdot + r is the sum of its squares.

    Args:
        tasks: in the order of their rows.

    Raises:
        ValueError: a weight is negative.
    """

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._tasks = []
        for task in tasks:
            weight = np.atleast_1d(np.asarray(task.weight, dtype=float))
            if not (weight >= 0.0).all():
                raise ValueError(
                    f"weight of {task.name} = {task.weight}: must be >= 0"
                )
            self._tasks.append((task, np.sqrt(weight)[:, None]))

    def rows(self, terms: WholeBodyTerms, command: WholeBodyCommand) -> Array:
        """The rows of this tick, braking links last.

        Args:
            terms: kinematics and dynamics.
            command: desired values.

        Returns:
            [S, r] (n, nv + 1).

        Raises:
            ValueError: a task's weights are neither one nor as many as rows.
        """
        parts, accelerations, roots = [], [], []
        for task, root in self._tasks:
            motion = task.motion(terms, command)
            if motion is None:
                continue
            parts.append(motion.rows)
            accelerations.append(motion.acceleration)
            if len(root) == 1:  # one weight for all
                root = np.repeat(root, len(motion.rows), axis=0)
            if len(root) != len(motion.rows):
                raise ValueError(
                    f"task {task.name!r}: {len(root)} weights for "
                    f"{len(motion.rows)} rows: must be as many, or one"
                )
            roots.append(root)
        rows = np.concatenate(parts)
        rows[:, -1] -= np.concatenate(accelerations)
        rows *= np.concatenate(roots)
        if terms.avoidance and len(terms.avoidance.braking):
            return np.concatenate((rows, terms.avoidance.braking))
        return rows


def rotation_error(yaw: float, R: Array) -> tuple[float, float, float]:
    """The rotation from R to upright at `yaw`.

    It is the antisymmetric part of R_upright R' as a vector, with the sine of
    the angle as its length: accurate to third order.

    Args:
        yaw: desired yaw in W [rad].
        R: rotation matrix of the body in W (3, 3).

    Returns:
        The rotation vector (3,) in W [rad].
    """
    c, s = math.cos(yaw), math.sin(yaw)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, _) = R.tolist()
    return (
        0.5 * (yz - s * zx - c * zy),
        0.5 * (c * zx - s * zy - xz),
        0.5 * (s * (xx + yy) + c * (xy - yx)),
    )
