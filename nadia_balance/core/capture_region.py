"""N-step capture regions: footholds from which N or fewer steps recover.

Nadia paper, Sec. IV.  All arguments of a function are in the same frame;
SwingGeometry holds the polygons of one swing in W.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from nadia_balance.core.bounds import bounded
from nadia_balance.core.mechanisms import Mechanisms
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.polygon import (
    Edge,
    as_array,
    clip_all,
    convex_hull,
    edges,
    halfspaces,
    hull,
    merge,
    minkowski_sum,
)
from nadia_balance.core.reachability import (
    ReachabilityParams,
    ReachRulesParams,
    in_world,
    step_regions,
    total_region,
)
from nadia_balance.core.swing_detour import SwingDetourParams
from nadia_balance.core.walking import (
    Array,
    ContactSchedule,
    FootPose,
    Footstep,
    Immutable,
    Side,
)

_ORIGIN = np.zeros((1, 2))
_INWARD = -0.5  # y of a normal that points away from the swing side [-]
_AXES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


@dataclass(kw_only=True)
class CaptureRegionStepAdjusterParams:
    """Parameters of the capture region and of the foothold adjustment."""

    # N of C_N; fewer if fewer steps are queued.
    num_steps: int = bounded(3, least=1, most=10)
    # Number of these steps that are restricted to the regions of the ground.
    # With 1, C_N ignores the ground: only the swing foot must land on a region.
    ground_steps: int = bounded(2, least=1, most=3)
    rules: ReachRulesParams = field(default_factory=ReachRulesParams)
    # Margins between the sole's front, back, inner and outer edge and the CoPs
    # that the capture regions assume.
    foot_front: float = bounded(0.02, least=0.0, unit="m", of="sole_length")
    foot_back: float = bounded(0.05, least=0.0, unit="m", of="sole_length")
    foot_inside: float = bounded(0.02, least=0.0, unit="m", of="sole_width")
    foot_outside: float = bounded(0.03, least=0.0, unit="m", of="sole_width")
    # Longest delay of the load on the new foot: the ICP may be short of the
    # foothold at touchdown and reach it during transfer.
    waiting_time: float = bounded(0.5, above=0.0, most=5.0, unit="s")
    # If True, the CoP reaches the new foot at the end of the transfer, not at
    # touchdown (Eq. 9).  False, as fast transfers are short: of 18 pushes near
    # the limits (12 of a point mass, 6 of the robot), 1 ends in a fall, not 6.
    transfer_aware: bool = False
    # If True, the CoP of later footholds may leave the centre of the sole.
    finite_foot: bool = False
    # Upper bounds on the durations of later transfers and swings, as their
    # timing may be adapted; infinite: as queued.  The shorter later steps
    # are, the more they can contribute to the recovery.
    shortest_transfer: float = bounded(
        math.inf, above=0.0, finite=False, unit="s"
    )
    shortest_swing: float = bounded(math.inf, above=0.0, finite=False, unit="s")
    # If no foothold captures, reachability regions are compared at the times
    # when the foot can reach them, with this lower bound; same meaning as
    # `min_remaining_swing` of TimingAdapterParams.
    least_time_to_land: float = bounded(0.08, least=0.0, unit="s")
    # Foothold changes smaller than this are ignored.
    dead_band: float = bounded(0.01, least=0.0, unit="m")
    # Desired distance of the foothold from the edge of the capture region.
    margin: float = bounded(0.03, least=0.0, unit="m")
    sole_clearance: float = bounded(0.005, least=0.0, unit="m", of="sole_width")
    # Times before touchdown and after lift-off without foothold changes.
    freeze_time: float = bounded(0.05, least=0.0, unit="s")
    settling_time: float = bounded(0.01, least=0.0, unit="s")
    # Time for which the capture region must cover the nominal foothold before
    # the step returns to it.
    return_time: float = bounded(0.05, least=0.0, unit="s")

    def usable_foot(self, sole: Array) -> Array:
        """Returns the part (n, 2) [m] of the `sole` (k, 2) used for the CoP.

        Both polygons are in the sole frame with y toward the swing side.

        Raises:
            ValueError: the margins leave no area.
        """
        upper = sole.max(axis=0) - [self.foot_front, self.foot_inside]
        lower = sole.min(axis=0) + [self.foot_back, self.foot_outside]
        part = clip_all(sole, _AXES, np.concatenate([upper, -lower]))
        if not len(part):
            raise ValueError(
                f"foot_front = {self.foot_front}, foot_back = "
                f"{self.foot_back}, foot_inside = {self.foot_inside}, "
                f"foot_outside = {self.foot_outside}: must leave some of the "
                "sole"
            )
        return part

    def transfer_duration(self, step: Footstep) -> float:
        """Returns the duration [s] of the transfer before `step`'s swing."""
        return min(step.transfer_duration, self.shortest_transfer)

    def duration(self, step: Footstep) -> float:
        """Returns the duration [s] of `step`: transfer and swing."""
        swing = min(step.swing_duration, self.shortest_swing)
        return self.transfer_duration(step) + swing


