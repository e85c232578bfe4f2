"""Where to walk and when: the walking clock, the ICP plan, its timing."""

import functools
import itertools
import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.plan import atlas_icp_plan, icp_plan
from nadia_balance.core.plan import walking_state_machine as clock
from nadia_balance.core.plan.footstep_plan import (
    FootstepPlan,
    FootstepPlannerParams,
    velocity_limits,
)
from nadia_balance.core.plan.gait import (
    Gait,
    remaining_footsteps,
    walking_start,
)
from nadia_balance.core.plan.time_adjustment import Timing, TimingAdapterParams
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.walking import state as walking
from nadia_balance.parameters.bounds import check
from nadia_balance.systems.ports import (
    Input,
    declare_output,
    declare_plan,
    inputs,
)
from nadia_balance.systems.signals import MODES, PHASES

_EARLY = 1e-6  # times of ticks differ by rounding [s]


class WalkingStateMachine(LeafSystem):
    """Advances the walking state once per control period.

    `footsteps` are those after the present phase.  They are read standing, on
    the way to it, and at touchdown; not connected, the steps are those of the
    start.  `time_adjustment`, `adjustment` and `revised_footsteps` are optional
    proposals.  Without an adjustment the footholds are those of the plan, and
    the wait before lift-off has no limit (`max_wait` is ignored).
    `walking_state`, and the same as numbers, `walking_signal`, are those before
    the update of a tick.

    .. pydrake_system::

        name: WalkingStateMachine
        input_ports: [foot_poses, foot_forces, icp, icp_plan,
                      time_adjustment, adjustment, footsteps,
                      revised_footsteps]
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
        names = "foot_poses foot_forces icp icp_plan time_adjustment"
        optional = "adjustment? footsteps? revised_footsteps?"
        *self._inputs, self._footsteps, self._revised = inputs(
            self, names, optional
        )
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
        now = self._machine.advance(
            self._walking_state(context),
            plan,
            feet,
            forces / self._weight,
            icp,
            time_gain=float(time[0]),
            adjustment=adjustment,
            footsteps=functools.partial(
                self._next_footsteps, self._footsteps, context
            ),
            revised=self._next_footsteps(self._revised, context),
        )
        state.get_mutable_abstract_state(self._state).set_value(now)
        return EventStatus.Succeeded()

    def _next_footsteps(
        self, port: Input, context
    ) -> tuple[walking.Footstep, ...] | None:
        """Returns the footsteps of the `port`, whose feet take turns."""
        steps = port(context)
        for step in steps or ():
            if not isinstance(step, walking.Footstep):
                what = f"has a {type(step).__name__}, needs Footsteps"
                raise port.error(context, what)
        sides = [step.side for step in steps or ()]
        if any(one is other for one, other in itertools.pairwise(sides)):
            named = ", ".join(side.value for side in sides)
            what = f"has feet {named}: they must take turns"
            raise port.error(context, what)
        return steps


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
        float(MODES.index(state.mode)),
    ]


def _planar(pose: walking.FootPose) -> tuple[float, float, float]:
    x, y, _ = pose.p_WF.tolist()
    return x, y, pose.yaw


class FootstepPlanner(LeafSystem):
    """Plans footsteps: to catch the robot, to walk as commanded, to stand.

    `footsteps` are those after the present phase, () to stand; of the foot in
    the air, as if it landed now.  `revised_footsteps` have not landed yet; they
    follow a command that has changed, and are None otherwise.  The state is the
    velocity of the walk (3,), which follows the `velocity_command`, clipped to
    the robot's `limits` (see velocity_limits).

    .. pydrake_system::

        name: FootstepPlanner
        input_ports: [walking_state, velocity_command, alip_icp,
                      icp_plan, foot_poses, mechanisms]
        output_ports: [footsteps, revised_footsteps]
    """

    def __init__(
        self,
        params: FootstepPlannerParams,
        model: PointMassModel,
        period: float,
        adjuster: CaptureRegionStepAdjusterParams | None = None,
        timing: TimingAdapterParams | None = None,
    ):
        """Plans for `model`, whose steps these blocks adjust, in `period`.

        Raises ValueError: a parameter is out of range.
        """
        super().__init__()
        adjuster = adjuster or CaptureRegionStepAdjusterParams()
        timing = timing or TimingAdapterParams()
        for checked in params, adjuster, timing:
            check(checked)
        self._planner = FootstepPlan(
            params, model, adjuster, timing.min_swing_duration
        )
        self.limits = velocity_limits(params, model)
        rates = [params.acceleration, params.acceleration]
        self._change = period * np.array([*rates, params.yaw_acceleration])
        names = "walking_state velocity_command alip_icp icp_plan foot_poses"
        ports = inputs(self, names, "mechanisms")
        self._walking, self._command, self._icp, *others = ports
        self._plan, self._feet, self._on = others
        self._memory = self.DeclareDiscreteState(3)
        needs = [*ports, self.discrete_state_ticket(self._memory)]
        declare_output(self, "footsteps", self._calc_footsteps, needs)
        declare_output(self, "revised_footsteps", self._calc_revised, needs)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _velocity(self, context) -> np.ndarray:
        return context.get_discrete_state(self._memory).value().copy()

    def _limited(self, context) -> np.ndarray:
        """The velocity commanded (3,), within the limits."""
        command = self._command(context)
        if not command.any():
            return command
        least, most = self.limits
        return np.clip(command, least, most)

    def _update(self, context, state):
        velocity, command = self._velocity(context), self._limited(context)
        if not (command.any() or velocity.any()):
            return EventStatus.DidNothing()
        if self._walking(context).mode is walking.Mode.RECOVERING:
            command = np.zeros(3)  # the walk begins anew when it is calm
        velocity += np.clip(command - velocity, -self._change, self._change)
        state.get_mutable_discrete_state(self._memory).set_value(velocity)
        return EventStatus.Succeeded()

    def _calc_footsteps(self, context) -> tuple[walking.Footstep, ...]:
        state = self._walking(context)
        reference = icp_plan.reference_of(self._plan(context), state)
        return self._planner.footsteps(
            state,
            self._velocity(context),
            self._limited(context),
            icp=self._icp(context),
            reference=reference.icp,
            feet=self._feet(context),
            on=self._on(context),
        )

    def _calc_revised(self, context) -> tuple[walking.Footstep, ...] | None:
        velocity, command = self._velocity(context), self._limited(context)
        if (velocity == command).all():
            return None
        return self._revised(self._walking(context), velocity, command)

    def _revised(
        self, state: walking.WalkingState, velocity, command
    ) -> tuple[walking.Footstep, ...] | None:
        """Returns the footsteps that have not landed; None: as they are."""
        return self._planner.revised(state, velocity, command)


class FixedFootsteps(FootstepPlanner):
    """Plans the footsteps of a list; then as a FootstepPlanner.

    The number of steps taken says where in the list it is; the next ones are
    within reach of where the feet are.  `velocity_command` counts once the
    robot stands after them.

    .. pydrake_system::

        name: FixedFootsteps
        input_ports: [walking_state, velocity_command, alip_icp,
                      icp_plan, foot_poses, mechanisms]
        output_ports: [footsteps, revised_footsteps]
    """

    def __init__(
        self,
        params: FootstepPlannerParams,
        model: PointMassModel,
        period: float,
        footsteps: tuple[walking.Footstep, ...] = (),
        adjuster: CaptureRegionStepAdjusterParams | None = None,
        timing: TimingAdapterParams | None = None,
    ):
        """Plans `footsteps` (see make_footsteps), as a FootstepPlanner."""
        super().__init__(params, model, period, adjuster, timing)
        self._fixed = tuple(footsteps)
        self._model, self._period = model, period

    def _is_over(self, context) -> bool:
        """True if no step of the list is left after the present phase."""
        state = self._walking(context)
        swings = state.schedule.phase is walking.Phase.SWING
        return state.steps_taken + swings >= len(self._fixed)

    def _calc_footsteps(self, context) -> tuple[walking.Footstep, ...]:
        if self._is_over(context):
            return super()._calc_footsteps(context)
        state, feet = self._walking(context), self._feet(context)
        known = self._model, self._period
        return remaining_footsteps(self._fixed, state, feet, *known)

    def _revised(
        self, state: walking.WalkingState, velocity, command
    ) -> tuple[walking.Footstep, ...] | None:
        if state.steps_taken < len(self._fixed):
            return None
        return super()._revised(state, velocity, command)


class VelocityCommands(LeafSystem):
    """Tells the velocity command of a list of rows, each from its time on.

    The rows are (time [s], forward, left [m/s], turn [rad/s]), in order of
    time; before the first one the command is to stand.

    .. pydrake_system::

        name: VelocityCommands
        input_ports: []
        output_ports: [velocity_command]
    """

    def __init__(self, rows: Iterable[Sequence[float]]):
        """Raises ValueError: a row of another length, or times that fall."""
        super().__init__()
        rows = [tuple(map(float, row)) for row in rows]
        for i, row in enumerate(rows):
            what = f"rows[{i}] = {row}: must"
            if len(row) != 4 or not np.isfinite(row).all():
                raise ValueError(f"{what} be 4 finite numbers")
            if row[0] < 0.0 or i and row[0] <= rows[i - 1][0]:
                raise ValueError(f"{what} be later than the one before")
        self._times = [row[0] - _EARLY for row in rows]
        self._values = [np.zeros(3), *(np.array(row[1:]) for row in rows)]
        time = [self.time_ticket()]
        declare_output(self, "velocity_command", self._calc, time)

    def _calc(self, context) -> np.ndarray:
        return self._values[bisect_right(self._times, context.get_time())]


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
