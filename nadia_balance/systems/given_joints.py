"""Joints that belong to somebody else."""

from bisect import bisect_right
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import check_number, require
from nadia_balance.systems.ports import TICK_TOLERANCE, Block, input_port


class GivenMotion(NamedTuple):
    """What a joint is told, by whom it belongs to.

    Args:
        times: from which each of the positions counts (n,) [s].
        positions: (n,) [rad].
        stiffness: of its drive [N m/rad].
        damping: of its drive [N m s/rad].
    """

    times: Array
    positions: Array
    stiffness: float
    damping: float


class GivenJoints(Block):
    """Commands some joints in the place of the controller.

        u = kp (q_d - q) - kd v

    is what their drives make of it, with q_d the position that counts now.  All
    other joints are commanded as the controller does.  `joint_command` (5 nu,)
    is as of WholeBodyInverseDynamics, whose `given_joints` these are to be.

    Args:
        motions: by the joint's name; before the first time the first position
            counts, too.
        plant: with the actuators of all joints.

    Raises:
        ValueError: a joint without a drive, times that fall, a number that is
            not finite, or a gain < 0.

    .. pydrake_system::

        name: GivenJoints
        input_ports: [joint_command]
        output_ports: [joint_command]
    """

    def __init__(
        self, motions: Mapping[str, GivenMotion], plant: MultibodyPlant
    ) -> None:
        super().__init__()
        numbers = {
            plant.get_joint_actuator(index).joint().name(): i
            for i, index in enumerate(plant.GetJointActuatorIndices())
        }
        for name, motion in motions.items():
            require(name in numbers, f"{name}: must be a joint with a drive")
            require(
                len(motion.times) == len(motion.positions) > 0
                and bool(np.isfinite([motion.times, motion.positions]).all())
                and bool((np.diff(motion.times) > 0.0).all()),
                f"{name}: must have a position for each of some rising times",
            )
            for gain in "stiffness", "damping":
                check_number(
                    f"{name}: {gain}", getattr(motion, gain), least=0.0
                )
        self._motions = {
            numbers[name]: (
                (np.asarray(motion.times) - TICK_TOLERANCE).tolist(),
                motion,
            )
            for name, motion in motions.items()
        }
        self._size = 5 * plant.num_actuators()
        self._command = input_port(self, "joint_command", self._size)
        self.DeclareVectorOutputPort(
            "joint_command",
            self._size,
            self._calc,
            {self._command.ticket(), self.time_ticket()},
        )

    def _calc(self, context: Context, output: BasicVector) -> None:
        command = self._command(context).reshape(5, -1).copy()
        for number, (times, motion) in self._motions.items():
            now = max(bisect_right(times, context.get_time()) - 1, 0)
            command[:, number] = (
                motion.positions[now],
                0.0,
                0.0,
                motion.stiffness,
                motion.damping,
            )
        output.SetFromVector(command.ravel())
