"""ICP control by the CMP and footholds, in one QP."""

from dataclasses import replace

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.feedback.icp_step_control import (
    IcpStepControl,
    StepFeedback,
)
from nadia_balance.core.feedback.icp_step_qp import IcpStepQpParams
from nadia_balance.core.math.bounds import check
from nadia_balance.core.math.polygon import shrink
from nadia_balance.core.plan.atlas_icp_plan import AtlasIcpPlan
from nadia_balance.core.steps.foothold_adjustment import CaptureRegions
from nadia_balance.core.walking import vocabulary as walking
from nadia_balance.core.walking.vocabulary import Phase
from nadia_balance.systems import ports
from nadia_balance.systems.signals import QpStatus, sizes


class IcpStepController(LeafSystem):
    """Computes CMP and footholds by one QP (Atlas paper, Sec. IV).

    It replaces a step adjuster and a MomentumQp.  The ICP reference follows
    from the plan, an AtlasIcpPlan, with the adjusted footholds, at the time to
    which the clock is about to be advanced.  `capture_regions` have no regions,
    in a swing reach and footholds; CoP and eCMP of `ecmp_command` are equal.
    The discrete state holds the last three outputs, as of the last tick.

    .. pydrake_system::

        name: IcpStepController
        input_ports: [icp, walking_state, icp_plan, time_adjustment,
                      mechanisms]
        output_ports: [adjustment, capture_regions, ecmp_command,
                       momentum_qp_status, icp_reference]
    """

    def __init__(
        self, params: IcpStepQpParams, model: PointMassModel, period: float
    ):
        """Controls the `model` every `period` [s].

        Raises ValueError for `params` that are out of range, and if the reach
        leaves no room for a step with uncrossed legs.
        """
        super().__init__()
        check(params)
        shrink(model.cop_area, params.cop_safe_distance, "cop_safe_distance")
        self._control = IcpStepControl(params, model)
        self._icp, self._walking_state = ports.inputs(
            self, "icp", "walking_state"
        )
        self._icp_plan = ports.Input(self, "icp_plan", AtlasIcpPlan)
        self._time, self._mechanisms = ports.inputs(
            self, "time_adjustment", "mechanisms"
        )
        self._phase = ports.declare_plan(
            self, self._walking_state, self._control.phase
        )
        self._feedback = ports.declare_cache(
            self, "feedback", self._calc_feedback
        )
        needs = [self._feedback]
        ports.declare_output(self, "adjustment", self._adjustment, needs)
        ports.declare_output(
            self, "capture_regions", self._calc_capture_regions, needs
        )
        ports.Outcome(
            self,
            sizes("ecmp_command", "momentum_qp_status", "icp_reference"),
            {},
            self._calc_outcome,
            period,
            needs,
        )

    def _calc_feedback(self, context, _) -> StepFeedback:
        state = self._walking_state(context)
        if (gain := float(self._time(context)[0])) > 0.0:  # t+
            time = min(state.time_in_phase + gain, state.schedule.duration)
            state = replace(state, time_in_phase=time)
        return self._control.feedback(
            state,
            self._phase.Eval(context)[1],
            self._icp_plan(context),
            self._icp(context),
            self._mechanisms(context).step,
        )

    def _adjustment(self, context) -> walking.Adjustment | None:
        return self._feedback.Eval(context).adjustment

    def _calc_capture_regions(self, context) -> CaptureRegions:
        if self._walking_state(context).schedule.phase is not Phase.SWING:
            return CaptureRegions()
        phase = self._phase.Eval(context)[1]
        # While `step` is off, the previous adjustment holds.
        now = self._adjustment(context) or phase.adjustment
        return CaptureRegions((), phase.reach, now.nominal.pose, now.pose)

    def _calc_outcome(self, context, last) -> tuple:
        _, reference, ecmp, result = self._feedback.Eval(context)
        status = QpStatus(last["momentum_qp_status"]).after(result)
        plan = reference.icp, reference.icp_velocity, reference.cop
        return ecmp, ecmp, status, *plan, reference.ecmp
