"""Centre of mass, ICP and feet, from the state of all joints."""

import math

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem, ValueProducer

from nadia_balance.core.lipm import icp
from nadia_balance.core.walking import FootPose, FootPoses, Side
from nadia_balance.robot import RobotModel


class CentroidalEstimator(LeafSystem):
    """Computes what the capture-point controller knows of the robot.

    `estimated_state` is [q, v] of the robot's `control_plant`; `com_state` is
    [p_WC, v_WC] [m, m/s]; `icp` follows from it by the Nadia paper's Eq. 1;
    `foot_poses` are the poses of both sole frames in W.

    Evaluating any output raises RuntimeError if the state is not finite.

    .. pydrake_system::

        name: CentroidalEstimator
        input_ports: [estimated_state]
        output_ports: [com_state, icp, foot_poses]
    """

    def __init__(self, robot: RobotModel):
        """Estimates with a private plant of `robot`."""
        super().__init__()
        self._plant = plant = robot.control_plant()
        self._omega = robot.omega
        self._soles = [
            (
                plant.GetBodyByName(robot.foot_bodies[side]),
                robot.X_FootSole[side].GetAsMatrix4(),
            )
            for side in (Side.LEFT, Side.RIGHT)
        ]
        self._estimated_state = self.DeclareVectorInputPort(
            "estimated_state", plant.num_multibody_states()
        )
        self._plant_context = self.DeclareCacheEntry(
            "plant context",
            ValueProducer(
                allocate=lambda: Value(plant.CreateDefaultContext()),
                calc=self._set_state,
            ),
            prerequisites_of_calc={self._estimated_state.ticket()},
        )
        needs = {self._plant_context.ticket()}
        self._com_state = self.DeclareVectorOutputPort(
            "com_state", 6, self._calc_com_state, prerequisites_of_calc=needs
        )
        self.DeclareVectorOutputPort(
            "icp",
            2,
            self._calc_icp,
            prerequisites_of_calc=needs,
        )
        self.DeclareAbstractOutputPort(
            "foot_poses",
            alloc=lambda: Value(FootPoses(FootPose(), FootPose())),
            calc=self._calc_foot_poses,
            prerequisites_of_calc=needs,
        )

    def _set_state(self, context, cache):
        state = self._estimated_state.Eval(context)
        if not math.isfinite(state @ state):
            i = int(np.flatnonzero(~np.isfinite(state))[0])
            raise RuntimeError(
                f"{self.get_name() or type(self).__name__}: input port "
                f"'estimated_state' is not finite: "
                f"{self._plant.GetStateNames()[i]} = {state[i]}"
            )
        self._plant.SetPositionsAndVelocities(cache.get_mutable_value(), state)

    def _calc_com_state(self, context, output):
        plant, at = self._plant, self._plant_context.Eval(context)
        p_WC = plant.CalcCenterOfMassPositionInWorld(at)
        v_WC = plant.CalcCenterOfMassTranslationalVelocityInWorld(at)
        output.set_value(np.concatenate((p_WC, v_WC)))

    def _calc_icp(self, context, output):
        state = self._com_state.Eval(context)
        output.set_value(icp(state[:2], state[3:5], self._omega))

    def _calc_foot_poses(self, context, output):
        at = self._plant_context.Eval(context)
        poses = []
        for body, X_BodySole in self._soles:
            X_WB = self._plant.EvalBodyPoseInWorld(at, body)
            X_WF = X_WB.GetAsMatrix34() @ X_BodySole
            yaw = math.atan2(X_WF[1, 0], X_WF[0, 0])
            poses.append(FootPose(X_WF[:, 3], yaw))
        output.set_value(FootPoses(*poses))
