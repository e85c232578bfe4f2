"""One QP for the ankles and the next foothold (Atlas paper, Sec. IV)."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nadia_balance.core.bounds import bounded
from nadia_balance.core.cop_waypoints import CopWaypointParams, cop_waypoints
from nadia_balance.core.foothold_adjustment import current_adjustment
from nadia_balance.core.icp_plan import recursive_multipliers
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.polygon import halfspaces, shrink
from nadia_balance.core.qp import SOLVERS, DenseQp, QpProblem, QpResult
from nadia_balance.core.reachability import base_region, in_world
from nadia_balance.core.walking import (
    Adjustment,
    Array,
    ContactSchedule,
    FootPose,
    Footstep,
    Immutable,
    Phase,
    Side,
    WalkingState,
)

_STEP, _CMP, _SLACK = slice(0, 2), slice(2, 4), slice(4, 6)


@dataclass(kw_only=True)
class IcpStepQpParams:
    """Gain, weights and limits of the Atlas paper's Eq. 20."""

    feedback_gain: float = bounded(3.0, above=1.0)  # k_xi, CMP per ICP error
    # Q_f and R, on the shift of the foothold and on delta.  Q_f is the larger:
    # the CoP is used up before the foothold moves.
    step_weight: float = bounded(10.0, above=0.0)
    feedback_weight: float = bounded(1.0, above=0.0)
    # Q_eta, on the ICP error that is left over.
    slack_weight: float = bounded(1e5, above=0.0)
    # How far inside the sole the CMP stays.
    cop_safe_distance: float = bounded(0.005, least=0.0, unit="m")
    # Between the soles, sideways.
    sole_clearance: float = bounded(0.005, least=0.0, unit="m")
    # The foothold moves by so much, or not at all.
    dead_band: float = bounded(0.02, least=0.0, unit="m")
    # No change so shortly before touchdown, nor so early in a swing.
    freeze_time: float = bounded(0.05, least=0.0, unit="s")
    settling_time: float = bounded(0.01, least=0.0, unit="s")
    solver: str = bounded("active_set", one_of=SOLVERS)


class StepFeedback(NamedTuple):
    """What the QP decides, each (2,) [m] in W.

    `step` is the shift of the foothold from the planned one, `delta` the
    feedback on the CMP, `slack` = eta the ICP error left to neither.
    They are NaN if the `result` is not solved.
    """

    step: Array
    delta: Array
    slack: Array
    result: QpResult


class IcpStepQp:
    """The quadratic program of the Atlas paper's Eq. 20, for the next step.

    With the ICP error e for the planned foothold, and Gamma, by how much the
    reference moves with the foothold (Eq. 18):

        min   |step|^2_Qf + |delta|^2_R + |eta|^2_Qeta
        s.t.  delta = k_xi (e - Gamma step - eta),
              delta in the room that the sole leaves (Eq. 21),
              step in the room that the legs' reach leaves (Eq. 22).

    Half-spaces of the sole stand for the paper's multipliers of its corners.
    """

    def __init__(self, params: IcpStepQpParams, max_rows: int = 32) -> None:
        """For rooms that have, together, up to `max_rows` half-spaces."""
        self.params, self._max_rows = params, max_rows
        self._qp = DenseQp(6, 2, max_rows, params.solver)
        p = params
        weights = p.step_weight, p.feedback_weight, p.slack_weight
        self._H = np.diag(np.repeat(weights, 2))

    def solve(
        self,
        error: Array,
        sensitivity: float,
        cmp_room: tuple[Array, Array],
        step_room: tuple[Array, Array],
    ) -> StepFeedback:
        """Returns step and feedback for the ICP `error` (2,) [m] in W.

        `sensitivity` is Gamma [-].  The rooms of delta and of the step are
        half-spaces A x <= b, with A (n, 2) and b (n,) [m].

        Raises:
            ValueError: an argument is not finite.
        """
        gain = self.params.feedback_gain
        A_eq = np.hstack(
            [gain * sensitivity * np.eye(2), np.eye(2), gain * np.eye(2)]
        )
        C = np.zeros((self._max_rows, 6))
        upper = np.full(self._max_rows, np.inf)
        (A_c, b_c), (A_s, b_s) = cmp_room, step_room
        n, m = len(b_c), len(b_c) + len(b_s)
        C[:n, _CMP], upper[:n] = A_c, b_c
        C[n:m, _STEP], upper[n:m] = A_s, b_s
        result = self._qp.solve(
            QpProblem(
                self._H,
                np.zeros(6),
                A_eq,
                gain * error,
                C,
                np.full(self._max_rows, -np.inf),
                upper,
            )
        )
        x = result.x
        return StepFeedback(x[_STEP], x[_CMP], x[_SLACK], result)


