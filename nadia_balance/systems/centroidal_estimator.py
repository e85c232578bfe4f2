"""Centre of mass, ICP, foot poses and dynamics terms from the joint state."""

import math

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.math.lipm import alip_velocity, icp
from nadia_balance.core.walking.vocabulary import FootPose, FootPoses
from nadia_balance.core.whole_body.collision_avoidance import (
    CollisionAvoidanceParams,
)
from nadia_balance.core.whole_body.command import WholeBodyTerms
from nadia_balance.robot.collision_avoidance import CollisionAvoidance
from nadia_balance.robot.kinematics import WholeBodyKinematics
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems import ports
from nadia_balance.systems.signals import ComState, size


class CentroidalEstimator(LeafSystem):
    """Computes CoM, ICP (Nadia paper, Eq. 1), foot poses and dynamics terms.

    icp = c + c_dot / omega; in alip_icp, c_dot is the velocity of a pendulum
    with the robot's angular momentum about its contact (`alip_velocity`), which
    a leg that is swung does not change.  `predicted_state` is [q, v] of the
    robot's `control_plant`.  `whole_body_terms` are WholeBodyTerms, from which
    the other outputs follow: `com_state`, a ComState, `icp` and `alip_icp`
    (2,) [m] in W, and `foot_poses`, FootPoses (as if level).

    .. pydrake_system::

        name: CentroidalEstimator
        input_ports: [predicted_state]
        output_ports: [whole_body_terms, com_state, icp, alip_icp, foot_poses]
    """

    def __init__(
        self,
        robot: RobotModel,
        avoidance: CollisionAvoidanceParams | None = None,
    ):
        """Estimates with a private plant of `robot`.

        The terms have the rows of `avoidance`, if given.
        """
        super().__init__()
        # A private plant for the terms and the distances of the shapes.
        diagram, plant, scene_graph = robot.control_diagram()
        self._plant = plant
        self._kinematics = WholeBodyKinematics(robot, plant)
        self._avoidance = avoidance and CollisionAvoidance(
            avoidance, robot, plant, scene_graph
        )
        self._omega = robot.point_mass.omega
        self._height = robot.com_height
        self._state = ports.VectorInput(
            self, "predicted_state", plant.num_multibody_states()
        )
        # Only the calculation of the terms changes it.
        self._scratch = ports.declare_scratch(self, diagram)
        self._terms = ports.declare_output(
            self, "whole_body_terms", self._calc_terms, {self._state.ticket()}
        )
        needs = {self._terms.ticket()}
        self.DeclareVectorOutputPort(
            "com_state", size(ComState), self._calc_com_state, needs
        )
        self.DeclareVectorOutputPort("icp", 2, self._calc_icp, needs)
        self.DeclareVectorOutputPort("alip_icp", 2, self._calc_alip_icp, needs)
        ports.declare_output(self, "foot_poses", self._calc_foot_poses, needs)

    def _calc_terms(self, context) -> WholeBodyTerms:
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

    def _calc_com_state(self, context, output):
        output.set_value(self._terms.Eval(context).com_state)

    def _calc_icp(self, context, output):
        com = ComState(self._terms.Eval(context).com_state)
        output.set_value(icp(com.position[:2], com.velocity[:2], self._omega))

    def _calc_alip_icp(self, context, output):
        terms = self._terms.Eval(context)
        com, L = ComState(terms.com_state), terms.angular_momentum
        v = alip_velocity(com.velocity[:2], L, self._height)
        output.set_value(icp(com.position[:2], v, self._omega))

    def _calc_foot_poses(self, context) -> FootPoses:
        terms = self._terms.Eval(context)
        left, right = (
            FootPose(
                terms.sole_positions[i], math.atan2(R_WF[1][0], R_WF[0][0])
            )
            for i, R_WF in enumerate(terms.rotations[:2].tolist())
        )
        return FootPoses(left, right)
