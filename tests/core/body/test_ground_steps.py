"""Oracles: figures by hand; the nearest foothold by test_ground's search."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.plan.gait import (
    Foothold,
    Gait,
    StepVector,
    make_footsteps,
    walking_start,
    within_reach,
)
from nadia_balance.core.walking.state import FootPose
from tests.core.body.test_ground import square
from tests.example_walks import FEET, MODEL, SOLE

STONES = (
    square("start", side=0.8),
    square("right", 0.7, -0.2, height=0.1),
    square("left", 1.3, 0.2, height=0.2),
)
GROUND = Ground(STONES, SOLE)
REACH = MODEL.reach


def steps_of(ground=GROUND, **gait):
    return make_footsteps(Gait(**gait), FEET, REACH, ground)


def test_step_vectors_go_to_the_nearest_foothold():
    """Oracle: by hand: the margin, half the sole; the heights of the stones.

    The frame goes on by 0.5 m a step, whatever the steps were moved by.
    """
    found = steps_of(num_steps=2, step=StepVector(length=0.5))
    first = 0.45 + 0.02 + 0.125
    expected = [[first, -0.125, 0.1], [1.05 + 0.145, 0.125, 0.2]]
    for step, p in zip(found, expected, strict=False):
        assert step.pose.p_WF == pytest.approx(p)


def test_no_step_is_planned_that_fits_nowhere():
    """Oracle: by hand; the message has the step, and what is nearest."""
    last, far = Ground(STONES[2:], SOLE), StepVector(length=3.0, sideways=-2.0)
    with pytest.raises(ValueError, match=r"step 1 .right.: must fit on a reg"):
        steps_of(num_steps=1, step=far, ground=last)
    on, beside = (
        Foothold(side=side, x=x, y=y)
        for side, x, y in (("right", 0.7, -0.15), ("left", 1.0, 0.15))
    )
    with pytest.raises(ValueError, match=r"step 2 .left.: the sole at x = 1.0"):
        steps_of(footholds=[on, beside])
    with pytest.raises(ValueError, match=r"left foot at the start.*on 'left'"):
        walking_start(Gait(), replace(MODEL, ground=last))


@pytest.mark.parametrize("height", [0.35, -0.35])
def test_no_step_is_planned_that_rises_too_far(height):
    """Oracle: by hand; as far up as down, from the foot that stands."""
    block = square("right", 0.7, -0.2, height=height)
    ground = Ground((STONES[0], block), SOLE)
    message = f"step 1 (right): {height:+.3f} m above the stance foot: must be"
    with pytest.raises(ValueError, match=re.escape(message)):
        steps_of(num_steps=1, step=StepVector(length=0.5), ground=ground)


def test_steps_after_an_adjusted_one_are_on_the_regions_as_well():
    """Oracle: by hand: from where the left foot is, its stone begins at x."""
    steps = steps_of(num_steps=2, step=StepVector(length=0.5))
    away = FEET.with_foot(steps[0].side, FootPose([0.2, -0.2, 0.0]))
    found = within_reach(steps[1:2], away, REACH, steps[0], ground=GROUND)
    p = found[0].pose.p_WF
    assert GROUND.region_under(found[0].pose) is not None
    assert math.dist(p[:2], [0.2, -0.2]) < 1.1
    # Where the reach ends is a region; another is too high above the foot.
    for x, z, name in (
        (-0.5, 0.0, "start"),
        (0.2, 0.0, "right"),
        (0.2, -0.2, "start"),
    ):
        away = FEET.with_foot(steps[0].side, FootPose([x, -0.2, z]))
        found = within_reach(steps[1:2], away, REACH, steps[0], ground=GROUND)
        region = GROUND.region_under(found[0].pose)
        assert region.name == name and found[0].pose.p_WF[2] == region.height
    # Nothing is in reach: it stays where the reach ends.
    far = FEET.with_foot(steps[0].side, FootPose([-3.0, -0.2, 0.0]))
    found = within_reach(steps[1:2], far, REACH, steps[0], ground=GROUND)
    assert np.isfinite(found[0].pose.p_WF).all()
    assert GROUND.region_under(found[0].pose) is None
