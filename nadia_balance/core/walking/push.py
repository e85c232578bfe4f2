"""A push: its force, direction and time."""

import functools
import math
import re
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import (
    Phase,
    Side,
    WalkingState,
    number_of_ticks,
)
from nadia_balance.parameters.bounds import bounded, parameters, require

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
        """Reads a moment.

        Args:
            text: such as `right swing 25 %` or `2.5 s`.

        Returns:
            The moment.

        Raises:
            ValueError: `text` has another form, or is beyond 100 %.
        """
        in_phase = _PHASE.fullmatch(text.strip())
        if in_phase:
            fraction = float(in_phase[3]) / 100.0
            if fraction <= 1.0:
                return cls(Phase(in_phase[2]), Side(in_phase[1]), fraction)
        at_time = _TIME.fullmatch(text.strip())
        if at_time:
            return cls(time=float(at_time[1]))
        raise ValueError(
            f'at = {text!r}: must be like "right swing 25 %", from 0 to '
            '100 %, or like "2.5 s"'
        )

    def __str__(self) -> str:
        """The text that `parse` reads as this moment, to nine decimals."""
        if self.phase is None:
            return f"{_short(self.time)} s"
        return (
            f"{self.swing.value} {self.phase.value} "
            f"{_short(100.0 * self.fraction)} %"
        )


# Force over its peak, with x from 0 to 1 over the duration: 1; sin(pi x); x
# (quasi-static, if it is slow); sin(2 pi f t).
SHAPES = RECTANGLE, HALF_SINE, RAMP, SINE = (
    "rectangle",
    "half_sine",
    "ramp",
    "sine",
)


