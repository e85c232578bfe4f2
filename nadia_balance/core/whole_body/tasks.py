"""Soft tasks of the whole-body QP."""

import math
from collections.abc import Iterable
from typing import NamedTuple, Protocol

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import tilt
from nadia_balance.core.whole_body.command import BASE, PELVIS, TORSO
from nadia_balance.core.whole_body.command import WholeBodyCommand as Command
from nadia_balance.core.whole_body.command import WholeBodyModel as Model
from nadia_balance.core.whole_body.command import WholeBodyTerms as Terms
from nadia_balance.core.whole_body.params import WholeBodyQpParams as Params

_FORCE = slice(3, 6)  # columns of the base's rows


class Motion(NamedTuple):
    """The task J vdot + b = a, of n rows.

    `rows` are [J, b] (n, nv + 1), as in WholeBodyTerms, `acceleration` a (n,).
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

    def motion(self, terms: Terms, command: Command) -> Motion | None:
        """Returns the motion wanted in this tick; None: any."""


class MomentumTask:
    """Linear momentum, and angular momentum about the CoM, per mass.

    The task for the horizontal force is its direction, from the eCMP to the
    CoM, at any magnitude.  With a task for the horizontal force itself, a
    sinking robot would tilt, a braking one jump.  Angular momentum is damped.
    """

    name = "momentum"

    def __init__(self, params: Params, model: Model):
        force, height = params.momentum_weight, params.height_weight
        moment = params.angular_momentum_weight
        self.weight = np.array([force, force, height, *[moment] * 3])
        self._damping, self._mass = params.angular_momentum_damping, model.mass
        self._selection: Array = np.eye(6)[[3, 4, 5, 0, 1, 2]]

    def motion(self, terms: Terms, command: Command) -> Motion:
        """Returns the rows (6, nv + 1) of force and moment about the CoM."""
        selection, base = self._selection.copy(), terms.rows[BASE]
        # The moment about the CoM: minus the lever arm times the force.  The
        # arm is in M, since the base's velocity is expressed in W.
        selection[3:, _FORCE] = -base[:3, 3:6]
        share = command.momentum_rate[:2] / (self._mass * GRAVITY)
        selection[:2, -1] -= share
        acceleration = np.zeros(6)
        # The force also carries the weight, which is no rate of momentum.
        acceleration[2] = command.momentum_rate[2] / self._mass + GRAVITY
        acceleration[3:] = -self._damping * (
            selection[3:] @ terms.velocities[BASE]
        )
        return Motion(selection @ base, acceleration)


class TrunkTask:
    """PD law for the orientation of torso or pelvis: upright, by the heading.

    The pelvis is turned relative to the heading (see crossing_turn).
    """

    def __init__(self, name: str, params: Params):
        self.name = name
        self.weight: float = getattr(params, f"{name}_weight")
        self._is_pelvis = name == "pelvis"
        self._rows: slice = PELVIS if self._is_pelvis else TORSO
        self._body = 3 if self._is_pelvis else 2  # of `rotations`
        self._kp = params.orientation_gain
        self._kd = 2.0 * params.damping_ratio * math.sqrt(self._kp)

    def motion(self, terms: Terms, command: Command) -> Motion:
        """Returns the rows (3, nv + 1) of the angular acceleration."""
        yaw, rate, acceleration = command.heading
        if self._is_pelvis:
            turn, turn_rate, turn_acceleration = command.turn
            yaw, rate = yaw + turn, rate + turn_rate
            acceleration += turn_acceleration
        error = np.array(rotation_error(yaw, terms.rotations[self._body]))
        velocity = np.array((0.0, 0.0, rate)) - terms.velocities[self._rows]
        wanted = self._kp * error
        wanted[2] += acceleration
        wanted += self._kd * velocity
        return Motion(terms.rows[self._rows], wanted)


class SwingFootTask:
    """PD laws for the sole's orientation and the ankle's position.

    The ankle is to be where the reference of the sole has it.  So the leg moves
    the foot, and not a tilt of the sole, whose orientation has little weight
    until it lands: it is times the command's `flatness`.  The height has a
    weight of its own: at the end of a long step the torques do not suffice for
    all, and a foot that is too low lands while it is fast.
    """

    name = "swing_foot"

    def __init__(self, params: Params, model: Model):
        over, height = params.swing_position_weight, params.swing_height_weight
        turn = [params.swing_orientation_weight] * 3
        self.weight = np.array([*turn, over, over, height])
        self._ankles = model.ankles
        self._kp = np.repeat(
            [params.swing_orientation_gain, params.swing_position_gain], 3
        )
        self._kd = 2.0 * params.damping_ratio * np.sqrt(self._kp)

    def motion(self, terms: Terms, command: Command) -> Motion | None:
        """Returns the rows (6, nv + 1) of the foot; None if both carry."""
        if all(command.contacts):
            return None
        side = command.contacts.index(False)
        yaw, rate, acceleration = command.swing[9:].tolist()
        R_WT, R_WF = tilt(command.normals[side]), terms.rotations[side]
        turn = R_WT @ rotation_error(yaw, R_WT.T @ R_WF)
        # The reference of the ankle, and the arm to it from the sole's centre.
        aim = command.swing[:9].reshape(3, 3)
        aim = aim + self._turned(side, yaw, rate, acceleration) @ R_WT.T
        arm = R_WF @ self._ankles[side]
        error = aim[0] - terms.sole_positions[side] - arm
        rows, now = terms.at_point(side, arm)
        root = math.sqrt(command.flatness)
        wanted = np.array((0.0, 0.0, acceleration, *aim[2].tolist()))
        wanted += self._kp * np.concatenate((turn, error))
        wanted += self._kd * ((0.0, 0.0, rate, *aim[1].tolist()) - now)
        rows[:3] *= root
        wanted[:3] *= root
        return Motion(rows, wanted)

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
                (x, y, z),
                (-rate * y, rate * x, 0.0),
                (
                    -acceleration * y - square * x,
                    acceleration * x - square * y,
                    0.0,
                ),
            )
        )


def usual_tasks(params: Params, model: Model) -> list[Task]:
    """Returns the tasks of the momentum, the trunk and the swing foot."""
    return [
        MomentumTask(params, model),
        TrunkTask("torso", params),
        TrunkTask("pelvis", params),
        SwingFootTask(params, model),
    ]


class WeightedTasks:
    """Tasks as rows [S, r], scaled by the roots of their weights.

    The cost of S vdot + r is the sum of its squares.
    """

    def __init__(self, tasks: Iterable[Task]):
        """Raises ValueError if a weight is negative."""
        self._tasks = []
        for task in tasks:
            weight = np.atleast_1d(np.asarray(task.weight, dtype=float))
            if not (weight >= 0.0).all():
                raise ValueError(
                    f"weight of {task.name} = {task.weight}: must be >= 0"
                )
            self._tasks.append((task, np.sqrt(weight)[:, None]))

    def rows(self, terms: Terms, command: Command) -> Array:
        """Returns [S, r] (n, nv + 1) of this tick, braking links last."""
        parts = []
        for task, root in self._tasks:
            motion = task.motion(terms, command)
            if motion is not None:
                rows = motion.rows.copy()
                rows[:, -1] -= motion.acceleration
                rows *= root
                parts.append(rows)
        if terms.avoidance:
            parts.append(terms.avoidance.braking)
        return np.concatenate(parts)


def rotation_error(yaw: float, R: Array) -> tuple[float, float, float]:
    """Rotation vector in W from R (3, 3) to upright at `yaw` [rad].

    It is the antisymmetric part of R_upright R' as a vector, with the sine of
    the angle as its length: accurate to third order.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, _) = R.tolist()
    return (
        0.5 * (yz - s * zx - c * zy),
        0.5 * (c * zx - s * zy - xz),
        0.5 * (s * (xx + yy) + c * (xy - yx)),
    )
