"""The reference ICP of the present phase, from the coming footsteps."""

import math

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem, ValueProducer

from nadia_balance.core.icp_plan import (
    IcpPlan,
    IcpPlanParams,
    plan_icp,
    reference_of,
)
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.systems.ports import declare_input, eval_typed


class IcpPlanner(LeafSystem):
    """Plans the ICP for each new contact schedule (Nadia paper, Eq. 4).

    `icp_reference` is [icp, icp velocity, CoP, eCMP], each xy of W in [m],
    [m/s].

    .. pydrake_system::

        name: IcpPlanner
        input_ports: [walking_state]
        output_ports: [icp_plan, icp_reference]
    """

    def __init__(self, params: IcpPlanParams, sole: np.ndarray, omega: float):
        """Plans for soles with the corners `sole` (n, 2) [m]; omega [rad/s]."""
        super().__init__()
        params.validate()
        self._params, self._sole, self._omega = params, sole, omega
        standing = _standing()
        example = (standing, plan_icp(standing, sole, params, omega))
        self._walking_state = declare_input(
            self, "walking_state", WalkingState(standing)
        )
        # The schedule and its plan: a pure function of the input.  Keeping
        # the last one only saves planning the same schedule in every tick.
        self._planned = self.DeclareCacheEntry(
            "schedule and ICP plan",
            ValueProducer(lambda: Value(example), self._calc_planned),
            {self.input_port_ticket(self._walking_state.get_index())},
        )
        self.DeclareAbstractOutputPort(
            "icp_plan",
            alloc=lambda: Value(example[1]),
            calc=lambda context, output: output.set_value(self._plan(context)),
            prerequisites_of_calc={self._planned.ticket()},
        )
        self.DeclareVectorOutputPort("icp_reference", 8, self._calc_reference)

    def _state(self, context) -> WalkingState:
        return eval_typed(self, context, self._walking_state, WalkingState)

    def _plan(self, context) -> IcpPlan:
        return self._planned.Eval(context)[1]

    def _calc_planned(self, context, planned):
        schedule = self._state(context).schedule
        if planned.get_value()[0] is not schedule:
            plan = plan_icp(schedule, self._sole, self._params, self._omega)
            planned.set_value((schedule, plan))

    def _calc_reference(self, context, output):
        now = reference_of(self._plan(context), self._state(context))
        output.SetFromVector(
            np.concatenate([now.icp, now.icp_velocity, now.cop, now.ecmp])
        )


def _standing() -> ContactSchedule:
    """Some schedule, to make the plan that the ports have as their example."""
    rest = np.zeros(2)
    return ContactSchedule(
        phase=Phase.STANDING,
        support_side=Side.LEFT,
        duration=math.inf,
        feet=FootPoses(FootPose(), FootPose()),
        footsteps=(),
        start=ReferencePoint(rest, rest, rest),
    )
