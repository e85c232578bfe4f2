"""Where to walk and when: the walking clock, the ICP plan, its timing."""

import functools
import itertools
import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, State

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.plan.atlas_icp_plan import (
    AtlasIcpPlanParams,
    plan_atlas_icp,
)
from nadia_balance.core.plan.cop_waypoints import CopPoints, IcpPlanParams
from nadia_balance.core.plan.footstep_plan import (
    FootstepPlan,
    FootstepPlannerParams,
    velocity_limits,
    within_limits,
)
from nadia_balance.core.plan.gait import (
    Gait,
    remaining_footsteps,
    walking_start,
)
from nadia_balance.core.plan.icp_plan import IcpPlan, plan_icp, reference_of
from nadia_balance.core.plan.time_adjustment import (
    TimeAdjustment,
    Timing,
    TimingAdapterParams,
)
from nadia_balance.core.plan.walking_state_machine import (
    StateMachine,
    WalkingStateMachineParams,
)
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.walking.mechanisms import USUAL
from nadia_balance.core.walking.state import (
    FootPose,
    Footstep,
    Mode,
    Phase,
    WalkingState,
)
from nadia_balance.parameters.bounds import check, require
from nadia_balance.parameters.yaml_reader import naming
from nadia_balance.systems.ports import (
    TICK_TOLERANCE,
    Block,
    Input,
    declare_output,
    declare_update,
    input_port,
    once_per_schedule,
    optional_input,
)
from nadia_balance.systems.signals import MODES, PHASES


class WalkingStateMachine(Block):
    """Advances the walking state once per control period.

    `footsteps` are those after the present phase.  They are read standing, on
    the way to it, and at touchdown; not connected, the steps are those of the
    start.  `time_adjustment`, `adjustment` and `revised_footsteps` are optional
    proposals.  Without an adjustment the footholds are those of the plan, and
    the wait before lift-off has no limit (`max_wait` is ignored).
    `walking_state`, and the same as numbers, `walking_signal`, are those before
    the update of a tick.

    Args:
        params: when a phase ends.
        model: point mass of the robot.
        period: control period [s].
        start: walking state at the start, by default standing.

    .. pydrake_system::

        name: WalkingStateMachine
        input_ports: [foot_poses, foot_forces, icp, icp_plan,
                      time_adjustment, adjustment, footsteps,
                      revised_footsteps]
        output_ports: [walking_state, walking_signal]
    """

    def __init__(
        self,
        params: WalkingStateMachineParams,
        model: PointMassModel,
        period: float,
        start: WalkingState | None = None,
    ) -> None:
        super().__init__()
        check(params)
        self._machine = StateMachine(params, model, period)
        self._weight = model.mass * GRAVITY
        self._feet = input_port(self, "foot_poses")
        self._forces = input_port(self, "foot_forces")
        self._icp = input_port(self, "icp")
        self._plan = input_port(self, "icp_plan")
        self._time = optional_input(self, "time_adjustment", default=(0.0, 0.0))
        self._adjustment = optional_input(self, "adjustment")
        self._footsteps = optional_input(self, "footsteps")
        self._revised = optional_input(self, "revised_footsteps")
        self._state: Any = self.DeclareAbstractState(
            Value(start or walking_start(Gait(), model))
        )
        # The outputs depend on the state only: this breaks every loop.
        state_only = [self.abstract_state_ticket(self._state)]
        declare_output(
            self, "walking_state", self._walking_state, needs=state_only
        )
        declare_output(
            self,
            "walking_signal",
            lambda context: walking_signal(self._walking_state(context)),
            needs=state_only,
        )
        declare_update(self, period, self._advance)

    def _walking_state(self, context: Context) -> Any:
        return context.get_abstract_state(self._state).get_value()

    def _advance(self, context: Context, state: Any) -> None:
        walking_state = self._machine.advance(
            self._walking_state(context),
            feet=self._feet(context),
            forces=self._forces(context) / self._weight,
            icp=self._icp(context),
            plan=self._plan(context),
            time_gain=float(self._time(context)[0]),
            adjustment=self._adjustment(context),
            footsteps=functools.partial(
                self._next_footsteps, self._footsteps, context
            ),
            revised=self._next_footsteps(self._revised, context),
        )
        state.get_mutable_abstract_state(self._state).set_value(walking_state)

    def _next_footsteps(
        self, port: Input, context: Context
    ) -> tuple[Footstep, ...] | None:
        """The footsteps at the `port`, whose feet take turns."""
        steps: tuple[Footstep, ...] | None = port(context)
        if not steps:
            return steps
        try:
            check_footsteps(steps)
        except ValueError as error:
            raise port.error(context, str(error)) from None
        return steps


