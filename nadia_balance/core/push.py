"""A push: how hard, which way, and when."""

import functools
import re
from dataclasses import dataclass

from nadia_balance.core.bounds import bounded
from nadia_balance.core.walking import Phase, Side, WalkingState

# A clock that counts ticks may miss a round number by a rounding error.
TIME_TOLERANCE = 1e-9  # [s]
_PHASE = re.compile(r"(left|right) (swing|transfer) (\d+(?:\.\d*)?) ?%")
_TIME = re.compile(r"(\d+(?:\.\d*)?) ?s")


@dataclass(frozen=True)
class Moment:
    """When a push begins: at a fraction of a phase, or at a time."""

    phase: Phase | None = None  # swing or transfer
    swing: Side = Side.RIGHT  # foot that swings, or will after the transfer
    fraction: float = 0.0  # of the phase that has passed, in [0, 1]
    time: float = 0.0  # if there is no phase [s]

    @classmethod
    @functools.cache
    def parse(cls, text: str) -> "Moment":
        """Returns what is meant by `right swing 25 %`, or by `2.5 s`.

        Raises:
            ValueError: `text` is not like that, or is of more than 100 %.
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
        """The text from which `parse` makes this moment, to nine decimals."""
        if self.phase is None:
            return f"{_short(self.time)} s"
        percent = _short(100.0 * self.fraction)
        return f"{self.swing.value} {self.phase.value} {percent} %"


@dataclass(kw_only=True)
class Push:
    """A constant horizontal force on one body.

    Either `delta_v` or `force` tells how hard.  The direction is relative to
    the heading of the support foot when the push begins.
    """

    body: str = ""  # pushed at its centre of mass; empty: the robot's base
    delta_v: float | None = bounded(None, least=0.0, unit="m/s")  # of the mass
    force: float | None = bounded(None, least=0.0, unit="N")
    duration: float = bounded(0.1, above=0.0, unit="s", of="")
    direction_deg: float = 0.0  # 0 forward, 90 left [deg]
    at: str = ""  # such as "right swing 25 %" or "2.5 s" (see Moment)
    # Not in a phase before so many steps are taken [-].
    after_steps: int = bounded(0, least=0)
    # Later than said above, for replicas.
    delay: float = bounded(0.0, least=0.0, unit="s")

    @property
    def moment(self) -> Moment:
        """What `at` means."""
        return Moment.parse(self.at)

    def validate_more(self) -> None:
        """Raises ValueError for fields that do not go together."""
        if (self.delta_v is None) == (self.force is None):
            raise ValueError(
                f"delta_v = {self.delta_v}, force = {self.force}: must give "
                "exactly one of them"
            )
        Moment.parse(self.at)

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
        moment = self.moment
        if moment.phase is None:
            return time >= moment.time - TIME_TOLERANCE
        duration = state.schedule.duration
        start = min(moment.fraction * duration, duration - 1.5 * period)
        return (
            self.is_in_phase(state)
            and state.time_in_phase >= start - TIME_TOLERANCE
        )

    def is_in_phase(self, state: WalkingState) -> bool:
        """True in the phase in which the push is to begin."""
        moment = self.moment
        return (
            state.schedule.phase is moment.phase
            and state.schedule.support_side.other is moment.swing
            and state.steps_taken >= self.after_steps
        )


def _short(value: float) -> str:
    return f"{value:.9f}".rstrip("0").rstrip(".")
