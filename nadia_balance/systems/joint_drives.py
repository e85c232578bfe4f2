"""The drives between the commanded torques and the joints."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.joint_drives import lag_share, torque_limits
from nadia_balance.robot import RobotModel
from nadia_balance.systems.ports import VectorInput


class JointDrives(LeafSystem):
    """Follows the commanded torques as real drives do.

    With a lag, and within the torque-speed line of each joint.  `actuation`
    (nu,) [N m] is what is commanded, `torques` (nu,) [N m] what is there, both
    in the order of the plant's actuators; `state` is [q, v] of the plant's
    robot.  The discrete state is `torques`; it follows in every step of the
    plant, so that a command is felt one step late.

    .. pydrake_system::

        name: JointDrives
        input_ports: [actuation, state]
        output_ports: [torques]
    """

    def __init__(self, plant: MultibodyPlant, robot: RobotModel):
        """The drives of `robot` in its `plant`, with its `drives`."""
        super().__init__()
        indices = plant.GetJointActuatorIndices()
        actuators = [plant.get_joint_actuator(i) for i in indices]
        first = plant.num_positions()
        self._columns = np.array(
            [first + a.joint().velocity_start() for a in actuators]
        )
        joints = self._columns - first - 6
        self._max_torque = np.array([a.effort_limit() for a in actuators])
        self._max_speed = robot.max_joint_speeds[joints]
        self._corner_speed = robot.drives.corner_speed
        step = plant.time_step()
        self._share = lag_share(robot.drives.bandwidth, step)
        self._actuation = VectorInput(self, "actuation", len(actuators))
        size = plant.num_multibody_states()
        self._plant_state = self.DeclareVectorInputPort("state", size)
        state = self.DeclareDiscreteState(len(actuators))
        self.DeclareStateOutputPort("torques", state)
        self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._follow)

    def _follow(self, context, new):
        torques = context.get_discrete_state_vector().value()
        wanted = self._actuation(context)
        speed = self._plant_state.Eval(context)[self._columns]
        least, most = torque_limits(
            speed, self._max_torque, self._max_speed, self._corner_speed
        )
        torques = torques + self._share * (wanted - torques)
        new.set_value(np.minimum(np.maximum(torques, least), most))
        return EventStatus.Succeeded()
