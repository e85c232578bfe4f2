"""The Atlas paper's controller (Sec. IV): feedback and footholds, one QP."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import base_region, in_world
from nadia_balance.core.math import polygon
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.qp import DenseQp, QpProblem, QpResult
from nadia_balance.core.plan.atlas_icp_plan import AtlasIcpPlan
from nadia_balance.core.plan.icp_plan import IcpReference, reference_of
from nadia_balance.core.steps.foothold_adjustment import unadjusted
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.state import Adjustment, WalkingState
from nadia_balance.parameters.bounds import bounded

Halfspaces = tuple[Array, Array]  # A, b with A p <= b, in W
_NO_QP = QpResult(np.empty(0), True, 0, violation=0.0)


@dataclass(kw_only=True)
class IcpStepQpParams:
    """Gain, weights and limits of the Atlas paper's Eqs. 20 to 22."""

    feedback_gain: float = bounded(3.0, above=1.0)  # k_xi, CMP per ICP error
    num_steps: int = bounded(1, least=1, most=4)  # N adjustable footholds
    # Q_f, R and Q_eta, each alike in all directions: weights of the foothold
    # shifts, of delta, and of the slack in the ICP error.  Q_f is larger than
    # R: the CoP reaches its limit before a foothold moves.
    step_weight: float = bounded(10.0, above=0.0)
    feedback_weight: float = bounded(1.0, above=0.0)
    slack_weight: float = bounded(1e5, above=0.0)
    # Margin of the CMP to the edge of the support polygon.
    cop_safe_distance: float = bounded(
        0.005, least=0.0, unit="m", of="sole_width"
    )
    # Lateral clearance between the soles.
    sole_clearance: float = bounded(0.005, least=0.0, unit="m", of="sole_width")
    # Foothold changes smaller than this are ignored.
    dead_band: float = bounded(0.02, least=0.0, unit="m")
    # Times before touchdown and after a phase change without foothold changes.
    freeze_time: float = bounded(0.05, least=0.0, unit="s")
    settling_time: float = bounded(0.01, least=0.0, unit="s")


class IcpStepQp:
    """The quadratic program of the Atlas paper's Eq. 20, for N steps.

        min   sum |step_i|^2_Qf + |delta|^2_R + |eta|^2_Qeta
        s.t.  delta = k_xi (e - sum Gamma_i step_i - eta),
              the CMP + delta in the support polygon (Eq. 21),
              the footholds within reach of each other (Eq. 22).

    Half-spaces replace the paper's multipliers of the corners.  The CMP also
    moves with the footholds while a spline shifts it.  Delta is eliminated.
    """

    def __init__(self, params: IcpStepQpParams) -> None:
        self._gain, self._size = params.feedback_gain, 2 * params.num_steps + 2
        self._qp = DenseQp(self._size)
        # The cost without that of delta, whose weight is R.
        costs = 2 * params.num_steps * [params.step_weight]
        self._H = np.diag([*costs, *(2 * [params.slack_weight])])
        self._R = params.feedback_weight

    def solve(
        self,
        error: Array,
        cmp: Array,
        moves: Array,
        cmp_room: Halfspaces,
        step_room: Halfspaces,
    ) -> tuple[Array, QpResult]:
        """Returns the shifts (n, 2) [m] of the footholds from the planned ones.

        `error` (2,) is xi - xi_r [m] and `cmp` (2,) the reference CMP [m]; all
        are in W; `moves` (2, n) are their Gamma_i (Eq. 18) for n <= N
        footholds.  The limits A p <= b are those of the CMP, A (k, 2), and of
        the shifts, A (m, 2 n).  Unless the result is solved, the shifts are
        NaN; its x ends in eta (2,) [m], the slack in the ICP error.

        Raises ValueError: an argument is not finite.
        """
        (A_cmp, b_cmp), (A, b) = cmp_room, step_room
        used, k = 2 * moves.shape[1], len(b_cmp)
        # x = (steps, eta), and delta = delta_0 + D x by the constraint.
        delta_0, D = self._gain * error, np.zeros((2, self._size))
        D[0, 0:used:2] = D[1, 1:used:2] = -self._gain * moves[0]
        D[0, -2] = D[1, -1] = -self._gain
        DR, cmp_D = self._R * D.T, D.copy()
        cmp_D[0, 0:used:2] += moves[1]
        cmp_D[1, 1:used:2] += moves[1]
        C = np.zeros((k + len(b), self._size))
        C[:k], C[k:, :used] = A_cmp @ cmp_D, A
        upper = np.concatenate((b_cmp - A_cmp @ (cmp + delta_0), b))
        lower = np.full(len(upper), -np.inf)
        problem = QpProblem(self._H + DR @ D, DR @ delta_0, C, lower, upper)
        result = self._qp.solve(problem)
        return result.x[:used].reshape(-1, 2), result


