"""How the walking state advances by one control period.

Standing -> transfer -> swing -> transfer -> ... -> standing (the state machine
that the papers leave to the reader; see also the Atlas paper, Sec. II).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from nadia_balance.core.footstep_plan import within_reach
from nadia_balance.core.icp_plan import IcpPlan
from nadia_balance.core.lift_off import LiftOffParams, may_lift
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import (
    Adjustment,
    Array,
    ContactSchedule,
    FootPoses,
    Footstep,
    Phase,
    Side,
    WalkingState,
)


@dataclass(kw_only=True)
class WalkingStateMachineParams:
    """When a phase ends."""

    standing_duration: float = 0.5  # before the first step [s]
    earliest_touchdown: float = 0.5  # fraction of the swing [-]
    # The foot has landed when forces above the former have, without a break,
    # brought the latter: it is pressed down for a few ms, or has hit hard, and
    # may bounce.
    contact_force: float = 0.034  # of the robot's weight [-]
    contact_impulse: float = 3.4e-4  # per weight [s]
    lift_off: LiftOffParams = field(default_factory=LiftOffParams)

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name in (
            "standing_duration",
            "earliest_touchdown",
            "contact_force",
            "contact_impulse",
        ):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} = {value}: must be finite and >= 0")
        for name in ("earliest_touchdown", "contact_force"):
            if not (value := getattr(self, name)) < 1.0:
                raise ValueError(f"{name} = {value}: must be < 1")
        self.lift_off.validate()


@dataclass(frozen=True, eq=False)
class Measurement:
    """What is measured of the robot: sole poses, forces, ICP [m], in W."""

    feet: Callable[[], FootPoses]  # asked for only when the contacts change
    forces: Array  # (2,) normal, left and right, of the robot's weight [-]
    icp: Array  # (2,)

    def force(self, side: Side) -> float:
        """Normal force on the foot of `side`, of the weight [-]."""
        return float(self.forces[0 if side is Side.LEFT else 1])


@dataclass(frozen=True)
class Proposal:
    """What the adapters propose for this tick."""

    # To advance the clock by, on top of the tick; negative: to hold it [s].
    time_gain: float = 0.0
    adjustment: Adjustment | None = None


KEEP = Proposal()


def advance(
    state: WalkingState,
    plan: IcpPlan,
    measured: Measurement,
    period: float,
    sole: Array,
    reach: ReachabilityParams,
    params: WalkingStateMachineParams,
    proposal: Proposal = KEEP,
) -> WalkingState:
    """Returns the walking state one `period` [s] later.

    `plan` is the ICP plan of `state.schedule`: it tells where the reference
    is when a phase ends, so that the next plan continues from there.  `sole`
    (n, 2) [m] are the sole's corners in the sole frame, `reach` is where
    later footsteps must be after the feet have landed elsewhere.
    """
    state = _tick(state, measured, period, params, proposal)
    schedule = state.schedule
    match schedule.phase:
        case Phase.STANDING if state.waiting:
            return _start_transfer(state, plan, measured, reach)
        case Phase.TRANSFER if state.waiting:
            icp, waited = measured.icp, state.waited
            if may_lift(schedule, plan, icp, sole, waited, params.lift_off):
                return _end_transfer(state, plan, measured)
        case Phase.SWING if state.contact_impulse > params.contact_impulse:
            landed = replace(
                state,
                commanded=state.commanded[1:],
                steps_taken=state.steps_taken + 1,
            )
            command = next(iter(state.commanded), None)
            return _start_transfer(landed, plan, measured, reach, command)
    return state


def _tick(
    state: WalkingState,
    measured: Measurement,
    period: float,
    params: WalkingStateMachineParams,
    proposal: Proposal,
) -> WalkingState:
    """The same phase one `period` [s] later; one value, as each takes time."""
    schedule, adjustment = _adjusted(state, proposal.adjustment)
    time = state.time_in_phase + max(period + proposal.time_gain, 0.0)
    done = time >= schedule.duration - 0.5 * period
    time = schedule.duration if done else time
    elapsed = state.elapsed + period
    waits = done and schedule.phase is Phase.TRANSFER
    impulse = 0.0
    if schedule.phase is Phase.SWING and (
        force := _contact_force(schedule, time, elapsed, measured, params)
    ):
        impulse = state.contact_impulse + period * force
    return replace(
        state,
        schedule=schedule,
        time_in_phase=time,
        elapsed=elapsed,
        waiting=done,
        waited=state.waited + period if waits else 0.0,
        contact_impulse=impulse,
        adjustment=adjustment,
    )


def _adjusted(
    state: WalkingState, adjustment: Adjustment | None
) -> tuple[ContactSchedule, Adjustment | None]:
    """Moves the foothold of the step in the air."""
    schedule = state.schedule
    if adjustment is None or schedule.phase is not Phase.SWING:
        return schedule, state.adjustment
    step, *later = schedule.footsteps
    if adjustment.pose is not step.pose:
        step = replace(step, pose=adjustment.pose)
        schedule = replace(schedule, footsteps=(step, *later))
    return schedule, adjustment


def _contact_force(
    schedule: ContactSchedule,
    time: float,
    elapsed: float,
    measured: Measurement,
    params: WalkingStateMachineParams,
) -> float:
    """Force of the ground on the foot in the air; 0 if it may not land."""
    # Of the swing as it really is: a clock that was advanced has passed half
    # of the plan before the foot has left the ground.
    earliest = params.earliest_touchdown * (elapsed + schedule.duration - time)
    force = measured.force(schedule.support_side.other)
    landing = elapsed >= earliest and force > params.contact_force
    return force if landing else 0.0


def _start_transfer(
    state: WalkingState,
    plan: IcpPlan,
    measured: Measurement,
    reach: ReachabilityParams,
    landed: Footstep | None = None,
) -> WalkingState:
    old, feet = state.schedule, measured.feet()
    steps = within_reach(state.commanded, feet, reach, landed)
    schedule = replace(
        old,
        phase=Phase.TRANSFER,
        support_side=steps[0].side.other if steps else old.support_side.other,
        duration=(
            steps[0].transfer_duration if steps else old.final_transfer_duration
        ),
        feet=feet,
        footsteps=steps,
        start=plan.at(state.time_in_phase).point(),
    )
    return _begin(state, schedule)


def _end_transfer(
    state: WalkingState, plan: IcpPlan, measured: Measurement
) -> WalkingState:
    """Lifts the foot, or comes to rest if there are no more steps."""
    old = state.schedule
    steps = old.footsteps
    schedule = replace(
        old,
        phase=Phase.SWING if steps else Phase.STANDING,
        duration=steps[0].swing_duration if steps else math.inf,
        feet=measured.feet(),
        start=plan.at(state.time_in_phase).point(),
    )
    return _begin(state, schedule)


def _begin(state: WalkingState, schedule: ContactSchedule) -> WalkingState:
    """The first tick of the phase that `schedule` begins."""
    return WalkingState(
        schedule, steps_taken=state.steps_taken, commanded=state.commanded
    )
