"""ICP feedback by CoP and eCMP, and control of the CoM height."""

from typing import NamedTuple

import numpy as np
from pydrake.common.containers import namedview
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.bounds import check
from nadia_balance.core.com_height import (
    ComHeightPlan,
    plan_com_height,
    vertical_acceleration,
)
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.momentum_qp import (
    FeedbackLimits,
    IcpFeedbackQp,
    MomentumQpParams,
    feedback_limits,
    momentum_rate,
)
from nadia_balance.core.polygon import shrink, support_polygon
from nadia_balance.core.qp import QpResult
from nadia_balance.core.walking import ContactSchedule, WalkingState
from nadia_balance.systems.centroidal_estimator import ComState
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
        "QpStatus",
        ["solved", "fallback", "solves", "violation", "failures"],
    )
):
    """Status of a QP in this tick, with the number of failures until now.

    `violation` is the largest constraint violation, in units of the QP's rows.
    """

    def after(self, qp: QpResult) -> tuple[float, ...]:
        """The next status, after the result `qp`."""
        failures = self.failures + (not qp.solved)
        return qp.solved, qp.fallback, qp.solves, qp.violation, failures


class PhaseData(NamedTuple):
    """Quantities that are constant for one contact schedule."""

    schedule: ContactSchedule | None = None
    limits: FeedbackLimits | None = None
    height: ComHeightPlan | None = None


class MomentumQp(LeafSystem):
    """Computes eCMP and momentum rate from the ICP error by a QP.

    Nadia paper, Eqs. 5-8.  Inputs: `com_state`, a ComState; `icp` (2,) [m] in
    W; `icp_reference`, an IcpReference; `walking_state`, a WalkingState.
    Outputs: `ecmp_command`, an EcmpCommand; `momentum_qp_status`, a QpStatus,
    its violation in [m]; `momentum_rate` (3,) [N] in W.  The discrete state
    holds the outputs of the last tick, and its [delta, kappa].

    Evaluating an output raises RuntimeError if an input that it depends on is
    not finite.

    .. pydrake_system::

        name: MomentumQp
        input_ports: [com_state, icp, icp_reference, walking_state]
        output_ports: [ecmp_command, momentum_qp_status, momentum_rate]
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
        self._com_state = VectorInput(self, "com_state", ComState)
        self._icp = VectorInput(self, "icp", 2)
        self._reference = VectorInput(self, "icp_reference", IcpReference)
        self._walking_state = ValueInput(self, "walking_state", WalkingState)
        self._phase_data = declare_cache(
            self,
            "phase data",
            self._calc_phase_data,
            {self._walking_state.ticket()},
            PhaseData(),
        )
        Outcome(
            self,
            {
                "ecmp_command": size(EcmpCommand),
                "momentum_qp_status": size(QpStatus),
                "momentum_rate": 3,
                "increments": 4,
            },
            3,
            self._calc_outcome,
            {self.all_input_ports_ticket(), self._phase_data.ticket()},
            period,
        )

    def _calc_phase_data(self, context, last: PhaseData) -> PhaseData:
        schedule = self._walking_state(context).schedule
        if schedule is last.schedule:
            return last
        limits = feedback_limits(
            support_polygon(schedule, self._model.sole),
            schedule.feet[schedule.support_side].yaw,
            self._params,
        )
        height = plan_com_height(schedule, self._params.com_height, self._model)
        return PhaseData(schedule, limits, height)

    def _calc_outcome(self, context, last) -> np.ndarray:
        reference = self._reference(context)
        cop_r, data = reference.cop, self._phase_data.Eval(context)
        feedback = self._qp.solve(
            self._icp(context) - reference.icp,
            cop_r,
            reference.ecmp - cop_r,
            last["increments"],
            data.limits,
        )
        return np.concatenate(
            (
                feedback.cop,
                feedback.ecmp,
                QpStatus(last["momentum_qp_status"]).after(feedback.result),
                self._momentum_rate(context, feedback.ecmp, data.height),
                feedback.increments,
            )
        )

    def _momentum_rate(self, context, ecmp, height) -> np.ndarray:
        com, time = self._com_state(context), self._walking_state(context)
        acceleration = vertical_acceleration(
            float(com.z),
            float(com.vz),
            *height.at(time.time_in_phase),
            self._params.com_height,
        )
        return momentum_rate(com.position[:2], ecmp, acceleration, self._model)
