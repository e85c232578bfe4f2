"""The state of the robot, from IMU, joint encoders and foot forces."""

import math
from typing import NamedTuple

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.estimation import invariant_ekf as ekf
from nadia_balance.core.estimation.complementary import Complementary
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.ports import Input, Outcome, declare_scratch
from nadia_balance.systems.sensors import SAMPLE, imu_motion, imu_place

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

        Soles land on ground of known `height` [m], None: of any height; `kind`
        is one of FILTERS.

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
