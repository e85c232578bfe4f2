"""The story of made-up runs, word by word."""

import numpy as np
import pytest

from nadia_balance.core.walking.state import Mode, Phase
from nadia_balance.results.log import pushes, signal_view
from nadia_balance.results.story import (
    TOLD_COMMANDS,
    direction_words,
    telling,
    telling_lines,
)
from nadia_balance.systems.signals import MODES, PHASES
from tests.results.made_up_run import Recipe, T, make_log, summary_of


def story(log, **conditions):
    return telling_lines(log, summary_of(log, **conditions))


def test_tells_a_recovery_from_the_push_to_the_end():
    """Oracle: the recipe; a push to the left in a left swing is outward."""
    lines = story(make_log(), direction_deg=90.0, cpu_time=3.783)
    assert lines == [
        "t=1.98 s  push 0.60 m/s outward, left swing 25 %        "
        "F = 545 N for 0.10 s",
        "t=2.23 s  first step (left) forward 0.12 m and out 0.20 m, "
        "swing 0.70 -> 0.43 s",
        "t=2.77 s  second step (right) in 0.31 m, transfer 0.30 -> 0.04 s, "
        "swing 0.70 -> 0.50 s",
        "t=2.77 s  RECOVERED in 2 steps   max ICP error 0.139 m   "
        "max torque 82 %   QP violation 2e-7   real-time factor 2.0",
    ]


@pytest.mark.parametrize(
    ("degrees", "word"),
    [
        (0.0, "forward"),
        (-180.0, "backward"),
        (90.0, "outward"),
        (270.0, "inward"),
        (30.0, "at 30 deg"),
    ],
)
def test_names_directions_as_seen_from_the_stance_foot(degrees, word):
    """Oracle: in a left swing the stance foot is at the right, at -90 deg.

    The whole scene is turned by 1 rad: names must not change.
    """
    log = make_log()
    angle = np.radians(degrees) + 1.0
    felt = signal_view(log, "push_signal")
    walking = signal_view(log, "walking_signal")
    felt.force[:2] = np.outer([np.cos(angle), np.sin(angle)], felt.force_y)
    walking.left_yaw[:] = walking.right_yaw[:] = 1.0
    first = pushes(log)[0]
    row = signal_view(log, "walking_signal", first.first)
    assert direction_words(row, first.force) == word


def commanded(*rows, recipe=None):
    """A log with the commands of the rows (time, forward, left, turn)."""
    log = make_log(recipe or Recipe(pushed_step=None, changed={}))
    commands = np.zeros((len(log["t"]), 3))
    for time, *command in rows:
        commands[log["t"] >= time - 0.5 * T] = command
    return log | {"velocity_command": commands}


def test_tells_each_change_of_the_command_in_order_of_time():
    """Oracle: the rows, word by word; to go on at the same speed is none.

    The push is told among them; the result is the last line.
    """
    log = commanded(
        (0.0, 0.3, 0.0, 0.0),
        (1.0, 0.3, 0.0, 0.0),
        (1.5, -0.2, -0.1, 0.0),
        (2.0, 0.0, 0.1, -0.25),
        (5.0, 0.0, 0.0, 0.0),
        recipe=Recipe(changed={}),
    )
    *lines, result = [line for _, line in telling(log, summary_of(log))]
    assert result.startswith("RECOVERED ")
    assert lines == [
        "commanded forward 0.30 m/s",
        "commanded backward 0.20 m/s, right 0.10 m/s",
        "push 0.60 m/s outward, left swing 25 %        F = 545 N for 0.10 s",
        "commanded left 0.10 m/s, turn right 0.25 rad/s",
        "commanded to stand",
    ]


def test_tells_no_command_where_there_is_none_or_very_many():
    """Oracle: the number of lines; the result of a run is always told."""
    count = TOLD_COMMANDS
    for number, lines in (0, 1), (count, 1 + count), (count + 1, 1):
        rows = [(0.1 * i, 0.1 * (i + 1), 0.0, 0.0) for i in range(number)]
        log = commanded(*rows)
        assert len(telling(log, summary_of(log))) == lines, number


def standing_at_first(log):
    """The log of a robot that stood before it began to step, to recover."""
    walking = signal_view(log, "walking_signal")
    stood = walking.phase == PHASES.index(Phase.STANDING)
    walking.mode[walking.mode == MODES.index(Mode.WALKING)] = MODES.index(
        Mode.RECOVERING
    )
    walking.mode[stood] = MODES.index(Mode.STANDING)
    return log


def test_tells_when_a_robot_that_stood_steps_and_stands_again():
    """Oracle: the recipe: it stands for 0.5 s, takes six steps of 1 s, and
    stands 0.8 s after them; without square feet it does not.
    """
    log = standing_at_first(make_log(Recipe(pushed_step=None, changed={})))
    entries = telling(log, summary_of(log))
    assert entries[0] == (pytest.approx(0.5), "steps, to recover")
    assert entries[1] == (pytest.approx(0.5 + 6.0 + 0.8), "stands")
    assert entries[2][1].startswith("WALKED 6 steps")
    walking = signal_view(log, "walking_signal")
    walking.left_x[walking.steps_taken == 6.0] += 0.3
    lines = [line for _, line in telling(log, summary_of(log))]
    assert "stands" not in lines and "steps, to recover" in lines


def test_the_steps_of_a_recovery_are_counted_until_it_has_recovered():
    """Oracle: the recovery of the recipe, in 2 steps, whatever comes later."""
    log = make_log()
    log["velocity_command"] = np.zeros((len(log["t"]), 3))
    log["velocity_command"][log["t"] > 5.0, 0] = 0.3
    *_, (_, command), (time, result) = telling(log, summary_of(log))
    assert command == "commanded forward 0.30 m/s" and time > 5.0
    assert result.startswith("RECOVERED in 2 steps ")
