"""When in a step a push begins, as people say it: `right swing 25 %`."""

import re
from dataclasses import dataclass

_WORDS = re.compile(r"(left|right) (swing|transfer) (\d+(?:\.\d*)?) ?%")


@dataclass(frozen=True, order=True)
class Moment:
    """A part of a swing or of a transfer."""

    phase: str  # swing or transfer
    side: str  # left or right: the foot that swings, or will after the transfer
    fraction: float  # of the phase that has passed, in [0, 1]

    @classmethod
    def parse(cls, text: str) -> "Moment":
        """Returns the moment that `text` names, such as `right swing 25 %`.

        Raises:
            ValueError: `text` is not like that, or is of more than 100 %.
        """
        match = _WORDS.fullmatch(text.strip())
        if not match:
            raise ValueError(f'at = {text!r}: must be like "right swing 25 %"')
        fraction = float(match[3]) / 100.0
        if fraction > 1.0:
            raise ValueError(f"fraction = {fraction}: must be in [0, 1]")
        return cls(phase=match[2], side=match[1], fraction=fraction)

    def __str__(self) -> str:
        """The words from which `parse` makes this moment, to 1e-9 %."""
        percent = f"{100.0 * self.fraction:.9f}".rstrip("0").rstrip(".")
        return f"{self.side} {self.phase} {percent} %"
