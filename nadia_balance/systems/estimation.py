"""Inertial measurement unit and joint encoders, and the state from them."""

import math
from typing import NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, RigidBody
from pydrake.systems.framework import Context, LeafSystem

from nadia_balance.core.estimation import invariant_ekf as ekf
from nadia_balance.core.estimation.complementary import Complementary
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import Side
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.ports import Input, Outcome, declare_scratch

SAMPLE = 0.001  # of the gyro's latest rate [s]
_G = np.array([0.0, 0.0, -GRAVITY])
FILTERS = {"invariant": ekf.InvariantEkf, "complementary": Complementary}
# A foot has landed above this share of the weight on it; it is let go below the
# second, before it is lifted and rolls.  It stands when it has settled: within
# 50 ms of a hurried landing a sole turns by up to 40 mrad.
LANDED, RELEASED = 0.4, 0.3
SETTLING = 0.06  # [s]
# Errors of what the robot is told at the start (see `begin`): tilt and height
# are measured, while W is where the robot stands and heads, but for rounding.
START = np.array(((5e-3, 5e-3, 1e-4), (1e-3,) * 3, (1e-4, 1e-4, 5e-3)))

_V = JacobianWrtVariable.kV
_SHAPES = {"R": (3, 3), "x": (4, 3), "bias": (2, 3), "heading": (2,)}
_SHAPES["cov"] = ekf.SIZE, ekf.SIZE


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
            R_mean = before @ ekf.gammas(0.5 * self._period * rate)[0]
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


class _Joints(NamedTuple):
    """What the joints tell of base B, IMU I and soles, without the base."""

    X_BI: RigidTransform
    V_BI: np.ndarray  # angular, linear velocity of I in B (2, 3)
    soles: ekf.Legs


