"""ICP feedback by the CoP and the eCMP."""

import numpy as np
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.feedback import momentum_qp
from nadia_balance.core.math.bounds import check
from nadia_balance.core.math.polygon import shrink
from nadia_balance.core.walking.vocabulary import WalkingState, support_polygon
from nadia_balance.systems import ports
from nadia_balance.systems.signals import (
    EcmpCommand,
    IcpReference,
    QpStatus,
    size,
)


class MomentumQp(LeafSystem):
    """Computes eCMP = CoP_r + kappa_r + delta + kappa from the ICP error.

    delta, of the CoP, and kappa, of the angular momentum, minimise the error of
    k_p (icp - icp_r) = delta + kappa with the CoP in the soles (Nadia paper,
    Eqs. 6-8).  Inputs: `icp` (2,) [m] in W; `icp_reference`, an IcpReference;
    `walking_state`, a WalkingState.  Outputs: `ecmp_command`, an EcmpCommand;
    `momentum_qp_status`, a QpStatus, its violation in [m].  The discrete state
    holds the outputs of the last tick, and its [delta, kappa].

    .. pydrake_system::

        name: MomentumQp
        input_ports: [icp, icp_reference, walking_state]
        output_ports: [ecmp_command, momentum_qp_status]
    """

    def __init__(
        self,
        params: momentum_qp.MomentumQpParams,
        model: PointMassModel,
        period: float,
    ):
        super().__init__()
        check(params)
        shrink(model.cop_area, params.cop_safe_distance, "cop_safe_distance")
        self._qp = momentum_qp.IcpFeedbackQp(params)
        self._icp = ports.VectorInput(self, "icp", 2)
        self._reference = ports.VectorInput(self, "icp_reference", IcpReference)
        self._walking = ports.ValueInput(self, "walking_state", WalkingState)
        self._limits = ports.declare_plan(
            self,
            self._walking,
            lambda state: momentum_qp.feedback_limits(
                support_polygon(state.schedule, model.cop_area),
                state.schedule.feet[state.schedule.support_side].yaw,
                params,
            ),
        )
        ports.Outcome(
            self,
            {
                "ecmp_command": size(EcmpCommand),
                "momentum_qp_status": size(QpStatus),
                "increments": 4,
            },
            2,
            self._calc_outcome,
            {self.all_input_ports_ticket(), self._limits.ticket()},
            period,
        )

    def _calc_outcome(self, context, last) -> np.ndarray:
        reference = self._reference(context)
        cop_r = reference.cop
        feedback = self._qp.solve(
            self._icp(context) - reference.icp,
            cop_r,
            reference.ecmp - cop_r,
            last["increments"],
            self._limits.Eval(context)[1],
        )
        return np.concatenate(
            (
                feedback.cop,
                feedback.ecmp,
                QpStatus(last["momentum_qp_status"]).after(feedback.result),
                feedback.increments,
            )
        )
