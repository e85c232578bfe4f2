"""Oracle: Coulomb's law by hand."""

import numpy as np
import pytest

from nadia_balance.core.whole_body.limits import friction_after
from nadia_balance.core.whole_body.params import SlipParams, WholeBodyQpParams

PERIOD = 0.002
USUAL = 0.6
SLIP = SlipParams()
STANDING = USUAL, 1.0, 1.0
STILL, FAST = (0.0, 0.0, 0.0), (0.0, 0.5, 0.0)


def after(force, velocity, last=STANDING):
    """With this force [weights] on the left sole, which moves so [m/s]."""
    return friction_after(
        last,
        np.array([force, (0.0, 0.0, 0.5)]),
        np.array([velocity, STILL]),
        WholeBodyQpParams(friction=USUAL, slip=SLIP),
        PERIOD,
    )


def test_less_is_counted_on_than_what_did_not_hold():
    """Oracle: by hand, 0.9 of the larger side over the normal force."""
    friction = after((0.2, -0.25, 0.5), FAST)[0]
    assert friction == pytest.approx(0.9 * 0.25 / 0.5)
    _, left, right = after((0.2, -0.25, 0.0), FAST)
    assert (left, right) == (0.0, pytest.approx(1.0 + PERIOD))  # under load
    assert after((0.2, -0.25, 0.5), STILL)[0] == USUAL


@pytest.mark.parametrize(
    ("force", "loaded"),
    [
        ((0.0, 0.1, 0.5), 1.0),  # less than any ground has
        ((0.0, 0.09, 0.15), 1.0),  # hardly carries
        ((0.0, 0.25, 0.5), 0.02),  # has just landed
    ],
)
def test_a_slide_that_says_nothing(force, loaded):
    """Oracle: the parameters' words."""
    last = USUAL, loaded, 1.0
    assert after(force, FAST, last)[0] == USUAL


def test_it_never_counts_on_less_than_any_ground_has_and_comes_back():
    """Oracle: by hand."""
    least = after((0.0, 0.31, 1.0), FAST)
    assert least[0] == SLIP.least_friction
    ticks = round((USUAL - SLIP.least_friction) / SLIP.recovery / PERIOD)
    then = least
    for _ in range(ticks // 2):
        then = after((0.0, 0.1, 1.0), STILL, then)
    assert then[0] == pytest.approx((USUAL + SLIP.least_friction) / 2)
    for _ in range(ticks):
        then = after((0.0, 0.1, 1.0), STILL, then)
    assert then[0] == USUAL
