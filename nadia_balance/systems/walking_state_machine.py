"""The owner of the walking clock, phase and contacts."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import (
    Adjustment,
    FootPose,
    FootPoses,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.core.walking_state_machine import (
    Measurement,
    Proposal,
    WalkingStateMachineParams,
    advance,
)
from nadia_balance.systems.icp_planner import IcpPlan
from nadia_balance.systems.ports import declare_input, eval_typed

PHASES = [Phase.STANDING, Phase.TRANSFER, Phase.SWING]


class WalkingStateMachine(LeafSystem):
    """Advances the walking state once per control period.

    `time_adjustment` [s] and `adjustment` are proposals; what is not
    connected is not used.

    `walking_signal` is the walking state as numbers, for logs: [phase
    (0 standing, 1 transfer, 2 swing), support side (+1 left, -1 right), time
    in phase [s], duration [s], waiting, steps taken, left sole x, y, yaw,
    right sole x, y, yaw, next foothold x, y, yaw (NaN if none), its side].

    .. pydrake_system::

        name: WalkingStateMachine
        input_ports: [foot_poses, foot_forces, icp, icp_plan,
                      time_adjustment, adjustment]
        output_ports: [walking_state, walking_signal]
    """

    def __init__(
        self,
        params: WalkingStateMachineParams,
        initial: WalkingState,
        sole: np.ndarray,
        reach: ReachabilityParams,
        control_period: float,
    ):
        """Starts in `initial`; `sole` (n, 2) [m], `control_period` [s]."""
        super().__init__()
        params.validate()
        self._params, self._sole, self._reach = params, sole, reach
        self._period = control_period
        poses = FootPoses(FootPose(), FootPose())
        self._foot_poses = declare_input(self, "foot_poses", poses)
        self._foot_forces = self.DeclareVectorInputPort("foot_forces", 2)
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self._icp_plan = self.DeclareAbstractInputPort(
            "icp_plan", Value(object())
        )
        self._time = self.DeclareVectorInputPort("time_adjustment", 1)
        self._adjustment = self.DeclareAbstractInputPort(
            "adjustment", Value(object())
        )
        self._state = self.DeclareAbstractState(Value(initial))
        # The outputs depend on the state only: this breaks every loop.
        state_only = {self.abstract_state_ticket(self._state)}
        self.DeclareAbstractOutputPort(
            "walking_state",
            alloc=lambda: Value(initial),
            calc=lambda context, output: output.set_value(
                self._walking_state(context)
            ),
            prerequisites_of_calc=state_only,
        )
        self.DeclareVectorOutputPort(
            "walking_signal",
            16,
            self._calc_signal,
            prerequisites_of_calc=state_only,
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=control_period, offset_sec=0.0, update=self._advance
        )

    def _walking_state(self, context) -> WalkingState:
        return context.get_abstract_state(self._state).get_value()

    def _advance(self, context, state):
        measured = Measurement(
            eval_typed(self, context, self._foot_poses, FootPoses),
            self._foot_forces.Eval(context),
            self._icp.Eval(context),
        )
        plan = eval_typed(self, context, self._icp_plan, IcpPlan)
        now = advance(
            self._walking_state(context),
            plan,
            measured,
            self._period,
            self._sole,
            self._reach,
            self._params,
            self._proposal(context),
        )
        state.get_mutable_abstract_state(self._state).set_value(now)
        return EventStatus.Succeeded()

    def _proposal(self, context) -> Proposal:
        """What is connected of the adapters; the rest stays as it is."""
        gain, adjustment = 0.0, None
        if self._time.HasValue(context):
            gain = float(self._time.Eval(context)[0])
        if self._adjustment.HasValue(context):
            adjustment = eval_typed(self, context, self._adjustment, Adjustment)
        return Proposal(gain, adjustment)

    def _calc_signal(self, context, output):
        output.SetFromVector(walking_signal(self._walking_state(context)))


def walking_signal(state: WalkingState) -> list[float]:
    """The walking state as 16 numbers (see WalkingStateMachine)."""
    schedule = state.schedule
    target = [np.nan, np.nan, np.nan, 0.0]
    if schedule.footsteps:
        step = schedule.footsteps[0]
        target = [*step.pose.p_WF[:2], step.pose.yaw, step.side.sign]
    left, right = schedule.feet[Side.LEFT], schedule.feet[Side.RIGHT]
    return [
        float(PHASES.index(schedule.phase)),
        schedule.support_side.sign,
        state.time_in_phase,
        schedule.duration,
        state.waiting,
        state.steps_taken,
        *left.p_WF[:2],
        left.yaw,
        *right.p_WF[:2],
        right.yaw,
        *target,
    ]
