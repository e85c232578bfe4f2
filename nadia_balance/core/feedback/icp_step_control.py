"""The Atlas paper's controller: feedback and footholds from one plan."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import base_region, in_world
from nadia_balance.core.feedback import icp_step_qp
from nadia_balance.core.math import polygon
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.qp import QpResult
from nadia_balance.core.plan.atlas_icp_plan import AtlasIcpPlan
from nadia_balance.core.plan.icp_plan import IcpReference, reference_of
from nadia_balance.core.steps.foothold_adjustment import unadjusted
from nadia_balance.core.walking import vocabulary as walking
from nadia_balance.core.walking.vocabulary import (
    Adjustment,
    Phase,
    WalkingState,
)

_NO_QP = QpResult(np.empty(0), True, 0, violation=0.0)


@dataclass(frozen=True, eq=False)
class StepPhase(walking.Immutable):
    """The data that depend only on the contact schedule.

    `steps` are the adjustments in force, `offsets` (n, 2) [m] in W their shifts
    from the nominal footholds; `adjustment` holds all of them; `reach` (n, 2)
    [m] in W is the region of the next foothold.
    """

    steps: tuple[Adjustment, ...]
    offsets: Array
    adjustment: Adjustment
    reach: Array
    limits: icp_step_qp.StepLimits
    ankles: icp_step_qp.AnkleFeedback


class StepFeedback(NamedTuple):
    """The feedback of one tick.

    `adjustment` is None if step adjustment is off; `reference` is that of the
    plan with the adjusted footholds; `ecmp` (2,) [m] in W is r_cmp,d.
    """

    adjustment: Adjustment | None
    reference: IcpReference
    ecmp: Array
    result: QpResult


def uncrossed_reach(
    params: icp_step_qp.IcpStepQpParams, model: PointMassModel
) -> Array:
    """Returns the region (n, 2) [m] of uncrossed footholds in the sole frame.

    It is the part of the base region, y toward the swing side, in which
    parallel soles are their clearance apart: the Atlas paper has no crossed
    legs.

    Raises ValueError: the region is empty.
    """
    apart = float(np.ptp(model.sole[:, 1]))
    apart += max(params.sole_clearance, model.sole_clearance)
    aside = np.array([[0.0, -1.0]]), np.array([-apart])
    reach = polygon.clip_all(base_region(model.reach), *aside)
    if not len(reach):
        raise ValueError(
            f"sole_clearance = {params.sole_clearance}: must leave some of "
            f"the reach, {model.reach.describe()}"
        )
    return reach


def reach_room(
    stance: walking.FootPose, steps: tuple[walking.Footstep, ...], reach: Array
) -> tuple[Array, Array]:
    """Returns half-spaces A s <= b of the shifts s (2 n,) of `steps` (Eq. 22).

    Each foothold is in the convex `reach` (k, 2) [m] of the previous foothold,
    the first one in that of `stance`.
    """
    n, k = len(steps), len(reach)
    rows, bounds = np.zeros((n, k, n, 2)), np.zeros((n, k))
    for i, step in enumerate(steps):
        turned = in_world(reach, walking.FootPose(yaw=stance.yaw), step.side)
        A, b = polygon.halfspaces(turned)
        rows[i, :, i], bounds[i] = A, b
        bounds[i] -= A @ (step.pose.p_WF - stance.p_WF)[:2]
        if i > 0:
            rows[i, :, i - 1] = -A
        stance = step.pose
    return rows.reshape(n * k, 2 * n), bounds.reshape(n * k)


class IcpStepControl:
    """Feedback and footholds of one tick, from one QP (Atlas paper, Sec. IV).

    The reference is always that of the plan with the executed footholds, those
    of the QP or those kept by a dead band.
    """

    def __init__(
        self, params: icp_step_qp.IcpStepQpParams, model: PointMassModel
    ):
        """Raises ValueError: see `uncrossed_reach`."""
        self._params, self._model = params, model
        self.qp = icp_step_qp.IcpStepQp(params)
        self._reach = uncrossed_reach(params, model)

    def phase(self, state: WalkingState) -> StepPhase:
        """Returns the StepPhase of the schedule of `state`."""
        schedule, params = state.schedule, self._params
        stance = schedule.feet[schedule.support_side]
        steps = _in_force(state, params.num_steps)
        nominal = tuple(a.nominal for a in steps)
        support = walking.support_polygon(schedule, self._model.cop_area)
        margin = params.cop_safe_distance
        room = polygon.shrink(support, margin, "cop_safe_distance")
        weights = icp_step_qp.StepWeights.of(params, stance)
        return StepPhase(
            steps,
            _shifts(steps),
            _chain(steps) or unadjusted(schedule),
            in_world(self._reach, stance, schedule.support_side.other),
            self.qp.limits(
                weights,
                polygon.halfspaces(room),
                reach_room(stance, nominal, self._reach),
            ),
            icp_step_qp.AnkleFeedback(room, weights, params.feedback_gain),
        )

    def may_move(self, state: WalkingState) -> bool:
        """True if footholds may change: steps remain, no phase change near."""
        schedule, params = state.schedule, self._params
        if schedule.phase is Phase.STANDING or not schedule.footsteps:
            return False
        in_time = (
            schedule.phase is Phase.TRANSFER
            or state.remaining_time >= params.freeze_time
        )
        return in_time and state.elapsed >= params.settling_time

    def feedback(
        self,
        state: WalkingState,
        phase: StepPhase,
        plan: AtlasIcpPlan,
        icp: Array,
        on: bool = True,
    ) -> StepFeedback:
        """Returns feedback and footholds for the measured `icp` (2,) [m] in W.

        `state` is at t+, with its clock already advanced; `phase` and `plan`
        are those of its schedule.  If step adjustment is not `on`, or the QP is
        not solved, footholds are kept and only the CMP feedback acts.
        """
        reference = reference_of(plan, state)
        steps, result = phase.steps, _NO_QP
        if on and self.may_move(state):
            moves = plan.moves_of(state)[:, : len(steps)]
            back = moves @ phase.offsets  # to the nominal footholds
            shifts, result = self.qp.solve(
                icp - reference.icp + back[0],
                reference.ecmp - back[1],
                moves,
                phase.limits,
            )
            if result.solved:
                steps = _moved(phase, shifts, self._params.dead_band)
            if steps is not phase.steps:
                dcm, cmp = moves @ (_shifts(steps) - phase.offsets)
                omega = plan.omega
                reference = _shifted(reference, dcm, cmp, omega, state.waiting)
        adjustment = None
        if on:
            kept = steps is phase.steps
            adjustment = phase.adjustment if kept else _chain(steps)
        # Equal to the QP's delta if the footholds are the QP's.
        delta = phase.ankles.delta(icp - reference.icp, reference.ecmp)
        ecmp = reference.ecmp + delta
        return StepFeedback(adjustment, reference, ecmp, result)


def _in_force(state: WalkingState, num_steps: int) -> tuple[Adjustment, ...]:
    """Returns the adjustments of the next steps; none while standing."""
    if state.schedule.phase is Phase.STANDING:
        return ()
    steps, made = state.schedule.footsteps[:num_steps], state.adjustment
    found = (replace(made, later=()), *made.later) if made else ()
    more = (Adjustment(step, step.pose) for step in steps[len(found) :])
    return (*found, *more)[: len(steps)]


def _moved(
    phase: StepPhase, shifts: Array, dead_band: float
) -> tuple[Adjustment, ...]:
    """Returns the steps, `shifts` (n, 2) [m] from the nominal footholds.

    The steps of `phase` are returned if no pose changes.
    """
    if _longest(shifts) < dead_band:
        if not phase.offsets.any():
            return phase.steps
        return tuple(Adjustment(a.nominal, a.nominal.pose) for a in phase.steps)
    if _longest(shifts - phase.offsets) < dead_band:
        return phase.steps
    poses = [a.nominal.pose for a in phase.steps]
    return tuple(
        Adjustment(a.nominal, walking.FootPose(p.p_WF + [*shift, 0.0], p.yaw))
        for a, p, shift in zip(phase.steps, poses, shifts, strict=True)
    )


def _longest(vectors: Array) -> float:
    return max(math.hypot(x, y) for x, y in vectors.tolist())


def _shifts(steps: tuple[Adjustment, ...]) -> Array:
    """Returns the shifts (n, 2) [m] from the nominal footholds, in W."""
    shifts = [(a.pose.p_WF - a.nominal.pose.p_WF)[:2] for a in steps]
    return np.reshape(shifts, (-1, 2))


def _chain(steps: tuple[Adjustment, ...]) -> Adjustment | None:
    """Returns the adjustment of the next step with the `later` ones."""
    if not steps:
        return None
    return replace(steps[0], later=steps[1:])


def _shifted(
    reference: IcpReference, icp: Array, cmp: Array, omega: float, held: bool
) -> IcpReference:
    """Returns the `reference`, its ICP and CMP shifted by (2,) [m] in W."""
    ecmp = reference.ecmp + cmp
    velocity = 0.0 if held else omega * (icp - cmp)
    return replace(
        reference,
        icp=reference.icp + icp,
        icp_velocity=reference.icp_velocity + velocity,
        cop=ecmp,
        ecmp=ecmp,
    )
