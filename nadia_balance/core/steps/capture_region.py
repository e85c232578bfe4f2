"""N-step capture regions of one swing, and where its foot may land.

Nadia paper, Sec. IV: footholds from which N or fewer steps recover.  All
arguments of a function are in the same frame.
"""

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.reachability import (
    in_world,
    step_regions,
    total_region,
)
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import (
    as_array,
    clip_all,
    contains,
    convex_hull,
    halfspaces,
    hull,
    minkowski_sum,
)
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import (
    ContactSchedule,
    FootPose,
    Footstep,
    Immutable,
)
from nadia_balance.parameters.bounds import bounded, parameters

ROUNDING = 1e-6  # tolerance of a foothold on the edge of a region [m]
_INWARD = -0.5  # y of a normal that points away from the swing side [-]
_KEPT = 4  # robots, with and without cross-over
_ORIGIN = np.zeros((1, 2))
_AXES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


@parameters
class ReachRulesParams:
    """Preference of the base region, and hysteresis of the choice."""

    area_margin: float = bounded(
        5.0,
        doc="least ratio of the area that a cross-over region shares with the "
        "capture region to that of the base region",
        least=1.0,
    )
    hysteresis: float = bounded(
        1.3, doc="factor on the shared area of the previous region", least=1.0
    )
    distance_hysteresis: float = bounded(
        0.03,
        doc="the previous region, if none shares any area, and the previous "
        "ground are kept until another is this much closer",
        least=0.0,
        unit="m",
    )


