"""A controller for LeRobot's G1, by the three names that it asks for.

LeRobot calls `run_step` once a `control_dt` in a thread of its own, and sends
the targets that it returns with the gains kp and kd, at rest and without
torques: what is asked of the drives is put into the targets.  Its states have
no time, so that a call is a period; one that is late is not known.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from nadia_balance.balance_controller import controller_params
from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import require
from nadia_balance.wire.balance import process_of
from nadia_balance.wire.g1_motors import JOINTS, motors_of
from nadia_balance.wire.kinds import joint_names
from nadia_balance.wire.messages import RobotState
from nadia_balance.wire.process import SILENCE, ProcessParams, damping

AXES = ("remote.ly", "remote.lx", "remote.rx")  # forward, left, turn
_SIGNS = np.array((1.0, -1.0, -1.0))


class LeRobotController:
    """Takes a G1's posture, waits for its weight, and balances it.

        q = q_now + (tau + kp_c (q_c - q_now) + kd_c (dq_c - dq_now)
                     + kd dq_now) / kp

    is the target by which kp (q - q_now) - kd dq_now, the law of LeRobot's
    drives, gives the torque of a JointCommand c at the time of the state.

    All is in the order of the G1's motors.  A state that is refused changes
    nothing, for as long as the robot is not silent.

    Args:
        robot: a model's name, or a robot.yaml, with the joints of LeRobot's G1.
        sensors: how wrong its IMU and encoders are, see load_sensors.
        tell: takes a line for each event.

    Raises:
        ValueError: there is no such robot, it is no G1, or there are no such
            sensors.
    """

    def __init__(
        self,
        robot: str = "g1",
        sensors: str = "proprioceptive",
        tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.control_dt = controller_params(robot).control_period
        params = ProcessParams(sample_period=self.control_dt)
        model, self._process = process_of(robot, sensors, tell, params)
        # Where the motors are among the robot's joints, and the other way.
        self._motors = motors_of(joint_names(model), f"robot = {robot!r}")
        self._joints = np.argsort(self._motors)
        limits = self._process.limits
        self.kp = self._process.stiffness[self._joints]
        self.kd = self.kp * params.posture_damping
        self._damping = damping(np.zeros(len(limits)), limits)
        self._keys = [lerobot_name(joint) for joint in JOINTS]
        self.reset()

    def reset(self) -> None:
        """Begins anew: its next steps take the posture."""
        self._steps = self._heard = 0
        self._command = self._damping
        self._last: Array | None = None  # targets [rad]
        self._process.stop("reset")
        self._process.forget()
        self._process.start()

    def run_step(
        self, action: Mapping[str, float], lowstate: Any
    ) -> dict[str, float]:
        """The joint targets of a period.

        Args:
            action: what the remote control says, by AXES; other keys are not
                used.
            lowstate: LeRobot's state.

        Returns:
            The targets [rad], by LeRobot's names of the joints.

        Raises:
            ValueError: the state is of a robot with fewer joints.
        """
        self._steps += 1
        motors, imu = lowstate.motor_state, lowstate.imu_state
        require(
            len(motors) >= len(self._keys),
            f"lowstate.motor_state has {len(motors)} motors: must have "
            f"{len(self._keys)}",
        )
        q, dq, tau = (
            np.array([getattr(motors[i], name) for i in self._motors])
            for name in ("q", "dq", "tau_est")
        )
        state = RobotState(
            time=self._steps * self.control_dt,
            q=q,
            dq=dq,
            tau=tau,
            quaternion=np.array(imu.quaternion),
            gyro=np.array(imu.gyroscope),
            force=np.array(imu.accelerometer),
            sticks=_SIGNS * [action.get(axis, 0.0) for axis in AXES],
        )
        answer = self._process.hear(state)
        if answer:
            self._command, self._heard = answer, self._steps
        elif (self._steps - self._heard) * self.control_dt > SILENCE:
            self._command = self._process.silent() or self._damping
        targets = self._targets(state)
        if not np.isfinite(targets).all():  # nor is what the joints tell
            targets = (
                np.nan_to_num(q[self._joints])
                if self._last is None
                else self._last
            )
        self._last = targets
        return dict(zip(self._keys, targets.tolist(), strict=True))

    def _targets(self, state: RobotState) -> Array:
        """The targets (n,) that give the command, by motor."""
        command = self._command
        torque = (
            command.tau
            + command.kp * (command.q - state.q)
            + command.kd * (command.dq - state.dq)
        )
        q, dq, torque = (x[self._joints] for x in (state.q, state.dq, torque))
        return np.asarray(q + (torque + self.kd * dq) / self.kp)


def lerobot_name(joint: str) -> str:
    """LeRobot's key of a joint's target.

    Args:
        joint: its name in the URDF, such as left_hip_pitch_joint.

    Returns:
        The key, such as kLeftHipPitch.q.
    """
    words = joint.removesuffix("_joint").split("_")
    return f"k{''.join(word.capitalize() for word in words)}.q"
