"""ICP feedback by the CoP and the eCMP."""

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.feedback import momentum_qp
from nadia_balance.core.math.bounds import check
from nadia_balance.core.math.polygon import shrink
from nadia_balance.core.walking.vocabulary import support_polygon
from nadia_balance.systems import ports
from nadia_balance.systems.signals import QpStatus, sizes


class MomentumQp(LeafSystem):
    """Computes eCMP = CoP_r + kappa_r + delta + kappa from the ICP error.

    delta, of the CoP, and kappa, of the angular momentum, minimise the error of
    k_p (icp - icp_r) = delta + kappa with the CoP in the soles (Nadia paper,
    Eqs. 6-8).  The discrete state holds the outputs of the last tick, and its
    [delta, kappa].

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
        self._icp, self._reference, self._walking = ports.inputs(
            self, "icp", "icp_reference", "walking_state"
        )
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
            sizes("ecmp_command", "momentum_qp_status"),
            {"increments": 4},
            self._calc_outcome,
            period,
        )

    def _calc_outcome(self, context, last) -> tuple:
        reference = self._reference(context)
        cop_r = reference.cop
        found = self._qp.solve(
            self._icp(context) - reference.icp,
            cop_r,
            reference.ecmp - cop_r,
            last["increments"],
            self._limits.Eval(context)[1],
        )
        status = QpStatus(last["momentum_qp_status"]).after(found.result)
        return found.cop, found.ecmp, status, found.increments
