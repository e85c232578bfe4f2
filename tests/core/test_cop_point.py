"""Oracles: the table of CoP points by hand, and shapely."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.cop_point import CopPointParams, Sole
from nadia_balance.core.walking import FootPose, Side, rectangle

SOLE = Sole.with_margin(rectangle(0.25, 0.12), 0.01)
EXIT = CopPointParams(
    offset_inside=0.025, step_length_factor=1.0 / 3.0, max_x=0.08
)


@pytest.mark.parametrize(
    ("length", "x"), [(-0.3, 0.0), (0.0, 0.0), (0.15, 0.05), (0.3, 0.08)]
)
@pytest.mark.parametrize(("side", "y"), [(Side.LEFT, -1), (Side.RIGHT, 1)])
def test_leans_to_the_other_foot_and_forward_with_the_step(length, x, side, y):
    """Oracle: a third of the step, clamped to [0, 0.08] m, by hand."""
    point = SOLE.cop_point(EXIT, side, length)
    np.testing.assert_allclose(point, [x, 0.025 * y], atol=1e-15)


def test_counts_from_the_centroid_of_the_sole():
    """Oracle: the same point, in a sole whose frame is elsewhere."""
    shift = np.array([0.05, -0.01])
    shifted = Sole.with_margin(SOLE.corners + shift, 0.01)
    np.testing.assert_allclose(
        shifted.cop_point(EXIT, Side.LEFT, 0.1),
        SOLE.cop_point(EXIT, Side.LEFT, 0.1) + shift,
        atol=1e-15,
    )


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-2, 2))
def test_stays_within_the_margin(offset_x, inside, length):
    """Oracle: shapely's distance to the sole's edge."""
    params = CopPointParams(
        offset_x=offset_x,
        offset_inside=inside,
        step_length_factor=0.5,
        min_x=-2.0,
        max_x=2.0,
    )
    point = shapely.Point(SOLE.cop_point(params, Side.RIGHT, length))
    sole = shapely.Polygon(SOLE.corners)
    assert sole.contains(point)
    assert sole.exterior.distance(point) >= 0.01 - 1e-12


@given(*[st.floats(-3, 3)] * 6)
def test_measures_the_step_from_toe_to_toe(x0, y0, yaw0, x1, y1, yaw1):
    """Oracle: all corners of the other sole, taken into the sole frame."""
    foot, other = FootPose([x0, y0, 0], yaw0), FootPose([x1, y1, 0], yaw1)
    toes = foot.to_sole(other.to_world(SOLE.corners))[:, 0]
    expected = max(toes) - 0.125
    assert SOLE.step_length(foot, other) == pytest.approx(expected, abs=1e-13)


def test_refuses_a_margin_that_leaves_nothing():
    """Oracle: half the width of the sole."""
    with pytest.raises(ValueError, match=r"^cop\.margin = 0\.06: must"):
        Sole.with_margin(rectangle(0.25, 0.12), 0.06)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"offset_x": math.nan}, "offset_x = nan: must be finite"),
        ({"max_x": math.inf}, "max_x = inf: must be finite"),
        ({"min_x": 0.1}, r"min_x = 0\.1: must be <= max_x = 0\.0"),
    ],
)
def test_refuses_bad_params(values, message):
    """Oracle: the message names field, value and what is allowed."""
    with pytest.raises(ValueError, match=message):
        CopPointParams(**values).validate()
