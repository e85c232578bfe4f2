"""The piecewise linear CoP reference through the coming footsteps."""

import math
from dataclasses import dataclass, field

import numpy as np

from nadia_balance.core.cop_point import CopPointParams, Sole
from nadia_balance.core.walking import (
    Array,
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    Side,
)

_MIN_DURATION = 1e-5  # [s]; keeps the slope of every segment finite
_REST_DURATION = 10.0  # [s]; long enough to count as for ever


@dataclass(kw_only=True)
class CopWaypointParams:
    """Where the CoP goes in each phase, and when."""

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
    margin: float = 0.01  # of the points, from the edge of the sole [m]
    mid_weight: float = 0.5  # of the leading foot, in mid-transfer [-]
    transfer_split: float = 0.5  # share of a transfer until its middle [-]
    swing_split: float = 0.5  # share of the swing's shift until the ball [-]
    swing_shift_fraction: float = 0.85  # share of a swing until the exit [-]
    num_previewed_steps: int = 3  # [-]

    def validate(self) -> None:
        """Raises ValueError naming the field, its value and what is allowed."""
        for name in ("entry", "ball", "exit"):
            try:
                getattr(self, name).validate()
            except ValueError as error:
                raise ValueError(f"{name}.{error}") from None
        for name in (
            "mid_weight",
            "transfer_split",
            "swing_split",
            "swing_shift_fraction",
        ):
            _check(self, name, "in (0, 1)", 0.0 < getattr(self, name) < 1.0)
        _check(self, "margin", ">= 0", 0.0 <= self.margin < math.inf)
        _check(
            self, "num_previewed_steps", ">= 1", self.num_previewed_steps > 0
        )


def _check(
    params: CopWaypointParams, name: str, rule: str, holds: bool
) -> None:
    if not holds:
        raise ValueError(f"{name} = {getattr(params, name)}: must be {rule}")


@dataclass(frozen=True, eq=False)
class CopWaypoints:
    """N linear CoP segments; the first `num_present` are the present phase.

    They meet at `points` (N + 1, 2) [m] in W and last `durations` (N,) [s].
    `step_shares` (N + 1,) [-] is by how much a point moves with the foothold
    of the first footstep.
    """

    points: Array
    durations: Array
    num_present: int
    step_shares: Array


def cop_waypoints(
    schedule: ContactSchedule, sole: Array, params: CopWaypointParams
) -> CopWaypoints:
    """Returns the CoP through the present phase, the footsteps, and to rest.

    A transfer goes over mid-transfer to the entry of the new stance foot; a
    swing goes over the ball to the exit, and waits there; the end is at rest
    midway between the soles.  `sole` (k, 2) [m] are the corners of either sole.

    Raises:
        ValueError: a swing without a footstep, or no sole within the margin.
    """
    if schedule.phase is Phase.SWING and not schedule.footsteps:
        raise ValueError("footsteps = (): a swing needs the step in the air")
    path = _Path(schedule, sole, params)
    steps = () if schedule.phase is Phase.STANDING else schedule.footsteps
    for i, step in enumerate(steps[: params.num_previewed_steps]):
        if i > 0 or schedule.phase is Phase.TRANSFER:
            path.add_transfer(step.side.other, step.transfer_duration)
        path.add_swing(step.side, step.pose, step.swing_duration)
    unseen = steps[params.num_previewed_steps :]
    path.add_final_transfer(
        unseen[0].transfer_duration
        if unseen
        else schedule.final_transfer_duration
    )
    return path.waypoints()


class _Path:
    """Collects the segments, phase after phase, from schedule.start on."""

    def __init__(
        self, schedule: ContactSchedule, sole: Array, params: CopWaypointParams
    ) -> None:
        self._params = params
        self._sole = Sole.with_margin(sole, params.margin)
        self._feet: FootPoses = schedule.feet
        self._present_duration = schedule.duration
        self._points = [schedule.start.cop]
        self._shares = [0.0]
        # Whether a foot stands where the first footstep has put it.
        self._first = dict.fromkeys(Side, 0.0)
        self._num_steps = 0
        self._phases: list[list[float]] = []  # durations of the segments

    def add_transfer(self, support: Side, duration: float) -> None:
        """Appends the shift of the weight to the `support` foot."""
        trailing, leading = self._feet[support.other], self._feet[support]
        (exit_,) = self._cops(support.other, trailing, leading, "exit")
        (entry,) = self._cops(support, leading, trailing, "entry")
        mid = exit_ + self._params.mid_weight * (entry - exit_)
        split = self._params.transfer_split
        on_exit, on_entry = self._first[support.other], self._first[support]
        on_mid = on_exit + self._params.mid_weight * (on_entry - on_exit)
        self._add(
            [mid, entry], [on_mid, on_entry], [split, 1.0 - split], duration
        )

    def add_swing(self, side: Side, pose: FootPose, duration: float) -> None:
        """Appends the swing of the foot of `side` to `pose`."""
        support = side.other
        ball, exit_ = self._cops(
            support, self._feet[support], pose, "ball", "exit"
        )
        shift = self._params.swing_shift_fraction
        split = self._params.swing_split
        times = [shift * split, shift * (1.0 - split), 1.0 - shift]
        on_support = [self._first[support]] * 3
        self._add([ball, exit_, exit_], on_support, times, duration)
        self._feet = self._feet.with_foot(side, pose)
        self._first[side] = float(self._num_steps == 0)
        self._num_steps += 1

    def add_final_transfer(self, duration: float) -> None:
        """Appends the shift to midway between the soles, and a long rest."""
        centre = self._sole.centroid
        left, right = (self._feet[side].to_world(centre) for side in Side)
        mid = 0.5 * (left + right)
        split = self._params.transfer_split
        on_mid = 0.5 * sum(self._first.values())
        self._add([mid, mid], [on_mid] * 2, [split, 1.0 - split], duration)
        self._points.append(mid)
        self._shares.append(on_mid)

    def waypoints(self) -> CopWaypoints:
        """Returns what has been collected."""
        durations = [d for phase in self._phases for d in phase]
        return CopWaypoints(
            np.array(self._points),
            np.maximum([*durations, _REST_DURATION], _MIN_DURATION),
            len(self._phases[0]),
            np.array(self._shares),
        )

    def _add(
        self,
        points: list[Array],
        step_shares: list[float],
        times: list[float],
        duration: float,
    ) -> None:
        """Appends a phase; `times` are the shares of its `duration` [s]."""
        # The schedule knows the present phase better than the footstep does.
        if not self._phases and math.isfinite(self._present_duration):
            duration = self._present_duration
        self._points += points
        self._shares += step_shares
        self._phases.append([share * duration for share in times])

    def _cops(
        self, side: Side, foot: FootPose, other: FootPose, *names: str
    ) -> list[Array]:
        """Returns the named CoP points (2,) [m] in W of the foot of `side`."""
        length = self._sole.step_length(foot, other)
        return [
            foot.to_world(
                self._sole.cop_point(getattr(self._params, name), side, length)
            )
            for name in names
        ]
