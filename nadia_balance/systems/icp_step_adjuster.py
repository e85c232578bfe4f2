"""Moves the foothold of the step in the air as one QP asks for."""

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.bounds import check
from nadia_balance.core.foothold_adjustment import (
    CaptureRegions,
    current_adjustment,
)
from nadia_balance.core.icp_plan import IcpPlan
from nadia_balance.core.icp_step_qp import (
    IcpStepQp,
    IcpStepQpParams,
    StepPlan,
    may_move,
    propose_by_qp,
    step_plan,
)
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.polygon import shrink
from nadia_balance.core.reachability import base_region, in_world
from nadia_balance.core.walking import Adjustment, Phase, WalkingState
from nadia_balance.systems.ports import (
    MechanismsInput,
    ValueInput,
    VectorInput,
    declare_cache,
    declare_output,
)


class IcpStepAdjuster(LeafSystem):
    """Proposes where the swing foot should land (Atlas paper, Sec. IV).

    In place of a CaptureRegionStepAdjuster, and without state like it.  Of the
    QP it takes the foothold; its feedback is that of the MomentumQp for the
    plan with this foothold.

    `icp` (2,) [m] in W; `walking_state` is a WalkingState, `icp_plan` the
    IcpPlan of its schedule; `mechanisms` (4,), all if not connected.
    `adjustment` is an Adjustment, None while `step` is off.  `capture_regions`
    are CaptureRegions without any, but with reach and footholds of a swing.

    .. pydrake_system::

        name: IcpStepAdjuster
        input_ports: [icp, walking_state, icp_plan, mechanisms]
        output_ports: [adjustment, capture_regions]
    """

    def __init__(
        self, params: IcpStepQpParams, model: PointMassModel, period: float
    ):
        """A foothold is proposed in each tick, whatever its `period`.

        Raises ValueError for `params` that are out of range.
        """
        super().__init__()
        check(params)
        shrink(model.sole, params.cop_safe_distance, "cop_safe_distance")
        max_rows = len(model.sole) + len(base_region(model.reach)) + 1
        self._qp = IcpStepQp(params, max_rows)
        self._model = model
        self._icp = VectorInput(self, "icp", 2)
        self._walking_state = ValueInput(self, "walking_state", WalkingState)
        self._icp_plan = ValueInput(self, "icp_plan", IcpPlan)
        self._mechanisms = MechanismsInput(self)
        self._plan = declare_cache(
            self,
            "step plan",
            self._calc_plan,
            {self._walking_state.ticket(), self._icp_plan.ticket()},
            (None, None),
        )
        self._adjustment = declare_output(
            self,
            "adjustment",
            self._calc_adjustment,
            {self.all_input_ports_ticket()},
        )
        declare_output(
            self,
            "capture_regions",
            self._calc_capture_regions,
            {self._adjustment.ticket()},
        )

    def _calc_plan(self, context, last) -> tuple[object, StepPlan]:
        """The plan and its key: a foothold that moves does not change it."""
        state = self._walking_state(context)
        nominal = current_adjustment(state).nominal
        # The start is a new one in every phase.
        key = state.schedule.start, nominal
        if key == last[0]:
            return last
        plan = step_plan(
            state.schedule,
            nominal,
            self._icp_plan(context).cop,
            self._qp.params,
            self._model,
        )
        return key, plan

    def _calc_adjustment(self, context) -> Adjustment | None:
        state = self._walking_state(context)
        if not self._mechanisms(context).step:
            return None
        if not may_move(state, self._qp.params):
            return current_adjustment(state)
        _, plan = self._plan.Eval(context)
        return propose_by_qp(state, plan, self._icp(context), self._qp)

    def _calc_capture_regions(self, context) -> CaptureRegions:
        state = self._walking_state(context)
        if state.schedule.phase is not Phase.SWING:
            return CaptureRegions()
        # While `step` is off, the adjustment of before holds.
        adjustment = self._adjustment.Eval(context) or current_adjustment(state)
        nominal = adjustment.nominal
        stance = state.schedule.feet[state.schedule.support_side]
        reach = in_world(base_region(self._model.reach), stance, nominal.side)
        return CaptureRegions((), reach, nominal.pose, adjustment.pose)
