"""N-step capture regions of one swing, and where its foot may land.

Nadia paper, Sec. IV: footholds from which N or fewer steps recover.  All
arguments of a function are in the same frame.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.body import reachability
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import in_world
from nadia_balance.core.math import polygon
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import clip_all, convex_hull, minkowski_sum
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.parameters.bounds import bounded

ROUNDING = 1e-6  # tolerance of a foothold on the edge of a region [m]
_INWARD = -0.5  # y of a normal that points away from the swing side [-]
_ORIGIN = np.zeros((1, 2))
_AXES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


@dataclass(kw_only=True)
class ReachRulesParams:
    """Preference of the base region, and hysteresis of the choice."""

    # Least ratio of the area that a cross-over region shares with the capture
    # region to that of the base region.
    area_margin: float = bounded(5.0, least=1.0)
    # The previous region is kept until another region shares this many times
    # its area or, if none shares any, is this much closer.  A foothold stays
    # on its ground region unless another one is this much closer to nominal.
    hysteresis: float = bounded(1.3, least=1.0)
    distance_hysteresis: float = bounded(0.03, least=0.0, unit="m")


@dataclass(kw_only=True)
class CaptureRegionStepAdjusterParams:
    """Parameters of the capture region and of the foothold adjustment."""

    # N of C_N; fewer if fewer steps are queued.
    num_steps: int = bounded(3, least=1, most=10)
    # Share of their planned durations that later steps take, if swings adapt,
    # where the region is chosen by rule 3.  In C_N itself a share below 1 would
    # leave to each next step what this one can do, without end.
    later_duration: float = bounded(0.6, above=0.0, most=1.0)
    rules: ReachRulesParams = bounded(ReachRulesParams)
    # Margins between the sole's front, back, inner and outer edge and the CoPs
    # that the capture regions assume.
    foot_front: float = bounded(0.02, least=0.0, unit="m", of="sole_length")
    foot_back: float = bounded(0.05, least=0.0, unit="m", of="sole_length")
    foot_inside: float = bounded(0.02, least=0.0, unit="m", of="sole_width")
    foot_outside: float = bounded(0.03, least=0.0, unit="m", of="sole_width")
    # Longest delay of the load on the new foot: the ICP may be short of the
    # foothold at touchdown and reach it during transfer.
    waiting_time: float = bounded(0.5, above=0.0, most=5.0, unit="s")
    # If no foothold captures, reachability regions are compared at the times
    # when the foot can reach them, or at this one.
    least_time_to_land: float = bounded(0.08, least=0.0, unit="s")
    # Foothold changes smaller than this are ignored.
    dead_band: float = bounded(0.01, least=0.0, unit="m")
    # Desired distance of the foothold from the edge of the capture region.
    margin: float = bounded(0.03, least=0.0, unit="m")
    sole_clearance: float = bounded(0.005, least=0.0, unit="m", of="sole_width")
    # Times without foothold changes, before touchdown and after lift-off.
    freeze_time: float = bounded(0.05, least=0.0, unit="s")
    settling_time: float = bounded(0.01, least=0.0, unit="s")
    # Time by which a swing may last longer than planned.
    prolongation: float = bounded(0.3, least=0.0, unit="s")
    # Time for which the capture region must cover the nominal foothold before
    # the step returns to it.
    return_time: float = bounded(0.05, least=0.0, unit="s")

    def usable_foot(self, sole: Array) -> Array:
        """Returns the part (n, 2) [m] of the `sole` (k, 2) used for the CoP.

        Both polygons are in the sole frame with y toward the swing side.

        Raises ValueError: the margins leave no area.
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


def one_step_region(
    icp: Array, foot: Array, omega: float, touchdown: tuple[float, float]
) -> Array:
    """Returns C_1 (n, 2) [m], the one-step capture region.

    C_1 is the hull of icp + l (icp - q) over all vertices q of the stance
    polygon `foot` (k, 2) [m] and both l = e^wt - 1 at the ends t of the
    interval `touchdown` [s] from now: the ICPs at touchdown of all CoP
    trajectories within `foot` (Nadia paper, Eq. 9).
    Erratum: the Nadia paper, Fig. 2, lets t go to infinity and cuts with a
    circle, so that the region jumps when the ICP leaves the foot.

    Raises ValueError: NaN or infinity.
    """
    scales = [math.exp(omega * t) - 1.0 for t in touchdown]
    (x, y), corners = icp.tolist(), foot.tolist()
    copies = [
        (x + scale * (x - qx), y + scale * (y - qy))
        for scale in scales
        for qx, qy in corners
    ]
    return polygon.as_array(polygon.hull(copies))