class StateEstimator(LeafSystem):
    """Estimates [q, v] by an InvariantEkf, or another of FILTERS.

    `imu` is that of an Imu, `joints` of JointEncoders, `foot_forces` (2,) [N].
    `estimated_state` is [q, v] of the robot's `control_plant`: the joints as
    measured, the pelvis from the IMU's pose.  `estimate_covariance` (81,) is
    that of (angle, velocity, position) of the pelvis, (9, 9) in W [rad], [m/s],
    [m].  A foot stands by its force, with hysteresis, once it has settled.
    The state is the Estimate, and since how many ticks each foot is loaded.
    RuntimeError: the IMU is saturated, which says nothing of the motion.

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
        q: np.ndarray,
        height: float | None = None,
        kind: str = "invariant",
    ):
        """Estimates every `period` [s], from the pose of the base in `q` (nq,).

        The ground's `height` [m] is known, or None; `kind` is one of FILTERS.

        Raises ValueError: the robot lacks the body that carries the IMU.
        """
        super().__init__()
        self._plant = plant = robot.control_plant()
        self._filter = FILTERS[kind](sensors, period)
        self._height, self._weight = height, robot.mass * GRAVITY
        self._settling = round(SETTLING / period)  # [ticks]
        self._q0, self._nj = q, plant.num_velocities() - 6
        self._body, self._X_BodyI = imu_place(plant, robot, sensors)
        self._soles = [
            (plant.GetFrameByName(name), robot.X_FootSole[side])
            for side, name in robot.foot_bodies.items()
        ]
        self._imu, self._range = Input(self, "imu", 9), sensors.imu_range
        self._rate_var = sensors.gyro_noise**2 / SAMPLE
        self._joints = Input(self, "joints", 2 * self._nj)
        self._forces = Input(self, "foot_forces", len(Side))
        self._scratch = declare_scratch(self, plant)
        size = plant.num_multibody_states()
        told = {"estimated_state": size, "estimate_covariance": 81}
        memory = {name: math.prod(n) for name, n in _SHAPES.items()}
        memory["loaded"] = 2
        needs = [self._imu, self._joints, self._forces]
        Outcome(self, told, memory, self._calc, period, needs, holds=True)

    @staticmethod
    def told(q: np.ndarray, seed: int) -> np.ndarray:
        """Positions `q` (nq,) with an error of START in the base's pose."""
        turn, move = np.random.default_rng((seed, 0, 4)).standard_normal((2, 3))
        R, told = RotationMatrix(ekf.gammas(START[0] * turn)[0]), q.copy()
        told[:4] = (R @ _rotation(q)).ToQuaternion().wxyz()
        told[4:7] += START[2] * move
        return told

    def _calc(self, context, last) -> tuple:
        joints, imu = self._joints(context), self._imu(context)
        if (np.abs(imu) >= self._range).any():
            raise self._imu.error(context, "is saturated")
        legs = self._legs(context, joints, imu[6:])
        loads = self._forces(context) / self._weight
        if last["cov"].any():
            least = np.where(last["loaded"] > 0.0, RELEASED, LANDED)
            loaded = (last["loaded"] + 1.0) * (loads > least)
            was = {name: last[name].reshape(n) for name, n in _SHAPES.items()}
            estimate = self._filter.predict(ekf.Estimate(**was), imu[:6])
        else:
            loaded = np.full(2, self._settling + 1.0)
            estimate = self._begin(legs)
        was, stands = last["loaded"] > self._settling, loaded > self._settling
        estimate = self._standing(estimate, legs, was, stands)
        pelvis, covariance = self._pelvis(estimate, imu, legs)
        return (
            self._state(*pelvis, joints),
            covariance.ravel(),
            *(part.ravel() for part in estimate),
            loaded,
        )

    def _standing(self, estimate, legs, was, stands) -> ekf.Estimate:
        """The estimate with the feet that stand; some `was` before."""
        f, soles = self._filter, legs.soles
        estimate = f.correct(estimate, was & stands, soles)
        new = np.flatnonzero(stands & ~was)
        for i in new:
            estimate = f.touch(estimate, i, soles)
        # One has settled: the other, with all of the weight until now, is flat.
        if self._height is not None:
            for i in 1 - new[stands[1 - new]]:
                estimate = f.level(estimate, i, self._height, soles)
        return estimate

    def _begin(self, legs: _Joints) -> ekf.Estimate:
        q = self._q0
        X_WI = RigidTransform(_rotation(q), q[4:7]) @ legs.X_BI
        R = X_WI.rotation().matrix()
        return self._filter.begin(R, X_WI.translation(), START)

    def _legs(self, context, joints, rate) -> _Joints:
        plant, own, n = self._plant, self._scratch.Eval(context), self._nj
        state = np.zeros(7 + 6 + 2 * n)
        state[0], state[7 : 7 + n], state[-n:] = 1.0, joints[:n], joints[n:]
        plant.SetPositionsAndVelocities(own, state)
        X_IB = self._X_BodyI.inverse()
        R_IB, body = X_IB.rotation().matrix(), self._body.body_frame()
        p, R, J = np.empty((2, 3)), np.empty((2, 3, 3)), np.empty((2, 6, n))
        for i, (frame, X) in enumerate(self._soles):
            X_IF = X_IB @ frame.CalcPose(own, body) @ X
            p[i], R[i] = X_IF.translation(), X_IF.rotation().matrix()
            J_B = plant.CalcJacobianSpatialVelocity(
                own, _V, frame, X.translation(), body, body
            )
            J[i] = (R_IB @ J_B[:, 6:].reshape(2, 3, n)).reshape(6, n)
        # The base is at W's origin.
        X_BI, V = imu_motion(plant, own, self._body, self._X_BodyI)
        V_BI = np.array((V.rotational(), V.translational()))
        v = J[:, 3:] @ joints[n:] - p @ ekf.skew(rate)
        return _Joints(X_BI, V_BI, ekf.Legs(p, R, J, v))

    def _pelvis(self, estimate: ekf.Estimate, imu, legs: _Joints) -> tuple:
        """R_WB, p_WB, w_WB, v_WB of the base, and their covariance (9, 9)."""
        R_WI, (v_WI, p_WI, *_), (bias, _), _, cov = estimate
        R_BI, p_BI = legs.X_BI.rotation().matrix(), legs.X_BI.translation()
        R = R_WI @ R_BI.T
        r = R @ p_BI
        w = R_WI @ (imu[6:] - bias) - R @ legs.V_BI[0]
        v = v_WI - ekf.skew(w) @ r - R @ legs.V_BI[1]
        p = p_WI - r
        T = np.eye(9)
        T[3:, :3] = -ekf.skew(np.array((v, p))).reshape(6, 3)
        T, arm = T @ ekf.IN_W, ekf.skew(r)
        T[3:6, ekf.GYRO_BIAS] -= arm @ R_WI  # of w in w x r
        covariance = T @ cov @ T.T
        covariance[3:6, 3:6] += self._rate_var * (arm @ arm.T)
        return (R, p, w, v), covariance

    def _state(self, R, p, w, v, joints) -> np.ndarray:
        R_WB = RotationMatrix.ProjectToRotationMatrix(R)
        angles, speeds = joints[: self._nj], joints[self._nj :]
        turn = R_WB.ToQuaternion().wxyz()
        return np.concatenate((turn, p, angles, w, v, speeds))


def _rotation(q: np.ndarray) -> RotationMatrix:
    """R_WB of the base at positions `q` (nq,)."""
    return RotationMatrix(Quaternion(q[:4]))
