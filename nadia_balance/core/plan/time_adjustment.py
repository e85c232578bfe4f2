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
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import (
    FootPose,
    FootPoses,
    Phase,
    WalkingState,
    support_polygon,
)
from nadia_balance.parameters.bounds import bounded, parameters

_TIMES_TRIED = 16
_NOTHING = 1e-9  # rounding of the clock [s]


@parameters
class TimingAdapterParams:
    """Gains, thresholds and limits of the timing adaptation.

    The paper's gamma is the share per tick T, 1 - e^(-T / time constant): for
    T = 2 ms, 0.1 in swing and 0.4 in transfer.  With time constants of 0 some
    pushes end in falls: the clock cannot go back.
    """

    swing_time_constant: float = bounded(
        0.01898,
        doc="time constant with which the clock of a swing catches up with an "
        "ICP ahead of the plan; 0: in one tick",
        least=0.0,
        unit="s",
    )
    transfer_time_constant: float = bounded(
        0.003915, doc="the same, of a transfer", least=0.0, unit="s"
    )
    icp_error_threshold: float = bounded(
        0.03,
        doc="ICP error below which the clock is not adjusted, and no ICP is "
        "leaving",
        least=0.0,
        unit="m",
    )
    min_swing_duration: float = bounded(
        0.25, doc="least duration of a swing", above=0.0, unit="s"
    )
    min_transfer_duration: float = bounded(
        0.03, doc="least duration of a transfer", above=0.0, unit="s"
    )
    min_remaining_swing: float = bounded(
        0.08,
        doc="lower bound on the remaining swing time, see "
        "`least_rest_of_swing`",
        least=0.0,
        unit="s",
    )
    near_foothold: float = bounded(
        0.08,
        doc="distance of the swing foot from its foothold within which the "
        "clock is not held: its tracking error must not keep it in the air",
        least=0.0,
        unit="m",
    )
    tolerated_delay: float = bounded(
        0.03,
        doc="lateness of the swing foot for which the clock is not held",
        least=0.0,
        unit="s",
    )
    max_speed_up: float = bounded(
        3.0,
        doc="sigma: upper bound on the speed-up of the rest of a swing",
        least=1.0,
    )
    support_margin: float = bounded(
        0.02,
        doc="distance from the edge of the support within which eCMPs are "
        "infeasible",
        least=0.0,
        unit="m",
        of="sole_width",
    )

    def least_rest_of_swing(self, duration: float, elapsed: float) -> float:
        """The rest of the foot's motion is sped up by sigma (Atlas, Eq. 13).

        Erratum: as printed, sigma has no upper bound.

        Args:
            duration: planned duration of the swing [s].
            elapsed: time since lift-off [s].

        Returns:
            The least rest of the swing [s].
        """
        return max(
            self.min_swing_duration - elapsed,
            self.min_remaining_swing,
            (duration - elapsed) / self.max_speed_up,
        )


def gamma(time_constant: float, period: float) -> float:
    """Gamma = 1 - e^(-period / time_constant) (Nadia paper, Sec. VI).

    Args:
        time_constant: time after which 1/e of an error is left [s].
        period: control period [s].

    Returns:
        The share of the error per tick [-]; 1 for a time constant of 0.
    """
    return -math.expm1(-period / time_constant) if time_constant else 1.0


def is_leaving(
    icp: Array, reference: IcpReference, support: Array, margin: float
) -> bool:
    """True if no feasible eCMP stops the ICP from diverging from its reference.

    This holds if the ICP is outside the support, its error points outward, and
    the eCMP that would keep the error constant (k_p = 1 in the Nadia paper,
    Eq. 6) is not `margin` inside the support.  An ICP that only lags behind on
    its way to the next foot does not leave.

    Args:
        icp: measured ICP (2,) in W [m].
        reference: ICP and eCMP of the plan in W.
        support: support polygon (n, 2) in W [m].
        margin: distance from its edge [m].

    Returns:
        False for an ICP within the support.
    """
    error = icp - reference.icp
    can_stop = contains(reference.ecmp + error, support, -margin)
    return not can_stop and bool((icp - project(icp, support)) @ error > 0.0)


class TimeAdjustment(NamedTuple):
    """Time [s] by which the clock is advanced; negative: held."""

    now: float  # in this tick
    in_all: float  # in total, predicted for this tick and the next ones