def transfer_factor(omega: float, duration: float) -> float:
    """Returns f = wT / (1 - e^-wT) >= 1, the step length factor of a transfer.

    If the CoP moves from r_0 to r at constant speed within `duration` T [s]
    after touchdown, the ICP ends at r if r = r_0 + f (icp_touchdown - r_0).
    Erratum: the Nadia paper, Eq. 9, moves the CoP to r instantly, f = 1.
    """
    x = omega * duration
    return x / -math.expm1(-x) if x > 0.0 else 1.0


def one_step_region(
    icp: Array,
    foot: Array,
    omega: float,
    touchdown: tuple[float, float],
    factor: float = 1.0,
) -> Array:
    """Returns C_1 (n, 2) [m], the one-step capture region.

    C_1 is the hull of icp + l (icp - q) over all vertices q of the stance
    polygon `foot` (k, 2) [m] and both l = factor e^wt - 1 at the ends t of the
    interval `touchdown` [s] from now.  With `factor` = 1 (`transfer_factor`),
    it contains the ICP at touchdown for any CoP trajectory within `foot`.
    Erratum: the Nadia paper, Fig. 2, lets t go to infinity and cuts with a
    circle, so that the region jumps when the ICP leaves the foot.

    Raises:
        ValueError: NaN or infinity.
    """
    scales = [factor * math.exp(omega * t) - 1.0 for t in touchdown]
    (x, y), corners = icp.tolist(), foot.tolist()
    copies = [
        (x + scale * (x - qx), y + scale * (y - qy))
        for scale in scales
        for qx, qy in corners
    ]
    return as_array(hull(copies))


def later_steps(
    reaches: Sequence[Array],
    contractions: Sequence[float],
    feet: Sequence[Array] = (),
    planned: bool = False,
) -> list[Array]:
    """Returns [D_1, ..., D_N], (n, 2) [m]: ICP offsets captured by later steps.

    D_n is the set of offsets of the ICP from the next foothold that n - 1 or
    fewer further steps capture.  The recursion runs from the last step to the
    first: D = {0} at the last foothold, then D <- conv({0} u E_k (R_k + D)),
    with Minkowski sums, as the robot may stop after any step, but cannot skip
    one.  `reaches` are R_2, ..., R_N [m], each about its own stance foot, so on
    alternating sides; `contractions` are E_k = e^-wT for the time T between
    touchdowns.  With `feet`, the CoP polygons G_1, ..., G_N [m] about the
    footholds, the CoP may be anywhere in them instead of at the foot's centre:
    D = G_N at the last foothold, then
    D <- conv(G_k-1 u ((1 - E_k) G_k-1 + E_k (R_k + D))).  D_1 is {0} or G_1.

    The hull is exact for convex R_k, as a step may last longer than planned:
    it is the union of (1 - E) G + E (R + D) for 0 <= E <= E_k, and E = 0 means
    stopping.  With `planned`, durations and numbers of steps are fixed: no
    hull is taken, and D_n is for exactly n - 1 steps.
    Erratum: the Nadia paper, Eq. 14, adds E^(n-1) R_n to C_n-1.  These regions
    do not nest where a foot cannot be put beneath the hip, and with 0 in each
    R_n, a step of zero length replaces a step of the other foot.
    """
    rests = list(feet) or [_ORIGIN] * (len(reaches) + 1)
    regions = []
    for n, offsets in enumerate(rests):
        for k in reversed(range(n)):
            E, rest = contractions[k], rests[k]
            step = E * minkowski_sum(reaches[k], offsets)
            offsets = minkowski_sum((1.0 - E) * rest, step)
            if not planned:
                offsets = convex_hull(np.concatenate([rest, offsets]))
        regions.append(offsets)
    return regions


