"""What all pictures of an envelope have in common."""

from diagrams.envelope.envelope_data import ORDER, WORDS, Envelope
from diagrams.envelope.moment import Moment
from nadia_balance.systems import palette

# One hue, the darker the more mechanisms: told apart without colours, too.
COLORS = dict(
    zip(
        ORDER,
        ("#b5cdf5", "#82a8ee", "#4f80e4", palette.ICP, "#102a78"),
        strict=True,
    )
)
NAMES = {
    "icp_only": "ankles and hips only",
    "step": "+ where to step",
    "step_swing": "+ when to land",
    "step_swing_transfer": "+ when to lift off",
    "all_with_cross_over": "+ crossing the legs",
}
PLANTS = {"humanoid": "whole body", "lipm": "point mass"}
PAPER_LINE = {"color": "#3d4552", "ls": (0, (4, 2)), "lw": 1.5}
PAPER_LABEL = "the Nadia paper's, Fig. 10"
PAPER_BAR = {"fc": "#9aa1ad", "ec": "#3d4552", "lw": 0.8, "hatch": "////"}
SEARCHED_LABEL = "still being searched"
LIMIT = "#8a93a3"
LIMIT_LABEL = "beyond the limit of any\ncontroller on a point\nmass 1 m high"
LIMIT_BAR_LABEL = "limit of any controller on a point mass 1 m high"
BEYOND = "#eceef2"


def title(envelope: Envelope, what: str) -> str:
    """Says what is seen, of which robot."""
    plant = PLANTS.get(envelope.plant, envelope.plant)
    return f"{what}   ·   {envelope.robot}, {plant}"


def key_name(envelope: Envelope, mechanisms: str) -> str:
    """What it adds to those before it; its name if one of them is missing."""
    before = ORDER[: ORDER.index(mechanisms)]
    stacked = set(before) <= set(envelope.mechanisms)
    return NAMES[mechanisms] if stacked else mechanisms


def tint(color: str) -> list[float]:
    """Red, green and blue of a pale, opaque version of a colour."""
    return [1.0 - 0.2 * (1.0 - part) for part in palette.rgb(color)]


def inward(moment: Moment) -> float:
    """The direction [deg] that points from the swing foot to the other."""
    return 90.0 if moment.side == "right" else 270.0


def direction_name(direction: float, moment: Moment) -> str:
    """Words for the four main directions; degrees for the others."""
    side = {inward(moment): "inward", 360.0 - inward(moment): "outward"}
    if direction not in WORDS:
        return f"{direction:g}°"
    word = WORDS[direction]
    return f"{word} ({side[direction]})" if direction in side else word
