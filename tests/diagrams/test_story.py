"""The story of made-up runs, word by word."""

import numpy as np
import pytest

from diagrams.run_log import pushes
from diagrams.story import direction, telling_lines
from diagrams.summary import RunInfo, summarize
from nadia_balance.core.walking import Side
from tests.diagrams.made_up_run import (
    Recipe,
    T,
    cut,
    make_log,
    without_robot,
)


def story(log, **info):
    told = {"robot": "nadia", "mechanisms": "step", **info}
    return telling_lines(log, summarize(log, RunInfo(**told)))


def test_tells_a_recovery_from_the_push_to_the_end():
    """Oracle: the recipe; a push to the left in a left swing is outward."""
    log = make_log(Recipe())
    lines = story(log, delta_v=0.6, direction_deg=90.0, cpu_time=3.784)
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


def test_tells_what_was_switched_in_the_tab():
    """Oracle: the rows in which the made-up signal changes."""
    log = make_log(Recipe())
    on = np.zeros((len(log["t"]), 4))
    on[500:900, [0, 3]] = 1.0
    lines = story({**log, "mechanisms": on})
    assert lines[0] == "t=1.00 s  switched in the tab, now on: step, cross_over"
    assert lines[1] == "t=1.80 s  switched in the tab, now on: nothing"


def test_tells_a_fall_at_its_time():
    lines = story(cut(make_log(), 1000), fell_at=1.998, fall_reason="too low")
    assert lines[-1].startswith("t=2.00 s  FELL: too low   max ICP error")


def test_tells_an_early_end_that_is_no_fall():
    """Oracle: the time of the last row."""
    lines = story(cut(make_log(), 1000), error="brain: input port 'icp': NaN")
    told = "t=2.00 s  STOPPED: brain: input port 'icp': NaN   max ICP error"
    assert lines[-1].startswith(told)


def test_tells_who_was_not_pushed():
    line = story(cut(make_log(), 900), missed_pushes=1)[-1]
    told = "t=1.80 s  NOT PUSHED: the push did not come before the end   max"
    assert line.startswith(told)


def test_tells_a_joint_that_was_too_fast():
    log = make_log()
    log["state"][700, -1] = 33.33
    line = story(log)[-1]
    told = "TOO FAST: a joint at 33.33 rad/s, limit 20 rad/s   max ICP error"
    assert told in line


def test_tells_with_what_reservation_she_recovered():
    line = story(make_log(), required_steps=3, wanted_steps=8)[-1]
    told = "t=2.77 s  RECOVERED in 2 steps (the run is too short for 8 more "
    assert line.startswith(f"{told}steps, 3 were required)   max ICP error")


def test_tells_when_a_push_was_decided_on():
    """Oracle: the last tick of a transfer; it is felt in the first swing's."""
    log = make_log(Recipe(pushed_step=None, changed={}))
    force = np.zeros_like(log["push_force"])
    swing = round((0.5 + 0.3 + 0.7 + 0.3) / T)
    force[swing : swing + 50, 1] = 100.0
    line = story({**log, "push_force": force})[0]
    assert "push left, left transfer 99 %" in line


def test_tells_a_walk_without_a_push():
    recipe = Recipe(num_steps=3, pushed_step=None, changed={})
    (line,) = story(make_log(recipe))
    assert line.startswith("t=5.30 s  WALKED 3 steps   max ICP error 0.000 m")


def test_tells_a_stand():
    (line,) = story(cut(make_log(), 200))
    assert line.startswith("t=0.40 s  STOOD")


def test_a_point_mass_has_no_torques_to_tell():
    line = story(without_robot(make_log()), plant="lipm")[-1]
    assert "RECOVERED" in line
    assert "torque" not in line


def test_tells_the_first_of_what_went_wrong():
    line = story(make_log(), required_steps=8)[-1]
    assert "FEWER THAN 8 STEPS AFTER THE PUSH" in line


def test_tells_nothing_of_an_empty_log_but_its_end():
    assert story(cut(make_log(), 0), interrupted=True) == [
        "t=0.00 s  INTERRUPTED"
    ]


@pytest.mark.parametrize(
    ("degrees", "word"),
    [
        (0.0, "forward"),
        (180.0, "backward"),
        (-180.0, "backward"),
        (90.0, "outward"),
        (-90.0, "inward"),
        (270.0, "inward"),
        (30.0, "at 30 deg"),
    ],
)
def test_names_directions_as_seen_from_the_stance_foot(degrees, word):
    """Oracle: in a left swing the stance foot is at the right, at -90 deg.

    The whole scene is turned by 1 rad: names must not change.
    """
    log = make_log(Recipe())
    force, signal = log["push_force"].copy(), log["walking_signal"].copy()
    angle = np.radians(degrees) + 1.0
    size = np.linalg.norm(force, axis=1)
    force[:, 0], force[:, 1] = size * np.cos(angle), size * np.sin(angle)
    signal[:, [8, 11]] = 1.0
    log = {**log, "push_force": force, "walking_signal": signal}
    assert direction(log, pushes(log)[0]) == word


@pytest.mark.parametrize(("side", "column"), [(Side.LEFT, 1), (Side.RIGHT, -1)])
def test_names_left_and_right_while_both_feet_carry(side, column):
    log = make_log(Recipe())
    force = np.zeros_like(log["push_force"])
    force[100:150, 1] = 100.0 * column
    log = {**log, "push_force": force}
    assert direction(log, pushes(log)[0]) == side.value
    assert "standing" in story(log)[0]
