"""Moves the foothold of the step in the air as one QP asks for."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem, ValueProducer

from nadia_balance.core.cop_waypoints import CopWaypointParams
from nadia_balance.core.feedback_limits import check_safe_distance
from nadia_balance.core.foothold_adjustment import (
    CaptureRegions,
    current_adjustment,
)
from nadia_balance.core.icp_step_adjustment import (
    StepPlan,
    may_move,
    propose_by_qp,
    step_plan,
)
from nadia_balance.core.icp_step_qp import IcpStepQp, IcpStepQpParams
from nadia_balance.core.mechanisms import Mechanisms
from nadia_balance.core.reachability import (
    ReachabilityParams,
    base_region,
    in_world,
)
from nadia_balance.core.walking import (
    Adjustment,
    FootPose,
    Footstep,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.systems.ports import eval_finite, eval_typed
from nadia_balance.systems.switched_params import SwitchedParams


class IcpStepAdjuster(LeafSystem):
    """Proposes where the swing foot should land (Atlas paper, Sec. IV).

    In place of a CaptureRegionStepAdjuster.  Of the QP it takes the foothold;
    its feedback is that of the MomentumQp for the plan with this foothold.
    `capture_regions` has none of them, but reach and footholds, to be drawn.
    Switched off by the optional `mechanisms` (see SwitchedParams), it proposes
    None.

    .. pydrake_system::

        name: IcpStepAdjuster
        input_ports: [icp, walking_state, mechanisms]
        output_ports: [adjustment, capture_regions]
    """

    def __init__(
        self,
        params: IcpStepQpParams,
        cop_params: CopWaypointParams,
        reach: ReachabilityParams,
        sole: np.ndarray,
        omega: float,
    ):
        """For soles with the corners `sole` (n, 2) [m]; omega [rad/s].

        The CoP goes where `cop_params` say, as in the ICP plan.

        Raises:
            ValueError: a parameter is out of range.
        """
        super().__init__()
        cop_params.validate()
        reach.validate()
        check_safe_distance(params.cop_safe_distance, sole)
        max_rows = len(sole) + len(base_region(reach)) + 1
        self._qp = IcpStepQp(params, max_rows)
        self._cop_params, self._reach = cop_params, reach
        self._sole, self._omega = sole, omega
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self._walking_state = self.DeclareAbstractInputPort(
            "walking_state", Value(object())
        )
        self._enabled = SwitchedParams(self, True, _switched)
        # A pure function of the walking state.  Keeping the last one only
        # saves making it anew for a foothold that moves.
        self._plan = self.DeclareCacheEntry(
            "step plan",
            ValueProducer(lambda: Value((None, None)), self._calc_plan),
            {self._walking_state.ticket()},
        )
        step = Footstep(Side.LEFT, FootPose(), 0.0, 0.0)
        self._adjustment = self.DeclareAbstractOutputPort(
            "adjustment",
            lambda: Value(Adjustment(step, step.pose)),
            self._calc_adjustment,
        )
        self.DeclareAbstractOutputPort(
            "capture_regions",
            lambda: Value(CaptureRegions()),
            self._calc_capture_regions,
        )

    def _state(self, context) -> WalkingState:
        return eval_typed(self, context, self._walking_state, WalkingState)

    def _calc_plan(self, context, cache):
        state = self._state(context)
        nominal = current_adjustment(state).nominal
        # The start is a new one in every phase.
        key = state.schedule.start, nominal
        if cache.get_value()[0] != key:
            plan = step_plan(
                state.schedule,
                nominal,
                self._sole,
                self._cop_params,
                self._reach,
                self._qp.params,
                self._omega,
            )
            cache.set_value((key, plan))

    def _step_plan(self, context) -> StepPlan:
        return self._plan.Eval(context)[1]

    def _calc_adjustment(self, context, output):
        state = self._state(context)
        if not self._enabled(context):
            proposal = None
        elif not may_move(state, self._qp.params):
            proposal = current_adjustment(state)
        else:
            proposal = propose_by_qp(
                state,
                self._step_plan(context),
                eval_finite(self, context, self._icp),
                self._qp,
            )
        output.set_value(proposal)

    def _calc_capture_regions(self, context, output):
        state = self._state(context)
        if state.schedule.phase is not Phase.SWING:
            output.set_value(CaptureRegions())
            return
        # None if it is switched off: that of before holds.
        adjustment = self._adjustment.Eval(context) or current_adjustment(state)
        reach = in_world(
            base_region(self._reach),
            state.schedule.feet[state.schedule.support_side],
            adjustment.nominal.side,
        )
        nominal = adjustment.nominal.pose
        output.set_value(CaptureRegions((), reach, nominal, adjustment.pose))


def _switched(_: bool, on: Mechanisms) -> bool:
    return on.step
