"""Joint torques that move the whole body as the capture point demands."""

import numpy as np
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.walking import WalkingState
from nadia_balance.core.whole_body_command import (
    WholeBodyQpParams,
    WholeBodyTerms,
    whole_body_command,
)
from nadia_balance.core.whole_body_qp import WholeBodyQp
from nadia_balance.robot import RobotModel
from nadia_balance.systems.momentum_qp import QpStatus
from nadia_balance.systems.ports import (
    Outcome,
    ValueInput,
    VectorInput,
    size,
)
from nadia_balance.systems.swing_foot_planner import SwingFootReference
from nadia_balance.whole_body_kinematics import whole_body_model


class WholeBodyInverseDynamics(LeafSystem):
    """Solves the whole-body QP once a tick, and holds the torques.

    `whole_body_terms` are WholeBodyTerms, see CentroidalEstimator;
    `momentum_rate` (3,) [N] is that of the linear momentum, in W;
    `swing_foot_reference` is a SwingFootReference, `walking_state` a
    WalkingState.  `actuation` [N m] is in the order of the plant's actuators;
    `foot_wrenches` (12,) are [tau, f] [N m, N] of the left and the right sole,
    at its centre, in W; `whole_body_qp_status` is a QpStatus.

    Before the update of a tick the outputs are computed from the inputs; after
    it, and up to the next tick, they are those of the state, whatever the
    inputs have become.  The discrete state holds what came of the last tick:
    the outputs, the active rows that warm-start the next one, and its time.
    If the QP has no solution, torques and wrenches of the last tick are held
    and the failure is counted.

    Evaluating any output raises RuntimeError if a vector input is not finite.

    .. pydrake_system::

        name: WholeBodyInverseDynamics
        input_ports: [whole_body_terms, momentum_rate, swing_foot_reference,
                      walking_state]
        output_ports: [actuation, foot_wrenches, whole_body_qp_status]
    """

    def __init__(
        self, params: WholeBodyQpParams, robot: RobotModel, period: float
    ):
        """Solves every `period` [s], for this `robot`.

        Raises ValueError for `params` that are out of range.
        """
        super().__init__()
        plant = robot.control_plant()
        model = whole_body_model(robot, plant, params.joint_lower_limits)
        self._params, self._model = params, model
        self._qp = WholeBodyQp(params, model, period)
        self._joint_of_actuator = np.array(
            [
                plant.get_joint_actuator(i).joint().velocity_start() - 6
                for i in plant.GetJointActuatorIndices()
            ]
        )
        self._terms = ValueInput(self, "whole_body_terms", WholeBodyTerms)
        self._momentum_rate = VectorInput(self, "momentum_rate", 3)
        shape = size(SwingFootReference)
        self._swing = VectorInput(self, "swing_foot_reference", shape)
        self._walking_state = ValueInput(self, "walking_state", WalkingState)
        Outcome(
            self,
            {
                "actuation": len(self._joint_of_actuator),
                "foot_wrenches": 12,
                "whole_body_qp_status": size(QpStatus),
                "active": self._qp.num_inequalities,
            },
            3,
            self._calc_outcome,
            {self.all_input_ports_ticket()},
            period,
            holds=True,
        )

    def _calc_outcome(self, context, last) -> np.ndarray:
        command = whole_body_command(
            self._walking_state(context),
            self._momentum_rate(context),
            self._swing(context),
            self._params,
            self._model,
        )
        guess = last["active"].astype(np.int8)
        status = QpStatus(last["whole_body_qp_status"])
        torques = None
        if status.solved:
            torques = np.empty(len(self._joint_of_actuator))
            torques[self._joint_of_actuator] = last["actuation"]
        found = self._qp.solve(self._terms(context), command, guess, torques)
        if found.qp.solved:
            actuation = found.torques[self._joint_of_actuator]
            wrenches = found.wrenches
        else:
            actuation, wrenches = last["actuation"], last["foot_wrenches"]
        return np.concatenate(
            (actuation, wrenches, status.after(found.qp), found.qp.active)
        )
