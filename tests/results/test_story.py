"""The story of made-up runs, word by word."""

import numpy as np
import pytest

from nadia_balance.results import pushes, signal
from nadia_balance.results.story import direction_words, telling_lines
from tests.results.made_up_run import make_log, summary_of


def story(log, **told):
    return telling_lines(log, summary_of(log, **told))


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
    felt, walking = signal(log, "push_signal"), signal(log, "walking_signal")
    felt.force[:2] = np.outer([np.cos(angle), np.sin(angle)], felt.force_y)
    walking.left_yaw[:] = walking.right_yaw[:] = 1.0
    first = pushes(log)[0]
    row = signal(log, "walking_signal", first.first)
    assert direction_words(row, first.force) == word