def later_steps(
    reaches: Sequence[Array], contractions: Sequence[float]
) -> list[Array]:
    """Returns [D_1, ..., D_N], (n, 2) [m]: ICP offsets captured by later steps.

    D_n is the set of offsets of the ICP from the next foothold that n - 1 or
    fewer further steps capture.  The recursion runs from the last step to the
    first: D = {0} at the last foothold, then D <- conv({0} u E_k (R_k + D)),
    with Minkowski sums, as the robot may stop after any step, but cannot skip
    one.  `reaches` are R_2, ..., R_N [m], each about its own stance foot, so on
    alternating sides; `contractions` are E_k = e^-wT, T between touchdowns.

    The hull is exact for convex R_k, as a step may last longer than planned:
    it is the union of E (R + D) for 0 <= E <= E_k, and E = 0 means stopping.
    Erratum: the Nadia paper, Eq. 14, adds E^(n-1) R_n to C_n-1.  These regions
    do not nest where a foot cannot be put beneath the hip, and with 0 in each
    R_n, a step of zero length replaces a step of the other foot.
    """
    regions = []
    for n in range(len(reaches) + 1):
        offsets = _ORIGIN
        for k in reversed(range(n)):
            offsets = contractions[k] * minkowski_sum(reaches[k], offsets)
            offsets = polygon.convex_hull(np.concatenate([_ORIGIN, offsets]))
        regions.append(offsets)
    return regions


def capture_region(one_step: Array, offsets: Array) -> Array:
    """Returns C_n = C_1 + (-D_n), (k, 2) [m], for `offsets` = D_n."""
    return minkowski_sum(one_step, -offsets)


@dataclass(frozen=True, eq=False)
class Place(walking.Immutable):
    """A convex region of footholds: one ground region within one reach."""

    reach: str  # name of the reachability region
    ground: int  # index of the ground region, 0 on flat ground
    polygon: Array  # (n, 2) [m] in W


