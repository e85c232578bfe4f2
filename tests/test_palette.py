"""The colours can be told apart, on paper and from each other."""

import itertools

import numpy as np
import pytest

from nadia_balance import palette


def luminance(color):
    """Relative luminance of sRGB, as in the WCAG 2 guidelines."""
    c = np.array(palette.rgb(color))
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def test_lines_stand_out_from_white_paper():
    """Oracle: WCAG contrast, here at least 2.4 (a thick line needs less)."""
    contrast = {
        name: 1.05 / (luminance(color) + 0.05)
        for name, color in palette.LEGEND.items()
        if name != "ICP reference"  # thin, and beside the ICP
    }
    assert min(contrast.values()) > 2.4, contrast


def test_no_two_colours_are_alike():
    """Oracle: Euclidean distance in RGB of at least a tenth of the cube."""
    colors = {k: np.array(palette.rgb(c)) for k, c in palette.LEGEND.items()}
    near = [
        (a, b)
        for a, b in itertools.combinations(colors, 2)
        if np.linalg.norm(colors[a] - colors[b]) <= 0.17
    ]
    assert not near


def test_reads_hexadecimal_colours():
    """Oracle: 0x80 / 0xff, by hand."""
    assert palette.rgb("#ff8000") == pytest.approx([1.0, 128 / 255, 0.0])
    assert palette.rgba("#ff8000", 0.25).a() == 0.25
