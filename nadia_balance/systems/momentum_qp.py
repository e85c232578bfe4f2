"""ICP feedback by the CoP and the eCMP."""

import numpy as np
from pydrake.common.containers import namedview
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.bounds import check
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.momentum_qp import (
    FeedbackLimits,
    IcpFeedbackQp,
    MomentumQpParams,
    feedback_limits,
)
from nadia_balance.core.polygon import shrink, support_polygon
from nadia_balance.core.qp import QpResult
from nadia_balance.core.walking import ContactSchedule, WalkingState
from nadia_balance.systems.icp_planner import IcpReference
from nadia_balance.systems.ports import (
    Outcome,
    ValueInput,
    VectorInput,
    declare_cache,
    entries,
    size,
)


class EcmpCommand(
    namedview("EcmpCommand", ["cop_x", "cop_y", "ecmp_x", "ecmp_y"])
):
    """The commanded CoP and eCMP, xy in W [m]."""

    cop, ecmp = entries(0, 2), entries(2, 4)


class QpStatus(
    namedview(
        "QpStatus", ["solved", "fallback", "solves", "violation", "failures"]
    )
):
    """Status of a QP in this tick, with the number of failures until now.

    `violation` is the largest constraint violation, in units of the QP's rows.
    """

    def after(self, qp: QpResult) -> tuple[float, ...]:
        """The next status, after the result `qp`."""
        failures = self.failures + (not qp.solved)
        return qp.solved, qp.fallback, qp.solves, qp.violation, failures


class MomentumQp(LeafSystem):
    """Computes eCMP = CoP_r + kappa_r + delta + kappa from the ICP error.

    delta, of the CoP, and kappa, of the angular momentum, minimise the error of
    k_p (icp - icp_r) = delta + kappa with the CoP in the soles (Nadia paper,
    Eqs. 6-8).  Inputs: `icp` (2,) [m] in W; `icp_reference`, an IcpReference;
    `walking_state`, a WalkingState.  Outputs: `ecmp_command`, an EcmpCommand;
    `momentum_qp_status`, a QpStatus, its violation in [m].  The discrete state
    holds the outputs of the last tick, and its [delta, kappa].

    Evaluating an output raises RuntimeError if an input that it depends on is
    not finite.

    .. pydrake_system::

        name: MomentumQp
        input_ports: [icp, icp_reference, walking_state]
        output_ports: [ecmp_command, momentum_qp_status]
    """

    def __init__(
        self, params: MomentumQpParams, model: PointMassModel, period: float
    ):
        """Controls the `model` every `period` [s].

        Raises ValueError for `params` that are out of range.
        """
        super().__init__()
        check(params)
        shrink(model.sole, params.cop_safe_distance, "cop_safe_distance")
        self._params, self._model = params, model
        self._qp = IcpFeedbackQp(params)
        self._icp = VectorInput(self, "icp", 2)
        self._reference = VectorInput(self, "icp_reference", IcpReference)
        self._walking_state = ValueInput(self, "walking_state", WalkingState)
        self._limits = declare_cache(
            self,
            "schedule and its limits",
            self._calc_limits,
            {self._walking_state.ticket()},
            (None, None),
        )
        Outcome(
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

    def _calc_limits(
        self,
        context,
        last: tuple[ContactSchedule | None, FeedbackLimits | None],
    ) -> tuple[ContactSchedule, FeedbackLimits]:
        schedule = self._walking_state(context).schedule
        if schedule is last[0]:
            return last
        limits = feedback_limits(
            support_polygon(schedule, self._model.sole),
            schedule.feet[schedule.support_side].yaw,
            self._params,
        )
        return schedule, limits

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
