"""The walking state machine, advanced once per control period.

Standing -> transfer -> swing -> transfer -> ... -> standing.  Where to step is
asked for when it is needed: standing, on the way to it, and at touchdown.  The
papers do not specify it; see also the Atlas paper, Sec. II.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.icp_plan import IcpPlan
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.state import (
    FootPoses,
    Footstep,
    Phase,
    WalkingState,
)
from nadia_balance.parameters.bounds import bounded

_NOBODY = type(None)  # plans footsteps: a call returns None
_HUGE = 700.0  # largest exponent: e^700 is finite [-]


@dataclass(kw_only=True)
class LiftOffParams:
    """ICP error for which a foot is lifted, and the longest wait for it."""

    # The foot is lifted when the ICP error is within this ellipse in the sole
    # frame: semi-axes forward, toward the other foot, and away from it.
    icp_error_forward: float = bounded(
        0.035, above=0.0, unit="m", of="sole_length"
    )
    icp_error_inward: float = bounded(
        0.015, above=0.0, unit="m", of="sole_width"
    )
    icp_error_outward: float = bounded(
        0.012, above=0.0, unit="m", of="sole_width"
    )
    # Largest distance of the eCMP from the support.
    ecmp_outside: float = bounded(0.03, least=0.0, unit="m", of="sole_width")
    # Time for which the foot that has landed must carry, without interruption.
    contact_time: float = bounded(0.01, least=0.0, unit="s")
    # The longest wait, if the footholds can be adjusted; infinite otherwise.
    max_wait: float = bounded(0.2, least=0.0, finite=False, unit="s")
    # The wait is extended to `max_held_wait` while the support extends
    # `held_room` beyond the ICP, so that the ICP error can be reduced.  Not for
    # feet farther apart than `held_stance`: the ankle of the trailing foot
    # would meet its limit, and the pelvis would tilt.
    max_held_wait: float = bounded(1.0, least=0.0, finite=False, unit="s")
    held_room: float = bounded(0.08, least=0.0, finite=False, unit="m")
    held_stance: float = bounded(0.45, least=0.0, finite=False, unit="m")


@dataclass(kw_only=True)
class WalkingStateMachineParams:
    """Conditions that end a phase."""

    # Share of the swing before which no contact counts as touchdown.
    earliest_touchdown: float = bounded(0.5, least=0.0, below=1.0)
    # Touchdown: forces above `contact_force`, as a share of the robot's weight,
    # have without interruption accumulated `contact_impulse`, per weight: a few
    # ms of load, or one hard impact that may bounce.
    contact_force: float = bounded(0.034, least=0.0, below=1.0)
    contact_impulse: float = bounded(3.4e-4, least=0.0, unit="s")
    lift_off: LiftOffParams = bounded(LiftOffParams)


@dataclass(frozen=True, eq=False)
class StateMachine:
    """The walking state machine of a robot, advanced once per `period` [s]."""

    params: WalkingStateMachineParams
    model: PointMassModel
    period: float

    def advance(
        self,
        state: WalkingState,
        plan: IcpPlan,
        feet: FootPoses,
        forces: Array,
        icp: Array,
        time_gain: float = 0.0,
        adjustment: walking.Adjustment | None = None,
        footsteps: Callable[[], tuple[Footstep, ...] | None] = _NOBODY,
        revised: tuple[Footstep, ...] | None = None,
    ) -> WalkingState:
        """Returns the walking state one period later.

        Args:
            state: the present walking state.
            plan: the ICP plan of its schedule.
            feet: the measured soles.
            forces: vertical forces (2,) [-] on them, per the robot's weight.
            icp: the measured ICP (2,) [m] in W.
            time_gain: time [s] by which the clock advances on top of the
                period; it is held if that is negative.
            adjustment: the foothold wanted; None: it cannot be adjusted.
            footsteps: the footsteps after the present phase, called when they
                are needed; (): the robot comes to rest; None: they are those of
                the schedule, from its start on.
            revised: the footsteps that have not landed, in the place of those
                of the schedule; (): the robot comes to rest, not while a
                foot is in the air.  None: as they are.
        """
        state = self._adjusted(state, plan, icp, adjustment)
        if revised is not None:
            state = self._revised(state, plan, feet, icp, revised)
        state = self._tick(state, forces, time_gain)
        schedule = state.schedule
        if schedule.phase is Phase.SWING:
            if state.contact_impulse <= self.params.contact_impulse:
                return state
            state = replace(state, steps_taken=state.steps_taken + 1)
            steps = _following(state, footsteps())
            begun = self._start_transfer(state, plan, feet, steps)
            return replace(begun, contact_time=state.contact_time)
        if not schedule.footsteps or schedule.phase is Phase.STANDING:
            if steps := _following(state, footsteps()):
                return self._start_transfer(state, plan, feet, steps)
        if schedule.phase is Phase.TRANSFER and state.waiting:
            # Without adjustment, only waiting reduces the ICP error.
            most = self.params.lift_off.max_wait if adjustment else math.inf
            if self.may_lift(state, plan, icp, most):
                return _end_transfer(state, plan, feet)
        return state

    def _revised(
        self,
        state: WalkingState,
        plan: IcpPlan,
        feet: FootPoses,
        icp: Array,
        steps: tuple[Footstep, ...],
    ) -> WalkingState:
        """Returns the state with other footsteps; durations stay as begun."""
        schedule = state.schedule
        if schedule.phase is Phase.STANDING or steps == schedule.footsteps:
            return state
        if not steps:
            if schedule.phase is Phase.SWING:
                return state
            return self._start_transfer(state, plan, feet, steps)
        time = state.time_in_phase
        schedule = plan.moved(schedule, steps, time, icp, self.model)
        return replace(state, schedule=schedule, adjustment=None)

    def _tick(
        self, state: WalkingState, forces: Array, time_gain: float
    ) -> WalkingState:
        """Returns the state one period later in the same phase."""
        schedule, period, params = state.schedule, self.period, self.params
        time = state.time_in_phase + max(period + time_gain, 0.0)
        done = time >= schedule.duration - 0.5 * period
        time = schedule.duration if done else time
        elapsed = state.elapsed + period
        waits = done and schedule.phase is Phase.TRANSFER
        impulse, support = 0.0, schedule.support_side
        lands = support.other if schedule.phase is Phase.SWING else support
        force = float(forces[0 if lands is walking.Side.LEFT else 1])
        carries = force > params.contact_force
        if schedule.phase is Phase.SWING:
            # A share of real time: an advanced clock may pass half of the plan
            # before the foot has left the ground.
            whole = elapsed + schedule.duration - time
            may_land = elapsed >= params.earliest_touchdown * whole
            if may_land and carries:
                impulse = state.contact_impulse + period * force
        return replace(
            state,
            time_in_phase=time,
            elapsed=elapsed,
            waiting=done,
            waited=state.waited + period if waits else 0.0,
            contact_impulse=impulse,
            contact_time=state.contact_time + period if carries else 0.0,
        )

    def may_lift(
        self, state: WalkingState, plan: IcpPlan, icp: Array, max_wait: float
    ) -> bool:
        """True if the ICP is near its reference, or waiting cannot bring it.

        `icp` (2,) [m] in W is measured after the transfer of `state`.  In
        double support, the eCMP can be held beyond the ICP, on the far side of
        the support.  If this cannot return the ICP within `max_wait` [s], the
        foot is lifted at once.  Crossed legs are always uncrossed at once, as
        the rear thigh approaches the other shin while the CoM moves on.  All
        this holds once the foot that has landed carries, or for `max_wait`.
        """
        schedule, waited = state.schedule, state.waited
        params = self.params.lift_off
        if (
            state.steps_taken > 0
            and state.contact_time < params.contact_time
            and waited < max_wait
        ):
            return False
        if schedule.legs_crossed or not schedule.footsteps:
            return True
        error = icp - plan.at(schedule.duration).icp
        excess = 1.0 - 1.0 / max(_size(error, schedule, params), 1e-9)
        if excess < 0.0:
            return True
        length = math.hypot(*error)
        support = walking.support_polygon(schedule, self.model.cop_area)
        room = float(np.max((support - icp) @ (error / length)))
        left, right = schedule.feet.left.p_WF, schedule.feet.right.p_WF
        if (
            room >= params.held_room
            and waited < params.max_held_wait
            and math.dist(left[:2], right[:2]) <= params.held_stance
        ):
            return False
        room += params.ecmp_outside
        # Eq. 3: the ICP moves back by room (e^wt - 1) in the remaining wait.
        growth = math.expm1(min(self.model.omega * (max_wait - waited), _HUGE))
        return room <= 0.0 or room * growth < length * excess

    def _adjusted(
        self,
        state: WalkingState,
        plan: IcpPlan,
        icp: Array,
        adjustment: walking.Adjustment | None,
    ) -> WalkingState:
        """Returns the state with the footholds of `adjustment`."""
        schedule = state.schedule
        steps = list(schedule.footsteps)
        if adjustment is None or not steps or schedule.phase is Phase.STANDING:
            return state
        moved = False
        for i, new in enumerate((adjustment, *adjustment.later)):
            if new.pose != steps[i].pose:
                steps[i], moved = replace(steps[i], pose=new.pose), True
        if moved:
            time = state.time_in_phase
            schedule = plan.moved(schedule, tuple(steps), time, icp, self.model)
        return replace(state, schedule=schedule, adjustment=adjustment)

    def _start_transfer(
        self,
        state: WalkingState,
        plan: IcpPlan,
        feet: FootPoses,
        steps: tuple[Footstep, ...],
    ) -> WalkingState:
        """Returns the state at the start of the transfer to the first step."""
        old, model = state.schedule, self.model
        wanted = old.feet
        if old.phase is Phase.SWING:
            side, pose = old.footsteps[0].side, old.footsteps[0].pose
            if model.ground and (on := model.ground.region_under(feet[side])):
                pose = replace(pose, normal=on.unit_normal)
            wanted = wanted.with_foot(side, pose)
        side, duration = old.support_side, old.final_transfer_duration
        if old.phase is Phase.SWING:
            side = side.other
        if steps:
            side, duration = steps[0].side.other, steps[0].transfer_duration
        return _begin(
            state,
            plan,
            _tilted(feet, wanted),
            phase=Phase.TRANSFER,
            support_side=side,
            duration=duration,
            footsteps=steps,
        )


def _following(
    state: WalkingState, footsteps: tuple[Footstep, ...] | None
) -> tuple[Footstep, ...]:
    """Returns the `footsteps` after a phase; None: those of the schedule."""
    if footsteps is not None:
        return footsteps
    schedule = state.schedule
    if schedule.phase is Phase.SWING:
        return schedule.footsteps[1:]
    return schedule.footsteps if state.waiting else ()


def _size(
    error: Array, schedule: walking.ContactSchedule, params: LiftOffParams
) -> float:
    """Returns the norm [-] of the ICP `error`: 1 on the lift-off ellipse."""
    side = schedule.support_side
    x, y = schedule.feet[side].rotation.T @ error
    inward = -side.sign * y > 0.0
    width = params.icp_error_inward if inward else params.icp_error_outward
    return math.hypot(x / params.icp_error_forward, y / width)


def _end_transfer(
    state: WalkingState, plan: IcpPlan, feet: FootPoses
) -> WalkingState:
    """Lifts the foot, or comes to rest if there are no more steps."""
    old = state.schedule
    steps = old.footsteps
    begun = _begin(
        state,
        plan,
        _tilted(feet, old.feet),
        phase=Phase.SWING if steps else Phase.STANDING,
        duration=steps[0].swing_duration if steps else math.inf,
    )
    # Footholds that were adjusted in the transfer are kept.
    return replace(begun, adjustment=state.adjustment)


def _tilted(feet: FootPoses, wanted: FootPoses) -> FootPoses:
    """Returns the measured `feet` with the normals of the `wanted` ones."""
    for side in walking.Side:
        normal = wanted[side].normal
        if feet[side].normal is not normal:
            feet = feet.with_foot(side, replace(feet[side], normal=normal))
    return feet


def _begin(
    state: WalkingState, plan: IcpPlan, feet: FootPoses, **changes: Any
) -> WalkingState:
    """Returns the state at the start of a phase, by its schedule's changes."""
    schedule = replace(
        state.schedule,
        feet=feet,
        start=plan.at(state.time_in_phase).point(),
        start_time=0.0,
        **changes,
    )
    return WalkingState(schedule, steps_taken=state.steps_taken)