def capture_region(one_step: Array, offsets: Array) -> Array:
    """Returns C_n = C_1 + (-D_n), (k, 2) [m], for `offsets` = D_n."""
    return minkowski_sum(one_step, -offsets)


@dataclass(frozen=True, eq=False)
class SwingGeometry(Immutable):
    """All polygons of one swing, (n, 2) [m] in W; constant during the swing."""

    stance: FootPose
    swing: Side
    omega: float  # [rad/s]
    foot: Array  # CoP polygon of the stance foot
    regions: Mapping[str, Array]  # reachability regions, by name
    reach: ReachabilityParams  # source of `regions`
    detour: SwingDetourParams  # path and timing of the swing foot
    offsets: tuple[Array, ...]  # D_1, ..., D_N of `later_steps`
    factor: float  # `transfer_factor` of the next transfer [-]
    # A foothold p with A p < b is on, beside or across the stance foot.
    stance_A: Array
    stance_b: Array

    def blocked(self, foothold: Array) -> bool:
        """True if a foot at `foothold` (2,) [m] would hit the stance foot."""
        return bool((self.stance_A @ foothold < self.stance_b).all())

    def free_parts(self, polygon: Array) -> list[Array]:
        """Returns the parts of `polygon` (n, 2) [m] that are not `blocked`."""
        parts = [
            clip_all(polygon, -normal[None], -offset[None])
            for normal, offset in zip(self.stance_A, self.stance_b, strict=True)
        ]
        return [part for part in parts if len(part)]

    def one_step_region(
        self, icp: Array, touchdown: tuple[float, float]
    ) -> Array:
        """Returns C_1 (n, 2) [m]; `icp` (2,) [m], `touchdown` [s] from now."""
        return one_step_region(
            icp, self.foot, self.omega, touchdown, self.factor
        )

    def capture_region(self, one_step: Array, n: int = -1) -> Array:
        """Returns C_N (k, 2) [m] for `one_step` = C_1; with n given, C_n+1."""
        return merge(edges(one_step), self._summands[n])

    @cached_property
    def _summands(self) -> list[list[Edge]]:
        """The edges of -D_1, ..., -D_N."""
        return [edges(-offsets) for offsets in self.offsets]


def swing_geometry(
    schedule: ContactSchedule,
    params: CaptureRegionStepAdjusterParams,
    model: PointMassModel,
    on: Mechanisms,
) -> SwingGeometry:
    """Returns the geometry of the swing of `schedule`, or of the next one.

    With cross-over, later steps use the hull of base and cross-over regions
    and ignore the stance foot as an obstacle.  This approximation enlarges D_2
    by at most 1.4, 7.3, 10.8 mm for steps of 1.0, 0.5, 0.38 s and Nadia's
    height and reach, D_3 by 2.4, 30.6, 44.3 mm, and C_3 in mid-swing by 2.4,
    19, 27 mm, which is 0.01, 0.2, 0.3 % of its area.
    """
    stance = schedule.feet[schedule.support_side]
    steps = schedule.footsteps
    side = steps[0].side
    A, b = _stance_foot(stance, steps[0], model.sole)
    regions = step_regions(model.reach, on.cross_over)
    return SwingGeometry(
        stance=stance,
        swing=side,
        omega=model.omega,
        foot=in_world(params.usable_foot(model.sole), stance, side),
        regions={
            name: in_world(region, stance, side)
            for name, region in regions.items()
        },
        reach=model.reach,
        detour=model.detour,
        offsets=_offsets(steps, params, model, on),
        factor=_factor(steps, 0, params, model.omega),
        stance_A=A,
        stance_b=b + params.sole_clearance,
    )