def check_footsteps(steps: Sequence[Footstep]) -> None:
    """Checks footsteps that are not ours.

    Args:
        steps: in their order.

    Raises:
        ValueError: one is no Footstep or has a bad duration, or the feet do not
            take turns.
    """
    for step in steps:
        if not isinstance(step, Footstep):
            raise ValueError(f"has a {type(step).__name__}, needs Footsteps")
        times = step.transfer_duration, step.swing_duration
        if not (0.0 <= times[0] < math.inf and 0.0 < times[1] < math.inf):
            raise ValueError(
                f"has a transfer of {times[0]} s and a swing of {times[1]} s: "
                "they must be >= 0 and > 0"
            )
    if any(one.side is two.side for one, two in itertools.pairwise(steps)):
        raise ValueError(
            f"has feet {', '.join(step.side.value for step in steps)}: they "
            "must take turns"
        )


def walking_signal(state: WalkingState) -> list[float]:
    """The walking state as numbers.

    Args:
        state: the walking state.

    Returns:
        The entries of a WalkingSignal.
    """
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


def _planar(pose: FootPose) -> tuple[float, float, float]:
    x, y, _ = pose.p_WF.tolist()
    return x, y, pose.yaw


class FootstepPlanner(Block):
    """Plans footsteps: to catch the robot, to walk as commanded, to stand.

    `footsteps` are those after the present phase, () to stand; of the foot in
    the air, as if it landed now.  `revised_footsteps` have not landed yet; they
    follow a command that has changed, or are of the other foot after a push in
    a transfer, and are None otherwise.  The state is the velocity of the walk
    (3,), which follows the `velocity_command`, within the robot's `limits` (see
    velocity_limits and within_limits).

    Args:
        params: rules of the planner.
        model: point mass of the robot.
        period: control period [s].
        adjuster: parameters of the block that adjusts the footholds.
        timing: parameters of the block that adjusts the timing.

    Raises:
        ValueError: a parameter is out of range.

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
    ) -> None:
        super().__init__()
        adjuster = adjuster or CaptureRegionStepAdjusterParams()
        timing = timing or TimingAdapterParams()
        for checked in (params, adjuster, timing):
            check(checked)
        self._planner = FootstepPlan(
            params,
            model,
            adjuster=adjuster,
            min_swing_duration=timing.min_swing_duration,
        )
        self.limits = velocity_limits(params, model)
        self._change = period * np.array(
            [params.acceleration, params.acceleration, params.yaw_acceleration]
        )
        self._walking = input_port(self, "walking_state")
        self._command = optional_input(
            self, "velocity_command", default=np.zeros(3)
        )
        self._icp = input_port(self, "alip_icp")
        self._plan = input_port(self, "icp_plan")
        self._feet = input_port(self, "foot_poses")
        self._mechanisms = optional_input(self, "mechanisms", default=USUAL)
        self._memory: Any = self.DeclareDiscreteState(3)
        needs = [
            self.all_input_ports_ticket(),
            self.discrete_state_ticket(self._memory),
        ]
        declare_output(self, "footsteps", self._calc_footsteps, needs=needs)
        declare_output(
            self, "revised_footsteps", self._calc_revised, needs=needs
        )
        declare_update(self, period, self._update)

    def _velocity(self, context: Context) -> Any:
        return context.get_discrete_state(self._memory).value().copy()

    def _limited(self, context: Context) -> Array:
        """The velocity commanded (3,), within the limits."""
        command: Array = self._command(context)
        if not any(command.tolist()):
            return command
        return within_limits(command, self.limits)

    def _update(self, context: Context, state: State) -> None:
        velocity = self._velocity(context)
        command = self._limited(context)
        if not any(command.tolist() + velocity.tolist()):
            return
        if self._walking(context).mode is Mode.RECOVERING:
            command = np.zeros(3)  # the walk begins anew when it is calm
        velocity += np.clip(command - velocity, -self._change, self._change)
        state.get_mutable_discrete_state(self._memory).set_value(velocity)

    def _calc_footsteps(self, context: Context) -> tuple[Footstep, ...]:
        state = self._walking(context)
        return self._planner.footsteps(
            state,
            velocity=self._velocity(context),
            command=self._limited(context),
            icp=self._icp(context),
            reference=reference_of(self._plan(context), state).icp,
            feet=self._feet(context),
            on=self._mechanisms(context),
        )

    def _calc_revised(self, context: Context) -> tuple[Footstep, ...] | None:
        """The footsteps that have not landed; None: as they are."""
        state = self._walking(context)
        if state.schedule.phase is Phase.TRANSFER:
            steps = self._planner.other_foot(
                state,
                icp=self._icp(context),
                reference=reference_of(self._plan(context), state).icp,
                feet=self._feet(context),
                on=self._mechanisms(context),
            )
            if steps:
                return steps
        velocity = self._velocity(context)
        command = self._limited(context)
        if (velocity == command).all():
            return None
        return self._planner.revised(state, velocity, command)


class FixedFootsteps(FootstepPlanner):
    """Plans the footsteps of a list; then as a FootstepPlanner.

    The number of steps taken says where in the list it is; the next ones are
    within reach of where the feet are.  `velocity_command` counts from the
    touchdown of the last one on, with the speed that its ramp has by then.

    Args:
        params: rules of the planner, for the time after the list.
        model: point mass of the robot.
        period: control period [s].
        footsteps: the list (see make_footsteps).
        adjuster: as for a FootstepPlanner.
        timing: as for a FootstepPlanner.

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
        footsteps: tuple[Footstep, ...] = (),
        adjuster: CaptureRegionStepAdjusterParams | None = None,
        timing: TimingAdapterParams | None = None,
    ) -> None:
        super().__init__(
            params, model, period, adjuster=adjuster, timing=timing
        )
        self._fixed = tuple(footsteps)
        with naming("footsteps"):
            check_footsteps(self._fixed)
        self._model, self._period = model, period

    def _calc_footsteps(self, context: Context) -> tuple[Footstep, ...]:
        state = self._walking(context)
        swings = state.schedule.phase is Phase.SWING
        if state.steps_taken + swings >= len(self._fixed):
            return super()._calc_footsteps(context)
        return remaining_footsteps(
            self._fixed,
            state,
            feet=self._feet(context),
            model=self._model,
            period=self._period,
        )

    def _calc_revised(self, context: Context) -> tuple[Footstep, ...] | None:
        if self._walking(context).steps_taken < len(self._fixed):
            return None
        return super()._calc_revised(context)


