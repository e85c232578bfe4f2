"""A tick of the Atlas paper's controller: feedback and footholds by one plan.

What is optimised is executed: the reference is that of the plan with the very
footholds that are taken, whether the QP or a dead band has chosen them.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nadia_balance.core.atlas_icp_plan import AtlasIcpPlan
from nadia_balance.core.com_height import ComHeightPlan, plan_com_height
from nadia_balance.core.foothold_adjustment import unadjusted
from nadia_balance.core.icp_plan import IcpReference, reference_of
from nadia_balance.core.icp_step_qp import (
    IcpStepQp,
    IcpStepQpParams,
    StepProblem,
    StepWeights,
    feedback_alone,
)
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.polygon import (
    clip_all,
    halfspaces,
    shrink,
    support_polygon,
)
from nadia_balance.core.qp import QpResult
from nadia_balance.core.reachability import base_region, in_world
from nadia_balance.core.walking import (
    Adjustment,
    Array,
    FootPose,
    Footstep,
    Immutable,
    Phase,
    WalkingState,
)

_NO_QP = QpResult(np.empty(0), True, np.empty(0, np.int8), 0, False, 0.0)


@dataclass(frozen=True, eq=False)
class StepPhase(Immutable):
    """What stays the same as long as the contact schedule does.

    `steps` are those in force, `offsets` (n, 2) [m] in W their shifts from the
    nominal footholds.  The CMP must be in the polygon `room` (k, 2) [m] in W;
    half-spaces of it, and of the shifts of all footholds.
    """

    steps: tuple[Adjustment, ...]
    offsets: Array
    room: Array
    cmp_room: tuple[Array, Array]
    step_room: tuple[Array, Array]
    weights: StepWeights
    height: ComHeightPlan


class StepFeedback(NamedTuple):
    """What a tick comes to.

    `adjustment` is None while no step may be moved; `reference` is that of the
    plan with its footholds; `ecmp` (2,) [m] in W is r_cmp,d.
    """

    adjustment: Adjustment | None
    reference: IcpReference
    ecmp: Array
    result: QpResult


def uncrossed_reach(params: IcpStepQpParams, model: PointMassModel) -> Array:
    """Returns where the foot can be put, in the sole frame of the stance foot.

    The base region (n, 2) [m], y toward the swing side, as far as the soles, if
    parallel, are their clearance apart: this paper knows no crossed legs.

    Raises:
        ValueError: there is no such place.
    """
    apart = float(np.ptp(model.sole[:, 1])) + params.sole_clearance
    aside = np.array([[0.0, -1.0]]), np.array([-apart])
    reach = clip_all(base_region(model.reach), *aside)
    if not len(reach):
        raise ValueError(
            f"sole_clearance = {params.sole_clearance}: must leave some of "
            f"the reach, {model.reach.describe()}"
        )
    return reach


def reach_room(
    stance: FootPose, steps: tuple[Footstep, ...], reach: Array
) -> tuple[Array, Array]:
    """Returns half-spaces A s <= b of the shifts s (2 n,) of `steps` (Eq. 22).

    Each foothold is in the convex `reach` (k, 2) [m] of the one before it, the
    first one in that of `stance`.
    """
    n, k = len(steps), len(reach)
    rows, bounds = np.zeros((n, k, n, 2)), np.zeros((n, k))
    for i, step in enumerate(steps):
        turned = in_world(reach, FootPose(yaw=stance.yaw), step.side)
        A, b = halfspaces(turned)
        rows[i, :, i], bounds[i] = A, b
        bounds[i] -= A @ (step.pose.p_WF - stance.p_WF)[:2]
        if i > 0:
            rows[i, :, i - 1] = -A
        stance = step.pose
    return rows.reshape(n * k, 2 * n), bounds.reshape(n * k)


def step_phase(
    state: WalkingState,
    reach: Array,
    params: IcpStepQpParams,
    model: PointMassModel,
) -> StepPhase:
    """Returns what the schedule of `state` leaves to feedback and footholds.

    `reach` (n, 2) [m] is that of `uncrossed_reach`.
    """
    schedule = state.schedule
    stance = schedule.feet[schedule.support_side]
    steps = _in_force(state, params.num_steps)
    shifts = [a.pose.p_WF - a.nominal.pose.p_WF for a in steps]
    support = support_polygon(schedule, model.sole)
    room = shrink(support, params.cop_safe_distance, "cop_safe_distance")
    return StepPhase(
        steps,
        np.reshape(shifts, (-1, 3))[:, :2],
        room,
        halfspaces(room),
        reach_room(stance, tuple(a.nominal for a in steps), reach),
        StepWeights.of(params, stance),
        plan_com_height(schedule, params.com_height, model),
    )


def _in_force(state: WalkingState, num_steps: int) -> tuple[Adjustment, ...]:
    """The adjustments of the next steps, moved or not; none while standing."""
    if state.schedule.phase is Phase.STANDING:
        return ()
    steps, made = state.schedule.footsteps[:num_steps], state.adjustment
    found = () if made is None else (made, *made.later)
    more = (Adjustment(step, step.pose) for step in steps[len(found) :])
    return (*found, *more)[: len(steps)]


def may_move(state: WalkingState, params: IcpStepQpParams) -> bool:
    """True with steps to come; in a swing not too early and not too late."""
    schedule = state.schedule
    if schedule.phase is Phase.STANDING or not schedule.footsteps:
        return False
    left = state.remaining_time
    in_time = schedule.phase is Phase.TRANSFER or left >= params.freeze_time
    return in_time and state.elapsed >= params.settling_time


def step_feedback(
    state: WalkingState,
    phase: StepPhase,
    plan: AtlasIcpPlan,
    icp: Array,
    qp: IcpStepQp,
    params: IcpStepQpParams,
    on: bool = True,
) -> StepFeedback:
    """Returns feedback and footholds for the measured `icp` (2,) [m] in W.

    `state` is at t+, its clock advanced already; `phase` and `plan` are those
    of its schedule.  No foothold moves unless the steps are `on`, nor if the QP
    is not solved: then the feedback does what it can alone.
    """
    reference = reference_of(plan, state)
    moves = plan.moves_of(state)[:, : len(phase.steps)]
    back = moves @ phase.offsets  # to the nominal footholds
    error, cmp = icp - reference.icp + back[0], reference.ecmp - back[1]
    steps, result = phase.steps, _NO_QP
    if on and may_move(state, params):
        problem = StepProblem(
            error, cmp, moves, phase.cmp_room, phase.step_room
        )
        shifts, _, _, result = qp.solve(problem, phase.weights)
        if result.solved:
            steps = _moved(phase, shifts, params.dead_band)
    # The QP's delta, if the footholds are the QP's.
    shifts = np.array(
        [(a.pose.p_WF - a.nominal.pose.p_WF)[:2] for a in steps]
    ).reshape(-1, 2)
    ahead = moves @ shifts
    error, cmp = error - ahead[0], cmp + ahead[1]
    delta = feedback_alone(
        error, cmp, phase.room, phase.weights, params.feedback_gain
    )
    return StepFeedback(
        _chain(steps, state) if on else None,
        _moved_reference(reference, icp - error, cmp, plan, state),
        cmp + delta,
        result,
    )


def _moved(
    phase: StepPhase, shifts: Array, dead_band: float
) -> tuple[Adjustment, ...]:
    """The steps, `shifts` (n, 2) [m] away from the nominal footholds."""
    if np.hypot(*shifts.T).max() < dead_band:
        return tuple(replace(a, pose=a.nominal.pose) for a in phase.steps)
    if np.hypot(*(shifts - phase.offsets).T).max() < dead_band:
        return phase.steps
    poses = [a.nominal.pose for a in phase.steps]
    return tuple(
        replace(a, pose=FootPose(pose.p_WF + [*shift, 0.0], pose.yaw))
        for a, pose, shift in zip(phase.steps, poses, shifts, strict=True)
    )


def _chain(steps: tuple[Adjustment, ...], state: WalkingState) -> Adjustment:
    """The adjustment of the next step, with those `later`."""
    if not steps:
        return unadjusted(state.schedule)
    first, *later = (replace(a, later=()) for a in steps)
    return replace(first, later=tuple(later))


def _moved_reference(
    reference: IcpReference,
    icp: Array,
    cmp: Array,
    plan: AtlasIcpPlan,
    state: WalkingState,
) -> IcpReference:
    """The `reference` with another ICP and CMP (2,) [m] in W."""
    velocity = reference.icp_velocity
    if not state.waiting:
        velocity = plan.omega * (icp - cmp)
    return replace(reference, icp=icp, icp_velocity=velocity, cop=cmp, ecmp=cmp)