def geometry_key(
    schedule: ContactSchedule, on: Mechanisms
) -> tuple[object, ...]:
    """Returns a key of the `swing_geometry` of `schedule` and mechanisms.

    Equal keys mean equal geometry.  The key does not contain the foothold of
    the step in the air, which may be adjusted.
    """
    step, *later = schedule.footsteps
    stance = schedule.feet[schedule.support_side]
    return (on.cross_over, stance, step.side, step.pose.yaw, *later)


def step_contractions(
    steps: tuple[Footstep, ...],
    params: CaptureRegionStepAdjusterParams,
    omega: float,
) -> list[float]:
    """Returns E_2, ..., E_N [-] of `later_steps`, transfers included.

    N is at most the number of queued steps; omega [rad/s].
    """
    contractions = []
    for n, step in enumerate(steps[1 : params.num_steps]):
        decay = math.exp(-omega * params.duration(step))
        before, after = (_factor(steps, k, params, omega) for k in (n, n + 1))
        contractions.append(decay * before / after)
    return contractions


def later_feet(
    steps: tuple[Footstep, ...],
    params: CaptureRegionStepAdjusterParams,
    sole: Array,
) -> list[Array]:
    """Returns G_1, ..., G_N (n, 2) [m] of `later_steps`; or [], if not used.

    `sole` (k, 2) [m]: the corners of either sole in its own frame.
    """
    if not params.finite_foot:
        return []
    foot = params.usable_foot(sole)
    return [
        in_world(foot, FootPose(yaw=step.pose.yaw), step.side.other)
        for step in steps[: params.num_steps]
    ]


def _factor(
    steps: tuple[Footstep, ...],
    n: int,
    params: CaptureRegionStepAdjusterParams,
    omega: float,
) -> float:
    """Returns `transfer_factor` for the transfer after steps[n] lands."""
    if not params.transfer_aware or n + 1 >= len(steps):
        return 1.0  # the last transfer is not followed by a lift-off
    return transfer_factor(omega, params.transfer_duration(steps[n + 1]))


def later_reaches(
    steps: tuple[Footstep, ...], model: PointMassModel, on: Mechanisms
) -> list[Array]:
    """Returns R_2, ..., R_N (n, 2) [m] of `later_steps` in W for N `steps`."""
    total = total_region(model.reach, on.cross_over)
    return [  # each foothold is the stance foot of the following step
        in_world(total, FootPose(yaw=step.pose.yaw), following.side)
        for step, following in itertools.pairwise(steps)
    ]


def _offsets(
    steps: tuple[Footstep, ...],
    params: CaptureRegionStepAdjusterParams,
    model: PointMassModel,
    on: Mechanisms,
) -> tuple[Array, ...]:
    """Returns D_1, ..., D_N in W; N is at most the number of queued steps."""
    reaches = later_reaches(steps[: params.num_steps], model, on)
    contractions = step_contractions(steps, params, model.omega)
    feet = later_feet(steps, params, model.sole)
    return tuple(later_steps(reaches, contractions, feet))


def _stance_foot(
    stance: FootPose, step: Footstep, sole: Array
) -> tuple[Array, Array]:
    """Returns A (k, 2), b (k,): the foothold p is blocked if A p < b.

    A and b are the sides of the Minkowski sum of the stance sole and the
    reflected swing sole, without the outer side: the swing foot cannot reach
    the far side of the stance leg.
    """
    swing = FootPose(yaw=step.pose.yaw)
    A, b = halfspaces(
        minkowski_sum(
            convex_hull(stance.to_world(sole)),
            convex_hull(-swing.to_world(sole)),
        )
    )
    y_axis = stance.rotation[:, 1] * step.side.sign
    inner = A @ y_axis > _INWARD
    return A[inner], b[inner]
