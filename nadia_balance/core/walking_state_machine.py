"""How the walking state advances by one control period.

Standing -> transfer -> swing -> transfer -> ... -> standing (the state machine
that the papers leave to the reader; see also the Atlas paper, Sec. II).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from nadia_balance.core.footstep_plan import within_reach
from nadia_balance.core.icp_plan import IcpPlan
from nadia_balance.core.polygon import project
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.support_polygon import support_polygon
from nadia_balance.core.walking import (
    Adjustment,
    Array,
    ContactSchedule,
    FootPoses,
    Phase,
    Side,
    WalkingState,
)


@dataclass(kw_only=True)
class WalkingStateMachineParams:
    """When a phase ends."""

    standing_duration: float = 0.5  # before the first step [s]
    earliest_touchdown: float = 0.5  # fraction of the swing [-]
    contact_force: float = 30.0  # the foot has landed above this [N]
    contact_ticks: int = 2  # for so many ticks in a row [-]
    # A transfer ends when the ICP error is within this ellipse of the sole
    # frame, or when waiting would make things worse because the ICP is
    # leaving the support polygon.
    icp_error_forward: float = 0.035  # [m]
    icp_error_inward: float = 0.015  # toward the other foot [m]
    icp_error_outward: float = 0.012  # [m]
    icp_outside: float = 0.03  # ICP so far outside the support: step [m]
    patience: float = 0.2  # waits no longer for the ICP than this [s]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name, value in vars(self).items():
            infinite = name != "patience" and value == math.inf
            if infinite or not value >= 0.0:
                raise ValueError(f"{name} = {value}: must be finite and >= 0")
        if not self.earliest_touchdown < 1.0:
            raise ValueError(
                f"earliest_touchdown = {self.earliest_touchdown}: must be < 1"
            )
        if not self.contact_ticks > 0:
            raise ValueError(
                f"contact_ticks = {self.contact_ticks}: must be > 0"
            )


@dataclass(frozen=True)
class Measurement:
    """What is measured of the robot: sole poses, forces [N], ICP [m], in W."""

    feet: FootPoses
    forces: Array  # (2,) normal forces, left and right
    icp: Array  # (2,)

    def force(self, side: Side) -> float:
        """Normal force [N] on the foot of `side`."""
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
    state = _adjust(state, proposal.adjustment)
    schedule = state.schedule
    t = state.time_in_phase + max(period + proposal.time_gain, 0.0)
    done = t >= schedule.duration - 0.5 * period
    state = replace(
        state,
        time_in_phase=schedule.duration if done else t,
        elapsed=state.elapsed + period,
        waiting=done,
    )
    match schedule.phase:
        case Phase.STANDING if done:
            return _start_transfer(state, plan, measured, reach)
        case Phase.TRANSFER if done:
            waited = state.waited + period
            impatient = waited > params.patience
            if impatient or _may_lift(schedule, plan, measured, sole, params):
                return _end_transfer(state, plan, measured)
            return replace(state, waited=waited)
        case Phase.SWING:
            return _advance_swing(state, plan, measured, reach, params)
    return state


def _adjust(state: WalkingState, adjustment: Adjustment | None) -> WalkingState:
    """Moves the foothold of the step in the air."""
    schedule = state.schedule
    if adjustment is None or schedule.phase is not Phase.SWING:
        return state
    step, *later = schedule.footsteps
    if adjustment.pose is not step.pose:
        step = replace(step, pose=adjustment.pose)
        schedule = replace(schedule, footsteps=(step, *later))
    return replace(state, schedule=schedule, adjustment=adjustment)


def _advance_swing(
    state: WalkingState,
    plan: IcpPlan,
    measured: Measurement,
    reach: ReachabilityParams,
    params: WalkingStateMachineParams,
) -> WalkingState:
    schedule = state.schedule
    # Of the swing as it really is: a clock that was advanced has passed half
    # of the plan before the foot has left the ground.
    earliest = params.earliest_touchdown * (
        state.elapsed + state.remaining_time
    )
    force = measured.force(schedule.support_side.other)
    touches = state.elapsed >= earliest and force > params.contact_force
    ticks = state.contact_ticks + 1 if touches else 0
    if ticks < params.contact_ticks:
        return replace(state, contact_ticks=ticks)
    landed = replace(
        state,
        commanded=state.commanded[1:],
        steps_taken=state.steps_taken + 1,
    )
    return _start_transfer(landed, plan, measured, reach)


def _start_transfer(
    state: WalkingState,
    plan: IcpPlan,
    measured: Measurement,
    reach: ReachabilityParams,
) -> WalkingState:
    old = state.schedule
    steps = within_reach(state.commanded, measured.feet, reach)
    schedule = replace(
        old,
        phase=Phase.TRANSFER,
        support_side=steps[0].side.other if steps else old.support_side.other,
        duration=(
            steps[0].transfer_duration if steps else old.final_transfer_duration
        ),
        feet=measured.feet,
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
        feet=measured.feet,
        start=plan.at(state.time_in_phase).point(),
    )
    return _begin(state, schedule)


def _begin(state: WalkingState, schedule: ContactSchedule) -> WalkingState:
    """The first tick of the phase that `schedule` begins."""
    return WalkingState(
        schedule, steps_taken=state.steps_taken, commanded=state.commanded
    )


def _may_lift(
    schedule: ContactSchedule,
    plan: IcpPlan,
    measured: Measurement,
    sole: Array,
    params: WalkingStateMachineParams,
) -> bool:
    """True if the ICP is near its reference, or leaves the support anyway."""
    if not schedule.footsteps:
        return True
    reference = plan.at(schedule.duration)
    support = schedule.feet[schedule.support_side]
    error = support.rotation.T @ (measured.icp - reference.icp)
    inward = -schedule.support_side.sign * error[1] > 0.0
    scale = np.array(
        [
            params.icp_error_forward,
            params.icp_error_inward if inward else params.icp_error_outward,
        ]
    )
    if np.sum((error / scale) ** 2) < 1.0:
        return True
    nearest = project(measured.icp, support_polygon(schedule, sole))
    return math.dist(measured.icp, nearest) > params.icp_outside
