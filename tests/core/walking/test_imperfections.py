"""Oracle: by hand."""

import pytest

from nadia_balance.core.math.bounds import check
from nadia_balance.core.walking.imperfections import Imperfections


@pytest.mark.parametrize(
    ("given", "noisy"),
    [
        ({}, False),
        ({"friction_ratio": 0.5, "delay": 0.01}, False),
        ({"pelvis_speed_noise": 0.01}, True),
    ],
)
def test_tells_those_of_the_measurements(given, noisy):
    imperfections = Imperfections(**given)
    check(imperfections)
    assert imperfections.has_noise is noisy
