"""Inertial measurement unit and joint encoders, and the state from them."""

import math
from typing import Any, cast

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, RigidBody
from pydrake.systems.framework import BasicVector, Context

from nadia_balance.core.estimation.complementary import Complementary
from nadia_balance.core.estimation.invariant_ekf import (
    GYRO_BIAS,
    IN_W,
    SIZE,
    Estimate,
    InvariantEkf,
    Legs,
    gammas,
    skew,
)
from nadia_balance.core.estimation.sensors import SAMPLE, SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.ports import (
    Block,
    check_period,
    declare_outcome,
    declare_scratch,
    input_port,
)

_G = np.array([0.0, 0.0, -GRAVITY])
FILTERS: dict[str, type[InvariantEkf | Complementary]] = {
    "invariant": InvariantEkf,
    "complementary": Complementary,
}
# A foot has landed above this share of the weight on it; it is let go below the
# second, before it is lifted and rolls.  It stands when it has settled: within
# 50 ms of a hurried landing a sole turns by up to 40 mrad.
LANDED, RELEASED = 0.4, 0.3
SETTLING = 0.06  # [s]
# Errors of what the robot is told at the start (see `begin`): tilt and height
# are measured, while W is where the robot stands and heads, but for rounding.
START = np.array(((5e-3, 5e-3, 1e-4), (1e-3,) * 3, (1e-4, 1e-4, 5e-3)))

# Shapes of the parts of an Estimate.
_SHAPES = {
    "R": (3, 3),
    "x": (4, 3),
    "bias": (2, 3),
    "heading": (2,),
    "cov": (SIZE, SIZE),
}


def imu_place(
    plant: MultibodyPlant, robot: RobotModel, sensors: SensorParams
) -> tuple[RigidBody, RigidTransform]:
    """The place of the IMU.

    Args:
        plant: plant with the robot.
        robot: robot that carries the IMU.
        sensors: say where.

    Returns:
        The body B of the plant that carries the IMU, and the pose X_BI.

    Raises:
        ValueError: the robot has no such body.
    """
    body = sensors.imu_body or robot.pelvis_body
    if not plant.HasBodyNamed(body):
        raise ValueError(f"imu_body = {body!r}: must be a body of {robot.name}")
    X_BI = RigidTransform(
        RollPitchYaw(*np.radians(sensors.imu_rpy_deg)),
        cast(Any, sensors.imu_position),
    )
    return plant.GetBodyByName(body), X_BI


def imu_motion(
    plant: MultibodyPlant,
    plant_context: Context,
    body: RigidBody,
    X_BI: RigidTransform,
) -> tuple[RigidTransform, SpatialVelocity]:
    """The motion of an IMU.

    Args:
        plant: plant with the robot.
        plant_context: context of the plant.
        body: body B that carries the IMU.
        X_BI: pose of the IMU in the frame of the body.

    Returns:
        The pose X_WI, and the velocity V_WI.
    """
    X_WB = plant.EvalBodyPoseInWorld(plant_context, body)
    V_WB = plant.EvalBodySpatialVelocityInWorld(plant_context, body)
    return X_WB @ X_BI, V_WB.Shift(X_WB.rotation() @ X_BI.translation())


