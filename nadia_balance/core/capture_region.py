"""Capture regions: where to step so as to recover in N steps or fewer.

Nadia paper, Sec. IV.  The functions take all their arguments in one frame;
SwingGeometry has the polygons of one swing in W.
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
    """How the capture region is made, and when it moves a foothold."""

    # N, or as many steps as are queued.
    num_steps: int = bounded(3, least=1, most=10)
    # Of them so many find only what the regions of the ground offer.  1 leaves
    # the ground out of C_N: only the foot in the air has to be on a region.
    ground_steps: int = bounded(2, least=1, most=3)
    rules: ReachRulesParams = field(default_factory=ReachRulesParams)
    # Margins at the sole's front, back, inner and outer edge that the capture
    # regions leave to the CoP.
    foot_front: float = bounded(0.02, least=0.0, unit="m", of="sole_length")
    foot_back: float = bounded(0.05, least=0.0, unit="m", of="sole_length")
    foot_inside: float = bounded(0.02, least=0.0, unit="m", of="sole_width")
    foot_outside: float = bounded(0.03, least=0.0, unit="m", of="sole_width")
    # The foot may take its load so much later than planned: the ICP may be
    # short of the foothold when the foot lands, and catch up in transfer.
    waiting_time: float = bounded(0.5, above=0.0, most=5.0, unit="s")
    # The weight arrives on the foot at the end of the transfer, not at once.
    # Off, as in Eq. 9: a transfer in a hurry is over soon.  On, 6 of 18 pushes
    # near the limits (12 of a point mass, 6 of the robot) end in a fall, off 1.
    transfer_aware: bool = False
    # The CoP may leave the centre of the feet that are still to land.
    finite_foot: bool = False
    # Upper bounds of how long the steps to come will last, as when their
    # timing is adapted; infinite: as long as they are queued.  The shorter
    # they are, the more of the recovery is left to them.
    shortest_transfer: float = bounded(
        math.inf, above=0.0, finite=False, unit="s"
    )
    shortest_swing: float = bounded(math.inf, above=0.0, finite=False, unit="s")
    # Where no foothold captures, regions are compared at the times at which
    # the foot can be there: no sooner than this, wherever it is; as
    # `min_remaining_swing` of the TimingAdapterParams.
    least_time_to_land: float = bounded(0.08, least=0.0, unit="s")
    # No foothold moves for a wish that is less far away.
    dead_band: float = bounded(0.01, least=0.0, unit="m")
    # How deep inside the capture region to step, if possible.
    margin: float = bounded(0.03, least=0.0, unit="m")
    sole_clearance: float = bounded(0.005, least=0.0, unit="m", of="sole_width")
    # No change so shortly before touchdown, nor so early in a swing.
    freeze_time: float = bounded(0.05, least=0.0, unit="s")
    settling_time: float = bounded(0.01, least=0.0, unit="s")
    # Back to the nominal foothold when the region has covered it for so long.
    return_time: float = bounded(0.05, least=0.0, unit="s")

    def usable_foot(self, sole: Array) -> Array:
        """Returns the part (n, 2) [m] of the `sole` (k, 2) used for the CoP.

        Both in the sole frame with y toward the swing side.

        Raises:
            ValueError: nothing is left.
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
        """How long [s] the transfer before the swing of `step` will last."""
        return min(step.transfer_duration, self.shortest_transfer)

    def duration(self, step: Footstep) -> float:
        """How long [s] `step` will last: transfer and swing."""
        swing = min(step.swing_duration, self.shortest_swing)
        return self.transfer_duration(step) + swing


