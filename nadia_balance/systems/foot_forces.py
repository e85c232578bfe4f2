"""Foot forces of a robot that has no sensors of them."""

import math
from typing import Any

import numpy as np
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces
from pydrake.systems.framework import Context

from nadia_balance.core.estimation.complementary import gravity_direction
from nadia_balance.core.estimation.foot_forces import (
    TORQUE_ERROR,
    SoleTerms,
    carrying,
    observed,
    observer_share,
    sole_forces,
)
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import (
    actuated_velocities,
    effort_limits,
    joints_above,
)
from nadia_balance.systems.estimation import imu_place
from nadia_balance.systems.ports import (
    Block,
    check_period,
    declare_outcome,
    declare_scratch,
    input_port,
)

_V = JacobianWrtVariable.kV


class FootForceEstimator(Block):
    """Estimates the vertical force on each foot by a momentum observer.

    `imu` is that of an Imu, `joints` of JointEncoders, `torques` (nu,) [N m]
    those of the drives now, in the order of the actuators.  `foot_forces` (2,)
    [N] are 0 for a foot that does not carry (see `carrying`), as those of a
    FootForceSensor.  No pose of the robot is needed: all is computed in the
    frame of the base, where a body at rest is accelerated by the specific force
    of the IMU.

    The state is the observer's, gravity's direction in the frame of the IMU,
    joints, torques and rate of the last tick, and which feet carried.  At the
    start the robot is at rest on feet that carry.

    Args:
        robot: robot whose feet are loaded.
        sensors: place and errors of the sensors.
        period: control period [s].

    Raises:
        ValueError: the robot lacks the body that carries the IMU.

    .. pydrake_system::

        name: FootForceEstimator
        input_ports: [imu, joints, torques]
        output_ports: [foot_forces]
    """

    def __init__(
        self, robot: RobotModel, sensors: SensorParams, period: float
    ) -> None:
        super().__init__()
        check_period(period)
        self._plant: Any = robot.control_plant()
        self._period, self._weight = period, robot.mass * GRAVITY
        nv = self._plant.num_velocities()
        self._nj = nv - 6
        body, self._X_BodyI = imu_place(self._plant, robot, sensors)
        self._imu_body = body.body_frame()
        self._actuated = actuated_velocities(self._plant)
        self._torque_noise = TORQUE_ERROR * effort_limits(self._plant)
        # Of a difference of speeds, as the observer filters it.
        share = observer_share(period)
        self._acceleration_noise = (
            sensors.joint_speed_noise / period * share
        ) * math.sqrt(2.0 / (2.0 - share))
        self._soles = [
            (self._plant.GetFrameByName(name), robot.X_FootSole[side])
            for side, name in robot.foot_bodies.items()
        ]
        self._legs = np.array(
            [
                [j.velocity_start() for j in joints_above(self._plant, name)]
                for name in robot.foot_bodies.values()
            ]
        )
        self._imu = input_port(self, "imu", 9)
        self._joints = input_port(self, "joints", 2 * self._nj)
        self._torques = input_port(self, "torques", self._actuated.size)
        self._scratch: Any = declare_scratch(self, self._plant)
        declare_outcome(
            self,
            outputs={"foot_forces": 2},
            memory={
                "external": nv,
                "up": 3,
                "joints": 2 * self._nj,
                "torques": self._actuated.size,
                "rate": 3,
                "carried": 2,
            },
            calc=self._calc,
            period=period,
            holds=True,
        )

    def _calc(self, context: Context, last: dict[str, Any]) -> tuple[Any, ...]:
        imu, joints = self._imu(context), self._joints(context)
        torques = self._torques(context)
        is_first = not last["up"].any()
        if is_first:
            last = {
                "up": imu[3:6],
                "joints": joints,
                "torques": torques,
                "rate": imu[6:],
                "carried": np.ones(2),
            }
        up = gravity_direction(last["up"], imu, self._period)
        residual, terms = self._dynamics(
            self._scratch.Eval(context),
            imu=imu,
            joints=(last["joints"], joints),
            torques=0.5 * (last["torques"] + torques),
            rates=(last["rate"], imu[6:]),
            up=up,
        )
        external = residual
        if not is_first:
            external = observed(last["external"], residual, self._period)
        forces = sole_forces(
            external,
            terms,
            weight=self._weight,
            acceleration_noise=self._acceleration_noise,
            torque_noise=self._torque_noise,
        )
        carried = carrying(forces, last["carried"], self._weight)
        return forces * carried, external, up, joints, torques, imu[6:], carried

    def _dynamics(
        self,
        plant_context: Context,
        imu: Array,
        joints: tuple[Array, Array],
        torques: Array,
        rates: tuple[Array, Array],
        up: Array,
    ) -> tuple[Array, SoleTerms]:
        """The residual forces (nv,) over a period, and the terms in its middle.

        `joints` and `rates` are those of its begin and its end, `torques` the
        mean.  W is the frame of the base in the middle, at rest but for the
        acceleration of a free fall.
        """
        plant, world = self._plant, self._plant.world_frame()
        n = self._nj
        mean = 0.5 * (joints[0] + joints[1])
        vdot, rate = np.zeros(6 + n), 0.5 * (rates[0] + rates[1])
        vdot[6:] = (joints[1] - joints[0])[n:] / self._period
        base = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        plant.SetPositions(plant_context, np.concatenate((base, mean[:n])))
        X_WI = self._imu_body.CalcPoseInWorld(plant_context) @ self._X_BodyI
        R = X_WI.rotation().matrix()
        p_BodyI = self._X_BodyI.translation()
        J = plant.CalcJacobianSpatialVelocity(
            plant_context, _V, self._imu_body, p_BodyI, world, world
        )
        w = R @ rate - J[:3, 6:] @ mean[n:]
        plant.SetVelocities(
            plant_context, np.concatenate((w, np.zeros(3), mean[n:]))
        )
        motion = np.concatenate((R @ (rates[1] - rates[0]), R @ imu[3:6]))
        motion[:3] /= self._period
        motion -= J[:, 6:] @ vdot[6:]
        motion -= plant.CalcBiasSpatialAcceleration(
            plant_context, _V, self._imu_body, p_BodyI, world, world
        ).get_coeffs()
        vdot[:6] = np.linalg.solve(J[:, :6], motion)
        vdot[3:6] += plant.gravity_field().gravity_vector()
        forces = MultibodyForces(plant)  # of gravity and the joints' damping
        plant.CalcForceElementsContribution(plant_context, forces)
        residual = plant.CalcInverseDynamics(plant_context, vdot, forces)
        residual[self._actuated] -= torques
        return residual, self._terms(plant_context, R @ up)

    def _terms(self, plant_context: Context, up: Array) -> SoleTerms:
        plant, world = self._plant, self._plant.world_frame()
        J = [
            plant.CalcJacobianSpatialVelocity(
                plant_context, _V, foot, X_FootSole.translation(), world, world
            )
            for foot, X_FootSole in self._soles
        ]
        M = plant.CalcMassMatrix(plant_context)
        return SoleTerms(M=M, J=np.array(J), up=up, legs=self._legs)
