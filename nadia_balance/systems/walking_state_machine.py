"""State machine of the walking clock, the phases and the contacts."""

import math

from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.bounds import check
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.plan import walking_state_machine
from nadia_balance.core.plan.gait import Gait, walking_start
from nadia_balance.core.walking import vocabulary as walking
from nadia_balance.systems.ports import declare_output, inputs
from nadia_balance.systems.signals import PHASES


class WalkingStateMachine(LeafSystem):
    """Advances the walking state once per control period.

    `time_adjustment` and `adjustment` are optional proposals.  Without an
    adjustment the footholds are those of the plan, and the wait before
    lift-off has no limit (`max_wait` is ignored).  `walking_state`, and the
    same as numbers, `walking_signal`, are those before the update of a tick.

    .. pydrake_system::

        name: WalkingStateMachine
        input_ports: [foot_poses, foot_forces, icp, icp_plan,
                      time_adjustment, adjustment]
        output_ports: [walking_state, walking_signal]
    """

    def __init__(
        self,
        params: walking_state_machine.WalkingStateMachineParams,
        model: PointMassModel,
        period: float,
        start: walking.WalkingState | None = None,
    ):
        """Begins with `start`, by default standing, ticks every `period`."""
        super().__init__()
        check(params)
        start = start or walking_start(Gait(), model)
        self._machine = walking_state_machine.StateMachine(
            params, model, period
        )
        self._weight = model.mass * GRAVITY
        self._foot_poses, self._foot_forces, self._icp = inputs(
            self, "foot_poses", "foot_forces", "icp"
        )
        self._icp_plan, self._time, self._adjustment = inputs(
            self, "icp_plan", "time_adjustment", "adjustment?"
        )
        self._state = self.DeclareAbstractState(Value(start))
        # The outputs depend on the state only: this breaks every loop.
        state_only = [self.abstract_state_ticket(self._state)]
        declare_output(self, "walking_state", self._walking_state, state_only)
        declare_output(
            self,
            "walking_signal",
            lambda context: walking_signal(self._walking_state(context)),
            state_only,
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._advance)

    def _walking_state(self, context) -> walking.WalkingState:
        return context.get_abstract_state(self._state).get_value()

    def _advance(self, context, state):
        now = self._machine.advance(
            self._walking_state(context),
            self._icp_plan(context),
            self._foot_poses(context),
            self._foot_forces(context) / self._weight,
            self._icp(context),
            float(self._time(context)[0]),
            self._adjustment(context),
        )
        state.get_mutable_abstract_state(self._state).set_value(now)
        return EventStatus.Succeeded()


def walking_signal(state: walking.WalkingState) -> list[float]:
    """The walking state as the numbers of a WalkingSignal."""
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


def _planar(pose: walking.FootPose) -> tuple[float, float, float]:
    x, y, _ = pose.p_WF.tolist()
    return x, y, pose.yaw
