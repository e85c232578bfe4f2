"""The state that the controller acts on: predicted, and what follows."""

import math

import numpy as np
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.body.model import lag_share
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import alip_velocity, icp
from nadia_balance.core.walking import state as walking
from nadia_balance.core.whole_body.command import WholeBodyTerms
from nadia_balance.core.whole_body.params import CollisionAvoidanceParams
from nadia_balance.robot.collision_avoidance import CollisionAvoidance
from nadia_balance.robot.kinematics import WholeBodyKinematics
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.ports import Input, declare_output, declare_scratch
from nadia_balance.systems.signals import ComState


class StatePredictor(LeafSystem):
    """Predicts the state over the delay behind it and the lag ahead of it.

    Over the `delay` of the measurement (a Smith predictor), in steps of the
    period h: q += h (v + h a / 2), v += h a, with the accelerations a that were
    commanded since.  Over the `lead` until the torques act: q += lead v.  There
    the velocity is kept: the last tick's accelerations make the loop unstable.

    `estimated_state` is [q, v] of the robot's `control_plant` a `delay` ago,
    `predicted_state` the same a `lead` from now.  `generalized_acceleration`
    (nv,), a port only with a delay, is the acceleration that the QP expects of
    the torques of a tick (see WholeBodyInverseDynamics); the drives' lag
    filters it.  The discrete state, only with a delay, is the filtered
    acceleration now, and its means over the periods of the delay, the latest
    first; 0 at the start.

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
    ):
        """Predicts by `delay`, a multiple of `period`, plus `lead` [s].

        Raises ValueError for another `delay`.
        """
        super().__init__()
        self._period, self._lead = period, lead
        self._plant = plant = robot.control_plant()
        self._nq, self._nv = plant.num_positions(), plant.num_velocities()
        size = plant.num_multibody_states()
        self._state = Input(self, "estimated_state", size)
        self._scratch = declare_scratch(self, plant)
        self._periods = walking.whole_ticks("delay", delay, period)
        if self._periods:
            # Response to a step in acceleration: after a period, and its mean.
            self._share, self._mean_share = 1.0, 1.0
            if robot.drives is not None:
                self._share = lag_share(robot.drives.bandwidth, period)
                self._mean_share -= self._share * robot.drives.lag / period
            self._commanded = Input(self, "generalized_acceleration", self._nv)
            self.DeclareDiscreteState((1 + self._periods) * self._nv)
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember)
        needs = {self._state.ticket(), self.all_state_ticket()}
        self.DeclareVectorOutputPort(
            "predicted_state", size, self._calc_state, needs
        )

    def _accelerations(self, context) -> np.ndarray:
        """Accelerations (1 + n, nv): now, and n means, the latest first."""
        values = context.get_discrete_state_vector().value()
        return values.reshape(-1, self._nv)

    def _remember(self, context, new):
        now, *means = self._accelerations(context)
        missing = self._commanded(context) - now
        latest = now + self._share * missing, now + self._mean_share * missing
        new.set_value(np.concatenate((*latest, *means[:-1])))
        return EventStatus.Succeeded()

    def _calc_state(self, context, output):
        q, v = np.split(self._state(context), [self._nq])
        if self._periods:
            h, way = self._period, np.zeros(self._nv)
            for acceleration in self._accelerations(context)[:0:-1]:
                way += h * (v + 0.5 * h * acceleration)
                v = v + h * acceleration
            q = self._moved(context, q, way, 1.0)
        if self._lead:
            q = self._moved(context, q, v, self._lead)
        output.SetFromVector(np.concatenate((q, v)))

    def _moved(
        self, context, q: np.ndarray, v: np.ndarray, time: float
    ) -> np.ndarray:
        """Positions (nq,) after `time` [s] from `q` at the velocity `v`."""
        plant_context = self._scratch.Eval(context)
        self._plant.SetPositions(plant_context, q)
        q = q + time * self._plant.MapVelocityToQDot(plant_context, v)
        q[:4] /= math.hypot(*q[:4].tolist())
        return q


class CentroidalEstimator(LeafSystem):
    """Computes CoM, ICP (Nadia paper, Eq. 1), foot poses and dynamics terms.

    icp = c + c_dot / omega; in alip_icp, c_dot is the velocity of a pendulum
    with the robot's angular momentum about its contact (`alip_velocity`), which
    a leg that is swung does not change.  `predicted_state` is [q, v] of the
    robot's `control_plant`.  The other outputs follow from `whole_body_terms`;
    `foot_poses` are as if level.

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
    ):
        """Estimates with a private plant of `robot`.

        The terms have the rows of `avoidance`, if given.  The positions of the
        state are a `lead` [s] ahead of its velocities (see StatePredictor).
        """
        super().__init__()
        # A private plant for the terms and the distances of the shapes.
        diagram, plant, scene_graph = robot.control_diagram()
        self._plant = plant
        self._kinematics = WholeBodyKinematics(robot, plant, lead)
        self._avoidance = avoidance and CollisionAvoidance(
            avoidance, robot, plant, scene_graph
        )
        self._omega = robot.point_mass.omega
        self._height = robot.com_height
        size = plant.num_multibody_states()
        self._state = Input(self, "predicted_state", size)
        # Only the calculation of the terms changes it.
        self._scratch = declare_scratch(self, diagram)
        self._terms = declare_output(self, "whole_body_terms", self._calc_terms)
        for name, calc in (
            ("com_state", lambda terms: terms.com_state),
            ("icp", self._calc_icp),
            ("alip_icp", self._calc_alip_icp),
            ("foot_poses", foot_poses),
        ):
            declare_output(
                self,
                name,
                lambda context, calc=calc: calc(self._terms.Eval(context)),
                [self._terms],
            )

    def _calc_terms(self, context) -> WholeBodyTerms:
        root = self._scratch.Eval(context)
        own = self._plant.GetMyMutableContextFromRoot(root)
        self._plant.SetPositionsAndVelocities(own, self._state(context))
        terms = self._kinematics.calc(own)
        if self._avoidance is None:
            return terms
        return terms._replace(avoidance=self._avoidance.calc(own))

    def _calc_icp(self, terms: WholeBodyTerms) -> Array:
        com = ComState(terms.com_state)
        return icp(com.position[:2], com.velocity[:2], self._omega)

    def _calc_alip_icp(self, terms: WholeBodyTerms) -> Array:
        com, L = ComState(terms.com_state), terms.angular_momentum
        v = alip_velocity(com.velocity[:2], L, self._height)
        return icp(com.position[:2], v, self._omega)


def foot_poses(terms: WholeBodyTerms) -> walking.FootPoses:
    """The measured soles, as if level."""
    left, right = (
        walking.FootPose(
            terms.sole_positions[i], math.atan2(R_WF[1][0], R_WF[0][0])
        )
        for i, R_WF in enumerate(terms.rotations[:2].tolist())
    )
    return walking.FootPoses(left, right)
