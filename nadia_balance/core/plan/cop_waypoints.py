"""The piecewise linear CoP reference through the next footsteps."""

import functools
import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import (
    Point,
    as_array,
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
from nadia_balance.parameters.bounds import bounded, parameters, require

_MIN_DURATION = 1e-5  # [s]; keeps the slope of every segment finite
_KEPT = 64  # routes, and as many points and polygons
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
        require(
            self.min_x <= self.max_x,
            f"min_x = {self.min_x}: must be <= max_x = {self.max_x}",
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


class _Phase(NamedTuple):
    points: list[Point]  # CoPs [m] in W at the ends of the segments
    shares: list[float]  # of the duration
    duration: float  # [s]
    feet: FootPoses  # soles in W
    # The feet that bound each of the points, without those at rest.
    carrying: Sequence[tuple[Side, ...]]


@dataclass(frozen=True, eq=False)
class CopRoute:
    """The CoP from the begin of the present phase to rest, from any start.

    Segment i ends in points[i] [m] in W, at the time ends[i] since the phase
    began, and lasts durations[i] [s].
    """

    phases: list[_Phase]
    points: list[Point]
    durations: list[float]
    ends: list[float]
    cop_points: "CopPoints"

    @cached_property
    def supports(self) -> list[Array]:
        """The polygons (n, 2) [m] in W that bound the first points.

        These are the points up to the end of the next phase, without those at
        rest.
        """
        return [
            self.cop_points.support(phase.feet, sides)
            for phase in self.phases[:2]
            for sides in phase.carrying
        ]


@dataclass(frozen=True, eq=False)
class CopWaypoints:
    """N linear CoP segments in W [m]."""

    points: Array  # (N + 1, 2), at which they meet
    knots: Array  # (N + 1,), times of the points since the phase began [s]
    durations: Array  # (N,) [s]
    route: CopRoute
    passed: int  # number of its segments before the start

    @property
    def supports(self) -> list[Array]:
        """Polygons (n, 2), within the margin, of points[1], points[2], ..."""
        return self.route.supports[self.passed :]


def cop_waypoints(
    schedule: ContactSchedule, cop_points: "CopPoints"
) -> CopWaypoints:
    """The CoP from schedule.start through the footsteps, and to rest.

    In a transfer the CoP moves via mid-transfer to the entry of the new stance
    foot; in a swing via the ball to the exit, where it stays; at the end it
    rests midway between the soles.

    Args:
        schedule: present phase, feet and footsteps.
        cop_points: CoP points in the robot's soles.

    Returns:
        The CoP segments from schedule.start_time on.

    Raises:
        ValueError: a swing without a footstep.
    """
    steps, final_transfer = schedule.preview(
        cop_points.params.num_previewed_steps
    )
    route = cop_points.route(
        schedule.phase, schedule.duration, schedule.feet, steps, final_transfer
    )
    start_time = schedule.start_time
    passed = min(
        bisect_right(route.ends, start_time), len(route.phases[0].shares) - 1
    )
    left = max(route.ends[passed] - start_time, _MIN_DURATION)
    durations = [left, *route.durations[passed + 1 :]]
    knots = [start_time + t for t in accumulate(durations, initial=0.0)]
    x, y = schedule.start.cop.tolist()
    return CopWaypoints(
        points=as_array([(x, y), *route.points[passed:]]),
        knots=np.array(knots),
        durations=np.array(durations),
        route=route,
        passed=passed,
    )


class CopPoints:
    """The segments of each phase, for feet on the ground.

    The last routes, points and polygons are kept: of a foothold that moves, the
    plan that is moved asks for them, and the one that follows it.
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
        self._points = {
            "entry": params.entry,
            "ball": params.ball,
            "exit": params.exit,
        }
        self.centroid = centroid(sole)
        self.inner = shrink(sole, params.margin, "margin")
        self._toe = float(sole[:, 0].max())
        self.route = functools.lru_cache(_KEPT)(self._route)
        self.support = functools.lru_cache(_KEPT)(self._support)
        self._cop = functools.lru_cache(_KEPT)(self._cop_of)

    def _route(
        self,
        phase: Phase,
        duration: float,
        feet: FootPoses,
        steps: tuple[Footstep, ...],
        final_transfer: float,
    ) -> CopRoute:
        """The CoP through a phase and the steps, and to rest.

        Args:
            phase: present phase.
            duration: of it; unless infinite, it overrides the footstep's [s].
            feet: soles in W as the phase begins.
            steps: steps to come.
            final_transfer: duration of the transfer after them [s].

        Returns:
            The route.
        """
        phases = []
        for i, step in enumerate(steps):
            if i > 0 or phase is Phase.TRANSFER:
                phases.append(self._transfer(feet, step))
            phases.append(self._swing(feet, step))
            feet = feet.with_foot(step.side, step.pose)
        phases.append(self._final_transfer(feet, final_transfer))
        if math.isfinite(duration):
            phases[0] = phases[0]._replace(duration=duration)
        points = [point for phase in phases for point in phase.points]
        times = [
            share * phase.duration for phase in phases for share in phase.shares
        ]
        durations = [max(t, _MIN_DURATION) for t in [*times, REST_DURATION]]
        return CopRoute(
            phases,
            points=[*points, points[-1]],
            durations=durations,
            ends=list(accumulate(durations)),
            cop_points=self,
        )

    def _transfer(self, feet: FootPoses, step: Footstep) -> _Phase:
        """The CoP moves to exit + mid_weight (entry - exit), then to the entry.

        Args:
            feet: soles in W as the transfer begins.
            step: step after the transfer; its other foot receives the weight.

        Returns:
            Two segments.
        """
        trailing, leading = step.side, step.side.other
        weight, split = self.params.mid_weight, self.params.transfer_split
        x, y = self._cop("exit", trailing, feet[trailing], feet[leading])
        entry = self._cop("entry", leading, feet[leading], feet[trailing])
        mid = x + weight * (entry[0] - x), y + weight * (entry[1] - y)
        return _Phase(
            points=[mid, entry],
            shares=[split, 1.0 - split],
            duration=step.transfer_duration,
            feet=feet,
            carrying=[tuple(Side), (leading,)],
        )

    def _swing(self, feet: FootPoses, step: Footstep) -> _Phase:
        """The CoP moves to the ball, then to the exit, where it stays.

        Args:
            feet: soles in W as the swing begins.
            step: step in the air.

        Returns:
            Three segments.
        """
        side = step.side.other
        ball = self._cop("ball", side, feet[side], step.pose)
        exit_ = self._cop("exit", side, feet[side], step.pose)
        shift = self.params.swing_shift_fraction
        split = self.params.swing_split
        return _Phase(
            points=[ball, exit_, exit_],
            shares=[shift * split, shift * (1.0 - split), 1.0 - shift],
            duration=step.swing_duration,
            feet=feet,
            carrying=3 * [(side,)],
        )

    def _final_transfer(self, feet: FootPoses, duration: float) -> _Phase:
        """The CoP moves to midway between the soles, where it stays.

        Args:
            feet: soles in W.
            duration: duration of the transfer [s].

        Returns:
            Two segments, of which the first has a support.
        """
        split = self.params.transfer_split
        left = feet.left.to_world(self.centroid)
        x, y = (0.5 * (left + feet.right.to_world(self.centroid))).tolist()
        return _Phase(
            points=[(x, y), (x, y)],
            shares=[split, 1.0 - split],
            duration=duration,
            feet=feet,
            carrying=[tuple(Side)],
        )

    def _support(self, feet: FootPoses, sides: tuple[Side, ...]) -> Array:
        """Returns the CoP polygon (n, 2) [m] in W for the feet of `sides`."""
        return convex_hull(
            np.concatenate([feet[side].to_world(self.inner) for side in sides])
        )

    def _cop_of(
        self, name: str, side: Side, foot: FootPose, other: FootPose
    ) -> Point:
        """Returns the CoP point [m] in W of a `foot` that `other` leads."""
        point, length = self._points[name], self.step_length(foot, other)
        x, y = foot.to_world(self.cop_point(point, side, length)).tolist()
        return x, y

    def step_length(self, foot: FootPose, other: FootPose) -> float:
        """Measures the step from toe to toe.

        Args:
            foot: stance foot in W.
            other: other foot in W.

        Returns:
            The distance by which `other` leads, along `foot` [m].
        """
        c, s = math.cos(foot.yaw), math.sin(foot.yaw)
        x, y, _ = (other.p_WF - foot.p_WF).tolist()
        turn, toe = other.yaw - foot.yaw, self._toe
        if turn:
            toes = self.corners @ np.array([math.cos(turn), -math.sin(turn)])
            toe = float(toes.max())
        return float(c * x + s * y + toe - self._toe)

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
