"""The owner of the walking clock, phase and contacts."""

import math
from dataclasses import replace

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.icp_plan import IcpPlan
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import (
    Adjustment,
    FootPose,
    FootPoses,
    Phase,
    WalkingState,
)
from nadia_balance.core.walking_state_machine import (
    Measurement,
    Proposal,
    WalkingStateMachineParams,
    advance,
)
from nadia_balance.systems.ports import (
    declare_input,
    eval_finite,
    eval_optional,
    eval_typed,
)

PHASES = [Phase.STANDING, Phase.TRANSFER, Phase.SWING]


class WalkingStateMachine(LeafSystem):
    """Advances the walking state once per control period.

    `time_adjustment` [s] and `adjustment` are proposals; what is not
    connected is not used.  If nobody proposes an adjustment, the feet go where
    they are told, and only waiting helps: then there is no end of `patience`.

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
        weight: float,
        control_period: float,
    ):
        """Starts in `initial`, for a robot of this `weight` [N].

        `sole` (n, 2) [m] are its corners, `control_period` [s].
        """
        super().__init__()
        params.validate()
        self._params, self._sole, self._reach = params, sole, reach
        self._patient = replace(
            params, lift_off=replace(params.lift_off, patience=math.inf)
        )
        self._weight, self._period = weight, control_period
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
            lambda: eval_typed(self, context, self._foot_poses, FootPoses),
            eval_finite(self, context, self._foot_forces) / self._weight,
            eval_finite(self, context, self._icp),
        )
        proposal = self._proposal(context)
        now = advance(
            self._walking_state(context),
            eval_typed(self, context, self._icp_plan, IcpPlan),
            measured,
            self._period,
            self._sole,
            self._reach,
            self._params if proposal.adjustment else self._patient,
            proposal,
        )
        state.get_mutable_abstract_state(self._state).set_value(now)
        return EventStatus.Succeeded()

    def _proposal(self, context) -> Proposal:
        """What is connected of the adapters; the rest stays as it is."""
        gain = 0.0
        if self._time.HasValue(context):
            gain = float(eval_finite(self, context, self._time)[0])
        return Proposal(
            gain, eval_optional(self, context, self._adjustment, Adjustment)
        )

    def _calc_signal(self, context, output):
        output.SetFromVector(walking_signal(self._walking_state(context)))


def walking_signal(state: WalkingState) -> list[float]:
    """The walking state as 16 numbers (see WalkingStateMachine)."""
    schedule = state.schedule
    target = [math.nan, math.nan, math.nan, 0.0]
    if schedule.footsteps:
        step = schedule.footsteps[0]
        target = [*_planar(step.pose), step.side.sign]
    return [
        float(PHASES.index(schedule.phase)),
        schedule.support_side.sign,
        state.time_in_phase,
        schedule.duration,
        state.waiting,
        state.steps_taken,
        *_planar(schedule.feet.left),
        *_planar(schedule.feet.right),
        *target,
    ]


def _planar(pose: FootPose) -> tuple[float, float, float]:
    x, y, _ = pose.p_WF.tolist()
    return x, y, pose.yaw
