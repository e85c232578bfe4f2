"""What the user names, in place of what would be found."""

from dataclasses import dataclass


@dataclass
class Named:
    """Links and joints by name; empty: to be found."""

    pelvis: str = ""
    torso: str = ""
    left_foot: str = ""
    right_foot: str = ""
    hip_pitch: str = ""  # "left,right"
    knee: str = ""
    ankle_pitch: str = ""
