"""A push: its force, direction and time."""

import functools
import re
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Phase, Side, WalkingState
from nadia_balance.parameters.bounds import bounded

# Rounding error of a clock that counts ticks.
TIME_TOLERANCE = 1e-9  # [s]
MOST_POINT = 3.0  # largest coordinate of a pushed point [m]
_PHASE = re.compile(r"(left|right) (swing|transfer) ([0-9]+(?:\.[0-9]*)?) ?%")
_TIME = re.compile(r"([0-9]+(?:\.[0-9]*)?) ?s")


@dataclass(frozen=True)
class Moment:
    """The begin of a push: at a fraction of a phase, or at a time."""

    phase: Phase | None = None  # swing or transfer
    swing: Side = Side.RIGHT  # swing foot, in a transfer the next one
    fraction: float = 0.0  # of the phase that has passed, in [0, 1]
    time: float = 0.0  # used without a phase [s]

    @classmethod
    @functools.cache
    def parse(cls, text: str) -> "Moment":
        """Returns the moment for text like `right swing 25 %` or `2.5 s`.

        Raises ValueError: `text` has another form, or is beyond 100 %.
        """
        if match := _PHASE.fullmatch(text.strip()):
            fraction = float(match[3]) / 100.0
            if fraction <= 1.0:
                return cls(Phase(match[2]), Side(match[1]), fraction)
        if match := _TIME.fullmatch(text.strip()):
            return cls(time=float(match[1]))
        raise ValueError(
            f'at = {text!r}: must be like "right swing 25 %", from 0 to '
            '100 %, or like "2.5 s"'
        )

    def __str__(self) -> str:
        """The text that `parse` reads as this moment, to nine decimals."""
        if self.phase is None:
            return f"{_short(self.time)} s"
        percent = _short(100.0 * self.fraction)
        return f"{self.swing.value} {self.phase.value} {percent} %"


# Force over its peak, with x from 0 to 1 over the duration: 1; sin(pi x); x
# (quasi-static, if it is slow); sin(2 pi f t).
SHAPES = RECTANGLE, HALF_SINE, RAMP, SINE = (
    "rectangle",
    "half_sine",
    "ramp",
    "sine",
)


@dataclass(kw_only=True)
class Push:
    """A horizontal force on one body.

    Either `delta_v` or `force` is given.  The direction is relative to the
    heading of the support foot when the push begins.
    """

    body: str = ""  # pushed at its centre of mass; empty: the robot's base
    # Point (3,) [m] of the body, in its frame, at which the force acts instead,
    # so that it has a moment about the centre of mass.
    point: list[float] | None = None
    # Velocity change of the total mass.
    delta_v: float | None = bounded(None, least=0.0, most=100.0, unit="m/s")
    # Peak force.
    force: float | None = bounded(None, least=0.0, most=1e5, unit="N")
    shape: str = bounded(RECTANGLE, one_of=SHAPES)
    # Frequency of a sine.
    frequency: float = bounded(1.0, above=0.0, most=50.0, unit="Hz")
    duration: float = bounded(0.1, above=0.0, most=60.0, unit="s", of="")
    # Direction: 0 forward, 90 left [deg].
    direction_deg: float = bounded(0.0, least=-3600.0, most=3600.0)
    at: str = ""  # such as "right swing 25 %" or "2.5 s" (see Moment)
    # Least number of steps taken before the phase of the push [-].
    after_steps: int = bounded(0, least=0, most=1000)
    # Delay after the time of `at`, for replicas.
    delay: float = bounded(0.0, least=0.0, unit="s")

    @property
    def moment(self) -> Moment:
        """The Moment of `at`."""
        return Moment.parse(self.at)

    def validate_more(self) -> None:
        """Raises ValueError for inconsistent fields."""
        if (self.delta_v is None) == (self.force is None):
            raise ValueError(
                f"delta_v = {self.delta_v}, force = {self.force}: must give "
                "exactly one of them"
            )
        if self.shape == SINE and self.force is None:
            raise ValueError(
                f"delta_v = {self.delta_v}: must be null for a {SINE}, which "
                "has a force"
            )
        point = self.point or [0.0] * 3
        if len(point) != 3 or not all(abs(x) <= MOST_POINT for x in point):
            raise ValueError(
                f"point = {self.point}: must be three coordinates within "
                f"+-{MOST_POINT:g} m"
            )
        Moment.parse(self.at)

    def shares(self, period: float) -> Array:
        """Returns force / peak (n,) at the middle of each tick.

        Ticks last `period` [s].
        """
        n = max(round(self.duration / period), 1)
        x = (np.arange(n) + 0.5) / n
        if self.shape == HALF_SINE:
            return np.sin(np.pi * x)
        if self.shape == RAMP:
            return x
        if self.shape == SINE:
            return np.sin(2.0 * np.pi * self.frequency * n * period * x)
        return np.ones(n)

    def effective_duration(self, period: float) -> float:
        """Returns how long the peak force has the same impulse [s]."""
        return self.duration * float(np.mean(self.shares(period)))

    def newtons(self, mass: float, period: float) -> float:
        """Returns the peak force [N] on a robot of this mass [kg].

        The impulse over all ticks of `period` [s] is m delta_v.
        """
        if self.force is not None:
            return self.force
        assert self.delta_v is not None
        return mass * self.delta_v / self.effective_duration(period)

    def is_due(self, time: float, state: WalkingState, period: float) -> bool:
        """True if the push begins at or before `time` [s], without `delay`.

        It is due at the latest in the last tick of its phase, less than 1.5
        `period` [s] before the end, as durations are rounded to ticks.
        """
        moment = self.moment
        if moment.phase is None:
            return time >= moment.time - TIME_TOLERANCE
        duration = state.schedule.duration
        start = min(moment.fraction * duration, duration - 1.5 * period)
        passed = state.time_in_phase >= start - TIME_TOLERANCE
        return passed and self.is_in_phase(state)

    def is_in_phase(self, state: WalkingState) -> bool:
        """True in the phase in which the push begins."""
        moment = self.moment
        return moment.phase is not None and (
            state.schedule.phase is moment.phase
            and state.schedule.support_side.other is moment.swing
            and state.steps_taken >= self.after_steps
        )


def random_pushes(
    number: int,
    seed: int,
    largest: float,
    pause: tuple[float, float] = (1.0, 3.0),
) -> list[Push]:
    """Returns pushes in random directions after pauses of random length.

    The first is a `pause` [s] after 1 s; each is at most `largest` [m/s].
    mjlab trains policies with such pushes.
    """
    rng, time, pushes = np.random.default_rng(seed), 1.0, []
    for _ in range(number):
        time += rng.uniform(*pause)
        size, angle = rng.uniform(0.0, [largest, 360.0])
        size, angle, at = round(size, 3), round(angle, 1), f"{time:.2f} s"
        pushes.append(Push(delta_v=size, direction_deg=angle, at=at))
    return pushes


def _short(value: float) -> str:
    return f"{value:.9f}".rstrip("0").rstrip(".")
