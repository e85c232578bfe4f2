"""Where the foot in the air is to land, by one QP (Atlas paper, Sec. IV)."""

import math
from dataclasses import dataclass, replace

import numpy as np

from nadia_balance.core.cop_waypoints import CopWaypointParams, cop_waypoints
from nadia_balance.core.foothold_adjustment import current_adjustment
from nadia_balance.core.icp_step_qp import IcpStepQp, IcpStepQpParams
from nadia_balance.core.polygon import halfspaces, shrink
from nadia_balance.core.reachability import (
    ReachabilityParams,
    base_region,
    in_world,
)
from nadia_balance.core.recursive_multipliers import recursive_multipliers
from nadia_balance.core.walking import (
    Adjustment,
    Array,
    ContactSchedule,
    FootPose,
    Footstep,
    Phase,
    Side,
    WalkingState,
)


@dataclass(frozen=True, eq=False)
class StepPlan:
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

    def __deepcopy__(self, memo: object) -> "StepPlan":
        return self

    def at(self, t: float) -> tuple[Array, Array, float]:
        """Returns ICP and CMP (2,) [m] in W at `t` [s], and Gamma [-].

        Both as if the foot landed at the nominal foothold; if it lands
        elsewhere, the ICP moves by Gamma times the way.
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
    sole: Array,
    cop_params: CopWaypointParams,
    reach: ReachabilityParams,
    params: IcpStepQpParams,
    omega: float,
) -> StepPlan:
    """Returns the plan of `schedule`, with `nominal` for its next footstep.

    `sole` (n, 2) [m] are the corners of either sole; omega [rad/s].  The foot
    lands in the base region of `reach`: this paper knows no crossed legs.
    """
    steps = (nominal, *schedule.footsteps[1:])
    path = cop_waypoints(replace(schedule, footsteps=steps), sole, cop_params)
    knots = np.concatenate([[0.0], np.cumsum(path.durations)])
    stance = schedule.feet[nominal.side.other]
    cmps = shrink(stance.to_world(sole), params.cop_safe_distance)
    return StepPlan(
        nominal,
        knots,
        path.points,
        path.step_shares,
        omega,
        halfspaces(cmps),
        footholds(stance, nominal.side, sole, reach, params.sole_clearance),
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

    `plan` is that of `state`, `icp` (2,) [m] is measured.  The way is counted
    from the foothold that was to be, so that it comes back with the ICP.  If
    there is no solution, the foothold stays.
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
    sole: Array,
    reach: ReachabilityParams,
    clearance: float,
) -> tuple[Array, Array]:
    """Returns the half-spaces A p <= b (Eq. 22) of the footholds p in W.

    The base region of `reach`, and the soles, if parallel, `clearance` [m]
    apart.
    """
    A, b = halfspaces(in_world(base_region(reach), stance, swing))
    inward = -swing.sign * stance.rotation[:, 1]
    apart = float(np.ptp(sole[:, 1])) + clearance
    return (
        np.vstack([A, inward]),
        np.append(b, inward @ stance.p_WF[:2] - apart),
    )


def _room(A: Array, b: Array, point: Array) -> tuple[Array, Array]:
    """How far one can go from `point` without leaving the half-spaces."""
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
