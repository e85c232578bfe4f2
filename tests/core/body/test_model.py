"""Oracle: the formula of the natural frequency."""

import math
from dataclasses import replace

import pytest

from tests.example_walks import MODEL


def test_the_natural_frequency_is_that_of_the_com_height():
    """Oracle: sqrt(g / z), also of a copy with another height."""
    assert math.sqrt(9.81 / 0.95) == MODEL.omega
    lower = replace(MODEL, com_height=0.5)
    assert lower.omega == pytest.approx(math.sqrt(9.81 / 0.5))
