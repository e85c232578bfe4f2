"""The piecewise linear CoP reference through the next footsteps."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from nadia_balance.core.math import polygon
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking import state as walking
from nadia_balance.core.walking.state import FootPose, FootPoses, Side
from nadia_balance.parameters.bounds import bounded

_MIN_DURATION = 1e-5  # [s]; keeps the slope of every segment finite
REST_DURATION = 10.0  # [s]; long enough to count as infinite


@dataclass(kw_only=True)
class CopPointParams:
    """One CoP point relative to the sole's centroid: x forward, y to the left.

    x = clamp(step_length_factor * step length, min_x, max_x), and y is
    offset_inside toward the other foot.
    """

    offset_inside: float = bounded(0.0, unit="m", of="sole_width")
    step_length_factor: float = 0.0  # [-]
    min_x: float = bounded(0.0, unit="m", of="sole_length")
    max_x: float = bounded(0.0, unit="m", of="sole_length")

    def validate_more(self) -> None:
        """Raises ValueError if the range of x is empty."""
        if self.min_x > self.max_x:
            raise ValueError(
                f"min_x = {self.min_x}: must be <= max_x = {self.max_x}"
            )


@dataclass(kw_only=True)
class IcpPlanParams:
    """Parameters of the ICP plan: where and when the CoP is in each phase."""

    entry: CopPointParams = field(
        default_factory=lambda: CopPointParams(
            offset_inside=-0.005,
            step_length_factor=1.0 / 3.0,
            min_x=-0.04,
            max_x=0.03,
        )
    )
    ball: CopPointParams = field(
        default_factory=lambda: CopPointParams(
            offset_inside=0.010, step_length_factor=0.125, max_x=0.055
        )
    )
    exit: CopPointParams = field(
        default_factory=lambda: CopPointParams(
            offset_inside=0.025, step_length_factor=1.0 / 3.0, max_x=0.08
        )
    )
    # Margin of the points to the edge of the sole.
    margin: float = bounded(0.01, least=0.0, unit="m", of="sole_width")
    # Weight of the leading foot's entry in the mid-transfer point.
    mid_weight: float = bounded(0.5, above=0.0, below=1.0)
    # Shares: of a transfer before its mid-point, of the swing's CoP shift
    # before the ball, and of a swing before the exit.
    transfer_split: float = bounded(0.5, above=0.0, below=1.0)
    swing_split: float = bounded(0.5, above=0.0, below=1.0)
    swing_shift_fraction: float = bounded(0.85, above=0.0, below=1.0)
    num_previewed_steps: int = bounded(3, least=1)


@dataclass(frozen=True, eq=False)
class CopWaypoints:
    """N linear CoP segments in W [m]."""

    points: Array  # (N + 1, 2), at which they meet
    durations: Array  # (N,) [s]
    start_time: float  # of the schedule [s]
    # Polygons (n, 2), within the margin, that bound points[1], points[2], ...
    # up to the end of the next phase, without the points at rest.
    supports: list[Array]

    @property
    def knots(self) -> Array:
        """Times (N + 1,) [s] of the points since the phase began."""
        times = np.append(0.0, self.durations)
        return np.asarray(self.start_time + np.cumsum(times))


def cop_waypoints(
    schedule: walking.ContactSchedule, params: IcpPlanParams, sole: Array
) -> CopWaypoints:
    """Returns the CoP from schedule.start through the footsteps, and to rest.

    In a transfer the CoP moves via mid-transfer to the entry of the new stance
    foot; in a swing via the ball to the exit, where it stays; at the end it
    rests midway between the soles, with the corners `sole` (k, 2) [m].

    Raises ValueError: a swing without a footstep, or no sole within the margin.
    """
    steps, last = schedule.preview(params.num_previewed_steps)
    feet, stance = schedule.feet, Stance(params, sole)
    phases = []
    for i, step in enumerate(steps):
        if i > 0 or schedule.phase is walking.Phase.TRANSFER:
            phases.append(stance.transfer(feet, step))
        phases.append(stance.swing(feet, step))
        feet = feet.with_foot(step.side, step.pose)
    phases.append(stance.final_transfer(feet, last))
    if math.isfinite(schedule.duration):  # overrides the footstep's
        phases[0] = phases[0]._replace(duration=schedule.duration)
    times = [share * p.duration for p in phases for share in p.shares]
    lasts = np.maximum([*times, REST_DURATION], _MIN_DURATION)
    ends, present = np.cumsum(lasts), len(phases[0].shares)
    over = int(np.searchsorted(ends, schedule.start_time, side="right"))
    over = min(over, present - 1)
    left = max(ends[over] - schedule.start_time, _MIN_DURATION)
    points = [point for phase in phases for point in phase.points]
    return CopWaypoints(
        np.array([schedule.start.cop, *points[over:], points[-1]]),
        np.append(left, lasts[over + 1 :]),
        schedule.start_time,
        [part for phase in phases[:2] for part in phase.supports][over:],
    )


class _Phase(NamedTuple):
    points: list[Array]  # CoPs (2,) [m] in W at the ends of the segments
    shares: list[float]  # of the duration
    duration: float  # [s]
    supports: list[Array]  # CoP polygons (n, 2) [m] in W of the points


class Stance:
    """The segments of each phase, for feet on the ground."""

    def __init__(self, params: IcpPlanParams, sole: Array) -> None:
        """Takes the corners `sole` (k, 2) [m] in the sole frame.

        Raises ValueError: the margin leaves no area of the sole.
        """
        self.params, self.corners = params, sole
        self.centroid = polygon.centroid(sole)
        self.inner = polygon.shrink(sole, params.margin, "margin")

    def transfer(self, feet: FootPoses, step: walking.Footstep) -> _Phase:
        """Returns the shift of the weight to the other foot of `step`."""
        leading, side, p = step.side.other, step.side, self.params
        exit_ = self._cop(p.exit, side, feet[side], feet[leading])
        entry = self._cop(p.entry, leading, feet[leading], feet[side])
        mid = exit_ + p.mid_weight * (entry - exit_)
        supports = [self._support(feet, *Side), self._support(feet, leading)]
        shares = [p.transfer_split, 1.0 - p.transfer_split]
        return _Phase([mid, entry], shares, step.transfer_duration, supports)

    def swing(self, feet: FootPoses, step: walking.Footstep) -> _Phase:
        """Returns the swing of `step`."""
        support, p = step.side.other, self.params
        ball, exit_ = (
            self._cop(point, support, feet[support], step.pose)
            for point in (p.ball, p.exit)
        )
        shift, split = p.swing_shift_fraction, p.swing_split
        shares = [shift * split, shift * (1.0 - split), 1.0 - shift]
        points, supports = [ball, exit_, exit_], [self._support(feet, support)]
        return _Phase(points, shares, step.swing_duration, 3 * supports)

    def final_transfer(self, feet: FootPoses, duration: float) -> _Phase:
        """Returns the shift to midway between the soles."""
        left, right = (feet[s].to_world(self.centroid) for s in Side)
        mid, split = 0.5 * (left + right), self.params.transfer_split
        supports = [self._support(feet, *Side)]
        return _Phase([mid, mid], [split, 1.0 - split], duration, supports)

    def _support(self, feet: FootPoses, *sides: Side) -> Array:
        """Returns the CoP polygon (n, 2) [m] in W for the feet of `sides`."""
        soles = [feet[side].to_world(self.inner) for side in sides]
        return polygon.convex_hull(np.concatenate(soles))

    def _cop(
        self, point: CopPointParams, side: Side, foot: FootPose, other: FootPose
    ) -> Array:
        length = self.step_length(foot, other)
        return foot.to_world(self.cop_point(point, side, length))

    def step_length(self, foot: FootPose, other: FootPose) -> float:
        """Returns the distance [m] from toe to toe by which `other` leads."""
        c, s = math.cos(foot.yaw), math.sin(foot.yaw)
        x, y, _ = other.p_WF - foot.p_WF
        turn = other.yaw - foot.yaw
        toes = self.corners @ np.array([math.cos(turn), -math.sin(turn)])
        return float(c * x + s * y + toes.max() - self.corners[:, 0].max())

    def cop_point(
        self, params: CopPointParams, side: Side, step_length: float
    ) -> Array:
        """Returns the CoP point (2,) [m] in the sole frame of `side`."""
        x = params.step_length_factor * step_length
        x = min(max(x, params.min_x), params.max_x)
        offset = np.array([x, -side.sign * params.offset_inside])
        return polygon.project(self.centroid + offset, self.inner)