@parameters
class CaptureRegionStepAdjusterParams:
    """Parameters of the capture region and of the foothold adjustment.

    The margins to the edges of the sole are those of the CoPs that the capture
    regions assume.  In C_N itself a `later_duration` below 1 would leave to
    each next step what this one can do, without end.
    """

    num_steps: int = bounded(
        3, doc="N of C_N; fewer if fewer steps are queued", least=1, most=10
    )
    later_duration: float = bounded(
        0.6,
        doc="share of their planned durations that later steps take, if "
        "swings adapt, where the region is chosen by rule 3",
        above=0.0,
        most=1.0,
    )
    rules: ReachRulesParams = bounded(
        ReachRulesParams, doc="choice of the reachability region"
    )
    foot_front: float = bounded(
        0.02,
        doc="margin of the CoP to the front edge",
        least=0.0,
        unit="m",
        of="sole_length",
    )
    foot_back: float = bounded(
        0.05,
        doc="margin of the CoP to the back edge",
        least=0.0,
        unit="m",
        of="sole_length",
    )
    foot_inside: float = bounded(
        0.02,
        doc="margin of the CoP to the inner edge",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    foot_outside: float = bounded(
        0.03,
        doc="margin of the CoP to the outer edge",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    waiting_time: float = bounded(
        0.5,
        doc="longest delay of the load on the new foot: the ICP may be short "
        "of the foothold at touchdown and reach it during transfer",
        above=0.0,
        most=5.0,
        unit="s",
    )
    least_time_to_land: float = bounded(
        0.08,
        doc="if no foothold captures, reachability regions are compared at "
        "the times when the foot can reach them, or at this one",
        least=0.0,
        unit="s",
    )
    dead_band: float = bounded(
        0.01, doc="least change of the foothold", least=0.0, unit="m"
    )
    margin: float = bounded(
        0.03, doc="desired depth in the capture region", least=0.0, unit="m"
    )
    sole_clearance: float = bounded(
        0.005,
        doc="least distance of the soles",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    freeze_time: float = bounded(
        0.05, doc="time before touchdown without changes", least=0.0, unit="s"
    )
    prolongation: float = bounded(
        0.3, doc="largest prolongation of a swing", least=0.0, unit="s"
    )
    return_time: float = bounded(
        0.05,
        doc="time for which the capture region must cover the nominal "
        "foothold before the step returns to it",
        least=0.0,
        unit="s",
    )

    def usable_foot(self, sole: Array) -> Array:
        """The part of a sole that is used for the CoP.

        Args:
            sole: polygon (k, 2) in the sole frame, y toward the swing side [m].

        Returns:
            The part (n, 2) within the margins, in the same frame [m].

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
                "sole; those of a robot are controller_params(its name)"
            )
        return part


def one_step_region(
    icp: Array, foot: Array, omega: float, touchdown: tuple[float, float]
) -> Array:
    """The one-step capture region C_1 (Nadia paper, Eq. 3 and Fig. 2).

        C_1 = hull of icp + (e^(omega t) - 1) (icp - q)

    over all vertices q of `foot` and both ends t of `touchdown`: the ICPs at
    touchdown of all CoP trajectories within `foot`.
    Erratum: the Nadia paper, Fig. 2, lets t go to infinity and cuts with a
    circle, so that the region jumps when the ICP leaves the foot.

    Args:
        icp: ICP (2,) [m].
        foot: polygon (k, 2) of the CoP in the stance foot [m].
        omega: natural frequency [rad/s].
        touchdown: earliest and latest touchdown from now [s].

    Returns:
        The region (n, 2) [m].

    Raises:
        ValueError: NaN or infinity.
    """
    scales = [math.exp(omega * t) - 1.0 for t in touchdown]
    (x, y), corners = icp.tolist(), foot.tolist()
    icps = [
        (x + scale * (x - qx), y + scale * (y - qy))
        for scale in scales
        for qx, qy in corners
    ]
    return as_array(hull(icps))


def later_steps(
    reaches: Sequence[Array], contractions: Sequence[float]
) -> list[Array]:
    """The ICP offsets that later steps capture.

    D_n is the set of offsets of the ICP from the next foothold that n - 1 or
    fewer further steps capture.  The recursion runs from the last step to the
    first:

        D = {0} at the last foothold, then D <- conv({0} u E_k (R_k + D)),

    with Minkowski sums, as the robot may stop after any step, but cannot skip
    one.
    The hull is exact for convex R_k, as a step may last longer than planned:
    it is the union of E (R + D) for 0 <= E <= E_k, and E = 0 means stopping.
    Erratum: the Nadia paper, Eq. 14, adds E^(n-1) R_n to C_n-1.  These regions
    do not nest where a foot cannot be put beneath the hip, and with 0 in each
    R_n, a step of zero length replaces a step of the other foot.

    Args:
        reaches: R_2, ..., R_N (k, 2), each about its own stance foot, so on
            alternating sides [m].
        contractions: E_k = e^(-omega T), T between touchdowns [-].

    Returns:
        D_1, ..., D_N (n, 2) [m].
    """
    return [
        captured_offsets(reaches[:n], contractions[:n])
        for n in range(len(reaches) + 1)
    ]


def captured_offsets(
    reaches: Sequence[Array], contractions: Sequence[float]
) -> Array:
    """The last set D_N of `later_steps`.

    Args:
        reaches: R_2, ..., R_N (k, 2) [m].
        contractions: E_k [-].

    Returns:
        D_N (n, 2) [m].
    """
    offsets = _ORIGIN
    for reach, contraction in zip(
        reversed(reaches), reversed(contractions), strict=True
    ):
        offsets = contraction * minkowski_sum(reach, offsets)
        offsets = convex_hull(np.concatenate([_ORIGIN, offsets]))
    return offsets


def capture_region(one_step: Array, offsets: Array) -> Array:
    """The n-step capture region C_n = C_1 + (-D_n), a Minkowski sum.

    Args:
        one_step: C_1 (m, 2) [m].
        offsets: D_n (k, 2) of `later_steps` [m].

    Returns:
        The region (n, 2) [m].
    """
    return minkowski_sum(one_step, -offsets)


@dataclass(frozen=True, eq=False)
class Place(Immutable):
    """A convex region of footholds: one ground region within one reach."""

    reach: str  # name of the reachability region
    ground: int  # index of the ground region, 0 on flat ground
    polygon: Array  # (n, 2) [m] in W


class SwingGeometry(Immutable):
    """All polygons of one swing, (n, 2) [m] in W; constant during the swing.

    `regions` are the reachability regions by name, `places` the ground within
    them; `foot` is the CoP polygon of the stance foot; `offsets` are D_1, ...,
    D_N of `later_steps`, with N at most the number of queued steps.
    The next foothold is on the ground; later steps are taken as on flat ground.
    With cross-over, these use the hull of base and cross-over regions and
    ignore the stance foot as an obstacle.  Whatever the ICP, the hull enlarges
    Nadia's C_3 by at most 3, 33, 46 mm for steps of 1.0, 0.5, 0.38 s.

    Args:
        schedule: feet and footsteps; the swing is its present or next one.
        params: N and the margins of the stance foot.
        model: sole, reach and ground.
        on: mechanisms; `swing` and `cross_over` count.
    """

    def __init__(
        self,
        schedule: ContactSchedule,
        params: CaptureRegionStepAdjusterParams,
        model: PointMassModel,
        on: Mechanisms,
    ) -> None:
        step = schedule.footsteps[0]
        stance = schedule.feet[schedule.support_side]
        self.key = geometry_key(schedule, on)
        self.model = model
        self.stance = stance
        self.swing = step.side
        self.foot = in_world(
            params.usable_foot(model.cop_area), stance, step.side
        )
        regions, total = _reach_of(model, on.cross_over)
        self.regions = {
            name: in_world(region, stance, step.side)
            for name, region in regions.items()
        }
        self.places = tuple(self._places(step.pose.yaw))
        steps = schedule.footsteps[: params.num_steps]
        # Each foothold is the stance foot of the following step.
        reaches = [
            in_world(total, FootPose(yaw=one.pose.yaw), two.side)
            for one, two in itertools.pairwise(steps)
        ]
        self.offsets = tuple(
            later_steps(reaches, _contractions(steps, model.omega))
        )
        share = params.later_duration if on.swing else 1.0
        self._hurried = captured_offsets(
            reaches, _contractions(steps, share * model.omega)
        )
        # A foothold p with A p < b is on, beside or across the stance foot.
        A, b = _stance_foot(stance, step, model.sole)
        self._blocking = A, b + max(params.sole_clearance, model.sole_clearance)

    def blocked(self, foothold: Array) -> bool:
        """Whether a foot would hit the stance foot.

        Args:
            foothold: centre of the sole (2,) in W [m].

        Returns:
            True if it would.
        """
        A, b = self._blocking
        return bool((A @ foothold < b).all())

    def free_parts(self, region: Array) -> list[Array]:
        """The parts of a region that are not `blocked`.

        Args:
            region: polygon (n, 2) in W [m].

        Returns:
            Polygons (k, 2) in W, which may overlap [m].
        """
        A, b = self._blocking
        parts = [
            clip_all(region, -normal[None], -offset[None])
            for normal, offset in zip(A, b, strict=True)
        ]
        return [part for part in parts if len(part)]

    def allows(self, foot: FootPose) -> bool:
        """Whether a foot is on the ground, in reach without crossing legs.

        Args:
            foot: pose of the swing foot in W.

        Returns:
            True if it is.
        """
        x, y = self.stance.to_sole(foot.p_WF[:2]).tolist()
        if not self.model.reach.in_base_region(x, self.swing.sign * y):
            return False
        return self.model.ground is None or (
            abs(foot.p_WF[2] - self.stance.p_WF[2])
            <= self.model.reach.rise_max + ROUNDING
            and self.model.ground.allows(foot)
        )

    def place_at(self, foothold: Array, reach: str = "") -> Place | None:
        """The place of a foothold.

        Args:
            foothold: centre of the sole (2,) in W [m].
            reach: name of the reachability region that is preferred.

        Returns:
            The place, or None if there is none: so it is if `blocked`.
        """
        places = (
            place
            for place in sorted(self.places, key=lambda p: p.reach != reach)
            if contains(foothold, place.polygon, ROUNDING)
        )
        return None if self.blocked(foothold) else next(places, None)

    def one_step_region(
        self, icp: Array, touchdown: tuple[float, float]
    ) -> Array:
        """The one-step capture region C_1 of this swing.

        Args:
            icp: ICP (2,) in W [m].
            touchdown: earliest and latest touchdown from now [s].

        Returns:
            The region (n, 2) in W [m].
        """
        return one_step_region(icp, self.foot, self.model.omega, touchdown)

    def hurried_region(self, one_step: Array) -> Array:
        """The N-step capture region C_N, if later steps hurry.

        Args:
            one_step: C_1 (n, 2) in W [m].

        Returns:
            The region (k, 2) in W [m].
        """
        return capture_region(one_step, self._hurried)

    def _places(self, yaw: float) -> Iterator[Place]:
        """Yields the places in `rise_max` for a foot of this `yaw` [rad]."""
        z = float(self.stance.p_WF[2])
        rise = self.model.reach.rise_max + ROUNDING
        for name, region in self.regions.items():
            if self.model.ground is None:
                yield Place(name, 0, region)
                continue
            for index, part in self.model.ground.footholds_within(
                region, yaw, z - rise, z + rise
            ):
                yield Place(name, index, part)


def geometry_key(
    schedule: ContactSchedule, on: Mechanisms
) -> tuple[object, ...]:
    """A key of the SwingGeometry: equal keys mean equal geometry.

    Args:
        schedule: feet and footsteps.
        on: mechanisms.

    Returns:
        All that it depends on, besides parameters and model.  The foothold of
        the step in the air is not in it, as it may be adjusted.
    """
    step, *later = schedule.footsteps
    return (
        on.cross_over,
        on.swing,
        schedule.feet[schedule.support_side],
        step.side,
        step.pose.yaw,
        *later,
    )


@functools.lru_cache(_KEPT)
def _reach_of(
    model: PointMassModel, cross_over: bool
) -> tuple[dict[str, Array], Array]:
    """Returns the regions of a step by name, and the hull of all.

    They are (n, 2) [m] in the sole frame of the stance foot.
    """
    return (
        step_regions(model.reach, cross_over),
        total_region(model.reach, cross_over),
    )


def _contractions(steps: tuple[Footstep, ...], rate: float) -> list[float]:
    """Returns e^(-rate T) [-] of the steps after the first one.

    T [s] is a step's duration, with its transfer.
    """
    return [
        math.exp(-rate * (step.transfer_duration + step.swing_duration))
        for step in steps[1:]
    ]


def _stance_foot(
    stance: FootPose, step: Footstep, sole: Array
) -> tuple[Array, Array]:
    """Returns A (k, 2), b (k,): the foothold p is blocked if A p < b.

    These are the sides of the Minkowski sum of the stance sole and the
    reflected swing sole, without the outer one: the swing foot cannot reach it.
    """
    reflected = convex_hull(-FootPose(yaw=step.pose.yaw).to_world(sole))
    A, b = halfspaces(
        minkowski_sum(convex_hull(stance.to_world(sole)), reflected)
    )
    inner = A @ (stance.rotation[:, 1] * step.side.sign) > _INWARD
    return A[inner], b[inner]
