"""Conversion of any robot's URDF or MJCF to a robot folder (extra `robots`)."""

from dataclasses import dataclass, field


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


@dataclass
class Notes:
    """Lines on guessed, changed and unknown properties, and warnings."""

    guessed: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    warning: list[str] = field(default_factory=list)

    def lines(self) -> list[str]:
        """All lines, each with its kind as prefix."""
        return [f"{w}: {line}" for w in vars(self) for line in vars(self)[w]]
