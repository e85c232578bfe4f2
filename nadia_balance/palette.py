"""The colours of all drawings, in Meshcat and in plots.

Those that appear in one picture differ also for the colour-blind, by hue or by
lightness (tests/test_palette.py).
"""

from typing import NamedTuple

from pydrake.geometry import Rgba

from nadia_balance.core.walking.state import Side

LEFT = "#01625f"  # teal
RIGHT = "#e06a20"  # orange
ICP = "#3a5cf0"  # blue
ICP_REFERENCE = "#6cc0f8"  # light blue
COM = "#3fa066"  # green
COP = "#a6094f"  # magenta
ECMP = "#e3b505"  # yellow
SUPPORT = "#1d2129"  # black
PUSH = "#cc1b22"  # red
COMMAND = "#fff6b8"  # pale yellow
CAPTURE_REGIONS = ("#330660", "#83459a", "#a48fbd")  # C_1 to C_3: violets
OPACITIES = (0.45, 0.3, 0.3)  # of the filled regions, which overlap
REACH = "#54290f"  # brown
NOMINAL = "#777c85"  # nominal foothold of an adjusted step: grey
FLOOR = "#c9d0da"  # grey
GRID = "#aab4c2"  # darker grey
GROUND = "#8d9aab"  # regions to step on: still darker
SKY_TOP = "#f4f7fb"
SKY_BOTTOM = "#c3cedb"
# Floor and sky in a page that is dark.
NIGHT_FLOOR, NIGHT_GRID = "#aab3c0", "#8d98a7"
NIGHT_TOP, NIGHT_BOTTOM = "#171b22", "#39424f"


class Entry(NamedTuple):
    """How a thing is drawn: a sign that has its shape, and its colour."""

    sign: str
    color: str


BALL, BOX, FILL, OUTLINE, ARROW, BAND = "\u25cf\u25aa\u25a0\u25a1\u279c\u2501"
LEGEND = {
    "ICP": Entry(BALL, ICP),
    "ICP reference": Entry(BALL, ICP_REFERENCE),
    "CoM": Entry(BALL, COM),
    "CoP": Entry(BALL, COP),
    "eCMP": Entry(BOX, ECMP),
    "support polygon": Entry(OUTLINE, SUPPORT),
    "left foot": Entry(FILL, LEFT),
    "right foot": Entry(FILL, RIGHT),
    "push": Entry(ARROW, PUSH),
    "capture region C\N{SUBSCRIPT ONE}": Entry(FILL, CAPTURE_REGIONS[0]),
    "C\N{SUBSCRIPT TWO}": Entry(FILL, CAPTURE_REGIONS[1]),
    "C\N{SUBSCRIPT THREE}": Entry(FILL, CAPTURE_REGIONS[2]),
    "reachable": Entry(OUTLINE, REACH),
    "foothold as planned": Entry(OUTLINE, NOMINAL),
}
# What a live session draws besides.
LIVE_LEGEND = {
    "push to come": Entry(ARROW, "#f09aa2"),
    "commanded way": Entry(BAND, COMMAND),
}


def foot_color(side: Side) -> str:
    """Returns the colour of a foot.

    Args:
        side: side of the foot.

    Returns:
        The colour, as #rrggbb.
    """
    return LEFT if side is Side.LEFT else RIGHT


def rgb(color: str) -> tuple[float, float, float]:
    """Returns the parts of a colour.

    Args:
        color: colour, written #rrggbb.

    Returns:
        Red, green and blue in [0, 1].
    """
    return (
        int(color[1:3], 16) / 255.0,
        int(color[3:5], 16) / 255.0,
        int(color[5:7], 16) / 255.0,
    )


def rgba(color: str, alpha: float = 1.0) -> Rgba:
    """Returns Drake's form of a colour.

    Args:
        color: colour, written #rrggbb.
        alpha: opacity in [0, 1].

    Returns:
        The colour.
    """
    return Rgba(*rgb(color), alpha)
