"""The state that the controller acts on: predicted, and what follows."""

import math
from collections.abc import Collection
from typing import Any

import numpy as np
from pydrake.systems.framework import Context

from nadia_balance.core.body.model import lag_share
from nadia_balance.core.estimation.motion_filter import motion_filter
from nadia_balance.core.estimation.sensors import SAMPLE, SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import alip_velocity, icp
from nadia_balance.core.walking.state import FootPose, FootPoses, whole_ticks
from nadia_balance.core.whole_body.command import WholeBodyTerms
from nadia_balance.core.whole_body.params import CollisionAvoidanceParams
from nadia_balance.robot.collision_avoidance import CollisionAvoidance
from nadia_balance.robot.kinematics import WholeBodyKinematics
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.ports import (
    Block,
    declare_output,
    declare_scratch,
    input_port,
)


class StatePredictor(Block):
    """Predicts the state over the delay behind it and the lag ahead of it.

    Over the `delay` of the measurement (a Smith predictor), in steps of the
    period h: q += h (v + h a / 2), v += h a, with the accelerations a that were
    commanded since.  Over the `lead` until the torques act: q += lead v.  There
    the velocity is kept: the last tick's accelerations make the loop unstable.

    The noise of `sensors` is filtered before, with the accelerations that were
    commanded (see MotionFilter): else torques would follow it.

    `estimated_state` is [q, v] of the robot's `control_plant` a `delay` ago,
    `predicted_state` the same a `lead` from now.  `generalized_acceleration`
    (nv,), a port only with a delay or a noise, is the acceleration that the QP
    expects of the torques of a tick (see WholeBodyInverseDynamics); the drives'
    lag filters it.  The discrete states, only then, are the filtered
    acceleration now, and its means over the last periods, the latest first, 0
    at the start; and the filtered motion (2, nv), and 1 once there is one.

    Args:
        robot: robot whose state is predicted.
        period: control period [s].
        delay: of the measurement [s], a multiple of the period.
        lead: time until the torques of a tick act [s].
        sensors: whose noise is filtered; None: there is none.

    Raises:
        ValueError: another delay.

    .. pydrake_system::

        name: StatePredictor
        input_ports: [estimated_state, generalized_acceleration]
        output_ports: [predicted_state]
    """

    def __init__(
        self,
        robot: RobotModel,
        period: float,
        delay: float = 0.0,
        lead: float = 0.0,
        sensors: SensorParams | None = None,
    ) -> None:
        super().__init__()
        self._period, self._lead = period, lead
        plant = robot.control_plant()
        self._nq, self._nv = plant.num_positions(), plant.num_velocities()
        num_states = plant.num_multibody_states()
        self._state = input_port(self, "estimated_state", num_states)
        self._delays = whole_ticks("delay", delay, period)
        self._filter = None
        if sensors is not None and sensors.joint_speed_noise > 0.0:
            self._filter = motion_filter(_noise(sensors, self._nv), period)
        self._periods = self._delays + (self._filter is not None)
        if self._periods:
            self._commanded = input_port(
                self, "generalized_acceleration", self._nv
            )
            # Response to a step in acceleration: after a period, and its mean.
            self._share, self._mean_share = 1.0, 1.0
            if robot.drives is not None:
                self._share = lag_share(robot.drives.bandwidth, period)
                self._mean_share -= self._share * robot.drives.lag / period
            self.DeclareDiscreteState((1 + self._periods) * self._nv)
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember)
        if self._filter:
            self.DeclareDiscreteState(2 * self._nv + 1)
        self.DeclareVectorOutputPort(
            "predicted_state",
            num_states,
            self._calc_state,
            {self._state.ticket(), self.all_state_ticket()},
        )

    def _accelerations(self, context: Context) -> Any:
        """Accelerations (1 + n, nv): now, and n means, the latest first."""
        values: Any = context.get_discrete_state(0).value()
        return values.reshape(-1, self._nv)

    def _remember(self, context: Context, new: Any) -> None:
        now, *means = self._accelerations(context)
        missing = self._commanded(context) - now
        new.get_mutable_vector(0).SetFromVector(
            np.concatenate(
                (
                    now + self._share * missing,
                    now + self._mean_share * missing,
                    *means[:-1],
                )
            )
        )
        if self._filter:
            motion = self._motion(context, self._state(context))
            new.get_mutable_vector(1).SetFromVector(np.append(motion, 1.0))

    def _motion(self, context: Context, state: Array) -> Array:
        """Positions and velocities (2, nv) when measured, without noise.

        The positions of the base are 0.
        """
        measured = np.zeros((2, self._nv))
        measured[0, 6:] = state[7 : self._nq]
        measured[1] = state[self._nq :]
        last: Any = context.get_discrete_state(1).value()
        if self._filter is None or not last[-1]:
            return measured
        h, expected = self._period, last[:-1].reshape(2, -1).copy()
        acceleration = self._accelerations(context)[-1]
        expected[0] += h * (expected[1] + 0.5 * h * acceleration)
        expected[1] += h * acceleration
        return self._filter.corrected(expected, measured)

    def _calc_state(self, context: Context, output: Any) -> None:
        state = self._state(context)
        q, v = state[: self._nq], state[self._nq :]
        if not q[0] and not q[:4].any():
            raise self._state.error(context, "has the quaternion 0")
        if self._filter:
            positions, v = self._motion(context, state)
            q = np.concatenate((q[:7], positions[6:]))
        if self._delays:
            h = self._period
            displacement = np.zeros(self._nv)
            means = self._accelerations(context)[1 : 1 + self._delays]
            for acceleration in means[::-1]:
                displacement += h * (v + 0.5 * h * acceleration)
                v = v + h * acceleration
            q = moved(q, displacement, time=1.0)
        if self._lead:
            q = moved(q, v, time=self._lead)
        output.SetFromVector(np.concatenate((q, v)))


