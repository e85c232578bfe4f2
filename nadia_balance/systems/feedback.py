"""ICP feedback: the eCMP, footholds in the same QP, and the CoM's height."""

from dataclasses import replace
from typing import Any

from pydrake.systems.framework import Context

from nadia_balance.core.body.com_height import ComHeight, ComHeightParams
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.feedback.icp_step_control import (
    IcpStepControl,
    StepFeedback,
)
from nadia_balance.core.feedback.icp_step_qp import IcpStepQpParams
from nadia_balance.core.feedback.momentum_qp import (
    IcpFeedbackQp,
    MomentumQpParams,
    feedback_limits,
    momentum_rate,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import icp
from nadia_balance.core.math.polygon import shrink
from nadia_balance.core.plan.atlas_icp_plan import AtlasIcpPlan
from nadia_balance.core.steps.foothold_adjustment import CaptureRegions
from nadia_balance.core.walking.mechanisms import USUAL
from nadia_balance.core.walking.state import Phase, support_polygon
from nadia_balance.parameters.bounds import check
from nadia_balance.systems.ports import (
    Block,
    declare_cache,
    declare_outcome,
    declare_output,
    input_port,
    once_per_schedule,
    optional_input,
)
from nadia_balance.systems.signals import (
    ComState,
    EcmpCommand,
    IcpReference,
    QpStatus,
    size,
)


class MomentumQp(Block):
    """Computes eCMP = CoP_r + kappa_r + delta + kappa from the ICP error.

    delta, of the CoP, and kappa, of the angular momentum, minimise the error of
    k_p (icp - icp_r) = delta + kappa with the CoP in the soles (Nadia paper,
    Eqs. 6-8).  The discrete state holds the last outputs and [delta, kappa].

    Args:
        params: gains, weights and limits of the QP.
        model: point mass of the robot.
        period: control period [s].

    .. pydrake_system::

        name: MomentumQp
        input_ports: [icp, icp_reference, walking_state]
        output_ports: [ecmp_command, momentum_qp_status]
    """

    def __init__(
        self, params: MomentumQpParams, model: PointMassModel, period: float
    ) -> None:
        super().__init__()
        check(params)
        shrink(model.cop_area, params.cop_safe_distance, "cop_safe_distance")
        self._qp = IcpFeedbackQp(params)
        self._icp = input_port(self, "icp")
        self._reference = input_port(self, "icp_reference", size(IcpReference))
        self._walking = input_port(self, "walking_state")
        self._limits = once_per_schedule(
            lambda state: feedback_limits(
                support_polygon(state.schedule, model.cop_area),
                state.schedule.feet[state.schedule.support_side].yaw,
                params,
            )
        )
        declare_outcome(
            self,
            outputs={
                "ecmp_command": size(EcmpCommand),
                "momentum_qp_status": size(QpStatus),
            },
            memory={"increments": 4},
            calc=self._calc_outcome,
            period=period,
        )

    def _calc_outcome(
        self, context: Context, last: dict[str, Any]
    ) -> tuple[Any, ...]:
        # The entries of an IcpReference; its properties take longer.
        reference = self._reference(context)
        icp_r, cop_r, ecmp_r = reference[:2], reference[4:6], reference[6:]
        feedback = self._qp.solve(
            error=self._icp(context) - icp_r,
            cop_r=cop_r,
            kappa_r=ecmp_r - cop_r,
            previous=last["increments"],
            limits=self._limits(self._walking(context)),
        )
        return (
            feedback.cop,
            feedback.ecmp,
            QpStatus(last["momentum_qp_status"]).after(feedback.result),
            feedback.increments,
        )


class IcpStepController(Block):
    """Computes CMP and footholds by one QP (Atlas paper, Sec. IV).

    It replaces a step adjuster and a MomentumQp.  The ICP reference follows
    from the plan, an AtlasIcpPlan, with the adjusted footholds, at the time to
    which the clock is about to be advanced.  `capture_regions` have no regions,
    in a swing reach and footholds; CoP and eCMP of `ecmp_command` are equal.
    The discrete state holds the last three outputs, as of the last tick.

    Erratum: the ICP is `alip_icp`, which a leg that is swung does not carry
    along, and by which the TimingAdapter goes, too.

    Args:
        params: gains, weights and limits of the QP.
        model: point mass of the robot.
        period: control period [s].

    Raises:
        ValueError: a bad parameter, or no room for uncrossed legs.

    .. pydrake_system::

        name: IcpStepController
        input_ports: [alip_icp, walking_state, icp_plan, time_adjustment,
                      mechanisms]
        output_ports: [adjustment, capture_regions, ecmp_command,
                       momentum_qp_status, icp_reference]
    """

    def __init__(
        self, params: IcpStepQpParams, model: PointMassModel, period: float
    ) -> None:
        super().__init__()
        check(params)
        shrink(model.cop_area, params.cop_safe_distance, "cop_safe_distance")
        self._control = IcpStepControl(params, model)
        self._icp = input_port(self, "alip_icp")
        self._walking = input_port(self, "walking_state")
        self._plan = input_port(self, "icp_plan", AtlasIcpPlan)
        self._time = optional_input(self, "time_adjustment", default=(0.0, 0.0))
        self._mechanisms = optional_input(self, "mechanisms", default=USUAL)
        self._phase = once_per_schedule(self._control.phase)
        self._feedback: Any = declare_cache(
            self, "feedback", self._calc_feedback
        )
        needs = [self._feedback]
        declare_output(self, "adjustment", self._calc_adjustment, needs=needs)
        declare_output(self, "capture_regions", self._calc_regions, needs=needs)
        declare_outcome(
            self,
            outputs={
                "ecmp_command": size(EcmpCommand),
                "momentum_qp_status": size(QpStatus),
                "icp_reference": size(IcpReference),
            },
            memory={},
            calc=self._calc_outcome,
            period=period,
            needs=needs,
        )

    def _calc_feedback(self, context: Context, _: object) -> StepFeedback:
        state = self._walking(context)
        time_gain = float(self._time(context)[0])
        if time_gain > 0.0:  # t+
            state = replace(
                state,
                time_in_phase=min(
                    state.time_in_phase + time_gain, state.schedule.duration
                ),
            )
        return self._control.feedback(
            state,
            phase=self._phase(state),
            plan=self._plan(context),
            icp=self._icp(context),
            on=self._mechanisms(context).step,
        )

    def _calc_adjustment(self, context: Context) -> Any:
        return self._feedback.Eval(context).adjustment

    def _calc_regions(self, context: Context) -> CaptureRegions:
        state = self._walking(context)
        if state.schedule.phase is not Phase.SWING:
            return CaptureRegions()
        phase = self._phase(state)
        # While `step` is off, the previous adjustment holds.
        adjustment = self._calc_adjustment(context) or phase.adjustment
        return CaptureRegions(
            regions=(),
            reach=phase.support.reach,
            nominal=adjustment.nominal.pose,
            adjusted=adjustment.pose,
        )

    def _calc_outcome(
        self, context: Context, last: dict[str, Any]
    ) -> tuple[Any, ...]:
        feedback = self._feedback.Eval(context)
        return (
            feedback.ecmp,  # as CoP, too
            feedback.ecmp,
            QpStatus(last["momentum_qp_status"]).after(feedback.result),
            feedback.reference.icp,
            feedback.reference.icp_velocity,
            feedback.reference.cop,
            feedback.reference.ecmp,
        )


class ComHeightController(Block):
    """Computes the momentum rate l_dot = m (omega^2 (c - eCMP), z_ddot).

    z_ddot = k_d clip(z_dot_d + k_p / k_d (z_d - z)) - k_d z_dot is a PD law on
    the planned height, limited; in a swing the CoM sinks from it by k_s omega^2
    (|icp - ecmp| - sink_distance).  The horizontal part is the pendulum's
    (Nadia paper, Eqs. 1 and 5).  The block has no state.

    Args:
        params: gains and limits of the height.
        model: point mass of the robot.
        period: not used, as the law has no memory: every block is made by
            Block(params, model, period).

    .. pydrake_system::

        name: ComHeightController
        input_ports: [com_state, ecmp_command, walking_state]
        output_ports: [momentum_rate]
    """

    def __init__(
        self, params: ComHeightParams, model: PointMassModel, period: float
    ) -> None:
        super().__init__()
        check(params)
        self._model = model
        self._control = ComHeight(params, model)
        self._com = input_port(self, "com_state", size(ComState))
        self._ecmp = input_port(self, "ecmp_command", size(EcmpCommand))
        self._walking = input_port(self, "walking_state")
        self._height = once_per_schedule(
            lambda state: self._control.plan(state.schedule)
        )
        declare_output(self, "momentum_rate", self._calc_rate)

    def _calc_rate(self, context: Context) -> Array:
        # The entries of a ComState, an EcmpCommand; properties take longer.
        com = self._com(context)
        place, velocity = com[:2], com[3:5]
        z, vz = float(com[2]), float(com[5])
        ecmp = self._ecmp(context)[2:]
        state = self._walking(context)
        # The planned height and its rate, which the stance leg may limit.
        desired = self._height(state).at(state.time_in_phase)
        sinking = 0.0
        if state.schedule.phase is Phase.SWING:
            desired = min(
                desired,
                self._control.stance_limit(place, velocity, state.schedule),
            )
            sole = state.schedule.feet[state.schedule.support_side].p_WF
            sinking = self._control.sinking(
                place,
                icp=icp(place, velocity, self._model.omega),
                ecmp=ecmp,
                above=z - float(sole[2]),
            )
        return momentum_rate(
            place,
            ecmp,
            vertical_acceleration=self._control.acceleration(
                z, vz, desired=desired[0], rate=desired[1], sinking=sinking
            ),
            model=self._model,
        )
