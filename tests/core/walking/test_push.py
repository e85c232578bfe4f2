"""Oracles: the time and the gait by hand."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.walking.push import Moment, Push, random_pushes
from nadia_balance.core.walking.state import Phase, Side, WalkingState
from nadia_balance.parameters.bounds import check
from tests.example_walks import standing

PERIOD = 0.002
RIGHT_SWING = WalkingState(
    replace(standing(), phase=Phase.SWING, duration=0.7),
    time_in_phase=0.175,
    steps_taken=4,
)


@pytest.mark.parametrize(
    ("shape", "peak", "square"),
    [
        ("rectangle", 1.0, 1.0),
        ("half_sine", math.pi / 2.0, math.pi**2 / 8.0),
        ("ramp", 2.0, 4.0 / 3.0),
    ],
)
def test_each_shape_has_the_same_impulse(shape, peak, square):
    """Oracles: m dv; peak and mean square over the mean, by integration."""
    push = Push(delta_v=0.6, duration=0.4, at="1 s", shape=shape)
    forces = push.newtons(90.0, 1e-4) * push.shares(1e-4)
    assert np.sum(forces) * 1e-4 == pytest.approx(54.0)
    mean = 54.0 / 0.4
    assert np.max(forces) == pytest.approx(peak * mean, rel=1e-3)
    assert np.mean(forces**2) == pytest.approx(square * mean**2, rel=1e-3)
    assert Push(force=200.0, at="1 s").newtons(90.0, PERIOD) == 200.0


def test_a_sine_goes_to_and_fro():
    """Oracle: whole periods have no impulse; half of one has 2 / omega."""
    push = Push(force=50.0, duration=1.0, at="1 s", shape="sine", frequency=2.0)
    forces = push.newtons(90.0, PERIOD) * push.shares(PERIOD)
    assert np.sum(forces) == pytest.approx(0.0, abs=1e-9)
    half = np.sum(forces[:125]) * PERIOD
    assert half == pytest.approx(50.0 * 2.0 / (4.0 * math.pi), rel=1e-4)


def test_random_pushes_are_those_of_their_seed():
    """Oracle: the bounds in the docstring; another seed, other pushes."""
    pushes = random_pushes(50, 3, 0.4)
    assert pushes == random_pushes(50, 3, 0.4) != random_pushes(50, 4, 0.4)
    times = [1.0, *(push.moment.time for push in pushes)]
    assert np.all((0.99 <= np.diff(times)) & (np.diff(times) <= 3.01))
    sizes = np.array([push.delta_v for push in pushes])
    assert 0.0 <= sizes.min() < 0.1 and 0.3 < sizes.max() <= 0.4
    angles = [push.direction_deg for push in pushes]
    assert len({int(angle // 90.0) for angle in angles}) == 4


def test_a_push_waits_for_its_steps():
    """Oracle: 25 % into the right foot's swing, after four steps."""
    for after_steps in 4, 5:
        push = Push(force=1, at="right swing 25 %", after_steps=after_steps)
        due = push.is_due(100.0, RIGHT_SWING, PERIOD)
        assert due is (after_steps == 4)


@pytest.mark.parametrize("phase", [Phase.SWING, Phase.TRANSFER])
@pytest.mark.parametrize("duration", [0.3, 0.25])
def test_is_due_once_the_fraction_is_there_or_never_will_be(phase, duration):
    """Oracle: the ticks of the state machine's rule, listed one by one."""
    schedule = replace(RIGHT_SWING.schedule, phase=phase, duration=duration)
    for period, percent in itertools.product(
        (0.002, 0.004, 0.02), (0.0, 25.0, 99.0, 99.9, 100.0)
    ):
        push = Push(force=1.0, at=f"right {phase.value} {percent:g} %")
        clock = [k * period for k in range(1000)]
        # The tick within half a period of the end begins what follows.
        ticks = [t for t in clock if t < duration - 0.5 * period - 1e-12]
        there = [t >= 0.01 * percent * duration - 1e-9 for t in ticks]
        there[-1] = True
        state = replace(RIGHT_SWING, schedule=schedule)
        due = [
            push.is_due(0.0, replace(state, time_in_phase=t), period)
            for t in ticks
        ]
        assert due == there, (period, percent)


@pytest.mark.parametrize(
    ("text", "moment"),
    [
        ("right swing 25 %", Moment(Phase.SWING, Side.RIGHT, 0.25)),
        (" left transfer 12.5% ", Moment(Phase.TRANSFER, Side.LEFT, 0.125)),
        ("2.5 s", Moment(time=2.5)),
        ("0s", Moment(time=0.0)),
    ],
)
def test_a_moment_is_what_its_text_says_and_back(text, moment):
    """Oracle: by hand; the text is parsed, and the one of its own again."""
    assert Moment.parse(text) == moment
    assert Moment.parse(str(moment)) == moment
    assert str(Moment.parse("left swing 100.00 %")) == "left swing 100 %"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("delta_v", math.nan), ("force", -1.0), ("force", None)),
        *(("delay", -1.0), ("duration", 0.0), ("direction_deg", math.nan)),
        *(("after_steps", -1), ("shape", "saw"), ("at", "")),
        *(("at", "noon"), ("at", "25 %"), ("at", "right swing")),
        ("at", "\N{ARABIC-INDIC DIGIT ONE} s"),
        *(("at", "right standing 25 %"), ("at", "right swing 101 %")),
        *(("at", "right swing nan %"), ("at", "2.5"), ("at", "1e3 s")),
    ],
)
def test_refuses_bad_pushes(field, value):
    """Oracle: the message names the field."""
    push = replace(Push(force=1.0, at="1 s"), **{field: value})
    with pytest.raises(ValueError, match=f"{field} = "):
        check(push)
