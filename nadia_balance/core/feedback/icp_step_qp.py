"""The Atlas paper's controller (Sec. IV): feedback and footholds, one QP."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import base_region, in_world
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import (
    Halfspaces,
    clip_all,
    halfspaces,
    project,
    shrink,
)
from nadia_balance.core.math.qp import DenseQp, QpProblem, QpResult
from nadia_balance.core.plan.atlas_icp_plan import AtlasIcpPlan
from nadia_balance.core.plan.icp_plan import IcpReference, reference_of
from nadia_balance.core.steps.foothold_adjustment import unadjusted
from nadia_balance.core.walking.state import (
    Adjustment,
    FootPose,
    Footstep,
    Immutable,
    Phase,
    WalkingState,
    support_polygon,
)
from nadia_balance.parameters.bounds import bounded, parameters

_NO_QP = QpResult(np.empty(0), True, 0, violation=0.0)


@parameters
class IcpStepQpParams:
    """Gain, weights and limits of the Atlas paper's Eqs. 20 to 22.

    The weights are alike in all directions.
    """

    feedback_gain: float = bounded(
        3.0, doc="k_xi: CMP offset per ICP error", above=1.0
    )
    num_steps: int = bounded(
        1, doc="N: number of adjustable footholds", least=1, most=4
    )
    step_weight: float = bounded(
        10.0,
        doc="Q_f: weight of the foothold shifts; larger than R: the CoP "
        "reaches its limit before a foothold moves",
        above=0.0,
    )
    feedback_weight: float = bounded(
        1.0, doc="R: weight of the CMP feedback delta", above=0.0
    )
    slack_weight: float = bounded(
        1e5, doc="Q_eta: weight of the slack in the ICP error", above=0.0
    )
    cop_safe_distance: float = bounded(
        0.005,
        doc="margin of the CMP to the edge of the support polygon",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    sole_clearance: float = bounded(
        0.005,
        doc="lateral clearance between the soles",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    dead_band: float = bounded(
        0.02,
        doc="foothold changes smaller than this are ignored",
        least=0.0,
        unit="m",
    )
    freeze_time: float = bounded(
        0.05,
        doc="time before touchdown without foothold changes",
        least=0.0,
        unit="s",
    )
    settling_time: float = bounded(
        0.01,
        doc="time after a phase change without foothold changes",
        least=0.0,
        unit="s",
    )


class IcpStepQp:
    """The quadratic program of the Atlas paper's Eq. 20, for N steps.

        minimise    sum |step_i|^2_Qf + |delta|^2_R + |eta|^2_Qeta
        subject to  delta = k_xi (e - sum Gamma_i step_i - eta),
                    the CMP + delta in the support polygon (Eq. 21),
                    the footholds within reach of each other (Eq. 22).

    Half-spaces replace the paper's multipliers of the corners.  The CMP also
    moves with the footholds while a spline shifts it.  Delta is eliminated.

    Args:
        params: gain, weights and N.
    """

    def __init__(self, params: IcpStepQpParams) -> None:
        self._gain = params.feedback_gain
        self._size = 2 * params.num_steps + 2
        self._qp = DenseQp(self._size)
        # The cost without that of delta, whose weight is R.
        step_costs = 2 * params.num_steps * [params.step_weight]
        self._H = np.diag(step_costs + 2 * [params.slack_weight])
        self._R = params.feedback_weight

    def solve(
        self,
        error: Array,
        cmp: Array,
        moves: Array,
        cmp_room: Halfspaces,
        step_room: Halfspaces,
    ) -> tuple[Array, QpResult]:
        """Solves the QP of a tick for n <= N footholds.

        Args:
            error: ICP error xi - xi_r (2,) in W [m].
            cmp: reference CMP (2,) in W [m].
            moves: Gamma_i (2, n) of ICP and CMP (Eq. 18) [-].
            cmp_room: limits A p <= b of the CMP, A (k, 2), in W [m].
            step_room: limits of the shifts, A (m, 2 n), in W [m].

        Returns:
            The shifts (n, 2) of the footholds from the planned ones in W [m],
            NaN unless the result is solved; and the result, whose x ends in
            eta (2,), the slack in the ICP error [m].

        Raises:
            ValueError: an argument is not finite.
        """
        A_cmp, b_cmp = cmp_room
        A_steps, b_steps = step_room
        used = 2 * moves.shape[1]
        # x = (steps, eta), and delta = delta_0 + D x by the constraint.
        delta_0 = self._gain * error
        D = np.zeros((2, self._size))
        D[0, 0:used:2] = D[1, 1:used:2] = -self._gain * moves[0]
        D[0, -2] = D[1, -1] = -self._gain
        cmp_D = D.copy()
        cmp_D[0, 0:used:2] += moves[1]
        cmp_D[1, 1:used:2] += moves[1]
        C = np.zeros((len(b_cmp) + len(b_steps), self._size))
        C[: len(b_cmp)] = A_cmp @ cmp_D
        C[len(b_cmp) :, :used] = A_steps
        upper = np.concatenate((b_cmp - A_cmp @ (cmp + delta_0), b_steps))
        DR = self._R * D.T
        result = self._qp.solve(
            QpProblem(
                H=self._H + DR @ D,
                g=DR @ delta_0,
                A=C,
                lower=np.full(len(upper), -np.inf),
                upper=upper,
            )
        )
        return result.x[:used].reshape(-1, 2), result


def ankle_feedback(
    error: Array, cmp: Array, room: Array, params: IcpStepQpParams
) -> Array:
    """Minimise |delta - K error|^2 subject to cmp + delta in `room`.

    This is Eq. 20 for fixed footholds in closed form, a projection: K is what
    is left of the gain once eta is eliminated.

    Args:
        error: ICP error xi - xi_r (2,) in W [m].
        cmp: reference CMP (2,) in W [m].
        room: polygon (n, 2) of the CMP in W [m].
        params: gain, and the weights of delta and eta.

    Returns:
        The CMP feedback delta (2,) in W [m].
    """
    slack = params.slack_weight / params.feedback_gain
    K = slack / (params.feedback_weight + slack / params.feedback_gain)
    return np.asarray(project(cmp + K * error, room) - cmp)


@dataclass(frozen=True, eq=False)
class StepPhase(Immutable):
    """The data that depend only on the contact schedule, in W [m]."""

    steps: tuple[Adjustment, ...]  # in force
    offsets: Array  # (n, 2), from the nominal footholds
    adjustment: Adjustment  # with all of `steps`
    reach: Array  # (n, 2), of the next foothold
    room: Array  # (k, 2), of the CMP
    cmp_room: Halfspaces  # of `room`
    step_room: Halfspaces  # see `reach_room`


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
        steps = _in_force(state, params.num_steps)
        room = shrink(
            support_polygon(schedule, self._model.cop_area),
            distance=params.cop_safe_distance,
            name="cop_safe_distance",
        )
        return StepPhase(
            steps,
            offsets=_shifts(steps),
            adjustment=(
                replace(steps[0], later=steps[1:])
                if steps
                else unadjusted(schedule)
            ),
            reach=in_world(self._reach, stance, schedule.support_side.other),
            room=room,
            cmp_room=halfspaces(room),
            step_room=reach_room(
                stance, tuple(step.nominal for step in steps), self._reach
            ),
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
                cmp_room=phase.cmp_room,
                step_room=phase.step_room,
            )
            if result.solved:
                steps = _moved(phase, shifts, self._params.dead_band)
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
            + ankle_feedback(
                icp - reference.icp, reference.ecmp, phase.room, self._params
            ),
            result,
        )


def _in_force(state: WalkingState, num_steps: int) -> tuple[Adjustment, ...]:
    """Returns the adjustments of the next steps; none while standing."""
    if state.schedule.phase is Phase.STANDING:
        return ()
    steps, made = state.schedule.footsteps[:num_steps], state.adjustment
    adjusted = (replace(made, later=()), *made.later) if made else ()
    unmoved = (Adjustment(step, step.pose) for step in steps[len(adjusted) :])
    return (*adjusted, *unmoved)[: len(steps)]


def _moved(
    phase: StepPhase, shifts: Array, dead_band: float
) -> tuple[Adjustment, ...]:
    """Returns the steps, `shifts` (n, 2) [m] from the nominal footholds.

    The steps of `phase` are returned if no pose changes.
    """
    if _longest(shifts) < dead_band:
        if not phase.offsets.any():
            return phase.steps
        return tuple(
            Adjustment(step.nominal, step.nominal.pose) for step in phase.steps
        )
    if _longest(shifts - phase.offsets) < dead_band:
        return phase.steps
    return tuple(
        Adjustment(
            step.nominal,
            FootPose(
                step.nominal.pose.p_WF + [*shift, 0.0], step.nominal.pose.yaw
            ),
        )
        for step, shift in zip(phase.steps, shifts, strict=True)
    )


def _longest(vectors: Array) -> float:
    return max(math.hypot(x, y) for x, y in vectors.tolist())


def _shifts(steps: tuple[Adjustment, ...]) -> Array:
    """Returns the shifts (n, 2) [m] from the nominal footholds, in W."""
    return np.reshape(
        [(step.pose.p_WF - step.nominal.pose.p_WF)[:2] for step in steps],
        (-1, 2),
    )
