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
from nadia_balance.core.walking.state import (
    Adjustment,
    ContactSchedule,
    FootPoses,
    Footstep,
    Phase,
    Side,
    WalkingState,
    support_polygon,
)
from nadia_balance.parameters.bounds import bounded, parameters

_HUGE = 700.0  # largest exponent: e^700 is finite [-]


@parameters
class LiftOffParams:
    """ICP error for which a foot is lifted, and the longest wait for it.

    The foot is lifted when the ICP error is within an ellipse in the sole
    frame.  The wait is extended while the ICP error can be reduced.  With feet
    far apart there is none, if footholds can be adjusted: as the CoM moves on,
    the ankle of the trailing foot would meet its limit, and the pelvis tilt.
    """

    icp_error_forward: float = bounded(
        0.035,
        doc="semi-axis of the ellipse along the foot",
        above=0.0,
        unit="m",
        of="sole_length",
    )
    icp_error_inward: float = bounded(
        0.015,
        doc="semi-axis of the ellipse toward the other foot",
        above=0.0,
        unit="m",
        of="sole_width",
    )
    icp_error_outward: float = bounded(
        0.012,
        doc="semi-axis of the ellipse away from the other foot",
        above=0.0,
        unit="m",
        of="sole_width",
    )
    ecmp_outside: float = bounded(
        0.03,
        doc="largest distance of the eCMP from the support",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    contact_time: float = bounded(
        0.01,
        doc="time for which the foot that has landed must carry, without "
        "interruption",
        least=0.0,
        unit="s",
    )
    max_wait: float = bounded(
        0.2,
        doc="longest wait, if the footholds can be adjusted; infinite "
        "otherwise",
        least=0.0,
        finite=False,
        unit="s",
    )
    max_held_wait: float = bounded(
        1.0,
        doc="longest wait while the support extends `held_room` beyond the ICP",
        least=0.0,
        finite=False,
        unit="s",
    )
    held_room: float = bounded(
        0.08,
        doc="distance from the ICP to the edge of the support for a longer "
        "wait",
        least=0.0,
        finite=False,
        unit="m",
    )
    held_stance: float = bounded(
        0.45,
        doc="largest distance of the feet for a wait",
        least=0.0,
        finite=False,
        unit="m",
    )


@parameters
class WalkingStateMachineParams:
    """Conditions that end a phase.

    Touchdown: forces above `contact_force` have without interruption
    accumulated `contact_impulse`: a few ms of load, or one hard impact that may
    bounce.
    """

    earliest_touchdown: float = bounded(
        0.5,
        doc="share of the swing before which no contact counts as touchdown",
        least=0.0,
        below=1.0,
    )
    contact_force: float = bounded(
        0.034,
        doc="least force of a foot that carries, as a share of the robot's "
        "weight",
        least=0.0,
        below=1.0,
    )
    contact_impulse: float = bounded(
        3.4e-4, doc="impulse of a touchdown per weight", least=0.0, unit="s"
    )
    displaced: float = bounded(
        0.05,
        doc="distance from its place by which a foot that stands was kicked "
        "or slid, so that the transfer begins anew from where the feet are",
        above=0.0,
        finite=False,
        unit="m",
    )
    lift_off: LiftOffParams = bounded(
        LiftOffParams, doc="conditions that end a transfer"
    )


@dataclass(frozen=True, eq=False)
class StateMachine:
    """The walking state machine of a robot.

    Args:
        params: conditions that end a phase.
        model: soles, ground and natural frequency.
        period: control period, once per which it is advanced [s].
    """

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
        footsteps: Callable[[], tuple[Footstep, ...] | None],
        revised: tuple[Footstep, ...] | None = None,
        time_gain: float = 0.0,
        adjustment: Adjustment | None = None,
    ) -> WalkingState:
        """Advances the walking state by one period.

        Args:
            state: the present walking state.
            plan: the ICP plan of its schedule.
            feet: the measured soles.
            forces: vertical forces (2,) [-] on them, per the robot's weight.
            icp: the measured ICP (2,) [m] in W.
            footsteps: returns the footsteps after the present phase, when they
                are needed; (): the robot comes to rest; None: they are those of
                the schedule, from its start on.
            revised: the footsteps that have not landed, in the place of those
                of the schedule; (): the robot comes to rest, not while a
                foot is in the air.  None: as they are.  If the first is of the
                foot that was to stay, a transfer to the other one begins.
            time_gain: time [s] by which the clock advances on top of the
                period; it is held if that is negative.
            adjustment: the foothold wanted; None: it cannot be adjusted.

        Returns:
            The walking state one period later.
        """
        state = self._adjusted(state, plan, icp, adjustment)
        state = self._revised(state, plan, feet=feet, icp=icp, steps=revised)
        state = self._tick(state, forces, time_gain)
        schedule = state.schedule
        if schedule.phase is Phase.SWING:
            if state.contact_impulse <= self.params.contact_impulse:
                return state
            state = replace(state, steps_taken=state.steps_taken + 1)
            return replace(
                self._start_transfer(
                    state, plan, feet, steps=_following(state, footsteps)
                ),
                contact_time=state.contact_time,
            )
        if self._displaced(schedule, feet):
            steps = footsteps()
            if steps is None:
                steps = schedule.footsteps
            return self._start_transfer(state, plan, feet, steps)
        if not schedule.footsteps or schedule.phase is Phase.STANDING:
            steps = _following(state, footsteps)
            if steps:
                return self._start_transfer(state, plan, feet, steps)
        if schedule.phase is Phase.TRANSFER and state.waiting:
            # Without adjustment, only waiting reduces the ICP error.
            max_wait = self.params.lift_off.max_wait if adjustment else math.inf
            if self.may_lift(state, plan, icp, max_wait):
                return _end_transfer(state, plan, feet)
        return state

    def _revised(
        self,
        state: WalkingState,
        plan: IcpPlan,
        feet: FootPoses,
        icp: Array,
        steps: tuple[Footstep, ...] | None,
    ) -> WalkingState:
        """Returns the state with other footsteps; durations stay as begun.

        To steps of the foot that was to stay, a transfer begins.
        """
        schedule = state.schedule
        if (
            steps is None
            or schedule.phase is Phase.STANDING
            or steps == schedule.footsteps
        ):
            return state
        if steps and steps[0].side is not schedule.support_side:
            return replace(
                state,
                schedule=plan.moved(
                    schedule, steps, t=state.time_in_phase, icp=icp
                ),
                adjustment=None,
            )
        if schedule.phase is Phase.SWING:
            return state
        return self._start_transfer(state, plan, feet, steps)

    def _displaced(self, schedule: ContactSchedule, feet: FootPoses) -> bool:
        """True if a foot that stands is not where the schedule has it."""
        return any(
            math.dist(feet[side].p_WF[:2], schedule.feet[side].p_WF[:2])
            > self.params.displaced
            for side in Side
        )

    def _tick(
        self, state: WalkingState, forces: Array, time_gain: float
    ) -> WalkingState:
        """Returns the state one period later in the same phase."""
        schedule, period, params = state.schedule, self.period, self.params
        swings = schedule.phase is Phase.SWING
        time = state.time_in_phase + max(period + time_gain, 0.0)
        done = time >= schedule.duration - 0.5 * period
        time = schedule.duration if done else time
        elapsed = state.elapsed + period
        lands = schedule.support_side.other if swings else schedule.support_side
        force = float(forces[lands.index])
        carries = force > params.contact_force
        # A share of real time: an advanced clock may pass half of the plan
        # before the foot has left the ground.
        whole = elapsed + schedule.duration - time
        touches = (
            swings and carries and elapsed >= params.earliest_touchdown * whole
        )
        return WalkingState(
            schedule,
            time_in_phase=time,
            elapsed=elapsed,
            waiting=done,
            waited=(
                state.waited + period
                if done and schedule.phase is Phase.TRANSFER
                else 0.0
            ),
            contact_impulse=(
                state.contact_impulse + period * force if touches else 0.0
            ),
            contact_time=state.contact_time + period if carries else 0.0,
            steps_taken=state.steps_taken,
            adjustment=state.adjustment,
        )

    def may_lift(
        self, state: WalkingState, plan: IcpPlan, icp: Array, max_wait: float
    ) -> bool:
        """True if the ICP is near its reference, or waiting cannot bring it.

        In double support, the eCMP can be held beyond the ICP, on the far side
        of the support: the ICP moves back by room (e^wt - 1) (Nadia paper, Eq.
        3).  If this cannot return the ICP within `max_wait`, the foot is lifted
        at once, as it is with feet far apart (`held_stance`) unless it may wait
        for ever.  Crossed legs are always uncrossed at once, as the rear thigh
        approaches the other shin while the CoM moves on.  All this holds once
        the foot that has landed carries, or for `max_wait`.

        Args:
            state: walking state that waits at the end of a transfer.
            plan: ICP plan of its schedule.
            icp: measured ICP (2,) in W [m].
            max_wait: longest wait [s].

        Returns:
            False to wait.
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
        size = _size(error, schedule, params)
        left, right = (schedule.feet[side].p_WF[:2] for side in Side)
        apart = math.dist(left, right) > params.held_stance
        if size < 1.0 or (apart and math.isfinite(max_wait)):
            return True
        length = math.hypot(*error)
        support = support_polygon(schedule, self.model.cop_area)
        room = float(np.max((support - icp) @ (error / length)))
        if room >= params.held_room and waited < params.max_held_wait:
            return False
        room += params.ecmp_outside
        growth = math.expm1(min(self.model.omega * (max_wait - waited), _HUGE))
        return room <= 0.0 or room * growth < length * (1.0 - 1.0 / size)

    def _adjusted(
        self,
        state: WalkingState,
        plan: IcpPlan,
        icp: Array,
        adjustment: Adjustment | None,
    ) -> WalkingState:
        """Returns the state with the footholds of `adjustment`."""
        schedule = state.schedule
        steps = list(schedule.footsteps)
        if adjustment is None or not steps or schedule.phase is Phase.STANDING:
            return state
        adjusted = adjustment, *adjustment.later
        for i, (step, new) in enumerate(zip(steps, adjusted, strict=False)):
            if new.pose != step.pose:
                steps[i] = replace(step, pose=new.pose)
        if tuple(steps) != schedule.footsteps:
            schedule = plan.moved(
                schedule, tuple(steps), t=state.time_in_phase, icp=icp
            )
        elif adjustment == state.adjustment:
            return state
        return replace(state, schedule=schedule, adjustment=adjustment)

    def _start_transfer(
        self,
        state: WalkingState,
        plan: IcpPlan,
        feet: FootPoses,
        steps: tuple[Footstep, ...],
    ) -> WalkingState:
        """Returns the state at the start of the transfer to the first step."""
        old = state.schedule
        planned, side = old.feet, old.support_side
        duration = old.final_transfer_duration
        if old.phase is Phase.SWING:
            side, step = side.other, old.footsteps[0]
            pose = step.pose
            if self.model.ground is not None:
                region = self.model.ground.region_under(feet[step.side])
                if region is not None:
                    pose = replace(pose, normal=region.unit_normal)
            planned = planned.with_foot(step.side, pose)
        if steps:
            side, duration = steps[0].side.other, steps[0].transfer_duration
        return _begin(
            state,
            plan,
            _tilted(feet, planned),
            phase=Phase.TRANSFER,
            support_side=side,
            duration=duration,
            footsteps=steps,
        )


def _following(
    state: WalkingState, footsteps: Callable[[], tuple[Footstep, ...] | None]
) -> tuple[Footstep, ...]:
    """Returns the `footsteps` after a phase; None: those of the schedule."""
    steps = footsteps()
    if steps is not None:
        return steps
    schedule = state.schedule
    if schedule.phase is Phase.SWING:
        return schedule.footsteps[1:]
    return schedule.footsteps if state.waiting else ()


def _size(
    error: Array, schedule: ContactSchedule, params: LiftOffParams
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
    steps = state.schedule.footsteps
    # Footholds that were adjusted in the transfer are kept.
    return replace(
        _begin(
            state,
            plan,
            _tilted(feet, state.schedule.feet),
            phase=Phase.SWING if steps else Phase.STANDING,
            duration=steps[0].swing_duration if steps else math.inf,
        ),
        adjustment=state.adjustment,
    )


def _tilted(feet: FootPoses, planned: FootPoses) -> FootPoses:
    """Returns the measured `feet` with the normals of the `planned` ones."""
    for side in Side:
        normal = planned[side].normal
        if feet[side].normal is not normal:
            feet = feet.with_foot(side, replace(feet[side], normal=normal))
    return feet


def _begin(
    state: WalkingState, plan: IcpPlan, feet: FootPoses, **changes: Any
) -> WalkingState:
    """Returns the state at the start of a phase, by its schedule's changes."""
    return WalkingState(
        replace(
            state.schedule,
            feet=feet,
            start=plan.at(state.time_in_phase).point(),
            start_time=0.0,
            **changes,
        ),
        steps_taken=state.steps_taken,
    )
