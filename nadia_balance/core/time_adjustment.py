"""How far to advance the walking clock, so that the plan meets the ICP.

The Nadia paper, Sec. VI: Eqs. 15 and 16 in swing and in transfer.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from nadia_balance.core.icp_plan import IcpPlan, IcpReference
from nadia_balance.core.polygon import contains, project
from nadia_balance.core.support_polygon import support_polygon
from nadia_balance.core.swing_detour import (
    SwingDetourParams,
    shortest_time,
    way_round,
)
from nadia_balance.core.ticks import share_of_tick
from nadia_balance.core.walking import (
    Array,
    FootPose,
    FootPoses,
    Phase,
    WalkingState,
)

_TIMES_TRIED = 16
_NOTHING = 1e-9  # rounding of the clock [s]
_TOLERATED = 0.03  # a foot that comes so late needs no time back [s]

# A foot in the second half of its swing, at its full speed, needs so much of
# the time that it would need from rest.
_UNDER_WAY = math.sqrt(0.5)

# The plan's way to the end of the phase has no direction below this [m]: in
# transfer it comes to a standstill, and Eq. 16 would amplify noise.
_SHORT_WAY = 0.01


@dataclass(kw_only=True)
class TimingAdapterParams:
    """How much the walking clock may be advanced, and when."""

    swing: bool = True  # shorten the swing
    transfer: bool = True  # shorten the transfer
    # The clock makes up for the time by which the ICP is ahead of the plan
    # within about this; 0: all at once.  The paper's gamma is the share of a
    # tick of T, 1 - e^(-T / time constant): in 2 ms, 0.1 of a swing and 0.4
    # of a transfer.  A share of 0.8 overshoots by up to 0.1 s where the eCMP
    # moves, and the clock cannot be turned back; 0.4 does not.
    swing_time_constant: float = 0.01898  # [s]
    transfer_time_constant: float = 0.003915  # [s]
    icp_error_threshold: float = 0.03  # smaller errors change no clock [m]
    min_swing_duration: float = 0.35  # [s]
    min_transfer_duration: float = 0.03  # [s]
    # What the swing foot needs, whatever the ICP does.
    min_remaining_swing: float = 0.08  # never leave it less than this [s]
    max_speed_up: float = 3.0  # sigma: of the rest of the swing [-]
    support_margin: float = 0.02  # eCMPs nearer the edge are not feasible [m]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name, least in (
            ("swing_time_constant", 0.0),
            ("transfer_time_constant", 0.0),
            ("icp_error_threshold", 0.0),
            ("min_swing_duration", 0.35),
            ("min_transfer_duration", 0.03),
            ("min_remaining_swing", 0.0),
            ("support_margin", 0.0),
            ("max_speed_up", 1.0),
        ):
            if not least <= (value := getattr(self, name)) < math.inf:
                raise ValueError(
                    f"{name} = {value}: must be >= {least}, finite"
                )

    def discount(self, phase: Phase, period: float) -> float:
        """Gamma of `phase`, for ticks of `period` [s].

        0 where the clock is left alone.
        """
        if phase is Phase.SWING and self.swing:
            return share_of_tick(self.swing_time_constant, period)
        if phase is Phase.TRANSFER and self.transfer:
            return share_of_tick(self.transfer_time_constant, period)
        return 0.0

    def least_rest_of_transfer(self, elapsed: float) -> float:
        """How long [s] a transfer still lasts after `elapsed` [s]; or < 0."""
        return self.min_transfer_duration - elapsed

    def least_rest_of_swing(self, duration: float, elapsed: float) -> float:
        """How long [s] a swing of `duration` [s] still lasts at least.

        `elapsed` [s] of it are over.  The rest of the foot's motion is sped up
        by no more than sigma (Atlas paper, Eq. 13).
        Erratum: as printed, sigma has no upper bound.
        """
        return max(
            self.min_swing_duration - elapsed,
            self.min_remaining_swing,
            (duration - elapsed) / self.max_speed_up,
        )


def fraction_done(icp: Array, icp_r: Array, icp_end: Array) -> float:
    """Returns how far along icp_r -> icp_end the ICP is, in [0, 1].

    Points (2,) [m] in W.  Goes to 0 where the way vanishes.
    Erratum: Atlas paper, Eq. 10 must divide by the squared norm.
    """
    way = icp_end - icp_r
    length2 = max(float(way @ way), _SHORT_WAY**2)
    return min(max(float((icp - icp_r) @ way) / length2, 0.0), 1.0)


def time_ahead(fraction: float, remaining: float, omega: float) -> float:
    """Returns how far ahead [s] of the plan the ICP is, in [0, remaining].

    `fraction` in [0, 1] of the plan's way to the end of the phase, which is
    `remaining` [s] away; omega [rad/s].
    Erratum: the logarithm of the Nadia paper's Eq. 16 is of the scalar ratio
    of two collinear vectors.  With the constant eCMP that leads from icp_r to
    icp_end in the remaining time, that ratio is 1 + fraction (e^(w T) - 1).
    """
    return math.log1p(fraction * math.expm1(omega * remaining)) / omega


def is_leaving(
    icp: Array, reference: IcpReference, support: Array, margin: float
) -> bool:
    """True if the ICP runs away from its reference and no eCMP can stop it.

    That is, if the ICP is out of the polygon `support` (n, 2), its error
    points outward there, and the eCMP that would keep the error from growing
    (K = 1 in the Nadia paper, Eq. 6) is not `margin` [m] within the support.
    An ICP that merely lags behind on its way to the next foot does not leave.
    `icp` (2,) [m] in W.
    """
    error = icp - reference.icp
    if contains(reference.ecmp + error, support, -margin):
        return False
    outward = icp - project(icp, support)
    return bool(outward @ error > 0.0)


def least_remaining_time(
    state: WalkingState,
    foot: FootPose,
    error: Array,
    omega: float,
    detour: SwingDetourParams,
    params: TimingAdapterParams,
) -> float:
    """Returns the time [s] that must be left in the swing, by the clock.

    What any swing needs, and what the foot, now at its measured pose `foot`,
    needs to get to its foothold, and to where the ICP `error` (2,) [m] will
    have taken it: within the time t, the error grows to e^wt times what it is.
    If the foot can at no time catch up with it, it makes do with the former.
    """
    step = state.schedule.footsteps[0]
    least = max(
        params.least_rest_of_swing(state.schedule.duration, state.elapsed),
        _time_to_foothold(state, foot, detour),
    )
    nominal = (state.adjustment.nominal if state.adjustment else step).pose
    x, y = nominal.p_WF[:2] - foot.p_WF[:2]
    more = max(state.remaining_time - least, 0.0)
    for i in range(_TIMES_TRIED):
        t = least + i / _TIMES_TRIED * more
        growth = math.exp(omega * t)
        way = math.hypot(x + growth * error[0], y + growth * error[1])
        if way <= 0.25 * detour.max_acceleration * t * t:
            return t
    return least


def _time_to_foothold(
    state: WalkingState, foot: FootPose, detour: SwingDetourParams
) -> float:
    """Returns how long [s] the swing foot takes from rest at `foot`."""
    side, goal = state.schedule.support_side, state.schedule.footsteps[0].pose
    stance = state.schedule.feet[side]
    way = way_round(foot.p_WF[:2], goal.p_WF[:2], stance, side.other, detour)
    return shortest_time(way, detour)


def time_to_return(
    state: WalkingState, foot: FootPose, detour: SwingDetourParams
) -> float:
    """Returns by how much [s] the swing was shortened too much, >= 0.

    The foothold may have moved away from the foot, now at its measured pose
    `foot`, since the clock was advanced.  No more than has been gained.
    """
    gained = max(state.time_in_phase - state.elapsed, 0.0)
    needed = _UNDER_WAY * _time_to_foothold(state, foot, detour)
    return min(max(needed - _TOLERATED - state.remaining_time, 0.0), gained)


def time_adjustment(
    icp: Array,
    plan: IcpPlan,
    state: WalkingState,
    feet: Callable[[], FootPoses],
    sole: Array,
    detour: SwingDetourParams,
    params: TimingAdapterParams,
    period: float,
) -> float:
    """Returns by how much [s] to advance the clock now; negative: to hold it.

    The discounted time by which the measured `icp` (2,) [m] is ahead of the
    plan (Nadia paper, Eqs. 15 and 16) or, if what Eq. 16 cannot explain makes
    the ICP leave the support, all that there is: the next step must come at
    once.  Limited by what the phase, and in a swing the foot, need.  `feet`
    is asked only then for the measured soles.  `sole` (n, 2) [m] are the
    corners of either sole in its own frame; a tick lasts `period` [s].
    """
    phase = state.schedule.phase
    discount = params.discount(phase, period)
    if discount == 0.0 or state.waiting or not state.schedule.footsteps:
        return 0.0
    reference = plan.at(state.time_in_phase)
    error = icp - reference.icp
    hurried = math.hypot(*error) >= params.icp_error_threshold
    if phase is Phase.TRANSFER:
        least = params.least_rest_of_transfer(state.elapsed)
    elif hurried or state.time_in_phase > state.elapsed + _NOTHING:
        foot = feet()[state.schedule.support_side.other]
        if (late := time_to_return(state, foot, detour)) > 0.0:
            return -late
        least = least_remaining_time(
            state, foot, error, plan.omega, detour, params
        )
    if not hurried or (most := state.remaining_time - max(least, 0.0)) <= 0.0:
        return 0.0
    done = fraction_done(icp, reference.icp, plan.icp_end)
    ahead = time_ahead(done, state.remaining_time, plan.omega)
    future = plan.at(state.time_in_phase + ahead)
    support = support_polygon(state.schedule, sole)
    if is_leaving(icp, future, support, params.support_margin):
        return most
    return min(discount * ahead, most)
