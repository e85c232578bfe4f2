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

PERIOD = 0.002
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
    times = (0.298, 3 * 0.1, 0.302)
    due = [push.is_due(t, RIGHT_SWING, PERIOD) for t in times]
    assert due == [False, True, True]
    assert push.is_due(sum([0.002] * 150), RIGHT_SWING, PERIOD)
    assert not push.is_in_phase(RIGHT_SWING)


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
    assert push.is_due(100.0, RIGHT_SWING, PERIOD) is due


def test_the_side_of_a_transfer_is_the_foot_that_swings_next():
    """Oracle: the left foot receives the weight, the right one will swing."""
    schedule = replace(RIGHT_SWING.schedule, phase=Phase.TRANSFER, duration=0.3)
    state = replace(RIGHT_SWING, schedule=schedule)
    right = Push(force=1.0, phase="transfer", fraction=0.5)
    assert right.is_due(0.0, state, PERIOD)
    left = Push(force=1.0, phase="transfer", fraction=0.5, side="left")
    assert not left.is_due(0.0, state, PERIOD)


@pytest.mark.parametrize("phase", [Phase.SWING, Phase.TRANSFER])
@pytest.mark.parametrize("period", [0.002, 0.004, 0.02])
@pytest.mark.parametrize("duration", [0.3, 0.7, 0.25])
@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.99, 0.999, 1.0])
def test_is_due_once_the_fraction_is_there_or_never_will_be(
    phase, period, duration, fraction
):
    """Oracle: the ticks of the state machine's rule, listed one by one."""
    schedule = replace(RIGHT_SWING.schedule, phase=phase, duration=duration)
    push = Push(force=1.0, phase=phase.value, fraction=fraction)
    clock = [k * period for k in range(1000)]
    # The tick that comes within half a period of the end begins what follows.
    ticks = [t for t in clock if t < duration - 0.5 * period - 1e-12]
    there = [t >= fraction * duration - 1e-9 for t in ticks]
    there[-1] = True
    due = [
        push.is_due(
            0.0,
            replace(RIGHT_SWING, schedule=schedule, time_in_phase=t),
            period,
        )
        for t in ticks
    ]
    assert due == there


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
