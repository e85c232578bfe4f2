"""Oracles: finite differences along a swing, mirror images, by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.crossing_turn import CrossingTurnParams, crossing_turn
from nadia_balance.core.walking import (
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    Side,
    WalkingState,
)
from tests.example_walks import standing

PARAMS = CrossingTurnParams()


def turn_of(
    offset, side=Side.RIGHT, yaw=0.0, v=(0, 0), a=(0, 0), phase=Phase.SWING
):
    """The turn for a sole of `side` at `offset` from the stance sole."""
    stance = FootPose(np.array([0.7, -0.4, 0.0]), yaw)
    offset, v, a = (stance.rotation @ np.array(e) for e in (offset, v, a))
    other = FootPose(np.append(stance.p_WF[:2] + offset, 0.0), yaw)
    feet = FootPoses(stance, other)
    if side is Side.LEFT:
        feet = FootPoses(other, stance)
    schedule = replace(
        standing(),
        phase=phase,
        support_side=side.other,
        feet=feet,
        footsteps=(Footstep(side, other, 0.3, 0.7),),
    )
    swing = np.zeros(12)
    swing[:2], swing[3:5], swing[6:8] = other.p_WF[:2], v, a
    return crossing_turn(WalkingState(schedule), swing, PARAMS)


def test_rates_are_the_derivatives_of_the_turn():
    """Oracle: central differences of a sole on a parabola that crosses."""
    p, v, a = (np.array(e) for e in ([0.2, 0.0], [1.0, 1.5], [-3.0, 2.0]))

    def at(t):
        return turn_of(p + v * t + 0.5 * a * t * t, v=v + a * t, a=a)

    h = 1e-5
    for t in (0.0, 0.05, 0.1):
        (before, *rates), (after, *later) = at(t - h), at(t + h)
        _, rate, acceleration = at(t)
        assert rate == pytest.approx((after - before) / (2 * h), rel=1e-6)
        assert acceleration == pytest.approx(
            (later[0] - rates[0]) / (2 * h), rel=1e-6
        )


def test_the_hip_of_the_crossing_leg_goes_ahead():
    """Oracle: by hand; a right leg in front turns to the left."""
    assert turn_of((0.3, 0.1))[0] > math.radians(15.0)
    assert turn_of((-0.4, 0.0))[0] < -math.radians(10.0)
    assert turn_of((0.3, -0.05))[0] < 0.5 * turn_of((0.3, 0.1))[0]
    assert turn_of((5.0, 5.0))[0] == pytest.approx(math.radians(30.0))


@pytest.mark.parametrize("offset", [(0.0, -0.25), (0.5, -0.25), (-0.5, -0.4)])
def test_feet_that_are_apart_do_not_turn_it(offset):
    """Oracle: zero, whatever the speed; side by side, or a long step."""
    assert turn_of(offset, v=(2.0, 1.0)) == (0.0, 0.0, 0.0)


def test_left_is_the_mirror_image_of_right():
    """Oracle: symmetry."""
    right = turn_of((0.3, 0.1), v=(1.0, 2.0), a=(3.0, -4.0))
    left = turn_of((0.3, -0.1), Side.LEFT, v=(1.0, -2.0), a=(3.0, 4.0))
    assert left == pytest.approx([-value for value in right], abs=1e-12)


def test_does_not_depend_on_which_foot_supports_nor_on_the_heading():
    """Oracle: the same two soles, so that a landing changes nothing."""
    swing = turn_of((0.3, 0.1))
    transfer = turn_of((0.3, 0.1), phase=Phase.TRANSFER, v=(9.0, 9.0))
    other = turn_of((-0.3, -0.1), Side.LEFT)
    turned = turn_of((0.3, 0.1), yaw=2.0)
    for same in transfer, other, turned:
        assert same == pytest.approx(swing, abs=1e-12)


@pytest.mark.parametrize(
    ("field", "value"),
    [("width", -0.1), ("gain", math.inf), ("max_turn_deg", 0.0)],
)
def test_refuses_bad_parameters(field, value):
    """Oracle: the message names the field and the value."""
    with pytest.raises(ValueError, match=f"{field} = {value}: must be"):
        CrossingTurnParams(**{field: value}).validate()