class Imu(Block):
    """Measures the mean angular velocity and specific force over a period.

    `state` is [q, v] of the robot's `control_plant`.  `imu`, (9,), is in the
    IMU's frame I: the mean angular velocity over the period [rad/s] and the
    mean specific force dv / T - g [m/s^2], which a unit integrates at its own
    high rate, with every impact, and the latest angular velocity, a mean of a
    SAMPLE.  Biases and white noise are added; then all is clipped at its range.
    A tick's noise depends on the seed and the tick's number only.  The state
    has the orientation, velocity and bias of the last tick.

    Args:
        robot: robot that carries the IMU.
        sensors: place and errors of the IMU.
        period: control period [s].
        seed: of the noise.

    Raises:
        ValueError: the robot lacks the body that carries the IMU.

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
    ) -> None:
        super().__init__()
        self._period, self._seed = period, seed
        self._plant: Any = robot.control_plant()
        self._body, self._X_BI = imu_place(self._plant, robot, sensors)
        root, short = math.sqrt(period), math.sqrt(SAMPLE)
        self._white = np.repeat(
            (
                sensors.gyro_noise / root,
                sensors.force_noise / root,
                sensors.gyro_noise / short,
            ),
            3,
        )
        self._walk = np.repeat(
            (sensors.gyro_walk * root, sensors.force_walk * root), 3
        )
        self._bias = np.repeat((sensors.gyro_bias, sensors.force_bias), 3)
        self._range = sensors.imu_range
        self._state = input_port(
            self, "state", self._plant.num_multibody_states()
        )
        self._scratch: Any = declare_scratch(self, self._plant)
        declare_outcome(
            self,
            outputs={"imu": 9},
            memory={"motion": 12, "bias": 6, "ticks": 1},
            calc=self._calc,
            period=period,
            holds=True,
        )

    def _calc(self, context: Context, last: dict[str, Any]) -> tuple[Any, ...]:
        plant_context = self._scratch.Eval(context)
        self._plant.SetPositionsAndVelocities(
            plant_context, self._state(context)
        )
        X_WI, V_WI = imu_motion(
            self._plant, plant_context, body=self._body, X_BI=self._X_BI
        )
        R: Any = X_WI.rotation().matrix()
        v: Any = V_WI.translational()
        tick = int(last["ticks"][0])
        rate, force = np.zeros(3), R.T @ -_G  # at rest
        if tick:
            last_R = last["motion"][:9].reshape(3, 3)
            turn: Any = RotationMatrix(last_R.T @ R).ToAngleAxis()
            rate = turn.angle() * turn.axis() / self._period
            R_mean = last_R @ gammas(0.5 * self._period * rate)[0]
            force = ((v - last["motion"][9:]) / self._period - _G) @ R_mean
        random = np.random.default_rng((self._seed, tick, 1))
        walked, noise = random.standard_normal(6), random.standard_normal(9)
        bias = last["bias"] + (self._walk if tick else self._bias) * walked
        imu = np.concatenate((rate, force, V_WI.rotational() @ R))
        imu += self._white * noise
        imu += np.concatenate((bias, bias[:3]))
        return (
            np.clip(imu, -self._range, self._range),
            R.ravel(),
            v,
            bias,
            (tick + 1.0,),
        )


class JointEncoders(Block):
    """Measures joint angles and speeds with white noise, a sample a period.

    `state` is [q, v] of the robot's `control_plant`, `joints` (2 nj,) are the
    angles [rad], then the speeds [rad/s].  The noise of a tick depends on the
    seed and the tick's number only.

    Args:
        robot: robot with the joints.
        sensors: errors of the encoders.
        period: control period [s].
        seed: of the noise.

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
    ) -> None:
        super().__init__()
        plant = robot.control_plant()
        self._period, self._seed = period, seed
        joints = plant.num_velocities() - 6
        self._deviations = np.repeat(
            (sensors.joint_noise, sensors.joint_speed_noise), joints
        )
        self._state = input_port(self, "state", plant.num_multibody_states())
        self.DeclareVectorOutputPort(
            "joints",
            2 * joints,
            self._calc,
            {self._state.ticket(), self.time_ticket()},
        )

    def _calc(self, context: Context, output: BasicVector) -> None:
        state = self._state(context)
        n = self._deviations.size // 2
        tick = round(context.get_time() / self._period)
        random = np.random.default_rng((self._seed, tick, 2))
        noise: Any = self._deviations * random.standard_normal(2 * n)
        output.SetFromVector(
            np.concatenate((state[7 : 7 + n], state[-n:])) + noise
        )


