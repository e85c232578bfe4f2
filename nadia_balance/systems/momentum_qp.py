"""ICP control with ankles and hips, and the CoM height."""

import functools
import itertools
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
from nadia_balance.core.feedback_limits import (
    FeedbackLimits,
    check_safe_distance,
    feedback_limits,
)
from nadia_balance.core.momentum_qp import (
    IcpFeedbackQp,
    MomentumQpParams,
    momentum_rate,
)
from nadia_balance.core.support_polygon import support_polygon
from nadia_balance.core.walking import ContactSchedule, WalkingState
from nadia_balance.systems.ports import declare_input, eval_finite, eval_typed


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
    The discrete state is what came of the last tick: the outputs, [delta,
    kappa], and the active limits.

    Evaluating an output raises RuntimeError if an input that it depends on is
    not finite.

    .. pydrake_system::

        name: MomentumQp
        input_ports: [com_state, icp, icp_reference, walking_state]
        output_ports: [ecmp_command, qp_status, momentum_rate]
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
        check_safe_distance(params.cop_safe_distance, sole)
        self._params, self._height_params = params, height_params
        self._mass, self._omega = mass, omega
        self._nominal, self._legs, self._sole = com_height, legs, sole
        self._max_edges = 2 * len(sole)
        self._qp = IcpFeedbackQp(params, self._max_edges)
        self._declare_inputs()
        self._declare_state()
        self._declare_caches()
        self._declare_outputs()
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=control_period, offset_sec=0.0, update=self._remember
        )

    def _declare_inputs(self):
        self._com_state = self.DeclareVectorInputPort("com_state", 6)
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self._reference = self.DeclareVectorInputPort("icp_reference", 8)
        self._walking_state = declare_input(self, "walking_state", object())

    def _declare_state(self):
        # Parts of an outcome, which is what one tick comes to.
        ends = np.cumsum([0, 4, 5, 4, self._max_edges + 2]).tolist()
        self._command, self._status, self._increments, self._active = (
            itertools.starmap(slice, itertools.pairwise(ends))
        )
        self._last = self.DeclareDiscreteState(ends[-1])

    def _declare_caches(self):
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
        self._outcome = self.DeclareCacheEntry(
            "outcome",
            ValueProducer(
                allocate=lambda: Value(object()), calc=self._calc_outcome
            ),
            prerequisites_of_calc={
                self._icp.ticket(),
                self._reference.ticket(),
                self._phase_data.ticket(),
                self.discrete_state_ticket(self._last),
            },
        )

    def _declare_outputs(self):
        needs = {self._outcome.ticket()}
        for name, part in (
            ("ecmp_command", self._command),
            ("qp_status", self._status),
        ):
            self.DeclareVectorOutputPort(
                name,
                part.stop - part.start,
                functools.partial(self._write, part),
                prerequisites_of_calc=needs,
            )
        self.DeclareVectorOutputPort(
            "momentum_rate",
            3,
            self._calc_momentum_rate,
            prerequisites_of_calc=needs
            | {self._com_state.ticket(), self._walking_state.ticket()},
        )

    def _write(self, part, context, output):
        output.set_value(self._outcome.Eval(context)[part])

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

    def _calc_outcome(self, context, cache):
        last = context.get_discrete_state(self._last).value()
        reference = eval_finite(self, context, self._reference)
        cop_r, ecmp_r = reference[4:6], reference[6:8]
        feedback = self._qp.solve(
            eval_finite(self, context, self._icp) - reference[:2],
            cop_r,
            ecmp_r - cop_r,
            last[self._increments],
            self._phase_data.Eval(context).limits,
            last[self._active].astype(np.int8),
        )
        qp, failures = feedback.result, last[self._status][-1]
        failures += not qp.solved
        status = qp.solved, qp.fallback, qp.iterations, qp.violation, failures
        command = feedback.cop, feedback.ecmp
        memory = feedback.increments, qp.active
        cache.set_value(np.concatenate((*command, status, *memory)))

    def _remember(self, context, state):
        state.set_value(self._last, self._outcome.Eval(context))
        return EventStatus.Succeeded()

    def _calc_momentum_rate(self, context, output):
        ecmp = self._outcome.Eval(context)[self._command][2:]
        com = eval_finite(self, context, self._com_state)
        plan = self._phase_data.Eval(context).height
        height, rate = plan.at(self._walking(context).time_in_phase)
        acceleration = vertical_acceleration(
            float(com[2]), float(com[5]), height, rate, self._height_params
        )
        output.set_value(
            momentum_rate(self._mass, self._omega, com[:2], ecmp, acceleration)
        )
