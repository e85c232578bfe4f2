"""Timing adaptation: the walking clock advances until the plan meets the ICP.

Nadia paper, Sec. VI: Eq. 15 in swing and transfer, along the ICP plan.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.swing_detour import UNDER_WAY
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import contains, project
from nadia_balance.core.plan.icp_plan import IcpPlan, IcpReference
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import FootPose, Phase, WalkingState
from nadia_balance.parameters.bounds import bounded

_TIMES_TRIED = 16
_NOTHING = 1e-9  # rounding of the clock [s]


@dataclass(kw_only=True)
class TimingAdapterParams:
    """Gains, thresholds and limits of the timing adaptation."""

    # Time constants with which the clock catches up with an ICP ahead of the
    # plan; 0: in one tick.  The paper's gamma is the share per tick T,
    # 1 - e^(-T / time constant): for T = 2 ms, 0.1 in swing and 0.4 in
    # transfer.  With 0 some pushes end in falls: the clock cannot go back.
    swing_time_constant: float = bounded(0.01898, least=0.0, unit="s")
    transfer_time_constant: float = bounded(0.003915, least=0.0, unit="s")
    # Below this ICP error the clock is not adjusted, and no ICP is leaving.
    icp_error_threshold: float = bounded(0.03, least=0.0, unit="m")
    min_swing_duration: float = bounded(0.25, above=0.0, unit="s")
    min_transfer_duration: float = bounded(0.03, above=0.0, unit="s")
    # Lower bound on the remaining swing time, see `least_rest_of_swing`.
    min_remaining_swing: float = bounded(0.08, least=0.0, unit="s")
    # Within this distance of the foothold the clock is not held: a tracking
    # error of the swing foot must not keep the foot in the air.
    near_foothold: float = bounded(0.08, least=0.0, unit="m")
    # Lateness of the swing foot for which the clock is not held.
    tolerated_delay: float = bounded(0.03, least=0.0, unit="s")
    max_speed_up: float = bounded(3.0, least=1.0)
    # Distance from the edge of the support within which eCMPs are infeasible.
    support_margin: float = bounded(0.02, least=0.0, unit="m", of="sole_width")

    def least_rest_of_swing(self, duration: float, elapsed: float) -> float:
        """Least rest [s] of a swing of `duration` [s] after `elapsed` [s].

        The rest of the foot's motion is sped up by sigma (Atlas paper, Eq. 13).
        Erratum: as printed, sigma has no upper bound.
        """
        return max(
            self.min_swing_duration - elapsed,
            self.min_remaining_swing,
            (duration - elapsed) / self.max_speed_up,
        )


def gamma(time_constant: float, period: float) -> float:
    """Returns gamma = 1 - e^(-period / time_constant) of the Nadia paper.

    It is the share per tick of `period` [s] of an error, of which 1/e is left
    after the `time_constant` [s]; 1 for a time constant of 0.
    """
    return -math.expm1(-period / time_constant) if time_constant else 1.0


def is_leaving(
    icp: Array, reference: IcpReference, support: Array, margin: float
) -> bool:
    """True if no feasible eCMP stops the ICP from diverging from its reference.

    This holds if the ICP is outside the polygon `support` (n, 2), its error
    points outward, and the eCMP that would keep the error constant (K = 1 in
    the Nadia paper, Eq. 6) is not `margin` [m] inside the support.  An `icp`
    (2,) [m] that only lags behind on its way to the next foot does not leave.
    """
    error = icp - reference.icp
    if contains(reference.ecmp + error, support, -margin):
        return False
    outward = icp - project(icp, support)
    return bool(outward @ error > 0.0)


class TimeAdjustment(NamedTuple):
    """Time [s] by which the clock is advanced; negative: held."""

    now: float  # in this tick
    in_all: float  # in total, predicted for this tick and the next ones


NO_ADJUSTMENT = TimeAdjustment(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Timing:
    """The timing adaptation of a robot, once per `period` [s]."""

    params: TimingAdapterParams
    model: PointMassModel
    period: float

    def adjustment(
        self,
        state: WalkingState,
        plan: IcpPlan,
        icp: Array,
        feet: walking.FootPoses,
        on: Mechanisms,
    ) -> TimeAdjustment:
        """Returns the time by which to advance the clock; negative: hold it.

        The advance is gamma times the time by which the measured `icp` (2,) [m]
        is ahead of the plan (Nadia paper, Eq. 15), or all the time left if the
        ICP then is still leaving the support (`is_leaving`).  The remaining
        time has lower bounds.  `feet` are the measured soles.
        """
        if state.waiting or not state.schedule.footsteps:
            return NO_ADJUSTMENT
        params, swings = self.params, state.schedule.phase is Phase.SWING
        if swings and on.swing:
            time_constant = params.swing_time_constant
        elif state.schedule.phase is Phase.TRANSFER and on.transfer:
            time_constant = params.transfer_time_constant
        else:
            return NO_ADJUSTMENT
        error = icp - plan.at(state.time_in_phase).icp
        hurried = math.hypot(*error) >= params.icp_error_threshold
        least = params.min_transfer_duration - state.elapsed
        if swings and (hurried or abs(state.gained_time) > _NOTHING):
            foot = feet[state.schedule.support_side.other]
            if (late := self.time_to_return(state, foot)) > 0.0:
                return TimeAdjustment(-late, -late)
            least = self.least_remaining_time(state, foot, error)
        most = state.remaining_time - max(least, 0.0)
        if not hurried or most <= 0.0:
            return NO_ADJUSTMENT
        return self._advance(state, plan, icp, most, time_constant)

    def _advance(
        self,
        state: WalkingState,
        plan: IcpPlan,
        icp: Array,
        most: float,
        time_constant: float,
    ) -> TimeAdjustment:
        """Returns the advance of the clock, up to `most` [s]."""
        ahead = plan.time_to(icp, state.time_in_phase)
        future = plan.at(state.time_in_phase + ahead)
        support = walking.support_polygon(state.schedule, self.model.cop_area)
        error = math.dist(icp, future.icp)
        if error >= self.params.icp_error_threshold and is_leaving(
            icp, future, support, self.params.support_margin
        ):
            return TimeAdjustment(most, most)
        now = gamma(time_constant, self.period) * ahead
        return TimeAdjustment(min(now, most), min(ahead, most))

    def least_remaining_time(
        self, state: WalkingState, foot: FootPose, error: Array
    ) -> float:
        """Returns the lower bound [s] on the remaining swing time by the clock.

        The bound is the maximum of `least_rest_of_swing` and of the time that
        the foot, now at its measured pose `foot`, needs to its foothold; beyond
        it, the least time t in which the foot reaches the foothold moved by the
        ICP `error` (2,) [m], which grows by e^wt.  If the foot cannot reach
        that within the remaining time, the first bound is returned.
        """
        step, detour = state.schedule.footsteps[0], self.model.detour
        duration = state.schedule.duration
        least = max(
            self.params.least_rest_of_swing(duration, state.elapsed),
            self._time_to_foothold(state, foot),
        )
        nominal = (state.adjustment.nominal if state.adjustment else step).pose
        x, y = nominal.p_WF[:2] - foot.p_WF[:2]
        more = max(state.remaining_time - least, 0.0)
        for i in range(_TIMES_TRIED):
            t = least + i / _TIMES_TRIED * more
            growth = math.exp(self.model.omega * t)
            way = math.hypot(x + growth * error[0], y + growth * error[1])
            if detour.time_from_rest(way) <= t:
                return t
        return least

    def time_to_return(self, state: WalkingState, foot: FootPose) -> float:
        """Returns the time [s] >= 0 for which the clock must be held.

        The foothold may have moved away from the foot, now at its measured pose
        `foot`, since the clock was advanced.  The result is at most the
        `gained_time`, and the time by which the swing may be prolonged.
        """
        goal = state.schedule.footsteps[0].pose.p_WF
        if math.dist(foot.p_WF[:2], goal[:2]) < self.params.near_foothold:
            return 0.0
        needed = UNDER_WAY * self._time_to_foothold(state, foot)
        late = needed - self.params.tolerated_delay - state.remaining_time
        most = state.gained_time
        if state.adjustment:
            most += state.adjustment.prolonged
        return max(min(late, most), 0.0)

    def _time_to_foothold(self, state: WalkingState, foot: FootPose) -> float:
        """Returns the time [s] from rest at `foot` to landing at the foothold.

        The descent below the lower of `foot` and the lift-off height follows
        the horizontal motion.
        """
        schedule, detour = state.schedule, self.model.detour
        side, goal = schedule.support_side, schedule.footsteps[0].pose.p_WF
        way = foot.p_WF[:2], goal[:2], schedule.feet[side], side.other
        brink = min(foot.p_WF[2], schedule.feet[side.other].p_WF[2])
        descent = float(brink - goal[2]) / detour.max_descent
        return detour.time_of_way(*way) + max(descent - detour.settling, 0.0)
