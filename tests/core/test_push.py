"""Oracles: the time and the gait by hand."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from nadia_balance.core.push import Push
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)

REST = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
FEET = FootPoses(FootPose([0.0, 0.125, 0.0]), FootPose([0.0, -0.125, 0.0]))
RIGHT_SWING = WalkingState(
    ContactSchedule(Phase.SWING, Side.LEFT, 0.7, FEET, (), REST),
    time_in_phase=0.175,
    steps_taken=4,
)


@dataclass
class Pushes:
    """What a scenario file holds."""

    pushes: list[Push] = field(default_factory=list)


def test_the_impulse_is_mass_times_delta_v():
    """Oracle: F dt = m dv."""
    push = Push(delta_v=0.6, duration=0.1, time=1.0)
    assert push.newtons(90.0) * push.duration == pytest.approx(54.0)
    assert Push(force=200.0, time=1.0).newtons(90.0) == 200.0


def test_a_time_is_due_from_then_on():
    """Oracle: comparison, with the rounding error of a clock."""
    push = Push(force=1.0, time=0.3)
    due = [push.is_due(t, RIGHT_SWING) for t in (0.298, 3 * 0.1, 0.302)]
    assert due == [False, True, True]
    assert push.is_due(sum([0.002] * 150), RIGHT_SWING)


@pytest.mark.parametrize(
    ("push", "due"),
    [
        (Push(force=1.0, phase="swing"), True),
        (Push(force=1.0, phase="swing", fraction=0.26), False),
        (Push(force=1.0, phase="swing", side="left"), False),
        (Push(force=1.0, phase="transfer"), False),
        (Push(force=1.0, phase="swing", after_steps=4), True),
        (Push(force=1.0, phase="swing", after_steps=5), False),
    ],
)
def test_a_phase_is_due_at_its_fraction_of_its_side(push, due):
    """Oracle: 25 % into the right foot's swing, after four steps."""
    push.validate()
    assert push.is_due(100.0, RIGHT_SWING) is due


def test_the_side_of_a_transfer_is_the_foot_that_swings_next():
    """Oracle: the left foot receives the weight, the right one will swing."""
    schedule = replace(RIGHT_SWING.schedule, phase=Phase.TRANSFER, duration=0.3)
    state = replace(RIGHT_SWING, schedule=schedule)
    assert Push(force=1.0, phase="transfer", fraction=0.5).is_due(0.0, state)
    left = Push(force=1.0, phase="transfer", fraction=0.5, side="left")
    assert not left.is_due(0.0, state)


def test_can_be_written_in_yaml():
    """Oracle: round trip through Drake's loader, and a hand-written text."""
    text = "pushes: [{delta_v: 0.6, phase: swing, side: right, fraction: 0.25}]"
    loaded = yaml_load_typed(schema=Pushes, data=text, defaults=Pushes())
    assert loaded.pushes == [Push(delta_v=0.6, phase="swing")]
    again = yaml_load_typed(
        schema=Pushes, data=yaml_dump_typed(loaded), defaults=Pushes()
    )
    assert again == loaded


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"time": 1.0}, "delta_v = None, force = None: must give exactly one"),
        (
            {"force": 1.0, "delta_v": 1.0, "time": 1.0},
            "delta_v = 1.0, force = 1.0: must give exactly one",
        ),
        ({"force": 1.0}, "time = None, phase = None: must give exactly one"),
        ({"force": -1.0, "time": 1.0}, "force = -1.0: must be finite"),
        ({"delta_v": math.nan, "time": 1.0}, "delta_v = nan: must be finite"),
        ({"force": 1.0, "time": math.inf}, "time = inf: must be finite"),
        ({"force": 1.0, "time": 1.0, "delay": -1.0}, "delay = -1.0: must be"),
        ({"force": 1.0, "time": 1.0, "duration": 0.0}, "duration = 0.0: must"),
        (
            {"force": 1.0, "time": 1.0, "direction_deg": math.nan},
            "direction_deg = nan: must be finite",
        ),
        ({"force": 1.0, "phase": "jump"}, "phase = 'jump': must be one of"),
        (
            {"force": 1.0, "phase": "swing", "side": "up"},
            "side = 'up': must be left or right",
        ),
        (
            {"force": 1.0, "phase": "swing", "fraction": 1.5},
            r"fraction = 1.5: must be in \[0, 1\]",
        ),
        (
            {"force": 1.0, "phase": "swing", "after_steps": -1},
            "after_steps = -1: must be >= 0",
        ),
    ],
)
def test_refuses_bad_pushes(fields, message):
    """Oracle: the message names field, value and what is allowed."""
    with pytest.raises(ValueError, match=message):
        Push(**fields).validate()