@parameters
class Push:
    """A force on one body.

    Either `delta_v` or `force` is given.  The direction is relative to the
    heading of the support foot when the push begins, or to a `frame`.
    """

    body: str = bounded(
        "", doc="pushed at its centre of mass; empty: the robot's base"
    )
    point: list[float] | None = bounded(
        None,
        doc="(3,) of the body, in its frame, in m, at which the force acts "
        "instead, so that it has a moment about the centre of mass",
    )
    delta_v: float | None = bounded(
        None,
        least=0.0,
        most=100.0,
        unit="m/s",
        doc="velocity change of the total mass",
    )
    force: float | None = bounded(
        None, least=0.0, most=1e5, unit="N", doc="peak force"
    )
    shape: str = bounded(RECTANGLE, one_of=SHAPES, doc="of the force over time")
    frequency: float = bounded(
        1.0, above=0.0, most=50.0, unit="Hz", doc="of a sine"
    )
    duration: float = bounded(
        0.1,
        above=0.0,
        most=60.0,
        unit="s",
        of="",
        doc="from the begin of the force to its end",
    )
    direction_deg: float = bounded(
        0.0,
        least=-3600.0,
        most=3600.0,
        doc="direction: 0 forward, 90 left, in degrees",
    )
    elevation_deg: float = bounded(
        0.0,
        least=-90.0,
        most=90.0,
        doc="its angle above the horizontal plane: 90 up, in degrees",
    )
    frame: str = bounded(
        "",
        doc="body in whose frame the direction is, and with which it turns; "
        "empty: that of the support foot, level, when the push begins",
    )
    at: str = bounded(
        "", doc='begin, such as "right swing 25 %" or "2.5 s" (see Moment)'
    )
    after_steps: int = bounded(
        0,
        least=0,
        most=1000,
        doc="least number of steps taken before the phase of the push",
    )
    delay: float = bounded(
        0.0,
        least=0.0,
        unit="s",
        doc="delay after the time of `at`, for replicas",
    )

    @property
    def moment(self) -> Moment:
        """The Moment of `at`."""
        return Moment.parse(self.at)

    def validate_more(self) -> None:
        """Checks conditions between fields.

        Raises:
            ValueError: fields are inconsistent.
        """
        require(
            (self.delta_v is None) != (self.force is None),
            f"delta_v = {self.delta_v}, force = {self.force}: must give "
            "exactly one of them",
        )
        require(
            self.shape != SINE or self.force is not None,
            f"delta_v = {self.delta_v}: must be null for a {SINE}, which "
            "has a force",
        )
        point = self.point or [0.0] * 3
        require(
            len(point) == 3 and all(abs(x) <= MOST_POINT for x in point),
            f"point = {self.point}: must be three coordinates within "
            f"+-{MOST_POINT:g} m",
        )
        Moment.parse(self.at)

    def along(self, heading: float) -> Array:
        """The unit vector of the force, in the frame of the heading.

        Args:
            heading: angle of its horizontal part [rad].

        Returns:
            The vector (3,) [-].
        """
        elevation = math.radians(self.elevation_deg)
        level = math.cos(elevation)
        return np.array(
            [
                level * math.cos(heading),
                level * math.sin(heading),
                math.sin(elevation),
            ]
        )

    def shares(self, period: float) -> Array:
        """The shape: force over peak force, at the middle of each tick.

        With the share x of the duration it is 1, sin(pi x), x or
        sin(2 pi frequency duration x).

        Args:
            period: length of a tick [s].

        Returns:
            Shares (n,) of n ticks [-].
        """
        n = number_of_ticks(self.duration, period)
        x = (np.arange(n) + 0.5) / n
        if self.shape == HALF_SINE:
            return np.sin(np.pi * x)
        if self.shape == RAMP:
            return x
        if self.shape == SINE:
            return np.sin(2.0 * np.pi * self.frequency * n * period * x)
        return np.ones(n)

    def effective_duration(self, period: float) -> float:
        """How long the peak force has the same impulse.

        Args:
            period: length of a tick [s].

        Returns:
            The mean of the shares times the duration [s].
        """
        return self.duration * float(np.mean(self.shares(period)))

    def newtons(self, mass: float, period: float) -> float:
        """The peak force: `force`, or m delta_v / effective_duration.

        Args:
            mass: m, of the robot [kg].
            period: length of a tick [s].

        Returns:
            Force [N] whose impulse over all ticks is m delta_v.
        """
        if self.force is not None:
            return self.force
        assert self.delta_v is not None
        return mass * self.delta_v / self.effective_duration(period)

    def is_due(self, time: float, state: WalkingState, period: float) -> bool:
        """Whether the push has begun, but for its `delay`.

        It is due at the latest in the last tick of its phase, less than 1.5
        periods before the end, as durations are rounded to ticks.

        Args:
            time: present time [s].
            state: present walking state.
            period: length of a tick [s].

        Returns:
            True if it begins at or before `time`.
        """
        moment = self.moment
        if moment.phase is None:
            return time >= moment.time - TIME_TOLERANCE
        duration = state.schedule.duration
        start = min(moment.fraction * duration, duration - 1.5 * period)
        return (
            state.time_in_phase >= start - TIME_TOLERANCE
            and self.is_in_phase(state)
        )

    def is_in_phase(self, state: WalkingState) -> bool:
        """Whether it is the phase in which the push begins.

        Args:
            state: present walking state.

        Returns:
            True in this phase, after `after_steps`.
        """
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
    """Pushes in random directions after pauses of random length.

    mjlab trains policies with such pushes.

    Args:
        number: of pushes.
        seed: of the random numbers.
        largest: velocity change of a push [m/s].
        pause: shortest and longest pause [s]; the first pause begins at 1 s.

    Returns:
        Pushes in the order of their times.
    """
    rng, time, pushes = np.random.default_rng(seed), 1.0, []
    for _ in range(number):
        time += rng.uniform(*pause)
        size, angle = rng.uniform(0.0, [largest, 360.0])
        pushes.append(
            Push(
                delta_v=round(size, 3),
                direction_deg=round(angle, 1),
                at=f"{time:.2f} s",
            )
        )
    return pushes


def _short(value: float) -> str:
    return f"{value:.9f}".rstrip("0").rstrip(".")
