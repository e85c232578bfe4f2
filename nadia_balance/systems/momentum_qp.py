"""ICP control with ankles and hips, and the CoM height."""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem, ValueProducer

from nadia_balance.core.com_height import (
    ComHeightParams,
    ComHeightPlan,
    LegGeometry,
    plan_com_height,
    vertical_acceleration,
)
from nadia_balance.core.feedback_limits import FeedbackLimits, feedback_limits
from nadia_balance.core.momentum_qp import (
    IcpFeedbackQp,
    MomentumQpParams,
    momentum_rate,
)
from nadia_balance.core.polygon import shrink
from nadia_balance.core.support_polygon import support_polygon
from nadia_balance.core.walking import ContactSchedule, WalkingState
from nadia_balance.systems.ports import declare_input, eval_typed


@dataclass(frozen=True)
class PhaseData:
    """What stays the same as long as the contact schedule does."""

    schedule: ContactSchedule | None
    limits: FeedbackLimits | None
    height: ComHeightPlan | None


class MomentumQp(LeafSystem):
    """Turns the ICP error into a momentum rate (Nadia paper, Eqs. 5-8).

    `icp_reference` is [icp, icp velocity, CoP, eCMP] and `ecmp_command`
    [CoP, eCMP], each xy of W [m]; `momentum_rate` [N] is in W; `qp_status`
    is [solved, fallback used, iterations, violation [m], failures so far].
    The discrete state is [delta, kappa] of the last tick, its active limits,
    and the failures so far.

    .. pydrake_system::

        name: MomentumQp
        input_ports: [com_state, icp, icp_reference, walking_state]
        output_ports: [ecmp_command, momentum_rate, qp_status]
    """

    def __init__(
        self,
        params: MomentumQpParams,
        height_params: ComHeightParams,
        *,
        mass: float,
        omega: float,
        com_height: float,
        sole: np.ndarray,
        legs: LegGeometry,
        control_period: float,
    ):
        """Controls a robot with `mass` [kg], `omega` [rad/s], `sole` (n, 2).

        `com_height` [m] is nominal, above the soles, and as low as `legs`
        require.

        Raises:
            ValueError: a parameter is out of range.
        """
        super().__init__()
        params.validate()
        height_params.validate()
        shrink(sole, params.cop_safe_distance)  # raises if nothing is left
        self._params, self._height_params = params, height_params
        self._mass, self._omega = mass, omega
        self._nominal, self._legs, self._sole = com_height, legs, sole
        self._max_edges = 2 * len(sole)
        self._qp = IcpFeedbackQp(params, self._max_edges)
        self._declare_inputs()
        num_limits = self._max_edges + 2
        self._state = self.DeclareDiscreteState(4 + num_limits + 1)
        self._declare_cache()
        self._declare_outputs()
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=control_period, offset_sec=0.0, update=self._remember
        )

    def _declare_inputs(self):
        self._com_state = self.DeclareVectorInputPort("com_state", 6)
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self._reference = self.DeclareVectorInputPort("icp_reference", 8)
        self._walking_state = declare_input(self, "walking_state", object())

    def _declare_cache(self):
        nothing = PhaseData(None, None, None)
        # Still a pure function of the input: the last value only spares
        # computing the same thing for one schedule many times.
        self._phase_data = self.DeclareCacheEntry(
            "phase data",
            ValueProducer(
                allocate=lambda: Value(nothing), calc=self._calc_phase_data
            ),
            prerequisites_of_calc={self._walking_state.ticket()},
        )
        self._feedback = self.DeclareCacheEntry(
            "feedback",
            ValueProducer(
                allocate=lambda: Value(object()), calc=self._calc_feedback
            ),
            prerequisites_of_calc={
                self._icp.ticket(),
                self._reference.ticket(),
                self._phase_data.ticket(),
                self.discrete_state_ticket(self._state),
            },
        )

    def _declare_outputs(self):
        needs = {self._feedback.ticket()}
        self.DeclareVectorOutputPort(
            "ecmp_command", 4, self._calc_command, prerequisites_of_calc=needs
        )
        self.DeclareVectorOutputPort(
            "momentum_rate",
            3,
            self._calc_momentum_rate,
            prerequisites_of_calc=needs
            | {self._com_state.ticket(), self._walking_state.ticket()},
        )
        self.DeclareVectorOutputPort(
            "qp_status", 5, self._calc_status, prerequisites_of_calc=needs
        )

    def _walking(self, context) -> WalkingState:
        return eval_typed(self, context, self._walking_state, WalkingState)

    def _calc_phase_data(self, context, cache):
        schedule = self._walking(context).schedule
        if cache.get_value().schedule is schedule:
            return
        limits = feedback_limits(
            support_polygon(schedule, self._sole),
            schedule.feet[schedule.support_side].yaw,
            self._params.cop_safe_distance,
            self._params.max_kappa,
            self._max_edges,
        )
        height = plan_com_height(
            schedule, self._nominal, self._legs, self._height_params
        )
        cache.set_value(PhaseData(schedule, limits, height))

    def _calc_feedback(self, context, cache):
        state = context.get_discrete_state(self._state).value()
        reference = self._reference.Eval(context)
        cop_r, ecmp_r = reference[4:6], reference[6:8]
        feedback = self._qp.solve(
            self._icp.Eval(context) - reference[:2],
            cop_r,
            ecmp_r - cop_r,
            state[:4],
            self._phase_data.Eval(context).limits,
            state[4:-1].astype(np.int8),
        )
        failures = state[-1] + (not feedback.result.solved)
        cache.set_value((feedback, failures))

    def _remember(self, context, state):
        feedback, failures = self._feedback.Eval(context)
        state.set_value(
            self._state,
            np.concatenate(
                (feedback.increments, feedback.result.active, [failures])
            ),
        )
        return EventStatus.Succeeded()

    def _calc_command(self, context, output):
        feedback, _ = self._feedback.Eval(context)
        output.set_value(np.concatenate((feedback.cop, feedback.ecmp)))

    def _calc_momentum_rate(self, context, output):
        feedback, _ = self._feedback.Eval(context)
        com = self._com_state.Eval(context)
        plan = self._phase_data.Eval(context).height
        height, rate = plan.at(self._walking(context).time_in_phase)
        acceleration = vertical_acceleration(
            float(com[2]), float(com[5]), height, rate, self._height_params
        )
        output.set_value(
            momentum_rate(
                self._mass, self._omega, com[:2], feedback.ecmp, acceleration
            )
        )

    def _calc_status(self, context, output):
        feedback, failures = self._feedback.Eval(context)
        result = feedback.result
        output.SetFromVector(
            [
                result.solved,
                result.fallback,
                result.iterations,
                result.violation,
                failures,
            ]
        )
