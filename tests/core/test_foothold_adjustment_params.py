"""Oracles: the message's text; durations and corners by hand."""

import math

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.polygon import convex_hull
from nadia_balance.core.reach_rules import ReachRulesParams
from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.walking import FootPose, Footstep, Side, rectangle


def test_the_defaults_are_valid_and_survive_yaml():
    """Oracle: the defaults themselves."""
    params = CaptureRegionStepAdjusterParams()
    params.validate()
    text = yaml_dump_typed(params)
    kind = CaptureRegionStepAdjusterParams
    assert yaml_load_typed(schema=kind, data=text) == params


@pytest.mark.parametrize(
    "bad",
    [
        {"num_steps": 0},
        {"num_steps": 11},
        {"foot_back": -0.01},
        {"margin": math.nan},
        {"dead_band": math.inf},
        {"waiting_time": 0.0},
        {"shortest_swing": 0.0},
        {"shortest_transfer": math.nan},
        {"return_time": -0.01},
    ],
)
def test_refuses_bad_parameters(bad):
    """Oracle: the message names field and value."""
    (name, value), *_ = bad.items()
    with pytest.raises(ValueError, match=f"{name} = {value}: must be"):
        CaptureRegionStepAdjusterParams(**bad).validate()


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"reachability": ReachabilityParams(width_min=-1.0)}, "width_min"),
        ({"rules": ReachRulesParams(hysteresis=0.5)}, "hysteresis"),
    ],
)
def test_refuses_bad_parts(part, message):
    """Oracle: the message names the part's field."""
    with pytest.raises(ValueError, match=message):
        CaptureRegionStepAdjusterParams(**part).validate()


def test_steps_last_as_queued_unless_their_timing_is_adapted():
    """Oracle: by hand."""
    step = Footstep(Side.LEFT, FootPose(), 0.3, 0.7)
    queued = CaptureRegionStepAdjusterParams()
    hurried = CaptureRegionStepAdjusterParams(
        shortest_transfer=0.05, shortest_swing=0.4
    )
    assert queued.duration(step) == pytest.approx(1.0)
    assert hurried.duration(step) == pytest.approx(0.45)
    assert hurried.transfer_duration(step) == 0.05
    quick = Footstep(Side.LEFT, FootPose(), 0.02, 0.3)
    assert hurried.duration(quick) == pytest.approx(0.32)


def test_the_foot_is_cut_on_its_proper_sides():
    """Oracle: by hand: x -0.125..0.125, y -0.06 (outside)..0.06 (inside)."""
    params = CaptureRegionStepAdjusterParams(
        foot_front=0.01, foot_back=0.02, foot_inside=0.03, foot_outside=0.04
    )
    foot = convex_hull(params.usable_foot(rectangle(0.25, 0.12)))
    corners = [[-0.105, -0.02], [0.115, -0.02], [0.115, 0.03], [-0.105, 0.03]]
    np.testing.assert_allclose(foot, corners, atol=1e-15)


def test_some_of_the_sole_must_be_left():
    """Oracle: 0.06 + 0.06 is all of 0.12 m."""
    params = CaptureRegionStepAdjusterParams(
        foot_inside=0.06, foot_outside=0.06
    )
    with pytest.raises(ValueError, match=r"foot_outside = 0\.06"):
        params.usable_foot(rectangle(0.25, 0.12))
