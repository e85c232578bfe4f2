"""The piecewise linear CoP reference through the next footsteps."""

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import (
    centroid,
    convex_hull,
    project,
    shrink,
)
from nadia_balance.core.walking.state import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    Side,
)
from nadia_balance.parameters.bounds import bounded, parameters

_MIN_DURATION = 1e-5  # [s]; keeps the slope of every segment finite
_KEPT = 64  # phases of each kind
REST_DURATION = 10.0  # [s]; long enough to count as infinite


@parameters
class CopPointParams:
    """One CoP point relative to the sole's centroid: x forward, y to the left.

    x = clamp(step_length_factor * step length, min_x, max_x), and y is
    offset_inside toward the other foot.
    """

    offset_inside: float = bounded(
        0.0, doc="offset toward the other foot", unit="m", of="sole_width"
    )
    step_length_factor: float = bounded(
        0.0, doc="forward offset per step length"
    )
    min_x: float = bounded(
        0.0, doc="least forward offset", unit="m", of="sole_length"
    )
    max_x: float = bounded(
        0.0, doc="largest forward offset", unit="m", of="sole_length"
    )

    def validate_more(self) -> None:
        """Checks the range of x.

        Raises:
            ValueError: it is empty.
        """
        if self.min_x > self.max_x:
            raise ValueError(
                f"min_x = {self.min_x}: must be <= max_x = {self.max_x}"
            )


