"""Model of the joint drives: torque lag and torque-speed limits."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.body.joint_drives import lag_share, torque_limits
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import actuated_velocities
from nadia_balance.systems.ports import Input


class JointDrives(LeafSystem):
    """Filters the commanded torques: first-order lag, torque-speed limits.

    `actuation` (nu,) [N m] are the commanded torques, `torques` (nu,) [N m]
    those of the drives, both in the order of the plant's actuators; `state` is
    [q, v] of the plant.  The discrete state is `torques`, 0 at the start; it is
    updated in every step of the plant, so that a command acts one step late.

    .. pydrake_system::

        name: JointDrives
        input_ports: [actuation, state]
        output_ports: [torques]
    """

    def __init__(self, plant: MultibodyPlant, robot: RobotModel):
        """Models the drives of `robot`, the only one in `plant`.

        Raises ValueError: the robot's fidelity is ideal: it has no drives.
        """
        super().__init__()
        if robot.drives is None:
            raise ValueError("fidelity = 'ideal': must be realistic")
        velocities = actuated_velocities(plant)
        self._max_speed = robot.max_joint_speeds[velocities - 6]
        self._speeds = plant.num_positions() + velocities
        self._max_torque = plant.GetEffortUpperLimits()
        self._corner_speed = robot.drives.corner_speed
        step = plant.time_step()
        self._share = lag_share(robot.drives.bandwidth, step)
        self._actuation = Input(self, "actuation", velocities.size)
        self._plant_state = Input(self, "state", plant.num_multibody_states())
        state = self.DeclareDiscreteState(velocities.size)
        self.DeclareStateOutputPort("torques", state)
        self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._follow)

    def _follow(self, context, new):
        torques = context.get_discrete_state_vector().value()
        missing = self._actuation(context) - torques
        least, most = torque_limits(
            self._plant_state(context)[self._speeds],
            self._max_torque,
            self._max_speed,
            self._corner_speed,
        )
        torques = torques + self._share * missing
        new.set_value(np.minimum(np.maximum(torques, least), most))
        return EventStatus.Succeeded()
