"""Conversion of any robot's URDF or MJCF to a robot folder (extra `robots`)."""

from dataclasses import dataclass


@dataclass
class Named:
    """Names given by the user; parts with an empty name are identified."""

    pelvis: str = ""
    torso: str = ""
    left_foot: str = ""
    right_foot: str = ""
    hip_pitch: str = ""  # "left,right"
    knee: str = ""
    ankle_pitch: str = ""


class Notes:
    """Lines on guessed, changed and unknown properties, and warnings."""

    KINDS = ("guessed", "changed", "unknown", "warning")

    def __init__(self):
        self._found = {kind: {} for kind in self.KINDS}

    def add(self, kind: str, line: str, *names: str) -> None:
        """Adds a line of one of KINDS; names join those of the same line."""
        self._found[kind].setdefault(line, []).extend(names)

    def of(self, kind: str) -> list[str]:
        """The lines of a kind, with their names."""
        found = [(k, ", ".join(v)) for k, v in self._found[kind].items()]
        return [f"{line}: {names}" if names else line for line, names in found]

    def lines(self) -> list[str]:
        """All lines, each with its kind as prefix."""
        return [f"{kind}: {x}" for kind in self.KINDS for x in self.of(kind)]
