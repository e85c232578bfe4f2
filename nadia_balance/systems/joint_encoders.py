"""Model of the joint encoders."""

import numpy as np
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.ports import Input


class JointEncoders(LeafSystem):
    """Measures joint angles and speeds with white noise, a sample a period.

    `state` is [q, v] of the robot's `control_plant`, `joints` (2 nj,) are the
    angles [rad], then the speeds [rad/s].  The noise of a tick depends on the
    seed and the tick's number only.

    .. pydrake_system::

        name: JointEncoders
        input_ports: [state]
        output_ports: [joints]
    """

    def __init__(
        self,
        robot: RobotModel,
        sensors: SensorParams,
        period: float,
        seed: int = 0,
    ):
        """Measures the `robot` every `period` [s]."""
        super().__init__()
        plant = robot.control_plant()
        self._period, self._seed = period, seed
        joints = plant.num_velocities() - 6
        self._deviations = np.repeat(
            (sensors.joint_noise, sensors.joint_speed_noise), joints
        )
        self._state = Input(self, "state", plant.num_multibody_states())
        self.DeclareVectorOutputPort(
            "joints",
            2 * joints,
            self._calc,
            {self._state.ticket(), self.time_ticket()},
        )

    def _calc(self, context, output):
        state, n = self._state(context), self._deviations.size // 2
        tick = round(context.get_time() / self._period)
        random = np.random.default_rng((self._seed, tick, 2))
        noise = random.standard_normal(2 * n)
        told = np.concatenate((state[7 : 7 + n], state[-n:]))
        output.SetFromVector(told + self._deviations * noise)
