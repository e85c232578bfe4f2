"""How far to advance the walking clock, so that the plan meets the ICP.

The Nadia paper, Sec. VI: Eqs. 15 and 16 in swing and in transfer.
"""

import math
from dataclasses import dataclass

from nadia_balance.core.icp_plan import IcpPlan, IcpReference
from nadia_balance.core.polygon import contains, project
from nadia_balance.core.support_polygon import support_polygon
from nadia_balance.core.walking import Array, FootPoses, Phase, WalkingState

_TIMES_TRIED = 16
_ARRIVED = 0.03  # so near to its foothold, a foot counts as there [m]

# The plan's way to the end of the phase has no direction below this [m]: in
# transfer it comes to a standstill, and Eq. 16 would amplify noise.
_SHORT_WAY = 0.01


@dataclass(kw_only=True)
class TimingAdapterParams:
    """How much the walking clock may be advanced, and when."""

    swing: bool = True  # shorten the swing
    transfer: bool = True  # shorten the transfer
    # Of each tick.  0.8 overshoots by up to 0.1 s where the eCMP moves, and
    # the clock cannot be turned back; 0.4 does not.
    swing_discount: float = 0.1  # gamma of a swing [-]
    transfer_discount: float = 0.4  # gamma of a transfer [-]
    icp_error_threshold: float = 0.03  # smaller errors change no clock [m]
    min_swing_duration: float = 0.4  # [s]
    min_transfer_duration: float = 0.05  # [s]
    # What the swing foot needs, whatever the ICP does.
    min_remaining_swing: float = 0.08  # never leave it less than this [s]
    max_foot_speed: float = 3.0  # mean, on the straight way to the target [m/s]
    max_speed_up: float = 3.0  # sigma: of the rest of the swing [-]
    support_margin: float = 0.02  # eCMPs nearer the edge are not feasible [m]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name in ("swing_discount", "transfer_discount"):
            self._check(name, 0.0 < getattr(self, name) <= 1.0, "in (0, 1]")
        for name, least in (
            ("icp_error_threshold", 0.0),
            ("min_swing_duration", 0.35),
            ("min_transfer_duration", 0.03),
            ("min_remaining_swing", 0.0),
            ("support_margin", 0.0),
            ("max_speed_up", 1.0),
        ):
            valid = least <= getattr(self, name) < math.inf
            self._check(name, valid, f">= {least}, finite")
        self._check("max_foot_speed", self.max_foot_speed > 0.0, "> 0 m/s")

    def discount(self, phase: Phase) -> float:
        """Gamma of `phase`; 0 where the clock is left alone."""
        if phase is Phase.SWING and self.swing:
            return self.swing_discount
        if phase is Phase.TRANSFER and self.transfer:
            return self.transfer_discount
        return 0.0

    def _check(self, name: str, valid: bool, rule: str) -> None:
        if not valid:
            raise ValueError(f"{name} = {getattr(self, name)}: must be {rule}")


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
    feet: FootPoses,
    error: Array,
    omega: float,
    params: TimingAdapterParams,
) -> float:
    """Returns the time [s] that must be left in the phase, by the clock.

    In a swing, the rest of the foot's motion is sped up by no more than sigma
    (Atlas paper, Eq. 13), and the foot, now at its measured pose in `feet`,
    needs time to get to where the ICP `error` (2,) [m] will have taken its
    foothold.  Erratum: as printed, sigma has no upper bound.
    """
    if state.schedule.phase is Phase.TRANSFER:
        return params.min_transfer_duration - state.elapsed
    least = max(
        params.min_swing_duration - state.elapsed,
        params.min_remaining_swing,
        (state.schedule.duration - state.elapsed) / params.max_speed_up,
    )
    return _first_arrival(state, feet, error, omega, least, params)


def _first_arrival(
    state: WalkingState,
    feet: FootPoses,
    error: Array,
    omega: float,
    least: float,
    params: TimingAdapterParams,
) -> float:
    """Returns the first time [s] >= `least` when the foot can be in place.

    Within the time t, the ICP error grows to e^wt times what it is, and takes
    the foothold along.  If the foot can at no time catch up with it, it makes
    do with the `least`.
    """
    step = state.schedule.footsteps[0]
    nominal = state.adjustment.nominal if state.adjustment else step
    x, y = nominal.pose.p_WF[:2] - feet[step.side].p_WF[:2]
    for i in range(_TIMES_TRIED):
        t = least + i / _TIMES_TRIED * max(state.remaining_time - least, 0.0)
        growth = math.exp(omega * t)
        way = math.hypot(x + growth * error[0], y + growth * error[1])
        if way <= params.max_foot_speed * t:
            return t
    return least


def time_to_return(
    state: WalkingState, feet: FootPoses, params: TimingAdapterParams
) -> float:
    """Returns by how much [s] the swing was shortened too much, >= 0.

    The foothold may have moved away from the foot, now at its measured pose
    in `feet`, since the clock was advanced.  No more than has been gained.
    """
    if state.schedule.phase is not Phase.SWING:
        return 0.0
    step = state.schedule.footsteps[0]
    x, y = step.pose.p_WF[:2] - feet[step.side].p_WF[:2]
    way = max(math.hypot(x, y) - _ARRIVED, 0.0)
    gained = state.time_in_phase - state.elapsed
    late = way / params.max_foot_speed - state.remaining_time
    return min(max(late, 0.0), max(gained, 0.0))


def time_adjustment(
    icp: Array,
    plan: IcpPlan,
    state: WalkingState,
    feet: FootPoses,
    sole: Array,
    params: TimingAdapterParams,
) -> float:
    """Returns by how much [s] to advance the clock now; negative: to hold it.

    The discounted time by which the measured `icp` (2,) [m] is ahead of the
    plan (Nadia paper, Eqs. 15 and 16) or, if what Eq. 16 cannot explain makes
    the ICP leave the support, all that there is: the next step must come at
    once.  Limited by `least_remaining_time`.  `sole` (n, 2) [m] are the
    corners of either sole in its own frame.
    """
    t, left = state.time_in_phase, state.remaining_time
    discount = params.discount(state.schedule.phase)
    if discount == 0.0 or state.waiting or not state.schedule.footsteps:
        return 0.0
    if (late := time_to_return(state, feet, params)) > 0.0:
        return -late
    reference = plan.at(t)
    error = icp - reference.icp
    if math.hypot(*error) < params.icp_error_threshold:
        return 0.0
    least = least_remaining_time(state, feet, error, plan.omega, params)
    most = left - max(least, 0.0)
    if most <= 0.0:
        return 0.0
    done = fraction_done(icp, reference.icp, plan.icp_end)
    ahead = time_ahead(done, left, plan.omega)
    support = support_polygon(state.schedule, sole)
    if is_leaving(icp, plan.at(t + ahead), support, params.support_margin):
        return most
    return min(discount * ahead, most)
