"""Footsteps from what a user commands: a step vector, or a list of steps."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import (
    FootPose,
    FootPoses,
    Footstep,
    Side,
)


@dataclass(kw_only=True)
class StepVector:
    """Where the next step goes, in the frame between the feet."""

    length: float = 0.0  # forward [m]
    sideways: float = 0.0  # to the left [m]
    yaw_deg: float = 0.0  # turn to the left [deg]

    def validate(self) -> None:
        """Raises ValueError if a field is not finite."""
        _check_finite(self, "length", "sideways", "yaw_deg")


@dataclass(kw_only=True)
class Foothold:
    """A foothold in the frame between the feet at the start."""

    side: str = "left"  # the foot that moves: left or right
    x: float = 0.0  # sole centre, forward [m]
    y: float = 0.0  # sole centre, to the left [m]
    yaw_deg: float = 0.0  # [deg]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        _check_side(self, "side")
        _check_finite(self, "x", "y", "yaw_deg")


@dataclass(kw_only=True)
class Gait:
    """A walking command.

    Either `num_steps` times the same `step`, or the list `steps`, or the list
    `footholds`, in which the feet take turns; only one of the three.
    """

    num_steps: int = 0  # times `step` [-]
    step: StepVector = field(default_factory=StepVector)
    steps: list[StepVector] = field(default_factory=list)
    footholds: list[Foothold] = field(default_factory=list)
    # Between the sole centres; None: as the robot stands. [m]
    step_width: float | None = None
    first_swing: str = "right"  # the foot that moves first: left or right
    swing_duration: float = 0.7  # [s]
    transfer_duration: float = 0.3  # [s]
    initial_transfer_duration: float = 0.8  # of the first step [s]
    final_transfer_duration: float = 0.8  # after the last step [s]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        if self.num_steps < 0:
            raise ValueError(f"num_steps = {self.num_steps}: must be >= 0")
        given = [self.num_steps > 0, bool(self.steps), bool(self.footholds)]
        if sum(given) > 1:
            raise ValueError(
                "gait: give only one of num_steps, steps, footholds"
            )
        for name in (
            "swing_duration",
            "transfer_duration",
            "initial_transfer_duration",
            "final_transfer_duration",
        ):
            value = getattr(self, name)
            if not 0.02 <= value <= 10.0:
                raise ValueError(f"{name} = {value}: must be in [0.02, 10] s")
        width = self.step_width
        if width is not None and not 0.0 < width < 1.0:
            raise ValueError(f"step_width = {width}: must be in (0, 1) m")
        _check_side(self, "first_swing")
        self._validate_steps()

    def _validate_steps(self) -> None:
        parts: list[tuple[str, StepVector | Foothold]] = [("step", self.step)]
        parts += [(f"steps[{i}]", v) for i, v in enumerate(self.steps)]
        parts += [(f"footholds[{i}]", f) for i, f in enumerate(self.footholds)]
        for name, part in parts:
            try:
                part.validate()
            except ValueError as error:
                raise ValueError(f"{name}.{error}") from None
        for i, (last, hold) in enumerate(itertools.pairwise(self.footholds), 1):
            if hold.side == last.side:
                raise ValueError(
                    f"footholds[{i}].side = {hold.side!r}: must be "
                    f"{Side(hold.side).other.value}, as the feet take turns"
                )


def _check_finite(part: object, *names: str) -> None:
    for name in names:
        if not math.isfinite(value := getattr(part, name)):
            raise ValueError(f"{name} = {value}: must be finite")


def _check_side(part: object, name: str) -> None:
    if (side := getattr(part, name)) not in ("left", "right"):
        raise ValueError(f"{name} = {side!r}: must be left or right")


def make_footsteps(
    gait: Gait, feet: FootPoses, reach: ReachabilityParams
) -> tuple[Footstep, ...]:
    """Returns the footsteps of `gait` for a robot that stands at `feet`.

    Raises:
        ValueError: a field of `gait` is out of range, or a footstep is not
            within `reach` of the stance foot.
    """
    gait.validate()
    steps: list[Footstep] = []
    for side, pose in _poses(gait, feet):
        transfer = (
            gait.transfer_duration if steps else gait.initial_transfer_duration
        )
        steps.append(Footstep(side, pose, transfer, gait.swing_duration))
    _check(steps, feet, reach)
    return tuple(steps)


def middle(feet: FootPoses) -> FootPose:
    """The frame half-way between the soles."""
    left, right = feet.left, feet.right
    turn = math.remainder(right.yaw - left.yaw, math.tau)
    return FootPose(0.5 * (left.p_WF + right.p_WF), left.yaw + 0.5 * turn)


def _poses(gait: Gait, feet: FootPoses) -> Iterator[tuple[Side, FootPose]]:
    frame = middle(feet)
    if gait.footholds:
        for hold in gait.footholds:
            yaw = math.radians(hold.yaw_deg)
            yield Side(hold.side), _offset(frame, hold.x, hold.y, yaw)
        return
    vectors = list(gait.steps) or [gait.step] * gait.num_steps
    if vectors and vectors[-1] != StepVector():
        vectors.append(StepVector())  # the last step brings the feet together
    width = gait.step_width
    if width is None:
        width = math.dist(feet.left.p_WF[:2], feet.right.p_WF[:2])
    side = Side(gait.first_swing)
    for v in vectors:
        yaw = math.radians(v.yaw_deg)
        frame = _offset(frame, v.length, v.sideways, yaw)
        yield side, _offset(frame, 0.0, side.sign * 0.5 * width, 0.0)
        side = side.other


def _offset(frame: FootPose, x: float, y: float, yaw: float) -> FootPose:
    xy = frame.to_world(np.array([[x, y]]))[0]
    return FootPose(np.append(xy, frame.p_WF[2]), frame.yaw + yaw)


def _check(
    steps: list[Footstep], feet: FootPoses, reach: ReachabilityParams
) -> None:
    """Raises ValueError if a step is out of reach of the other foot."""
    for number, step in enumerate(steps, start=1):
        stance = feet[step.side.other]
        p_F = stance.to_sole(step.pose.p_WF[None, :2])[0]
        x, y = p_F[0], step.side.sign * p_F[1]
        if not reach.in_base_region(x, y):
            raise ValueError(
                f"step {number} ({step.side.value}): {x:.3f} m forward and "
                f"{y:.3f} m out of the stance foot: must be within "
                f"{reach.describe()}"
            )
        feet = feet.with_foot(step.side, step.pose)