def _noise(sensors: SensorParams, nv: int) -> Array:
    """Standard deviations (2, nv) of the measured positions and velocities.

    The base's orientation and place are filtered already; a rate is that of the
    gyro's latest sample.
    """
    noise = np.zeros((2, nv))
    noise[0] = np.inf
    noise[1, :3] = sensors.gyro_noise / math.sqrt(SAMPLE)
    noise[0, 6:] = sensors.joint_noise
    noise[1, 6:] = sensors.joint_speed_noise
    return noise


def moved(q: Array, v: Array, time: float) -> Array:
    """Positions after a time at a constant velocity: q + qdot time.

    The base's quaternion p has the rate L(p / 2) w, w its angular velocity; it
    is normalized.  All other rates are velocities.

    Args:
        q: positions [p, ...] (nq,).
        v: velocities [w, ...] (nv,).
        time: the time [s].

    Returns:
        The positions (nq,).
    """
    w, x, y, z = q[:4].tolist()
    wx, wy, wz = (0.5 * v[:3]).tolist()
    w, x, y, z = (
        w + time * (-x * wx - y * wy - z * wz),
        x + time * (w * wx + z * wy - y * wz),
        y + time * (-z * wx + w * wy + x * wz),
        z + time * (y * wx - x * wy + w * wz),
    )
    norm = math.hypot(w, x, y, z)
    quaternion = (w / norm, x / norm, y / norm, z / norm)
    return np.concatenate((quaternion, q[4:] + time * v[3:]))


class CentroidalEstimator(Block):
    """Computes dynamics terms; from them CoM, ICP and foot poses.

    Three ideas in one block, as all follow from one pass over the links:

    1. `whole_body_terms`, kinematics and dynamics for the whole-body QP.
    2. `com_state`, and icp = c + c_dot / omega (Nadia paper, Eq. 1); in
       `alip_icp`, c_dot is the velocity of a pendulum with the robot's angular
       momentum about its contact (`alip_velocity`), which a leg that is swung
       does not change.
    3. `foot_poses`, as if level.

    `predicted_state` is [q, v] of the robot's `control_plant`.

    Args:
        robot: robot whose links move.
        avoidance: which links the terms keep apart; None: none.
        lead: by which the positions of the state are ahead of its
            velocities [s] (see StatePredictor).
        given: joints that somebody else moves: the terms do not keep their
            links apart.

    .. pydrake_system::

        name: CentroidalEstimator
        input_ports: [predicted_state]
        output_ports: [whole_body_terms, com_state, icp, alip_icp, foot_poses]
    """

    def __init__(
        self,
        robot: RobotModel,
        avoidance: CollisionAvoidanceParams | None = None,
        lead: float = 0.0,
        given: Collection[str] = (),
    ) -> None:
        super().__init__()
        # A private plant for the terms and the distances of the shapes.
        diagram, plant, scene_graph = robot.control_diagram()
        self._plant: Any = plant
        self._kinematics = WholeBodyKinematics(robot, plant, lead)
        self._avoidance = (
            None
            if avoidance is None
            else CollisionAvoidance(
                avoidance, robot, plant, scene=scene_graph, given=given
            )
        )
        self._omega = robot.point_mass.omega
        self._height = robot.com_height
        self._state = input_port(
            self, "predicted_state", plant.num_multibody_states()
        )
        # Only the calculation of the terms changes it.
        self._scratch: Any = declare_scratch(self, diagram)
        self._terms: Any = declare_output(
            self, "whole_body_terms", self._calc_terms
        )
        needs = [self._terms]
        declare_output(
            self,
            "com_state",
            lambda context: self._terms.Eval(context).com_state,
            needs=needs,
        )
        declare_output(self, "icp", self._calc_icp, needs=needs)
        declare_output(self, "alip_icp", self._calc_alip_icp, needs=needs)
        declare_output(
            self,
            "foot_poses",
            lambda context: foot_poses(self._terms.Eval(context)),
            needs=needs,
        )

    def _calc_terms(self, context: Context) -> WholeBodyTerms:
        plant_context = self._plant.GetMyMutableContextFromRoot(
            self._scratch.Eval(context)
        )
        self._plant.SetPositionsAndVelocities(
            plant_context, self._state(context)
        )
        terms = self._kinematics.calc(plant_context)
        if self._avoidance is None:
            return terms
        return terms._replace(avoidance=self._avoidance.calc(plant_context))

    def _calc_icp(self, context: Context) -> Array:
        com_state = self._terms.Eval(context).com_state
        return icp(com_state[:2], com_state[3:5], self._omega)

    def _calc_alip_icp(self, context: Context) -> Array:
        terms = self._terms.Eval(context)
        velocity = alip_velocity(
            terms.com_state[3:5], terms.angular_momentum, self._height
        )
        return icp(terms.com_state[:2], velocity, self._omega)


def foot_poses(terms: WholeBodyTerms) -> FootPoses:
    """The measured soles, as if level.

    Args:
        terms: kinematics of the robot.

    Returns:
        The poses of the soles in W.
    """
    left, right = (
        FootPose(terms.sole_positions[i], math.atan2(R_WF[1][0], R_WF[0][0]))
        for i, R_WF in enumerate(terms.rotations[:2].tolist())
    )
    return FootPoses(left, right)
