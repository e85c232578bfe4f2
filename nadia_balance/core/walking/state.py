"""Data types of walking: feet, phases, steps, walking state.

All values are frozen and their arrays read-only, because Drake passes the same
object to every reader of an abstract port, and clones of a Context share it.
Types that hold arrays compare by identity, except FootPose.
"""

from __future__ import annotations

import enum
import functools
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np

from nadia_balance.core.math.arrays import Array, read_only
from nadia_balance.core.math.polygon import convex_hull

_KEPT = 8  # support polygons: a foothold that moves changes none


class Side(enum.Enum):
    """Left or right, as seen by the robot."""

    LEFT = "left"
    RIGHT = "right"

    @property
    def other(self) -> Side:
        """The opposite side."""
        return Side.RIGHT if self is Side.LEFT else Side.LEFT

    @property
    def sign(self) -> int:
        """Sign of the lateral (y) coordinate of this side: left is +1."""
        return 1 if self is Side.LEFT else -1

    @property
    def index(self) -> int:
        """Its number in an array of both sides; left is 0."""
        return 0 if self is Side.LEFT else 1

    @classmethod
    def of_sign(cls, sign: float) -> Side:
        """The side of a lateral coordinate.

        Args:
            sign: > 0 for the left side.

        Returns:
            The side.
        """
        return cls.LEFT if sign > 0.0 else cls.RIGHT


class Phase(enum.Enum):
    """Contact phases of the gait."""

    STANDING = "standing"  # both feet carry, no step has started
    TRANSFER = "transfer"  # both feet carry, weight moves to support_side
    SWING = "swing"  # support_side carries, the other foot is in the air


class Mode(enum.Enum):
    """What the robot does with its feet, as a user would say it."""

    STANDING = "standing"  # no step is queued
    WALKING = "walking"  # it steps where it was told
    RECOVERING = "recovering"  # it steps where it must, not to fall


def tilt(normal: Array) -> Array:
    """The shortest rotation R with R (0, 0, 1) = normal.

    Args:
        normal: unit vector (3,), upward.

    Returns:
        R (3, 3).
    """
    x, y, z = normal.tolist()
    c = 1.0 / (1.0 + z)
    return np.array(
        [
            [1.0 - c * x * x, -c * x * y, x],
            [-c * x * y, 1.0 - c * y * y, y],
            [-x, -y, z],
        ]
    )


UPRIGHT = read_only([0.0, 0.0, 1.0], 3)


class Immutable:
    """A frozen value, shared by the clones of a Context."""

    def __deepcopy__(self, memo: object) -> Self:
        return self


