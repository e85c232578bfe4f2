"""Where to walk and when: the walking clock, the ICP plan, its timing."""

import math

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.bounds import check
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.plan import atlas_icp_plan, icp_plan
from nadia_balance.core.plan import walking_state_machine as clock
from nadia_balance.core.plan.gait import Gait, walking_start
from nadia_balance.core.plan.time_adjustment import Timing, TimingAdapterParams
from nadia_balance.core.walking import vocabulary as walking
from nadia_balance.systems.ports import declare_output, declare_plan, inputs
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
        params: clock.WalkingStateMachineParams,
        model: PointMassModel,
        period: float,
        start: walking.WalkingState | None = None,
    ):
        """Begins with `start`, by default standing, ticks every `period`."""
        super().__init__()
        check(params)
        start = start or walking_start(Gait(), model)
        self._machine = clock.StateMachine(params, model, period)
        self._weight = model.mass * GRAVITY
        names = "foot_poses foot_forces icp icp_plan"
        self._inputs = inputs(self, names, "time_adjustment adjustment?")
        self._state = self.DeclareAbstractState(Value(start))
        # The outputs depend on the state only: this breaks every loop.
        state_only = [self.abstract_state_ticket(self._state)]
        declare_output(self, "walking_state", self._walking_state, state_only)
        declare_output(self, "walking_signal", self._calc_signal, state_only)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._advance)

    def _walking_state(self, context) -> walking.WalkingState:
        return context.get_abstract_state(self._state).get_value()

    def _calc_signal(self, context) -> list[float]:
        return walking_signal(self._walking_state(context))

    def _advance(self, context, state):
        feet, forces, icp, plan, time, adjustment = (
            get(context) for get in self._inputs
        )
        measured = feet, forces / self._weight, icp
        now = self._machine.advance(
            self._walking_state(context),
            *(plan, *measured, float(time[0]), adjustment),
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


class IcpPlanner(LeafSystem):
    """Plans the ICP for each new contact schedule.

    The plan is that of the Nadia paper (Eq. 4) or, with AtlasIcpPlanParams, of
    the Atlas paper (Sec. II-A), an AtlasIcpPlan.  `icp_reference` exists only
    if it `has_reference`.

    .. pydrake_system::

        name: IcpPlanner
        input_ports: [walking_state]
        output_ports: [icp_plan, icp_reference]
    """

    def __init__(
        self,
        params: icp_plan.IcpPlanParams | atlas_icp_plan.AtlasIcpPlanParams,
        model: PointMassModel,
        period: float,
        has_reference: bool = True,
    ):
        super().__init__()
        check(params)
        (self._walking,) = inputs(self, "walking_state")
        atlas = isinstance(params, atlas_icp_plan.AtlasIcpPlanParams)
        plan = atlas_icp_plan.plan_atlas_icp if atlas else icp_plan.plan_icp
        self._planned = declare_plan(
            self, self._walking, lambda now: plan(now.schedule, params, model)
        )
        declare_output(self, "icp_plan", self._plan, [self._planned])
        if has_reference:
            declare_output(
                self, "icp_reference", self._calc_reference, [self._planned]
            )

    def _plan(self, context) -> icp_plan.IcpPlan:
        return self._planned.Eval(context)[1]

    def _calc_reference(self, context) -> np.ndarray:
        now = icp_plan.reference_of(self._plan(context), self._walking(context))
        return np.concatenate([now.icp, now.icp_velocity, now.cop, now.ecmp])


class TimingAdapter(LeafSystem):
    """Computes the time by which to advance the walking clock (Nadia, Sec. VI).

    `time_adjustment` is the time to add to the clock in this tick, besides the
    control period, and the present estimate of the total over this and the next
    ticks; the clock is held while it is negative.

    .. pydrake_system::

        name: TimingAdapter
        input_ports: [walking_state, icp_plan, icp, foot_poses, mechanisms]
        output_ports: [time_adjustment]
    """

    def __init__(
        self, params: TimingAdapterParams, model: PointMassModel, period: float
    ):
        super().__init__()
        check(params)
        self._timing = Timing(params, model, period)
        names = "walking_state icp_plan icp foot_poses mechanisms"
        self._inputs = inputs(self, names)
        declare_output(self, "time_adjustment", self._calc)

    def _calc(self, context) -> tuple[float, float]:
        return self._timing.adjustment(*(get(context) for get in self._inputs))
