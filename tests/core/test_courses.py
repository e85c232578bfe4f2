"""Oracles: figures by hand, shapely."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from nadia_balance.core.bounds import check
from nadia_balance.core.courses import COURSES
from nadia_balance.core.gait import Gait, StepVector, walking_start
from nadia_balance.core.ground import Ground, check_ground
from tests.example_walks import MODEL, SOLE


def ground_of(name, seed=0):
    ground = Ground(tuple(COURSES[name](seed)), SOLE)
    for region in ground.regions:
        check(region)
    check_ground(ground)
    return ground


@pytest.mark.parametrize("name", COURSES)
def test_a_course_can_be_walked_to_its_end(name):
    """Oracle: shapely; each sole is within its region, 2 cm from the edge."""
    ground = ground_of(name)
    length = {"stepping_stones": 0.5, "stairs": 0.32}.get(name, 0.3)
    last = min(max(r.polygon[:, 0].max() for r in ground.regions), 3.5)
    steps = math.floor((last - 0.2) / length)
    gait = Gait(num_steps=steps, step=StepVector(length=length))
    model = replace(MODEL, ground=ground)
    state = walking_start(replace(gait, step_width=0.4), model)
    feet = state.schedule.footsteps
    assert feet[-1].pose.p_WF[0] > last - 1.0
    for step in feet:
        region = ground.region_under(step.pose)
        sole = shapely.Polygon(step.pose.to_world(SOLE))
        inner = shapely.Polygon(region.polygon).buffer(-0.0199)
        if ground.is_level:
            assert inner.covers(sole)
        height = region.heights(step.pose.p_WF[None, :2])[0]
        assert step.pose.p_WF[2] == height


def test_heights_and_slopes_are_those_of_the_issue():
    """Oracle: by hand: 18 cm, 10 deg, 15 deg, 3 cm, level."""
    stairs = ground_of("stairs").regions
    rises = np.diff([region.height for region in stairs])
    assert np.abs(rises) == pytest.approx(0.18)
    for name, degrees in ("slopes", 10.0), ("tilted_blocks", 15.0):
        tilts = [
            math.degrees(math.acos(r.unit_normal[2]))
            for r in ground_of(name).regions
        ]
        assert max(tilts) == pytest.approx(degrees)
    tiles = ground_of("tiles", seed=3).regions
    assert 0.025 < max(abs(r.height) for r in tiles) <= 0.03
    assert tiles[5].height != ground_of("tiles", seed=4).regions[5].height
    assert ground_of("stepping_stones").is_level
    assert ground_of("gap").is_level and not ground_of("tiles").is_level
