"""Colours that appear in one picture are told apart, also by the colour-blind.

Dichromacy is simulated by the matrices of Machado, Oliveira and Fernandes, "A
Physiologically-based Model for Simulation of Color Vision Deficiency", 2009
(severity 1.0, on linear RGB), distances are CIEDE2000 (Sharma, Wu and Dalal,
"The CIEDE2000 Color-Difference Formula", 2005): 1 is just noticed, 10 is seen
at a glance.
"""

import itertools
import math

import numpy as np
import pytest

import envelopes
from nadia_balance import palette
from nadia_balance.core.walking import mechanisms
from nadia_balance.results.plots import style, time_series
from nadia_balance.sweep import envelope_plot as envelope

LEAST = 10.0
DEUTERANOPIA = [
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.011820, 0.042940, 0.968881],
]
PROTANOPIA = [
    [0.152286, 1.052583, -0.204868],
    [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
]
# Linear sRGB to XYZ, and its white (IEC 61966-2-1, D65).
XYZ = [
    [0.4124564, 0.3575761, 0.1804375],
    [0.2126729, 0.7151522, 0.0721750],
    [0.0193339, 0.1191920, 0.9503041],
]
WHITE = [0.95047, 1.0, 1.08883]


def lab(color: str, sight) -> tuple[float, float, float]:
    """The CIELAB coordinates of a colour #rrggbb, as it is seen."""
    parts = np.array(palette.rgb(color))
    linear = np.where(
        parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4
    )
    seen = np.clip(np.asarray(sight) @ linear, 0.0, 1.0)
    ratio = np.asarray(XYZ) @ seen / WHITE
    x, y, z = np.where(
        ratio > 216 / 24389, np.cbrt(ratio), (24389 / 27 * ratio + 16) / 116
    )
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def distance(one, two) -> float:
    """The colour difference CIEDE2000 of two CIELAB colours."""
    (l_1, a_1, b_1), (l_2, a_2, b_2) = one, two
    chroma = 0.5 * (math.hypot(a_1, b_1) + math.hypot(a_2, b_2))
    g = 0.5 * (1 - math.sqrt(chroma**7 / (chroma**7 + 25**7)))
    a_1, a_2 = (1 + g) * a_1, (1 + g) * a_2
    c_1, c_2 = math.hypot(a_1, b_1), math.hypot(a_2, b_2)
    h_1, h_2 = math.atan2(b_1, a_1), math.atan2(b_2, a_2)
    turn = math.remainder(h_2 - h_1, math.tau) if c_1 * c_2 else 0.0
    h = math.degrees(h_1 + 0.5 * turn) if c_1 * c_2 else math.degrees(h_1 + h_2)
    light, c = 0.5 * (l_1 + l_2), 0.5 * (c_1 + c_2)
    t = 1.0 + sum(
        weight * math.cos(math.radians(times * h + phase))
        for weight, times, phase in (
            (-0.17, 1, -30),
            (0.24, 2, 0),
            (0.32, 3, 6),
            (-0.20, 4, -63),
        )
    )
    blue = 60 * math.exp(-(((h % 360 - 275) / 25) ** 2))
    rotation = -2 * math.sqrt(c**7 / (c**7 + 25**7))
    rotation *= math.sin(math.radians(blue))
    s_l = 1 + 0.015 * (light - 50) ** 2 / math.sqrt(20 + (light - 50) ** 2)
    in_l = (l_2 - l_1) / s_l
    in_c = (c_2 - c_1) / (1 + 0.045 * c)
    in_h = 2 * math.sqrt(c_1 * c_2) * math.sin(0.5 * turn) / (1 + 0.015 * c * t)
    return math.sqrt(in_l**2 + in_c**2 + in_h**2 + rotation * in_c * in_h)


SCENE = {
    name: entry.color
    for name, entry in (palette.LEGEND | palette.LIVE_LEGEND).items()
}
FEET = {"left": palette.LEFT, "right": palette.RIGHT}
GROUPS = {name: color for name, (_, color) in time_series.GROUPS.items()}


def curves(paper: str) -> dict[str, str]:
    """Those of an envelope, beside a paper's and the limit of a point mass."""
    sets = [one for one in mechanisms.SETS if one.paper == paper]
    return {one.name: one.color for one in sets} | {
        "paper": envelope.PAPER,
        "limit": style.FAINT,
    }


PICTURES = {
    "scene": SCENE | {"floor": palette.FLOOR},
    "dark page": SCENE | {"floor": palette.NIGHT_FLOOR},
    "strips": {"torque": palette.SUPPORT, "speed": palette.ECMP},
    "timeline": FEET
    | {mode.value: color for mode, color in time_series._MODE_COLORS.items()},
    "effort": GROUPS | {"limit": palette.PUSH},
    "velocity": time_series._VELOCITY,
    "estimate": time_series._AXES | {"truth": style.FAINT},
    "bars": FEET | {"push": palette.PUSH},
    "envelopes": {
        "ours": envelopes.OURS,
        "paper": envelopes.PAPER,
        "policy": envelopes.POLICY,
    },
    "Nadia's envelope": curves("nadia"),
    "Atlas' envelope": curves("atlas"),
}


@pytest.mark.parametrize("sight", [np.eye(3), DEUTERANOPIA, PROTANOPIA])
@pytest.mark.parametrize("picture", PICTURES)
def test_the_colours_of_a_picture_are_told_apart(picture, sight):
    """Oracle: CIEDE2000 between all pairs."""
    seen = {
        name: lab(color, sight) for name, color in PICTURES[picture].items()
    }
    near = {
        f"{one}, {two}": round(distance(seen[one], seen[two]), 1)
        for one, two in itertools.combinations(seen, 2)
    }
    assert {pair: d for pair, d in near.items() if d < LEAST} == {}


@pytest.mark.parametrize(
    ("one", "two", "expected"),
    [
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 2.5, 0.0), (50.0, 0.0, -2.5), 4.3065),
        ((50.0, 2.5, 0.0), (58.0, 24.0, 15.0), 19.4535),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
        ((90.8027, -2.0831, 1.4410), (91.1528, -1.6435, 0.0447), 1.4441),
    ],
)
def test_the_distance_is_that_of_its_authors(one, two, expected):
    """Oracle: pairs 1, 16, 17, 34 and 32 of the paper's Table 1."""
    assert distance(one, two) == pytest.approx(expected, abs=1e-4)


def test_red_and_green_are_alike_to_a_deuteranope():
    """Oracle: by hand, that is what it means; greys stay as they are."""
    red, green = (lab(c, DEUTERANOPIA) for c in ("#b03030", "#557020"))
    assert distance(red, green) < 8.0
    assert distance(lab("#b03030", np.eye(3)), lab("#557020", np.eye(3))) > 40.0
    grey = lab("#808080", DEUTERANOPIA)
    assert distance(grey, lab("#808080", np.eye(3))) < 0.1