class StateEstimator(Block):
    """Estimates [q, v] by an InvariantEkf, or another of FILTERS.

    `imu` is that of an Imu, `joints` of JointEncoders, `foot_forces` (2,) [N].
    `estimated_state` is [q, v] of the robot's `control_plant`: the joints as
    measured, the pelvis from the IMU's pose.  `estimate_covariance` (81,) is
    that of (angle, velocity, position) of the pelvis, (9, 9) in W [rad], [m/s],
    [m].  A foot stands by its force, with hysteresis, once it has settled.
    The state is the Estimate, and since how many ticks each foot is loaded.
    RuntimeError: the IMU is saturated, which says nothing of the motion.

    Args:
        robot: robot whose state is estimated.
        sensors: place and errors of the sensors.
        period: control period [s].
        q: positions at the start (nq,), for the pose of the base; None: by the
            first joints, level soles stand about W's origin.
        height: height of the ground [m], if known.
        kind: name of the filter, one of FILTERS.

    Raises:
        ValueError: the robot lacks the body that carries the IMU, or there is
            no such filter.

    .. pydrake_system::

        name: StateEstimator
        input_ports: [imu, joints, foot_forces]
        output_ports: [estimated_state, estimate_covariance]
    """

    def __init__(
        self,
        robot: RobotModel,
        sensors: SensorParams,
        period: float,
        q: Array | None,
        height: float | None = None,
        kind: str = "invariant",
    ) -> None:
        super().__init__()
        check_period(period)
        require(
            kind in FILTERS,
            f"kind = {kind!r}: must be one of {', '.join(FILTERS)}",
        )
        self._plant: Any = robot.control_plant()
        self._filter = FILTERS[kind](sensors, period)
        self._height, self._weight = height, robot.mass * GRAVITY
        self._settling = round(SETTLING / period)  # [ticks]
        self._X_WB = None if q is None else _base_pose(q)  # at the start
        self._nj = self._plant.num_velocities() - 6
        self._body, self._X_BodyI = imu_place(self._plant, robot, sensors)
        self._soles = [
            (self._plant.GetFrameByName(name), robot.X_FootSole[side])
            for side, name in robot.foot_bodies.items()
        ]
        self._range = sensors.imu_range
        self._rate_var = sensors.gyro_noise**2 / SAMPLE
        self._imu = input_port(self, "imu", 9)
        self._joints = input_port(self, "joints", 2 * self._nj)
        self._forces = input_port(self, "foot_forces")
        self._scratch: Any = declare_scratch(self, self._plant)
        declare_outcome(
            self,
            outputs={
                "estimated_state": self._plant.num_multibody_states(),
                "estimate_covariance": 81,
            },
            memory={
                **{name: math.prod(shape) for name, shape in _SHAPES.items()},
                "loaded": 2,
            },
            calc=self._calc,
            period=period,
            holds=True,
        )

    @staticmethod
    def with_start_error(q: Array, seed: int) -> Array:
        """The positions of a robot, its base with an error of START.

        Args:
            q: positions (nq,).
            seed: of the error.

        Returns:
            Positions (nq,).
        """
        turn, move = np.random.default_rng((seed, 0, 4)).standard_normal((2, 3))
        error: Any = gammas(START[0] * turn)[0]
        R_WB = RotationMatrix(error) @ _base_pose(q).rotation()
        positions = q.copy()
        positions[:4] = R_WB.ToQuaternion().wxyz()
        positions[4:7] += START[2] * move
        return positions

    def _calc(self, context: Context, last: dict[str, Any]) -> tuple[Any, ...]:
        joints = self._joints(context)
        imu = self._imu(context)
        if (np.abs(imu) >= self._range).any():
            raise self._imu.error(context, "is saturated")
        X_BI, V_BI, legs = self._legs(context, joints, imu[6:])
        loads = self._forces(context) / self._weight
        if last["cov"].any():
            loaded = (last["loaded"] + 1.0) * (
                loads > np.where(last["loaded"] > 0.0, RELEASED, LANDED)
            )
            parts = {name: last[name].reshape(n) for name, n in _SHAPES.items()}
            estimate = self._filter.predict(Estimate(**parts), imu[:6])
        else:
            loaded = np.full(2, self._settling + 1.0)
            X_WI = _above(legs) if self._X_WB is None else self._X_WB @ X_BI
            estimate = self._filter.begin(
                X_WI.rotation().matrix(), X_WI.translation(), START
            )
        estimate = self._standing(
            estimate,
            legs,
            stood=last["loaded"] > self._settling,
            stands=loaded > self._settling,
        )
        R_WB, p, w, v, covariance = self._pelvis(estimate, imu, X_BI, V_BI)
        return (
            # The estimated state, in six parts.
            RotationMatrix.ProjectToRotationMatrix(R_WB).ToQuaternion().wxyz(),
            p,
            joints[: self._nj],
            w,
            v,
            joints[self._nj :],
            covariance.ravel(),
            *(part.ravel() for part in estimate),
            loaded,
        )

    def _standing(
        self, estimate: Estimate, legs: Legs, stood: Any, stands: Any
    ) -> Estimate:
        """The estimate with the feet that stand; some `stood` before."""
        estimate = self._filter.correct(estimate, stood & stands, legs)
        landed = np.flatnonzero(stands & ~stood)
        for i in landed.tolist():
            estimate = self._filter.touch(estimate, i, legs)
        # One has settled: the other, with all of the weight until now, is flat.
        if self._height is not None:
            for i in 1 - landed[stands[1 - landed]]:
                estimate = self._filter.level(
                    estimate, i, height=self._height, legs=legs
                )
        return estimate

    def _legs(
        self, context: Context, joints: Array, rate: Array
    ) -> tuple[Any, Array, Legs]:
        """What the joints (2 nj,) and the IMU's `rate` (3,) say [rad], [s].

        X_BI of IMU I in base B, its angular and linear velocity V_BI (2, 3),
        and the soles, without the base.
        """
        plant_context = self._scratch.Eval(context)
        n = self._nj
        # The base is at W's origin, and at rest.
        base, rest = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], np.zeros(6)
        self._plant.SetPositionsAndVelocities(
            plant_context, np.concatenate((base, joints[:n], rest, joints[n:]))
        )
        X_IB: Any = self._X_BodyI.inverse()
        R_IB, body = X_IB.rotation().matrix(), self._body.body_frame()
        p, R, J = np.empty((2, 3)), np.empty((2, 3, 3)), np.empty((2, 6, n))
        for i, (frame, X) in enumerate(self._soles):
            X_IF = X_IB @ frame.CalcPose(plant_context, body) @ X
            p[i] = X_IF.translation()
            R[i] = X_IF.rotation().matrix()
            J_B = self._plant.CalcJacobianSpatialVelocity(
                plant_context,
                JacobianWrtVariable.kV,
                frame_B=frame,
                p_BoBp_B=X.translation(),
                frame_A=body,
                frame_E=body,
            )
            J[i] = (R_IB @ J_B[:, 6:].reshape(2, 3, n)).reshape(6, n)
        X_BI, V = imu_motion(
            self._plant, plant_context, body=self._body, X_BI=self._X_BodyI
        )
        v = J[:, 3:] @ joints[n:] - p @ skew(rate)
        return (
            X_BI,
            np.array((V.rotational(), V.translational())),
            Legs(p=p, R=R, J=J, v=v),
        )

    def _pelvis(
        self, estimate: Estimate, imu: Array, X_BI: Any, V_BI: Array
    ) -> tuple[Any, Array, Array, Array, Array]:
        """R_WB, p_WB, w_WB, v_WB of the base, and their covariance (9, 9)."""
        R = estimate.R @ X_BI.rotation().matrix().T
        r = R @ X_BI.translation()
        w = estimate.R @ (imu[6:] - estimate.bias[0]) - R @ V_BI[0]
        v = estimate.x[0] - skew(w) @ r - R @ V_BI[1]
        p = estimate.x[1] - r
        T = np.eye(9)
        T[3:, :3] = -skew(np.array((v, p))).reshape(6, 3)
        T = T @ IN_W
        arm = skew(r)
        T[3:6, GYRO_BIAS] -= arm @ estimate.R  # of w in w x r
        covariance = T @ estimate.cov @ T.T
        covariance[3:6, 3:6] += self._rate_var * (arm @ arm.T)
        return R, p, w, v, covariance


def _above(legs: Legs) -> Any:
    """X_WI of the IMU if the left sole is level, W's origin between both."""
    R_WI = legs.R[0].T
    return RigidTransform(
        RotationMatrix(R_WI), cast(Any, -R_WI @ legs.p.mean(axis=0))
    )


def _base_pose(q: Any) -> Any:
    """X_WB of the base at positions `q` (nq,)."""
    return RigidTransform(RotationMatrix(Quaternion(q[:4])), q[4:7])