@dataclass(frozen=True, eq=False)
class FootPose(Immutable):
    """Pose of a sole: its centre p_WF (3,) [m] and its yaw [rad], in W.

    The sole frame F is z-up with x along the foot and y to the left.  The
    rotation of a tilted sole with the unit `normal` (3,) is
    R = tilt(normal) Rz(yaw); F itself stays level.  Poses compare by value.
    """

    p_WF: Array = field(default_factory=lambda: np.zeros(3))
    yaw: float = 0.0
    normal: Array = field(default_factory=lambda: UPRIGHT)

    def __post_init__(self) -> None:
        object.__setattr__(self, "p_WF", read_only(self.p_WF, 3))
        x, y, z = self.p_WF.tolist()
        if not math.isfinite(x + y + z + self.yaw):
            raise ValueError(
                f"p_WF = {[x, y, z]}, yaw = {self.yaw}: must be finite"
            )
        if self.normal is not UPRIGHT:
            object.__setattr__(self, "normal", read_only(self.normal, 3))
            if not np.isfinite(self.normal).all():
                raise ValueError(f"normal = {self.normal}: must be finite")

    @cached_property
    def _values(self) -> tuple[float, ...]:
        return (*self.p_WF.tolist(), self.yaw, *self.normal.tolist())

    def __eq__(self, other: object) -> bool:
        return self is other or (
            isinstance(other, FootPose) and self._values == other._values
        )

    def __hash__(self) -> int:
        return hash(self._values)

    @cached_property
    def rotation(self) -> Array:
        """R_WF restricted to the plane, shape (2, 2)."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return read_only([[c, -s], [s, c]], (2, 2))

    def to_world(self, points_F: Array) -> Array:
        """p_W = p_WF + R_WF p_F.

        Args:
            points_F: points p_F (..., 2) in F [m].

        Returns:
            Points p_W (..., 2) in W [m].
        """
        return np.asarray(self.p_WF[:2] + points_F @ self.rotation.T)

    def outline(self, sole: Array) -> Array:
        """The tilted sole, seen from above.

        Args:
            sole: corners (n, 2) in its own frame [m].

        Returns:
            Corners (n, 2) in W [m].
        """
        seen = tilt(self.normal)[:2, :2] @ self.rotation
        return np.asarray(self.p_WF[:2] + sole @ seen.T)

    def to_sole(self, points_W: Array) -> Array:
        """p_F = R_FW (p_W - p_WF).

        Args:
            points_W: points p_W (..., 2) in W [m].

        Returns:
            Points p_F (..., 2) in F [m].
        """
        return np.asarray((points_W - self.p_WF[:2]) @ self.rotation)

    def displaced(self, x: float, y: float, yaw: float = 0.0) -> FootPose:
        """A level frame that is given in F.

        Args:
            x: forward in F [m].
            y: to the left in F [m].
            yaw: relative to F [rad].

        Returns:
            The frame at the same height.
        """
        return FootPose(
            np.append(self.to_world(np.array([[x, y]]))[0], self.p_WF[2]),
            self.yaw + yaw,
        )


ORIGIN = FootPose()


@dataclass(frozen=True)
class FootPoses(Immutable):
    """The poses of both soles in W."""

    left: FootPose
    right: FootPose

    def __getitem__(self, side: Side) -> FootPose:
        return self.left if side is Side.LEFT else self.right

    def with_foot(self, side: Side, pose: FootPose) -> FootPoses:
        """These poses with one foot moved.

        Args:
            side: of the foot.
            pose: of its sole in W.

        Returns:
            New poses.
        """
        if side is Side.LEFT:
            return FootPoses(pose, self.right)
        return FootPoses(self.left, pose)


@dataclass(frozen=True)
class Footstep(Immutable):
    """One foothold, and the durations of the step to it."""

    side: Side  # of the swing foot
    pose: FootPose
    transfer_duration: float  # of the weight shift before the swing [s]
    swing_duration: float  # [s]
    reactive: bool = False  # it catches the robot; nobody has commanded it


@dataclass(frozen=True, eq=False)
class ReferencePoint(Immutable):
    """A sample of the reference motion, each (2,) in W: [m], [m/s]."""

    com: Array
    com_velocity: Array
    cop: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "com", read_only(self.com, 2))
        object.__setattr__(
            self, "com_velocity", read_only(self.com_velocity, 2)
        )
        object.__setattr__(self, "cop", read_only(self.cop, 2))


@dataclass(frozen=True)
class ContactSchedule(Immutable):
    """The input of the ICP plan; replaced only when it is re-planned.

    The present phase began at time 0.  `support_side` is the stance foot of a
    swing, and in a transfer the foot that receives the weight.  `footsteps`
    have not landed yet: in a swing, footsteps[0] is in the air; a transfer
    without any ends between the feet.  The plan continues from `start`, the
    reference at `start_time`: the end of the previous phase, or a moved one.
    """

    phase: Phase
    support_side: Side
    duration: float  # of the present phase [s]; infinite when standing
    feet: FootPoses
    footsteps: tuple[Footstep, ...]
    start: ReferencePoint
    final_transfer_duration: float = 0.8  # after the last step [s]
    start_time: float = 0.0  # since the phase began [s]

    def in_contact(self, side: Side) -> bool:
        """Whether a foot carries weight in this phase.

        Args:
            side: of the foot.

        Returns:
            True for both but in a swing.
        """
        return self.phase is not Phase.SWING or side is self.support_side

    def preview(self, number: int) -> tuple[tuple[Footstep, ...], float]:
        """The next steps, and the transfer after them.

        Args:
            number: of steps at most.

        Returns:
            Steps, and the duration of the transfer [s].

        Raises:
            ValueError: a swing without a footstep.
        """
        steps = () if self.phase is Phase.STANDING else self.footsteps
        if self.phase is Phase.SWING and not steps:
            raise ValueError("footsteps = (): a swing needs one in the air")
        if len(steps) > number:
            return steps[:number], steps[number].transfer_duration
        return steps, self.final_transfer_duration

    @cached_property
    def legs_crossed(self) -> bool:
        """True if the other foot is (in swing: was) across the support foot."""
        side = self.support_side.other
        stance, p_WF = self.feet[self.support_side], self.feet[side].p_WF
        return bool(side.sign * stance.to_sole(p_WF[None, :2])[0, 1] < 0.0)


@dataclass(frozen=True)
class Adjustment(Immutable):
    """The adjusted pose of the next foothold, with its nominal step."""

    nominal: Footstep
    pose: FootPose
    region: str = "base"  # chosen reachability region; or forward, backward
    # Ticks since the capture region has covered the nominal foothold again.
    covered_ticks: int = 0
    later: tuple[Adjustment, ...] = ()  # of the steps after it
    ground: int = 0  # index of the ground region, 0 if it is flat
    prolonged: float = 0.0  # time [s] by which the swing may last longer

    @property
    def moved(self) -> bool:
        """True if the pose differs from the nominal one."""
        return self.pose != self.nominal.pose


@dataclass(frozen=True)
class WalkingState(Immutable):
    """The walking clock: the schedule and the present time in it."""

    schedule: ContactSchedule
    time_in_phase: float = 0.0  # [s], in [0, schedule.duration]
    elapsed: float = 0.0  # real time since the phase began [s]
    waiting: bool = False  # the clock has run out, the phase has not ended
    waited: float = 0.0  # waiting time for the ICP at a transfer's end [s]
    contact_impulse: float = 0.0  # of the swing foot, per weight [s]
    contact_time: float = 0.0  # of the foot that lands or has landed [s]
    steps_taken: int = 0
    adjustment: Adjustment | None = None  # of the next step

    @property
    def mode(self) -> Mode:
        """The mode: that of the next step, or of the one in the air."""
        steps = self.schedule.footsteps
        if not steps:
            return Mode.STANDING
        moved = self.adjustment is not None and self.adjustment.moved
        return Mode.RECOVERING if moved or steps[0].reactive else Mode.WALKING

    @property
    def remaining_time(self) -> float:
        """Planned time [s] until the present phase ends."""
        return max(self.schedule.duration - self.time_in_phase, 0.0)

    @property
    def gained_time(self) -> float:
        """Time [s] by which the clock leads real time; negative: it lags."""
        return self.time_in_phase - self.elapsed


def number_of_ticks(duration: float, period: float) -> int:
    """A duration in ticks, rounded.

    Args:
        duration: [s].
        period: length of a tick [s].

    Returns:
        Ticks, at least 1.
    """
    return max(round(duration / period), 1)


def whole_ticks(name: str, time: float, period: float) -> int:
    """A time in ticks, exactly.

    Args:
        name: what the message calls the time.
        time: [s].
        period: length of a tick [s].

    Returns:
        Ticks.

    Raises:
        ValueError: the time is no multiple of the period, or < 0.
    """
    ticks = round(time / period) if math.isfinite(time) else -1
    if ticks < 0 or abs(ticks * period - time) > 1e-9:
        raise ValueError(
            f"{name} = {time}: must be a multiple of {period} s, and >= 0"
        )
    return ticks


def support_polygon(schedule: ContactSchedule, sole: Array) -> Array:
    """The hull of the soles in contact.

    Args:
        schedule: feet and phase.
        sole: corners (k, 2) of either sole in its own frame [m].

    Returns:
        Vertices (n, 2) in W [m], counter-clockwise.
    """
    sides = tuple(side for side in Side if schedule.in_contact(side))
    return _hull_of_soles(schedule.feet, sides, sole.tobytes())


@functools.lru_cache(_KEPT)
def _hull_of_soles(
    feet: FootPoses, sides: tuple[Side, ...], sole: bytes
) -> Array:
    """Returns the read-only `support_polygon`, of the bytes of the corners."""
    corners = np.frombuffer(sole).reshape(-1, 2)
    hull = convex_hull(
        np.concatenate([feet[side].to_world(corners) for side in sides])
    )
    hull.flags.writeable = False
    return hull