def transfer_factor(omega: float, duration: float) -> float:
    """Returns f >= 1: how much farther to step for a transfer that takes time.

    If the CoP moves from r_0 to r in a straight line within `duration` [s]
    after touchdown, then the ICP is at r in the end if
    r = r_0 + f (icp_touchdown - r_0), f = wT / (1 - e^-wT).
    Erratum: the Nadia paper, Eq. 9, puts all weight on r at once, f = 1.
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
    """Returns C_1 (n, 2) [m]: where the ICP may be when the foot lands.

    For any course of the CoP within the stance polygon `foot` (k, 2) [m], and
    a landing at any time in the interval `touchdown` [s] from now; `factor`
    is that of `transfer_factor`.  The hull of icp + l (icp - q), of all
    vertices q and the two l = factor e^wt - 1.
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
    """Returns [D_1, ..., D_N], (n, 2) [m]: what later steps can make up for.

    D_n is the set of all offsets of the ICP from the foot that lands next,
    from which n - 1 further steps, or fewer, capture it.  It is made from the
    back, as the robot may stop after any step, but cannot leave one out:
    D = {0} for the last foot, then, from the last step to the first,
    D <- conv({0} u E_k (R_k + D)), with Minkowski sums.  `reaches` are
    R_2, ..., R_N [m], each about its own stance foot, so on alternating sides;
    `contractions` the E_k = e^-wT of the whole step from one touchdown to the
    next.  With `feet`, the CoP polygons G_1, ..., G_N [m] about the holds, the
    CoP may go anywhere in them instead of staying at the foot's centre: D =
    G_N for the last foot, then D <- conv(G_k-1 u ((1 - E_k) G_k-1 +
    E_k (R_k + D))).  So D_1 is {0} or G_1.

    The hull is exact for convex R_k, as a step may last longer than planned:
    it is the union of (1 - E) G + E (R + D) for 0 <= E <= E_k, and E = 0 is to
    stop.  With `planned` times and numbers of steps it is left out, and D_n is
    of n - 1 steps exactly.
    Erratum: the Nadia paper, Eq. 14, adds E^(n-1) R_n to C_n-1.  These do not
    nest where a foot cannot be put beneath the hip, and with 0 in each R_n, a
    step of no length takes the turn of the other foot.
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
    """All polygons of one swing, (n, 2) [m] in W; the same in all its ticks."""

    stance: FootPose
    swing: Side
    omega: float  # [rad/s]
    foot: Array  # where the CoP of the stance foot can be
    regions: Mapping[str, Array]  # where the swing foot can be put, by name
    reach: ReachabilityParams  # of which they are made
    detour: SwingDetourParams  # how the swing foot gets there
    offsets: tuple[Array, ...]  # D_1, ..., D_N of `later_steps`
    factor: float  # `transfer_factor` of the transfer to come [-]
    # A foothold p with A p < b is on, beside or across the stance foot.
    stance_A: Array
    stance_b: Array

    def blocked(self, foothold: Array) -> bool:
        """True if a foot at `foothold` (2,) [m] would hit the stance foot."""
        return bool((self.stance_A @ foothold < self.stance_b).all())

    def free_parts(self, polygon: Array) -> list[Array]:
        """What of `polygon` (n, 2) [m] is in front, behind, to the side."""
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
        """Returns C_N (k, 2) [m] for `one_step` = C_1; or C_n+1."""
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

    With cross-over, later steps count the hull of base and cross-over regions,
    as if the stance foot were not in the way.  For steps of 1.0, 0.5, 0.38 s
    and Nadia's height and reach, D_2 is so 1.4, 7.3, 10.8 mm too large at one
    place, D_3 2.4, 30.6, 44.3 mm; C_3 in mid-swing less, 2.4, 19, 27 mm, which
    is 0.01, 0.2, 0.3 % of its area.
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
    """Returns what of `schedule` and mechanisms the geometry depends on.

    While the key is equal, the geometry is the same.  It does not depend on
    where the step in the air goes, so that this can be adjusted.
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

    N counts no more steps than are queued; omega [rad/s].
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
    """Returns G_1, ..., G_N (n, 2) [m] of `later_steps`; none if not wanted.

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
    """The factor of the transfer after the landing of steps[n]."""
    if not params.transfer_aware or n + 1 >= len(steps):
        return 1.0  # after the last step there is time: no foot is lifted
    return transfer_factor(omega, params.transfer_duration(steps[n + 1]))


def later_reaches(
    steps: tuple[Footstep, ...], model: PointMassModel, on: Mechanisms
) -> list[Array]:
    """Returns R_2, ..., R_N (n, 2) [m] of `later_steps` in W, of N `steps`."""
    total = total_region(model.reach, on.cross_over)
    return [  # about a foothold, the next swing foot is the other one
        in_world(total, FootPose(yaw=step.pose.yaw), following.side)
        for step, following in itertools.pairwise(steps)
    ]


def _offsets(
    steps: tuple[Footstep, ...],
    params: CaptureRegionStepAdjusterParams,
    model: PointMassModel,
    on: Mechanisms,
) -> tuple[Array, ...]:
    """Returns D_1, ..., D_N in W; N counts no more steps than are queued."""
    reaches = later_reaches(steps[: params.num_steps], model, on)
    contractions = step_contractions(steps, params, model.omega)
    feet = later_feet(steps, params, model.sole)
    return tuple(later_steps(reaches, contractions, feet))


def _stance_foot(
    stance: FootPose, step: Footstep, sole: Array
) -> tuple[Array, Array]:
    """Returns A (k, 2), b (k,): the foothold p is blocked if A p < b.

    The sides of the sum of the stance sole and the reflected swing sole, but
    for the outer one: the far side of the stance leg is out of reach.
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