class VelocityCommands(Block):
    """Tells the velocity command of a list of rows, each from its time on.

    Before the time of the first row the command is to stand.

    Args:
        rows: (time [s], forward, left [m/s], turn [rad/s]), in order of
            time.

    Raises:
        ValueError: a row of another length, or times that fall.

    .. pydrake_system::

        name: VelocityCommands
        input_ports: []
        output_ports: [velocity_command]
    """

    def __init__(self, rows: Iterable[Sequence[float]]) -> None:
        super().__init__()
        rows = [tuple(map(float, row)) for row in rows]
        for i, row in enumerate(rows):
            require(
                len(row) == 4 and bool(np.isfinite(row).all()),
                f"rows[{i}] = {row}: must be 4 finite numbers",
            )
            require(
                row[0] >= 0.0 and (i == 0 or row[0] > rows[i - 1][0]),
                f"rows[{i}] = {row}: must be later than the one before, and "
                "not before 0 s",
            )
        self._times = [row[0] - TICK_TOLERANCE for row in rows]
        self._values = [np.zeros(3), *(np.array(row[1:]) for row in rows)]
        declare_output(
            self, "velocity_command", self._calc, needs=[self.time_ticket()]
        )

    def _calc(self, context: Context) -> Array:
        return self._values[bisect_right(self._times, context.get_time())]