class SwingGeometry(walking.Immutable):
    """All polygons of one swing, (n, 2) [m] in W; constant during the swing.

    It is the swing of `schedule`, or the next one.  `regions` are the
    reachability regions by name, `places` the ground within them; `foot` is the
    CoP polygon of the stance foot; `offsets` are D_1, ..., D_N of
    `later_steps`, with N at most the number of queued steps.

    The next foothold is on the ground; later steps are taken as on flat ground.
    With cross-over, these use the hull of base and cross-over regions and
    ignore the stance foot as an obstacle.  This enlarges Nadia's C_3 in
    mid-swing by at most 2.4, 19, 27 mm for steps of 1.0, 0.5, 0.38 s.
    """

    def __init__(
        self,
        schedule: walking.ContactSchedule,
        params: CaptureRegionStepAdjusterParams,
        model: PointMassModel,
        on: Mechanisms,
    ) -> None:
        self.key, self.model = geometry_key(schedule, on), model
        self.stance = stance = schedule.feet[schedule.support_side]
        step = schedule.footsteps[0]
        self.swing = step.side
        usable = params.usable_foot(model.cop_area)
        self.foot = in_world(usable, stance, step.side)
        regions = reachability.step_regions(model.reach, on.cross_over)
        self.regions = {
            name: in_world(region, stance, step.side)
            for name, region in regions.items()
        }
        self.places = tuple(self._places(step.pose.yaw))
        steps = schedule.footsteps[: params.num_steps]
        self.offsets = _offsets(steps, model, on, 1.0)
        share = params.later_duration if on.swing else 1.0
        self._hurried = _offsets(steps, model, on, share)[-1]
        # A foothold p with A p < b is on, beside or across the stance foot.
        A, b = _stance_foot(stance, step, model.sole)
        apart = max(params.sole_clearance, model.sole_clearance)
        self._blocking = A, b + apart

    def blocked(self, foothold: Array) -> bool:
        """True if a foot at `foothold` (2,) [m] would hit the stance foot."""
        A, b = self._blocking
        return bool((A @ foothold < b).all())

    def free_parts(self, region: Array) -> list[Array]:
        """Returns the parts of `region` (n, 2) [m] that are not `blocked`."""
        parts = [
            clip_all(region, -normal[None], -offset[None])
            for normal, offset in zip(*self._blocking, strict=True)
        ]
        return [part for part in parts if len(part)]

    def allows(self, foot: walking.FootPose) -> bool:
        """True if the foot is on the ground, in reach without crossing legs."""
        x, y = self.stance.to_sole(foot.p_WF[:2]).tolist()
        ground, reach = self.model.ground, self.model.reach
        if not reach.in_base_region(x, self.swing.sign * y):
            return False
        rise = abs(foot.p_WF[2] - self.stance.p_WF[2])
        return ground is None or (
            rise <= reach.rise_max + ROUNDING and ground.allows(foot)
        )

    def foot_at(
        self, point: Array, nominal: walking.FootPose
    ) -> walking.FootPose:
        """Returns the foot at `point` (2,) [m] in W, `nominal` in yaw.

        Its height and normal are those of the ground, on flat ground `nominal`.
        """
        height = float(nominal.p_WF[2])
        if self.model.ground is None:
            return walking.FootPose(np.append(point, height), nominal.yaw)
        return self.model.ground.pose(point, nominal.yaw, height)

    def place_at(self, foothold: Array, reach: str = "") -> Place | None:
        """Returns the place of `foothold` (2,) [m], if possible of `reach`.

        None if there is none; a foothold that is `blocked` has no place.
        """
        found = (
            place
            for place in sorted(self.places, key=lambda p: p.reach != reach)
            if polygon.contains(foothold, place.polygon, ROUNDING)
        )
        return None if self.blocked(foothold) else next(found, None)

    def one_step_region(
        self, icp: Array, touchdown: tuple[float, float]
    ) -> Array:
        """Returns C_1 (n, 2) [m]; `icp` (2,) [m], `touchdown` [s] from now."""
        return one_step_region(icp, self.foot, self.model.omega, touchdown)

    def hurried_region(self, one_step: Array) -> Array:
        """Returns C_N (k, 2) [m] for `one_step` = C_1, if later steps hurry."""
        return capture_region(one_step, self._hurried)

    def _places(self, yaw: float) -> Iterator[Place]:
        """Yields the places for a foot of this `yaw` [rad].

        They rise or fall from the stance foot by at most `rise_max`.
        """
        ground, rise = self.model.ground, self.model.reach.rise_max + ROUNDING
        z = float(self.stance.p_WF[2])
        for name, region in self.regions.items():
            if ground is None:
                yield Place(name, 0, region)
                continue
            parts = ground.footholds_within(region, yaw, z - rise, z + rise)
            for index, part in parts:
                yield Place(name, index, part)


def geometry_key(
    schedule: walking.ContactSchedule, on: Mechanisms
) -> tuple[object, ...]:
    """Returns a key of the SwingGeometry of `schedule` and mechanisms.

    Equal keys mean equal geometry.  The key does not contain the foothold of
    the step in the air, which may be adjusted.
    """
    step, *later = schedule.footsteps
    stance = schedule.feet[schedule.support_side]
    reach = on.cross_over, on.swing
    return (*reach, stance, step.side, step.pose.yaw, *later)


def _offsets(
    steps: tuple[walking.Footstep, ...],
    model: PointMassModel,
    on: Mechanisms,
    share: float,
) -> tuple[Array, ...]:
    """Returns D_1, ..., D_N in W of N `steps`, transfers included.

    Each foothold is the stance foot of the following step, whose reach is about
    it.  Later steps take `share` of their planned durations.
    """
    total = reachability.total_region(model.reach, on.cross_over)
    reaches = [
        in_world(total, walking.FootPose(yaw=step.pose.yaw), following.side)
        for step, following in itertools.pairwise(steps)
    ]
    rate = -share * model.omega
    contractions = [
        math.exp(rate * (step.transfer_duration + step.swing_duration))
        for step in steps[1:]
    ]
    return tuple(later_steps(reaches, contractions))


def _stance_foot(
    stance: walking.FootPose, step: walking.Footstep, sole: Array
) -> tuple[Array, Array]:
    """Returns A (k, 2), b (k,): the foothold p is blocked if A p < b.

    These are the sides of the Minkowski sum of the stance sole and the
    reflected swing sole, without the outer one: the swing foot cannot reach it.
    """
    swing = walking.FootPose(yaw=step.pose.yaw)
    soles = (
        convex_hull(stance.to_world(sole)),
        convex_hull(-swing.to_world(sole)),
    )
    A, b = polygon.halfspaces(minkowski_sum(*soles))
    y_axis = stance.rotation[:, 1] * step.side.sign
    inner = A @ y_axis > _INWARD
    return A[inner], b[inner]
