"""The Atlas paper's controller (Sec. IV): the limits and the QP of a tick."""

import functools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import base_region, in_world
from nadia_balance.core.feedback.icp_step_qp import (
    AnkleFeedback,
    IcpStepQp,
    IcpStepQpParams,
    StepWeights,
    ankle_feedback,
    step_weights,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import (
    Halfspaces,
    clip_all,
    halfspaces,
    shrink,
)
from nadia_balance.core.math.qp import QpResult
from nadia_balance.core.plan.atlas_icp_plan import AtlasIcpPlan
from nadia_balance.core.plan.icp_plan import IcpReference, reference_of
from nadia_balance.core.steps.foothold_adjustment import unadjusted
from nadia_balance.core.walking.state import (
    Adjustment,
    FootPose,
    Footstep,
    Immutable,
    Phase,
    Side,
    WalkingState,
    support_polygon,
)

_NO_QP = QpResult(np.empty(0), True, 0, violation=0.0)
_KEPT = 8  # supports: a foothold that moves changes none


class Support(NamedTuple):
    """The data that depend only on the feet in contact, in W [m]."""

    reach: Array  # (n, 2), of the next foothold
    cmp_room: Halfspaces  # the support polygon less its margin
    ankles: AnkleFeedback  # of fixed footholds


@dataclass(frozen=True, eq=False)
class StepPhase(Immutable):
    """The data that depend only on the contact schedule, in W [m]."""

    steps: tuple[Adjustment, ...]  # in force
    offsets: Array  # (n, 2), from the nominal footholds
    adjustment: Adjustment  # with all of `steps`
    support: Support
    weights: StepWeights
    step_room: Halfspaces  # see `reach_room` and `region_room`


class StepFeedback(NamedTuple):
    """The feedback of one tick."""

    adjustment: Adjustment | None  # None if step adjustment is off
    # With the executed footholds: of the QP, or those kept by a dead band.
    reference: IcpReference
    ecmp: Array  # r_cmp,d (2,) [m] in W
    result: QpResult


def uncrossed_reach(params: IcpStepQpParams, model: PointMassModel) -> Array:
    """The base region, as far as parallel soles are their clearance apart.

    The Atlas paper crosses no legs.

    Args:
        params: clearance of the soles.
        model: sole, base region and least clearance.

    Returns:
        The region (n, 2) of footholds in the sole frame, y toward the swing
        side [m].

    Raises:
        ValueError: the region is empty.
    """
    clearance = max(params.sole_clearance, model.sole_clearance)
    reach = clip_all(
        base_region(model.reach),
        A=np.array([[0.0, -1.0]]),
        b=np.array([-float(np.ptp(model.sole[:, 1])) - clearance]),
    )
    if not len(reach):
        raise ValueError(
            f"sole_clearance = {params.sole_clearance}: must leave some of "
            f"the reach, {model.reach.describe()}"
        )
    return reach


def reach_room(
    stance: FootPose, steps: tuple[Footstep, ...], reach: Array
) -> Halfspaces:
    """A_i (p_i + s_i - p_i-1 - s_i-1) <= b_i for each of n steps (Eq. 22).

    Args:
        stance: foot from which the first step is made, in W.
        steps: steps, each made from the foothold of the one before it.
        reach: convex region (k, 2) of a step in the sole frame of the foot
            that it is made from, y toward the swing side [m].

    Returns:
        A (n k, 2 n) and b (n k,) with A s <= b for the shifts s in W [m].
    """
    n, k = len(steps), len(reach)
    rows, bounds = np.zeros((n, k, n, 2)), np.zeros((n, k))
    for i, step in enumerate(steps):
        A, b = halfspaces(in_world(reach, FootPose(yaw=stance.yaw), step.side))
        rows[i, :, i] = A
        bounds[i] = b - A @ (step.pose.p_WF - stance.p_WF)[:2]
        if i > 0:
            rows[i, :, i - 1] = -A
        stance = step.pose
    return rows.reshape(n * k, 2 * n), bounds.reshape(n * k)


def region_room(steps: tuple[Footstep, ...], ground: Ground) -> Halfspaces:
    """A_i (p_i + s_i) <= b_i for each of n steps (Eq. 22).

    Each sole stays on the region on which its foothold is planned; the QP
    would not be convex if it chose the regions.

    Args:
        steps: steps on the ground.
        ground: the regions.

    Returns:
        A (m, 2 n) and b (m,) with A s <= b for the shifts s in W [m].
    """
    rows, bounds = [np.zeros((0, 2 * len(steps)))], [np.zeros(0)]
    for i, step in enumerate(steps):
        A, b = halfspaces(ground.footholds_at(step.pose))
        row = np.zeros((len(b), 2 * len(steps)))
        row[:, 2 * i : 2 * i + 2] = A
        rows.append(row)
        bounds.append(b - A @ step.pose.p_WF[:2])
    return np.concatenate(rows), np.concatenate(bounds)


class IcpStepControl:
    """Feedback and footholds of a tick, from one QP (Atlas paper, Sec. IV)."""

    def __init__(self, params: IcpStepQpParams, model: PointMassModel) -> None:
        """Prepares the QP.

        Args:
            params: gain, weights and limits.
            model: soles and reach.

        Raises:
            ValueError: see `uncrossed_reach`.
        """
        self._params, self._model = params, model
        self.qp = IcpStepQp(params)
        self._reach = uncrossed_reach(params, model)
        self._support = functools.lru_cache(_KEPT)(self._make_support)

    def phase(self, state: WalkingState) -> StepPhase:
        """Prepares what is constant while the schedule is.

        Args:
            state: walking state, of which the schedule and the adjustment
                count.

        Returns:
            Footholds in force and limits.
        """
        schedule, params = state.schedule, self._params
        stance = schedule.feet[schedule.support_side]
        swing, ground = schedule.support_side.other, self._model.ground
        steps = _in_force(state, params.num_steps)
        nominal = tuple(step.nominal for step in steps)
        A, b = reach_room(stance, nominal, self._reach)
        if ground is not None:
            A_regions, b_regions = region_room(nominal, ground)
            A, b = np.concatenate((A, A_regions)), np.append(b, b_regions)
        polygon = support_polygon(schedule, self._model.cop_area)
        return StepPhase(
            steps,
            offsets=_shifts(steps),
            adjustment=(
                replace(steps[0], later=steps[1:])
                if steps
                else unadjusted(schedule)
            ),
            support=self._support(polygon.tobytes(), stance, swing),
            weights=step_weights(params, stance, steps=nominal, swing=swing),
            step_room=(A, b),
        )

    def _make_support(
        self, polygon: bytes, stance: FootPose, swing: Side
    ) -> Support:
        """Returns the data of a support polygon, given by its bytes."""
        params = self._params
        room = shrink(
            np.frombuffer(polygon).reshape(-1, 2),
            distance=params.cop_safe_distance,
            name="cop_safe_distance",
        )
        weights = step_weights(params, stance, steps=(), swing=swing)
        return Support(
            reach=in_world(self._reach, stance, swing),
            cmp_room=halfspaces(room),
            ankles=ankle_feedback(room, weights, params.feedback_gain),
        )

    def may_move(self, state: WalkingState) -> bool:
        """True if footholds may change: steps remain, no phase change near.

        Args:
            state: walking state.

        Returns:
            False, too, while standing.
        """
        schedule, params = state.schedule, self._params
        if not schedule.footsteps or state.elapsed < params.settling_time:
            return False
        return schedule.phase is Phase.TRANSFER or (
            schedule.phase is Phase.SWING
            and state.remaining_time >= params.freeze_time
        )

    def feedback(
        self,
        state: WalkingState,
        phase: StepPhase,
        plan: AtlasIcpPlan,
        icp: Array,
        on: bool = True,
    ) -> StepFeedback:
        """r_cmp,d = r_cmp,r + delta, with the footholds of the QP (Eq. 20).

        If step adjustment is not `on`, or the QP is not solved, footholds are
        kept and only the CMP feedback acts.

        Args:
            state: walking state at t+, with its clock already advanced.
            phase: that of the schedule of `state`.
            plan: ICP plan of the schedule of `state`.
            icp: measured ICP (2,) in W [m].
            on: whether footholds may be adjusted.

        Returns:
            The CMP, the adjustment, and the reference that follows from it.
        """
        reference = reference_of(plan, state)
        steps, result = phase.steps, _NO_QP
        adjustment = phase.adjustment if on else None
        if on and self.may_move(state):
            moves = plan.moves_of(state)[:, : len(steps)]
            back = moves @ phase.offsets  # to the nominal footholds
            shifts, result = self.qp.solve(
                icp - reference.icp + back[0],
                cmp=reference.ecmp - back[1],
                moves=moves,
                cmp_room=phase.support.cmp_room,
                step_room=phase.step_room,
                weights=phase.weights,
            )
            if result.solved:
                steps = self._moved(phase, shifts)
            if steps is not phase.steps:
                adjustment = replace(steps[0], later=steps[1:])
                dcm, cmp = moves @ (_shifts(steps) - phase.offsets)
                faster = 0.0 if state.waiting else plan.omega * (dcm - cmp)
                reference = replace(
                    reference,
                    icp=reference.icp + dcm,
                    icp_velocity=reference.icp_velocity + faster,
                    ecmp=reference.ecmp + cmp,
                    cop=reference.ecmp + cmp,
                )
        # Equal to the QP's delta if the footholds are the QP's.
        return StepFeedback(
            adjustment,
            reference,
            reference.ecmp
            + phase.support.ankles.delta(icp - reference.icp, reference.ecmp),
            result,
        )

    def _moved(self, phase: StepPhase, shifts: Array) -> tuple[Adjustment, ...]:
        """Returns the steps, `shifts` (n, 2) [m] from the nominal footholds.

        The steps of `phase` are returned if no pose changes.
        """
        if _longest(shifts) < self._params.dead_band:
            if not phase.offsets.any():
                return phase.steps
            return tuple(
                Adjustment(step.nominal, step.nominal.pose)
                for step in phase.steps
            )
        if _longest(shifts - phase.offsets) < self._params.dead_band:
            return phase.steps
        return tuple(
            Adjustment(
                step.nominal,
                self._model.foot_at(
                    step.nominal.pose.p_WF[:2] + shift, step.nominal.pose
                ),
            )
            for step, shift in zip(phase.steps, shifts, strict=True)
        )


def _in_force(state: WalkingState, num_steps: int) -> tuple[Adjustment, ...]:
    """Returns the adjustments of the next steps; none while standing."""
    if state.schedule.phase is Phase.STANDING:
        return ()
    steps, made = state.schedule.footsteps[:num_steps], state.adjustment
    adjusted = (replace(made, later=()), *made.later) if made else ()
    unmoved = (Adjustment(step, step.pose) for step in steps[len(adjusted) :])
    return (*adjusted, *unmoved)[: len(steps)]


def _longest(vectors: Array) -> float:
    return max(math.hypot(x, y) for x, y in vectors.tolist())


def _shifts(steps: tuple[Adjustment, ...]) -> Array:
    """Returns the shifts (n, 2) [m] from the nominal footholds, in W."""
    return np.reshape(
        [(step.pose.p_WF - step.nominal.pose.p_WF)[:2] for step in steps],
        (-1, 2),
    )
