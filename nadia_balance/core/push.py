"""A push: how hard, which way, and when."""

import math
from dataclasses import dataclass

from nadia_balance.core.walking import Phase, WalkingState

PHASES = ("swing", "transfer")
SIDES = ("left", "right")
# A clock that counts ticks may miss a round number by a rounding error.
TIME_TOLERANCE = 1e-9  # [s]


@dataclass(kw_only=True)
class Push:
    """A constant horizontal force on one body.

    Either `delta_v` or `force` tells how hard; either `time` or `phase` when.
    The direction is relative to the heading of the support foot at that time.
    """

    body: str = ""  # pushed at its centre of mass; empty: the robot's base
    delta_v: float | None = None  # [m/s] of the whole robot's mass
    force: float | None = None  # [N]
    duration: float = 0.1  # [s]
    direction_deg: float = 0.0  # 0 forward, 90 left [deg]
    time: float | None = None  # of the start [s]
    phase: str | None = None  # swing or transfer
    side: str = "right"  # the foot that swings, or will after the transfer
    fraction: float = 0.25  # of the phase, when the push starts [-]
    after_steps: int = 0  # not before so many steps are taken [-]
    delay: float = 0.0  # later than said above, for replicas [s]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        _exactly_one("delta_v", self.delta_v, "force", self.force)
        _exactly_one("time", self.time, "phase", self.phase)
        for name in ("delta_v", "force", "time", "delay"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < math.inf:
                raise ValueError(f"{name} = {value}: must be finite and >= 0")
        if not 0.0 < self.duration < math.inf:
            raise ValueError(f"duration = {self.duration}: must be > 0 s")
        if not math.isfinite(self.direction_deg):
            raise ValueError(
                f"direction_deg = {self.direction_deg}: must be finite"
            )
        if self.phase not in (None, *PHASES):
            raise ValueError(
                f"phase = {self.phase!r}: must be one of {', '.join(PHASES)}"
            )
        if self.side not in SIDES:
            raise ValueError(f"side = {self.side!r}: must be left or right")
        if not 0.0 <= self.fraction <= 1.0:
            raise ValueError(f"fraction = {self.fraction}: must be in [0, 1]")
        if self.after_steps < 0:
            raise ValueError(f"after_steps = {self.after_steps}: must be >= 0")

    def newtons(self, mass: float) -> float:
        """The force [N] on a robot of this mass [kg]: m delta_v / duration."""
        if self.force is not None:
            return self.force
        assert self.delta_v is not None
        return mass * self.delta_v / self.duration

    def is_due(self, time: float, state: WalkingState, period: float) -> bool:
        """True if the push is to begin by `time` [s], apart from `delay`.

        Whatever the fraction, it is due in the last tick of its phase: the one
        that begins less than a `period` [s] and a half before the end, since
        the state machine rounds durations to ticks.
        """
        if self.time is not None:
            return time >= self.time - TIME_TOLERANCE
        duration = state.schedule.duration
        start = min(self.fraction * duration, duration - 1.5 * period)
        return (
            self.is_in_phase(state)
            and state.time_in_phase >= start - TIME_TOLERANCE
        )

    def is_in_phase(self, state: WalkingState) -> bool:
        """True in the phase in which the push is to begin."""
        return (
            self.phase is not None
            and state.schedule.phase is Phase(self.phase)
            and state.schedule.support_side.other.value == self.side
            and state.steps_taken >= self.after_steps
        )


def _exactly_one(a: str, value_a: object, b: str, value_b: object) -> None:
    if (value_a is None) == (value_b is None):
        raise ValueError(
            f"{a} = {value_a}, {b} = {value_b}: must give exactly one of them"
        )