@parameters
class IcpPlanParams:
    """Parameters of the ICP plan: where and when the CoP is in each phase."""

    entry: CopPointParams = bounded(
        lambda: CopPointParams(
            offset_inside=-0.005,
            step_length_factor=1.0 / 3.0,
            min_x=-0.04,
            max_x=0.03,
        ),
        doc="CoP at the end of a transfer, in the new stance foot",
    )
    ball: CopPointParams = bounded(
        lambda: CopPointParams(
            offset_inside=0.010, step_length_factor=0.125, max_x=0.055
        ),
        doc="CoP within a swing",
    )
    exit: CopPointParams = bounded(
        lambda: CopPointParams(
            offset_inside=0.025, step_length_factor=1.0 / 3.0, max_x=0.08
        ),
        doc="CoP at the end of a swing",
    )
    margin: float = bounded(
        0.01,
        doc="margin of the points to the edge of the sole",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    mid_weight: float = bounded(
        0.5,
        doc="weight of the leading foot's entry in the mid-transfer point",
        above=0.0,
        below=1.0,
    )
    transfer_split: float = bounded(
        0.5,
        doc="share of a transfer before its mid-point",
        above=0.0,
        below=1.0,
    )
    swing_split: float = bounded(
        0.5,
        doc="share of a swing's CoP shift before the ball",
        above=0.0,
        below=1.0,
    )
    swing_shift_fraction: float = bounded(
        0.85,
        doc="share of a swing before the exit: its CoP shift",
        above=0.0,
        below=1.0,
    )
    num_previewed_steps: int = bounded(
        3, doc="number of footsteps in the plan", least=1
    )


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
        return np.asarray(
            self.start_time + np.cumsum(np.append(0.0, self.durations))
        )


def cop_waypoints(schedule: ContactSchedule, stance: "Stance") -> CopWaypoints:
    """The CoP from schedule.start through the footsteps, and to rest.

    In a transfer the CoP moves via mid-transfer to the entry of the new stance
    foot; in a swing via the ball to the exit, where it stays; at the end it
    rests midway between the soles.

    Args:
        schedule: present phase, feet and footsteps.
        stance: CoP points in the robot's soles.

    Returns:
        The CoP segments from schedule.start_time on.

    Raises:
        ValueError: a swing without a footstep.
    """
    steps, final_transfer = schedule.preview(stance.params.num_previewed_steps)
    feet = schedule.feet
    phases = []
    for i, step in enumerate(steps):
        if i > 0 or schedule.phase is Phase.TRANSFER:
            phases.append(stance.transfer(feet, step))
        phases.append(stance.swing(feet, step))
        feet = feet.with_foot(step.side, step.pose)
    phases.append(stance.final_transfer(feet, final_transfer))
    if math.isfinite(schedule.duration):  # overrides the footstep's
        phases[0] = phases[0]._replace(duration=schedule.duration)
    times = [
        share * phase.duration for phase in phases for share in phase.shares
    ]
    durations = np.maximum([*times, REST_DURATION], _MIN_DURATION)
    ends = np.cumsum(durations)
    passed = min(
        int(np.searchsorted(ends, schedule.start_time, side="right")),
        len(phases[0].shares) - 1,
    )
    points = [point for phase in phases for point in phase.points]
    return CopWaypoints(
        points=np.array([schedule.start.cop, *points[passed:], points[-1]]),
        durations=np.append(
            max(ends[passed] - schedule.start_time, _MIN_DURATION),
            durations[passed + 1 :],
        ),
        start_time=schedule.start_time,
        supports=[
            support for phase in phases[:2] for support in phase.supports
        ][passed:],
    )


class _Phase(NamedTuple):
    points: list[Array]  # CoPs (2,) [m] in W at the ends of the segments
    shares: list[float]  # of the duration
    duration: float  # [s]
    supports: list[Array]  # CoP polygons (n, 2) [m] in W of the points


class Stance:
    """The segments of each phase, for feet on the ground.

    The last phases are kept: those of a foothold that moves are asked for
    several times, by the plan that is moved and by the one that follows it.
    """

    def __init__(self, params: IcpPlanParams, sole: Array) -> None:
        """Measures the sole.

        Args:
            params: CoP points, and their shares of the phases.
            sole: corners (k, 2) in the sole frame [m].

        Raises:
            ValueError: the margin leaves no area of the sole.
        """
        self.params, self.corners = params, sole
        self.centroid = centroid(sole)
        self.inner = shrink(sole, params.margin, "margin")
        self.transfer = functools.lru_cache(_KEPT)(self._transfer)
        self.swing = functools.lru_cache(_KEPT)(self._swing)
        self.final_transfer = functools.lru_cache(_KEPT)(self._final_transfer)

    def _transfer(self, feet: FootPoses, step: Footstep) -> _Phase:
        """The CoP moves to exit + mid_weight (entry - exit), then to the entry.

        Args:
            feet: soles in W as the transfer begins.
            step: step after the transfer; its other foot receives the weight.

        Returns:
            Two segments.
        """
        p, trailing, leading = self.params, step.side, step.side.other
        exit_ = self._cop(p.exit, trailing, feet[trailing], feet[leading])
        entry = self._cop(p.entry, leading, feet[leading], feet[trailing])
        return _Phase(
            points=[exit_ + p.mid_weight * (entry - exit_), entry],
            shares=[p.transfer_split, 1.0 - p.transfer_split],
            duration=step.transfer_duration,
            supports=[self._support(feet, *Side), self._support(feet, leading)],
        )

    def _swing(self, feet: FootPoses, step: Footstep) -> _Phase:
        """The CoP moves to the ball, then to the exit, where it stays.

        Args:
            feet: soles in W as the swing begins.
            step: step in the air.

        Returns:
            Three segments.
        """
        p, side = self.params, step.side.other
        ball = self._cop(p.ball, side, feet[side], step.pose)
        exit_ = self._cop(p.exit, side, feet[side], step.pose)
        shift, split = p.swing_shift_fraction, p.swing_split
        return _Phase(
            points=[ball, exit_, exit_],
            shares=[shift * split, shift * (1.0 - split), 1.0 - shift],
            duration=step.swing_duration,
            supports=3 * [self._support(feet, side)],
        )

    def _final_transfer(self, feet: FootPoses, duration: float) -> _Phase:
        """The CoP moves to midway between the soles, where it stays.

        Args:
            feet: soles in W.
            duration: duration of the transfer [s].

        Returns:
            Two segments, of which the first has a support.
        """
        left = feet.left.to_world(self.centroid)
        mid = 0.5 * (left + feet.right.to_world(self.centroid))
        return _Phase(
            points=[mid, mid],
            shares=[
                self.params.transfer_split,
                1.0 - self.params.transfer_split,
            ],
            duration=duration,
            supports=[self._support(feet, *Side)],
        )

    def _support(self, feet: FootPoses, *sides: Side) -> Array:
        """Returns the CoP polygon (n, 2) [m] in W for the feet of `sides`."""
        return convex_hull(
            np.concatenate([feet[side].to_world(self.inner) for side in sides])
        )

    def _cop(
        self, point: CopPointParams, side: Side, foot: FootPose, other: FootPose
    ) -> Array:
        return foot.to_world(
            self.cop_point(point, side, self.step_length(foot, other))
        )

    def step_length(self, foot: FootPose, other: FootPose) -> float:
        """Measures the step from toe to toe.

        Args:
            foot: stance foot in W.
            other: other foot in W.

        Returns:
            The distance by which `other` leads, along `foot` [m].
        """
        c, s = math.cos(foot.yaw), math.sin(foot.yaw)
        x, y, _ = other.p_WF - foot.p_WF
        turn = other.yaw - foot.yaw
        toes = self.corners @ np.array([math.cos(turn), -math.sin(turn)])
        return float(c * x + s * y + toes.max() - self.corners[:, 0].max())

    def cop_point(
        self, params: CopPointParams, side: Side, step_length: float
    ) -> Array:
        """Places a CoP: x = clamp(step_length_factor length, min_x, max_x).

        Args:
            params: offsets of the point.
            side: foot that it is in.
            step_length: distance by which the other foot leads [m].

        Returns:
            The point (2,) in the sole frame, within the margin [m].
        """
        x = min(
            max(params.step_length_factor * step_length, params.min_x),
            params.max_x,
        )
        offset = np.array([x, -side.sign * params.offset_inside])
        return project(self.centroid + offset, self.inner)
