"""What a swing's capture regions owe to the footsteps, not to the ICP."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from nadia_balance.core.capture_region import (
    later_steps,
    one_step_region,
    transfer_factor,
)
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.minkowski_sum import (
    Edge,
    edges,
    merge,
    minkowski_sum,
)
from nadia_balance.core.polygon import clip_all, convex_hull, halfspaces
from nadia_balance.core.reachability import (
    in_world,
    step_regions,
    total_region,
)
from nadia_balance.core.walking import (
    Array,
    ContactSchedule,
    FootPose,
    Footstep,
    Side,
)

_INWARD = -0.5  # y of a normal that points away from the swing side


@dataclass(frozen=True, eq=False)
class SwingGeometry:
    """All polygons of one swing, (n, 2) [m] in W; the same in all its ticks."""

    stance: FootPose
    swing: Side
    foot: Array  # where the CoP of the stance foot can be
    regions: Mapping[str, Array]  # where the swing foot can be put, by name
    offsets: tuple[Array, ...]  # D_1, ..., D_N of `later_steps`
    factor: float  # `transfer_factor` of the transfer to come [-]
    # A foothold p with A p < b is on, beside or across the stance foot.
    stance_A: Array
    stance_b: Array

    def __deepcopy__(self, memo: object) -> SwingGeometry:
        return self

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
        self, icp: Array, omega: float, touchdown: tuple[float, float]
    ) -> Array:
        """Returns C_1 (n, 2) [m]; `icp` (2,) [m], `touchdown` [s] from now."""
        return one_step_region(icp, self.foot, omega, touchdown, self.factor)

    def capture_region(self, one_step: Array, n: int = -1) -> Array:
        """Returns C_N (k, 2) [m] for `one_step` = C_1; or C_n+1."""
        return merge(edges(one_step), self._summands[n])

    @cached_property
    def _summands(self) -> list[list[Edge]]:
        """The edges of -D_1, ..., -D_N."""
        return [edges(-offsets) for offsets in self.offsets]


def swing_geometry(
    schedule: ContactSchedule,
    sole: Array,
    params: CaptureRegionStepAdjusterParams,
    omega: float,
) -> SwingGeometry:
    """Returns the geometry of the swing of `schedule`.

    `sole` (k, 2) [m]: the corners of either sole in its own frame.
    """
    stance = schedule.feet[schedule.support_side]
    step = schedule.footsteps[0]
    regions = step_regions(params.reachability)
    A, b = _stance_foot(stance, step, sole)
    return SwingGeometry(
        stance=stance,
        swing=step.side,
        foot=in_world(params.usable_foot(sole), stance, step.side),
        regions={
            name: in_world(region, stance, step.side)
            for name, region in regions.items()
        },
        offsets=_offsets(schedule.footsteps, sole, params, omega),
        factor=_factor(schedule.footsteps, 0, params, omega),
        stance_A=A,
        stance_b=b + params.sole_clearance,
    )


def geometry_key(
    schedule: ContactSchedule, params: CaptureRegionStepAdjusterParams
) -> tuple[object, ...]:
    """The parts of `schedule`, and the switch, that its geometry depends on.

    While they are equal, the geometry is the same.  Where the step in the air
    goes is not among them, so that it can be adjusted.
    """
    step, *later = schedule.footsteps
    stance = schedule.feet[schedule.support_side]
    cross_over = params.reachability.cross_over
    return (cross_over, stance, step.side, step.pose.yaw, *later)


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


def counted_feet(
    steps: tuple[Footstep, ...],
    sole: Array,
    params: CaptureRegionStepAdjusterParams,
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


def _offsets(
    steps: tuple[Footstep, ...],
    sole: Array,
    params: CaptureRegionStepAdjusterParams,
    omega: float,
) -> tuple[Array, ...]:
    """Returns D_1, ..., D_N in W; N counts no more steps than are queued."""
    total = total_region(params.reachability)
    reaches = [  # about a foothold, the next swing foot is the other one
        in_world(total, FootPose(yaw=step.pose.yaw), following.side)
        for step, following in itertools.pairwise(steps[: params.num_steps])
    ]
    contractions = step_contractions(steps, params, omega)
    feet = counted_feet(steps, sole, params)
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
