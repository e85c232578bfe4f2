"""The colours of all drawings, in Meshcat and in plots."""

from pydrake.geometry import Rgba

from nadia_balance.core.walking.state import Side

LEFT = "#0b8a8f"  # teal
RIGHT = "#e8632b"  # orange
ICP = "#2456d6"  # blue
ICP_REFERENCE = "#86a6f2"  # light blue
COM = "#259b4c"  # green
COP = "#b8157a"  # magenta
ECMP = "#d29a00"  # gold
SUPPORT = "#3d4552"  # slate
PUSH = "#d11f35"  # red
COMMAND = "#1f2a44"  # navy
CAPTURE_REGIONS = ("#4a0f8f", "#7d3cc9", "#a673e3")  # C_1 to C_3: violets
OPACITIES = (0.4, 0.25, 0.18)  # of the filled regions, which overlap
REACH = "#8a5a2b"  # brown
NOMINAL = "#626b78"  # nominal foothold of an adjusted step: grey
FLOOR = "#c9d0da"  # grey
GRID = "#aab4c2"  # darker grey
GROUND = "#8d9aab"  # regions to step on: still darker
SKY_TOP = "#f4f7fb"
SKY_BOTTOM = "#c3cedb"

LEGEND = {
    "ICP": ICP,
    "ICP reference": ICP_REFERENCE,
    "CoM": COM,
    "CoP": COP,
    "eCMP": ECMP,
    "support polygon": SUPPORT,
    "left foot": LEFT,
    "right foot": RIGHT,
    "push": PUSH,
    "capture region C\N{SUBSCRIPT ONE}": CAPTURE_REGIONS[0],
    "C\N{SUBSCRIPT TWO}": CAPTURE_REGIONS[1],
    "C\N{SUBSCRIPT THREE}": CAPTURE_REGIONS[2],
    "reachable": REACH,
    "foothold as planned": NOMINAL,
}
# What a live session draws besides.
LIVE_LEGEND = {"push to come": "#ed9aa4", "commanded way": COMMAND}
OUTLINED = ("support polygon", "reachable", "foothold as planned")  # of these


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