class IcpPlanner(Block):
    """Plans the ICP for each new contact schedule.

    The plan is that of the Nadia paper (Eq. 4) or, with AtlasIcpPlanParams, of
    the Atlas paper (Sec. II-A), an AtlasIcpPlan.  `icp_reference` exists only
    if it `has_reference`.

    Args:
        params: where the CoP is planned; their class says which plan.
        model: point mass of the robot.
        period: not used, as the plan is one of continuous time: every
            block is made by Block(params, model, period).
        has_reference: whether there is an `icp_reference`.

    .. pydrake_system::

        name: IcpPlanner
        input_ports: [walking_state]
        output_ports: [icp_plan, icp_reference]
    """

    def __init__(
        self,
        params: IcpPlanParams | AtlasIcpPlanParams,
        model: PointMassModel,
        period: float,
        has_reference: bool = True,
    ) -> None:
        super().__init__()
        check(params)
        self._walking = input_port(self, "walking_state")
        self._plan = once_per_schedule(_planning(params, model))
        declare_output(
            self, "icp_plan", lambda context: self._plan(self._walking(context))
        )
        if has_reference:
            declare_output(self, "icp_reference", self._calc_reference)

    def _calc_reference(self, context: Context) -> Array:
        state = self._walking(context)
        now = reference_of(self._plan(state), state)
        return np.concatenate([now.icp, now.icp_velocity, now.cop, now.ecmp])


def _planning(
    params: IcpPlanParams | AtlasIcpPlanParams, model: PointMassModel
) -> Callable[[WalkingState], IcpPlan]:
    """The plan of a walking state, by the class of its parameters."""
    if isinstance(params, AtlasIcpPlanParams):
        return lambda state: plan_atlas_icp(state.schedule, params, model)
    cop_points = CopPoints(params, model.cop_area)
    return lambda state: plan_icp(state.schedule, params, model, cop_points)


class TimingAdapter(Block):
    """Computes the time by which to advance the walking clock (Nadia, Sec. VI).

    `time_adjustment` is the time to add to the clock in this tick, besides the
    control period, and the present estimate of the total over this and the next
    ticks; the clock is held while it is negative.

    Erratum: the ICP is `alip_icp`.  The angular momentum of a leg that is
    swung fast carries the `icp` ahead in mid-swing only, when hurrying makes
    it faster still; `alip_icp` is ahead in the transfer before.  Only if both
    leave the support, the rest of a swing is skipped at once.

    Args:
        params: limits of the adjustment.
        model: point mass of the robot.
        period: control period [s].

    .. pydrake_system::

        name: TimingAdapter
        input_ports: [walking_state, icp_plan, icp, alip_icp, foot_poses,
                      mechanisms]
        output_ports: [time_adjustment]
    """

    def __init__(
        self, params: TimingAdapterParams, model: PointMassModel, period: float
    ) -> None:
        super().__init__()
        check(params)
        self._timing = Timing(params, model, period)
        self._walking = input_port(self, "walking_state")
        self._plan = input_port(self, "icp_plan")
        self._icp = input_port(self, "icp")
        self._alip_icp = input_port(self, "alip_icp")
        self._feet = input_port(self, "foot_poses")
        self._mechanisms = optional_input(self, "mechanisms", default=USUAL)
        declare_output(self, "time_adjustment", self._calc)

    def _calc(self, context: Context) -> TimeAdjustment:
        return self._timing.adjustment(
            self._walking(context),
            plan=self._plan(context),
            icp=self._icp(context),
            alip_icp=self._alip_icp(context),
            feet=self._feet(context),
            on=self._mechanisms(context),
        )