@dataclass(frozen=True, eq=False)
class StepPlan(Immutable):
    """The reference ICP as a linear function of the next foothold.

    The Atlas paper's Eq. 18, with the places of the CMP in the soles as they
    are for the `nominal` footstep.  The CMP goes through the `waypoints`
    (N + 1, 2) [m] in W at the times `knots` (N + 1,) [s] since the phase began,
    and these move with the foothold by their `shares` (N + 1,) [-].  CMP and
    foothold must be in half-spaces A p <= b, with A (n, 2) and b (n,) [m].
    """

    nominal: Footstep
    knots: Array
    waypoints: Array
    shares: Array
    omega: float
    cmps: tuple[Array, Array]  # of the stance foot (Eq. 21)
    footholds: tuple[Array, Array]  # within reach (Eq. 22)

    def at(self, t: float) -> tuple[Array, Array, float]:
        """Returns ICP and CMP (2,) [m] in W at `t` [s], and Gamma [-].

        Both as if the foot landed at the nominal foothold; if it lands
        elsewhere, the ICP moves by Gamma times the shift.
        """
        multipliers = recursive_multipliers(self.knots, t, self.omega)
        cmp = np.array(
            [np.interp(t, self.knots, axis) for axis in self.waypoints.T]
        )
        gamma = float(multipliers @ self.shares)
        return multipliers @ self.waypoints, cmp, gamma


def step_plan(
    schedule: ContactSchedule,
    nominal: Footstep,
    cop: CopWaypointParams,
    params: IcpStepQpParams,
    model: PointMassModel,
) -> StepPlan:
    """Returns the plan of `schedule`, with `nominal` for its next footstep.

    The CoP goes where `cop` says, as in the ICP plan.  The foot lands in the
    base region: this paper knows no crossed legs.
    """
    steps = (nominal, *schedule.footsteps[1:])
    path = cop_waypoints(replace(schedule, footsteps=steps), cop, model.sole)
    knots = path.knots
    stance = schedule.feet[nominal.side.other]
    cmps = shrink(stance.to_world(model.sole), params.cop_safe_distance)
    return StepPlan(
        nominal,
        knots,
        path.points,
        path.step_shares,
        model.omega,
        halfspaces(cmps),
        footholds(stance, nominal.side, params, model),
    )


def may_move(state: WalkingState, params: IcpStepQpParams) -> bool:
    """True in a swing, but not too early and not too late in it."""
    return (
        state.schedule.phase is Phase.SWING
        and state.elapsed >= params.settling_time
        and state.remaining_time >= params.freeze_time
    )


def propose_by_qp(
    state: WalkingState, plan: StepPlan, icp: Array, qp: IcpStepQp
) -> Adjustment:
    """Returns the adjustment of the step in the air for this tick.

    `plan` is that of `state`, `icp` (2,) [m] is measured.  The foothold is
    shifted from the nominal one, so that it comes back with the ICP.  If
    there is no solution, it stays where it is.
    """
    current = current_adjustment(state)
    icp_r, cmp_r, gamma = plan.at(state.time_in_phase)
    feedback = qp.solve(
        icp - icp_r,
        gamma,
        _room(*plan.cmps, cmp_r),
        _room(*plan.footholds, plan.nominal.pose.p_WF[:2]),
    )
    if not feedback.result.solved:
        return current
    pose = _moved(current, plan.nominal, feedback.step, qp.params.dead_band)
    return Adjustment(plan.nominal, pose)


def footholds(
    stance: FootPose,
    swing: Side,
    params: IcpStepQpParams,
    model: PointMassModel,
) -> tuple[Array, Array]:
    """Returns the half-spaces A p <= b (Eq. 22) of the footholds p in W.

    The base region, and the soles, if parallel, their clearance apart.
    """
    A, b = halfspaces(in_world(base_region(model.reach), stance, swing))
    inward = -swing.sign * stance.rotation[:, 1]
    apart = float(np.ptp(model.sole[:, 1])) + params.sole_clearance
    return (
        np.vstack([A, inward]),
        np.append(b, inward @ stance.p_WF[:2] - apart),
    )


def _room(A: Array, b: Array, point: Array) -> tuple[Array, Array]:
    """The half-spaces (A, b) of the shift from `point` that stay within."""
    return A, b - A @ point


def _moved(
    current: Adjustment, nominal: Footstep, step: Array, dead_band: float
) -> FootPose:
    """Where the foot lands, `step` (2,) [m] away from the nominal foothold."""
    if math.hypot(*step) < dead_band:
        return nominal.pose
    target = nominal.pose.p_WF + [*step, 0.0]
    if math.dist(target, current.pose.p_WF) < dead_band:
        return current.pose
    return FootPose(target, nominal.pose.yaw)