def ankle_feedback(
    error: Array, cmp: Array, room: Array, params: IcpStepQpParams
) -> Array:
    """Returns delta (2,) of Eq. 20 for fixed footholds, in closed form.

    Eliminating eta leaves the cost |delta - K error|^2, with the reference
    `cmp` (2,) [m] plus delta in the polygon `room` (n, 2) [m]: a projection.
    `error` (2,) is xi - xi_r [m]; all are in W.
    """
    slack = params.slack_weight / params.feedback_gain
    K = slack / (params.feedback_weight + slack / params.feedback_gain)
    return np.asarray(polygon.project(cmp + K * error, room) - cmp)


@dataclass(frozen=True, eq=False)
class StepPhase(walking.Immutable):
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
    """Returns the region (n, 2) [m] of uncrossed footholds in the sole frame.

    It is the part of the base region, y toward the swing side, in which
    parallel soles are their clearance apart: the Atlas paper crosses no legs.

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
) -> Halfspaces:
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
    """Feedback and footholds of a tick, from one QP (Atlas paper, Sec. IV)."""

    def __init__(self, params: IcpStepQpParams, model: PointMassModel):
        """Raises ValueError: see `uncrossed_reach`."""
        self._params, self._model = params, model
        self.qp = IcpStepQp(params)
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
        return StepPhase(
            steps,
            _shifts(steps),
            _joined(steps) if steps else unadjusted(schedule),
            in_world(self._reach, stance, schedule.support_side.other),
            room,
            polygon.halfspaces(room),
            reach_room(stance, nominal, self._reach),
        )

    def may_move(self, state: WalkingState) -> bool:
        """True if footholds may change: steps remain, no phase change near."""
        schedule, params = state.schedule, self._params
        if not schedule.footsteps or state.elapsed < params.settling_time:
            return False
        if schedule.phase is walking.Phase.SWING:
            return state.remaining_time >= params.freeze_time
        return schedule.phase is walking.Phase.TRANSFER

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
        adjustment = phase.adjustment if on else None
        if on and self.may_move(state):
            moves = plan.moves_of(state)[:, : len(steps)]
            back = moves @ phase.offsets  # to the nominal footholds
            shifts, result = self.qp.solve(
                icp - reference.icp + back[0],
                reference.ecmp - back[1],
                moves,
                phase.cmp_room,
                phase.step_room,
            )
            if result.solved:
                steps = _moved(phase, shifts, self._params.dead_band)
            if steps is not phase.steps:
                adjustment = _joined(steps)
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
        error = icp - reference.icp
        delta = ankle_feedback(error, reference.ecmp, phase.room, self._params)
        ecmp = reference.ecmp + delta
        return StepFeedback(adjustment, reference, ecmp, result)


def _in_force(state: WalkingState, num_steps: int) -> tuple[Adjustment, ...]:
    """Returns the adjustments of the next steps; none while standing."""
    if state.schedule.phase is walking.Phase.STANDING:
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


def _joined(steps: tuple[Adjustment, ...]) -> Adjustment:
    return replace(steps[0], later=steps[1:])


def _longest(vectors: Array) -> float:
    return max(math.hypot(x, y) for x, y in vectors.tolist())


def _shifts(steps: tuple[Adjustment, ...]) -> Array:
    """Returns the shifts (n, 2) [m] from the nominal footholds, in W."""
    shifts = [(a.pose.p_WF - a.nominal.pose.p_WF)[:2] for a in steps]
    return np.reshape(shifts, (-1, 2))
