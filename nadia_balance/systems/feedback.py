"""ICP feedback: the eCMP, footholds in the same QP, and the CoM's height."""

from dataclasses import replace

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.com_height import ComHeight, ComHeightParams
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.feedback import icp_step_qp, momentum_qp
from nadia_balance.core.feedback.momentum_qp import momentum_rate
from nadia_balance.core.math import lipm
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import shrink
from nadia_balance.core.plan.atlas_icp_plan import AtlasIcpPlan
from nadia_balance.core.steps.foothold_adjustment import CaptureRegions
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.state import Phase, support_polygon
from nadia_balance.parameters.bounds import check
from nadia_balance.systems import ports
from nadia_balance.systems.signals import QpStatus, sizes


class MomentumQp(LeafSystem):
    """Computes eCMP = CoP_r + kappa_r + delta + kappa from the ICP error.

    delta, of the CoP, and kappa, of the angular momentum, minimise the error of
    k_p (icp - icp_r) = delta + kappa with the CoP in the soles (Nadia paper,
    Eqs. 6-8).  The discrete state holds the last outputs and [delta, kappa].

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
        names = "icp icp_reference walking_state"
        self._icp, self._reference, self._walking = ports.inputs(self, names)
        self._limits = ports.declare_plan(
            self,
            self._walking,
            lambda state: momentum_qp.feedback_limits(
                support_polygon(state.schedule, model.cop_area),
                state.schedule.feet[state.schedule.support_side].yaw,
                params,
            ),
        )
        told = sizes("ecmp_command momentum_qp_status")
        ports.Outcome(self, told, {"increments": 4}, self._calc_outcome, period)

    def _calc_outcome(self, context, last) -> tuple:
        reference, limits = self._reference(context), self._limits.Eval(context)
        error, cop_r = self._icp(context) - reference.icp, reference.cop
        found = self._qp.solve(
            error, cop_r, reference.ecmp - cop_r, last["increments"], limits[1]
        )
        status = QpStatus(last["momentum_qp_status"]).after(found.result)
        return found.cop, found.ecmp, status, found.increments


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
        self,
        params: icp_step_qp.IcpStepQpParams,
        model: PointMassModel,
        period: float,
    ):
        """Raises ValueError: a bad parameter, no room for uncrossed legs."""
        super().__init__()
        check(params)
        shrink(model.cop_area, params.cop_safe_distance, "cop_safe_distance")
        self._control = control = icp_step_qp.IcpStepControl(params, model)
        self._icp, self._walking = ports.inputs(self, "icp walking_state")
        self._icp_plan = ports.Input(self, "icp_plan", AtlasIcpPlan)
        self._time, self._on = ports.inputs(self, "time_adjustment mechanisms")
        self._phase = ports.declare_plan(self, self._walking, control.phase)
        self._feedback = ports.declare_cache(self, "feedback", self._calc)
        needs = [self._feedback]
        ports.declare_output(self, "adjustment", self._adjustment, needs)
        ports.declare_output(self, "capture_regions", self._regions, needs)
        told = sizes("ecmp_command momentum_qp_status icp_reference")
        ports.Outcome(self, told, {}, self._calc_outcome, period, needs)

    def _calc(self, context, _) -> icp_step_qp.StepFeedback:
        state = self._walking(context)
        if (gain := float(self._time(context)[0])) > 0.0:  # t+
            time = min(state.time_in_phase + gain, state.schedule.duration)
            state = replace(state, time_in_phase=time)
        return self._control.feedback(
            state,
            self._phase.Eval(context)[1],
            self._icp_plan(context),
            self._icp(context),
            self._on(context).step,
        )

    def _adjustment(self, context) -> walking.Adjustment | None:
        return self._feedback.Eval(context).adjustment

    def _regions(self, context) -> CaptureRegions:
        if self._walking(context).schedule.phase is not Phase.SWING:
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


class ComHeightController(LeafSystem):
    """Computes the momentum rate l_dot = m (omega^2 (c - eCMP), z_ddot).

    z_ddot = k_d clip(z_dot_d + k_p / k_d (z_d - z)) - k_d z_dot is a PD law on
    the planned height, limited; in a swing the CoM sinks from it by k_s omega^2
    (|icp - ecmp| - sink_distance).  The horizontal part is the pendulum's
    (Nadia paper, Eqs. 1 and 5).  The block has no state.

    .. pydrake_system::

        name: ComHeightController
        input_ports: [com_state, ecmp_command, walking_state]
        output_ports: [momentum_rate]
    """

    def __init__(
        self, params: ComHeightParams, model: PointMassModel, period: float
    ):
        super().__init__()
        check(params)
        self._model, self._control = model, ComHeight(params, model)
        names = "com_state ecmp_command walking_state"
        self._com, self._ecmp, self._walking = ports.inputs(self, names)
        self._height = ports.declare_plan(
            self,
            self._walking,
            lambda state: self._control.plan(state.schedule),
        )
        ports.declare_output(self, "momentum_rate", self._calc_rate)

    def _calc_rate(self, context) -> Array:
        com = self._com(context)
        state, plan = self._walking(context), self._height.Eval(context)
        wanted, sink = plan[1].at(state.time_in_phase), 0.0
        z, vz, ecmp = float(com.z), float(com.vz), self._ecmp(context).ecmp
        place, velocity = com.position[:2], com.velocity[:2]
        if state.schedule.phase is Phase.SWING:
            most = self._control.stance_limit(place, velocity, state.schedule)
            wanted = min(wanted, most)
            icp = lipm.icp(place, velocity, self._model.omega)
            sole = state.schedule.feet[state.schedule.support_side].p_WF
            sink = self._control.sinking(place, icp, ecmp, z - float(sole[2]))
        az = self._control.acceleration(z, vz, *wanted, sink)
        return momentum_rate(place, ecmp, az, self._model)
