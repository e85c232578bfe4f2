"""What a user has to be told of a robot that was made."""

from dataclasses import dataclass, field


@dataclass
class Notes:
    """Lines, each of which says what and where."""

    guessed: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)

    def lines(self) -> list[str]:
        """All of them, each after the word that tells which."""
        words = ("guessed", "changed", "unknown")
        return [f"{w}: {line}" for w in words for line in getattr(self, w)]
