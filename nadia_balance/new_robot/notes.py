"""Notes to the user about a converted robot."""

from dataclasses import dataclass, field


@dataclass
class Notes:
    """Lines on guessed, changed and unknown properties."""

    guessed: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)

    def lines(self) -> list[str]:
        """All lines, each with its kind as prefix."""
        words = ("guessed", "changed", "unknown")
        return [f"{w}: {line}" for w in words for line in getattr(self, w)]
