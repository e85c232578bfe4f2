"""The colours can be told apart, on paper and from each other."""

import itertools

import numpy as np
import pytest

from nadia_balance.core.walking import Side
from nadia_balance.systems import palette

LINES = {k: v for k, v in palette.LEGEND.items() if k != "ICP reference"}


def luminance(color):
    """Relative luminance of sRGB, as in the WCAG 2 guidelines."""
    c = np.array(palette.rgb(color))
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


@pytest.mark.parametrize("name", LINES)
def test_a_line_stands_out_from_white_paper(name):
    """Oracle: WCAG contrast, here at least 2.4 (a thick line needs less)."""
    assert 1.05 / (luminance(LINES[name]) + 0.05) > 2.4


@pytest.mark.parametrize(
    ("a", "b"), list(itertools.combinations(palette.LEGEND, 2))
)
def test_no_two_colours_are_alike(a, b):
    """Oracle: Euclidean distance in RGB of at least a tenth of the cube."""
    colors = np.array([palette.rgb(palette.LEGEND[k]) for k in (a, b)])
    assert np.linalg.norm(colors[0] - colors[1]) > 0.17


def test_reads_hexadecimal_colours():
    """Oracle: 0x80 / 0xff, by hand."""
    assert palette.rgb("#ff8000") == pytest.approx([1.0, 128 / 255, 0.0])
    color = palette.rgba("#ff8000", 0.25)
    assert [color.r(), color.g(), color.b(), color.a()] == pytest.approx(
        [1.0, 128 / 255, 0.0, 0.25]
    )


def test_each_foot_has_its_own_colour():
    assert palette.foot_color(Side.LEFT) == palette.LEFT
    assert palette.foot_color(Side.RIGHT) == palette.RIGHT