@dataclass(frozen=True, eq=False)
class Timing:
    """The timing adaptation of a robot.

    Args:
        params: gains, thresholds and limits.
        model: soles, swing foot and natural frequency.
        period: control period [s].
    """

    params: TimingAdapterParams
    model: PointMassModel
    period: float

    def adjustment(
        self,
        state: WalkingState,
        plan: IcpPlan,
        icp: Array,
        alip_icp: Array,
        feet: FootPoses,
        on: Mechanisms,
    ) -> TimeAdjustment:
        """The advance is gamma times the time ahead (Nadia paper, Eq. 15).

        The measured `alip_icp` is ahead of the plan by that time.  The advance
        is all the time left if then both ICPs are still leaving the support
        (`is_leaving`): after a push they do, while in an undisturbed walk one
        of them departs from the plan by as much as legs and arms swing.  The
        remaining time has lower bounds; the clock is held if the foot is late.

        Args:
            state: walking state.
            plan: ICP plan of its schedule.
            icp: measured ICP (2,) in W [m].
            alip_icp: that with the momentum about the contact (2,) in W [m].
            feet: measured soles in W.
            on: mechanisms, of which `swing` and `transfer` count.

        Returns:
            The time by which to advance the clock.
        """
        if state.waiting or not state.schedule.footsteps:
            return TimeAdjustment(now=0.0, in_all=0.0)
        params, swings = self.params, state.schedule.phase is Phase.SWING
        if swings and on.swing:
            time_constant = params.swing_time_constant
        elif state.schedule.phase is Phase.TRANSFER and on.transfer:
            time_constant = params.transfer_time_constant
        else:
            return TimeAdjustment(now=0.0, in_all=0.0)
        error = alip_icp - plan.at(state.time_in_phase).icp
        hurried = math.hypot(*error.tolist()) >= params.icp_error_threshold
        least = params.min_transfer_duration - state.elapsed
        if swings and (hurried or abs(state.gained_time) > _NOTHING):
            foot = feet[state.schedule.support_side.other]
            landing = self.time_to_foothold(state, foot)
            late = self.time_to_return(state, foot, landing)
            if late > 0.0:
                return TimeAdjustment(-late, -late)
            least = self.least_remaining_time(state, foot, error, landing)
        available = state.remaining_time - max(least, 0.0)
        if not hurried or available <= 0.0:
            return TimeAdjustment(now=0.0, in_all=0.0)
        return self._advance(
            state,
            plan,
            icp,
            alip_icp,
            available=available,
            time_constant=time_constant,
        )

    def _advance(
        self,
        state: WalkingState,
        plan: IcpPlan,
        icp: Array,
        alip_icp: Array,
        available: float,
        time_constant: float,
    ) -> TimeAdjustment:
        """Returns the advance of the clock, up to the `available` time [s]."""
        ahead = plan.time_to(alip_icp, state.time_in_phase)
        future = plan.at(state.time_in_phase + ahead)
        if all(
            math.dist(measured, future.icp) >= self.params.icp_error_threshold
            and is_leaving(
                measured,
                reference=future,
                support=support_polygon(state.schedule, self.model.cop_area),
                margin=self.params.support_margin,
            )
            for measured in (alip_icp, icp)
        ):
            return TimeAdjustment(available, available)
        return TimeAdjustment(
            now=min(gamma(time_constant, self.period) * ahead, available),
            in_all=min(ahead, available),
        )

    def least_remaining_time(
        self, state: WalkingState, foot: FootPose, error: Array, landing: float
    ) -> float:
        """The least time t in which the foot reaches its foothold, moved.

        The foothold moves by the ICP error, which grows by e^wt.  At least, t
        is `least_rest_of_swing` and the time to the foothold as it is.

        Args:
            state: walking state in a swing.
            foot: measured sole of the swing foot in W.
            error: ICP error (2,) in W [m].
            landing: time from rest at `foot` to its foothold [s].

        Returns:
            The lower bound on the remaining swing time by the clock [s]; that
            of the foothold as it is if the foot cannot reach the moved one
            within the remaining time.
        """
        least = max(
            self.params.least_rest_of_swing(
                state.schedule.duration, state.elapsed
            ),
            landing,
        )
        nominal = (
            state.adjustment.nominal
            if state.adjustment
            else state.schedule.footsteps[0]
        )
        x, y, _ = (nominal.pose.p_WF - foot.p_WF).tolist()
        error_x, error_y = error.tolist()
        room = max(state.remaining_time - least, 0.0)
        for i in range(_TIMES_TRIED):
            t = least + i / _TIMES_TRIED * room
            growth = math.exp(self.model.omega * t)
            length = math.hypot(x + growth * error_x, y + growth * error_y)
            if self.model.detour.time_from_rest(length) <= t:
                return t
        return least

    def time_to_return(
        self, state: WalkingState, foot: FootPose, landing: float
    ) -> float:
        """The time for which the clock must be held until the foot is back.

        The foothold may have moved away from the foot since the clock was
        advanced.  It is held for no longer than the `gained_time` and the time
        by which the swing may be prolonged.

        Args:
            state: walking state in a swing.
            foot: measured sole of the swing foot in W.
            landing: as for `least_remaining_time`.

        Returns:
            The time >= 0 [s].
        """
        goal = state.schedule.footsteps[0].pose.p_WF
        if math.dist(foot.p_WF[:2], goal[:2]) < self.params.near_foothold:
            return 0.0
        late = (
            UNDER_WAY * landing
            - self.params.tolerated_delay
            - state.remaining_time
        )
        limit = state.gained_time
        if state.adjustment:
            limit += state.adjustment.prolonged
        return max(min(late, limit), 0.0)

    def time_to_foothold(self, state: WalkingState, foot: FootPose) -> float:
        """The time from rest at `foot` to landing at the foothold.

        The descent below the lower of `foot` and the lift-off height follows
        the horizontal motion.

        Args:
            state: walking state in a swing.
            foot: measured sole of the swing foot in W.

        Returns:
            The time [s].
        """
        schedule, detour = state.schedule, self.model.detour
        side, goal = schedule.support_side, schedule.footsteps[0].pose.p_WF
        brink = min(foot.p_WF[2], schedule.feet[side.other].p_WF[2])
        descent = float(brink - goal[2]) / detour.max_descent
        return detour.time_of_way(
            foot.p_WF[:2],
            goal=goal[:2],
            stance=schedule.feet[side],
            swing=side.other,
        ) + max(descent - detour.settling, 0.0)
