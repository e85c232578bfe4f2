"""Models of an inertial measurement unit and of joint encoders."""

import math

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, LeafSystem

from nadia_balance.core.estimation.invariant_ekf import gammas
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.ports import Input, Outcome, declare_scratch

SAMPLE = 0.001  # of the gyro's latest rate [s]
_G = np.array([0.0, 0.0, -GRAVITY])


def imu_place(
    plant: MultibodyPlant, robot: RobotModel, sensors: SensorParams
) -> tuple[RigidBody, RigidTransform]:
    """Returns the body of `plant` that carries the IMU, and its pose there.

    Raises ValueError: the robot has no such body.
    """
    body = sensors.imu_body or robot.pelvis_body
    if not plant.HasBodyNamed(body):
        raise ValueError(f"imu_body = {body!r}: must be a body of {robot.name}")
    turn = RollPitchYaw(np.radians(sensors.imu_rpy_deg))
    return plant.GetBodyByName(body), RigidTransform(turn, sensors.imu_position)


def imu_motion(
    plant: MultibodyPlant, own: Context, body: RigidBody, X_BI: RigidTransform
) -> tuple[RigidTransform, SpatialVelocity]:
    """Returns the pose X_WI and the velocity V_WI of an IMU on a `body`."""
    X_WB = plant.EvalBodyPoseInWorld(own, body)
    V_WB = plant.EvalBodySpatialVelocityInWorld(own, body)
    return X_WB @ X_BI, V_WB.Shift(X_WB.rotation() @ X_BI.translation())


class Imu(LeafSystem):
    """Measures the mean angular velocity and specific force over a period.

    `state` is [q, v] of the robot's `control_plant`.  `imu`, (9,), is
    in the IMU's frame I: the rotation per period [rad/s] and dv / T - g
    [m/s^2], which a unit integrates at its own high rate, with every impact,
    and the latest angular velocity, a mean of a SAMPLE.  Biases and white noise
    are added; then all is clipped at its range.  A tick's noise depends on the
    seed and the tick's number only.  The state has the orientation, velocity
    and bias of the last tick.

    .. pydrake_system::

        name: Imu
        input_ports: [state]
        output_ports: [imu]
    """

    def __init__(
        self,
        robot: RobotModel,
        sensors: SensorParams,
        period: float,
        seed: int = 0,
    ):
        """Measures the `robot` every `period` [s].

        Raises ValueError: the robot lacks the body that carries the IMU.
        """
        super().__init__()
        self._period, self._seed, s = period, seed, sensors
        self._plant = plant = robot.control_plant()
        self._place = imu_place(plant, robot, sensors)
        root, short = math.sqrt(period), math.sqrt(SAMPLE)
        noise = s.gyro_noise / root, s.force_noise / root, s.gyro_noise / short
        self._white = np.repeat(noise, 3)
        walk = s.gyro_walk * root, s.force_walk * root
        self._walk = np.repeat(walk, 3)
        self._bias = np.repeat((s.gyro_bias, s.force_bias), 3)
        self._range = s.imu_range
        self._state = Input(self, "state", plant.num_multibody_states())
        self._scratch = declare_scratch(self, plant)
        memory, needs = {"motion": 12, "bias": 6, "ticks": 1}, [self._state]
        Outcome(self, {"imu": 9}, memory, self._calc, period, needs, holds=True)

    def _calc(self, context, last) -> tuple:
        own = self._scratch.Eval(context)
        self._plant.SetPositionsAndVelocities(own, self._state(context))
        X_WI, V_WI = imu_motion(self._plant, own, *self._place)
        R, v = X_WI.rotation().matrix(), V_WI.translational()
        tick = int(last["ticks"][0])
        rate, force = np.zeros(3), R.T @ -_G  # at rest
        if tick:
            before = last["motion"][:9].reshape(3, 3)
            turn = RotationMatrix(before.T @ R).ToAngleAxis()
            rate = turn.angle() * turn.axis() / self._period
            R_mean = before @ gammas(0.5 * self._period * rate)[0]
            dv = v - last["motion"][9:]
            force = (dv / self._period - _G) @ R_mean
        random = np.random.default_rng((self._seed, tick, 1))
        walked, noise = random.standard_normal(6), random.standard_normal(9)
        bias = last["bias"] + (self._walk if tick else self._bias) * walked
        told = np.concatenate((rate, force, V_WI.rotational() @ R))
        told += self._white * noise
        told += np.concatenate((bias, bias[:3]))
        told = np.clip(told, -self._range, self._range)
        return told, R.ravel(), v, bias, (tick + 1.0,)


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
        noise = sensors.joint_noise, sensors.joint_speed_noise
        self._deviations = np.repeat(noise, joints)
        self._state = Input(self, "state", plant.num_multibody_states())
        needs = {self._state.ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("joints", 2 * joints, self._calc, needs)

    def _calc(self, context, output):
        state, n = self._state(context), self._deviations.size // 2
        tick = round(context.get_time() / self._period)
        random = np.random.default_rng((self._seed, tick, 2))
        noise = random.standard_normal(2 * n)
        told = np.concatenate((state[7 : 7 + n], state[-n:]))
        output.SetFromVector(told + self._deviations * noise)
