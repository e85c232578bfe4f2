"""Oracle: the extents of the ellipse, by hand."""

import pytest

from nadia_balance.core.reachability import ReachabilityParams


@pytest.mark.parametrize(
    ("x", "y", "inside"),
    [
        (0.0, 0.125, True),
        (0.0, 0.124, False),
        (0.0, 0.8, True),
        (0.0, 0.801, False),
        (0.999, 0.25, True),
        (-1.001, 0.25, False),
        (0.7, 0.65, False),
        (0.6, 0.6, True),
    ],
)
def test_base_region_is_four_quarter_ellipses(x, y, inside):
    """Oracle: (x / l)^2 + ((y - w_nom) / w)^2 <= 1."""
    assert ReachabilityParams().in_base_region(x, y) is inside


@pytest.mark.parametrize(
    "bad", [{"width_min": 0.3}, {"length_forward": -1.0}, {"width_max": 0.2}]
)
def test_refuses_bad_parameters(bad):
    """Oracle: the message names the value."""
    with pytest.raises(ValueError, match=str(next(iter(bad.values())))):
        ReachabilityParams(**bad).validate()
