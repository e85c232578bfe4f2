"""Centre of mass, ICP, foot poses and dynamics terms from the joint state."""

import math

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import alip_velocity, icp
from nadia_balance.core.walking.vocabulary import FootPose, FootPoses
from nadia_balance.core.whole_body.command import WholeBodyTerms
from nadia_balance.core.whole_body.params import CollisionAvoidanceParams
from nadia_balance.robot.collision_avoidance import CollisionAvoidance
from nadia_balance.robot.kinematics import WholeBodyKinematics
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems import ports
from nadia_balance.systems.signals import ComState


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
        self._state = ports.Input(self, "predicted_state", size)
        # Only the calculation of the terms changes it.
        self._scratch = ports.declare_scratch(self, diagram)
        self._terms = ports.declare_output(
            self, "whole_body_terms", self._calc_terms
        )
        for name, calc in (
            ("com_state", lambda terms: terms.com_state),
            ("icp", self._calc_icp),
            ("alip_icp", self._calc_alip_icp),
            ("foot_poses", foot_poses),
        ):
            ports.declare_output(
                self,
                name,
                lambda context, calc=calc: calc(self._terms.Eval(context)),
                [self._terms],
            )

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

    def _calc_icp(self, terms: WholeBodyTerms) -> Array:
        com = ComState(terms.com_state)
        return icp(com.position[:2], com.velocity[:2], self._omega)

    def _calc_alip_icp(self, terms: WholeBodyTerms) -> Array:
        com, L = ComState(terms.com_state), terms.angular_momentum
        v = alip_velocity(com.velocity[:2], L, self._height)
        return icp(com.position[:2], v, self._omega)


def foot_poses(terms: WholeBodyTerms) -> FootPoses:
    """The measured soles, as if level."""
    left, right = (
        FootPose(terms.sole_positions[i], math.atan2(R_WF[1][0], R_WF[0][0]))
        for i, R_WF in enumerate(terms.rotations[:2].tolist())
    )
    return FootPoses(left, right)
