"""Phases, steps and pushes are found in a log whose recipe is known."""

import numpy as np
import pytest

from diagrams.run_log import icp_error, phase_spans, pushes, sole_pose, steps
from nadia_balance.core.walking import Phase, Side
from tests.diagrams.made_up_run import (
    HALF_WIDTH,
    MASS,
    Recipe,
    T,
    cut,
    make_log,
)


def test_finds_every_phase_with_its_true_times():
    """Oracle: the recipe, by hand; every boundary to the tick."""
    spans = phase_spans(make_log(Recipe(num_steps=2, pushed_step=None)))
    kinds = [span.phase.value for span in spans]
    assert kinds == [
        *("standing", "transfer", "swing", "transfer", "swing"),
        *("transfer", "standing"),
    ]
    # Step 2 is a changed one: it swings for 0.43 s instead of 0.7 s.
    starts = [0.0, 0.5, 0.8, 1.5, 1.8, 2.23, 3.03]
    assert [span.start for span in spans] == pytest.approx(starts)
    assert [span.complete for span in spans] == [True] * 6 + [False]
    assert [span.planned for span in spans[1:6]] == [0.3, 0.7, 0.3, 0.7, 0.8]


def test_a_phase_that_the_log_cuts_off_is_not_complete():
    log = cut(make_log(Recipe(num_steps=2)), round(1.0 / T))
    assert [s.complete for s in phase_spans(log)] == [True, True, False]
    assert steps(log) == []


def test_knows_which_feet_carry():
    spans = phase_spans(make_log(Recipe(num_steps=1, pushed_step=None)))
    carriers = [
        tuple(side.value for side in Side if span.carries(side))
        for span in spans
    ]
    both = ("left", "right")
    assert carriers == [both, both, ("left",), both, both]


def test_a_step_knows_what_was_commanded_adjusted_and_achieved():
    """Oracle: the recipe: step 2 (left) is moved by (0.12, 0.2) m."""
    recipe = Recipe(num_steps=3, length=0.3)
    second = steps(make_log(recipe))[1]
    assert second.side is Side.LEFT
    assert second.number == 2
    nominal = np.array([0.6, HALF_WIDTH, 0.0])
    assert second.commanded.p_WF == pytest.approx(nominal)
    assert second.adjustment == pytest.approx([0.12, 0.2])
    landed = nominal + [0.12 + recipe.miss, 0.2, 0.0]
    assert second.achieved.p_WF == pytest.approx(landed)
    assert second.error == pytest.approx(recipe.miss)
    assert second.swing.duration == pytest.approx(0.43)
    assert second.transfer.phase is Phase.TRANSFER


def test_finds_the_push():
    """Oracle: the recipe: 0.1 s, from 25 % of the swing that began at 1.8 s."""
    (push,) = pushes(make_log(Recipe(delta_v=0.4)))
    assert push.start == pytest.approx(1.8 + 0.25 * 0.7, abs=1.01 * T)
    assert push.end - push.start == pytest.approx(0.1)
    assert push.force == pytest.approx([0.0, MASS * 0.4 / 0.1, 0.0])


def test_a_run_without_a_push_has_none():
    assert pushes(make_log(Recipe(pushed_step=None))) == []


def test_icp_error_is_the_distance_from_the_reference():
    log = make_log(Recipe())
    dx, dy = (log["icp"] - log["icp_reference"][:, :2]).T
    assert icp_error(log) == pytest.approx(np.hypot(dx, dy))


def test_sole_pose_is_that_of_the_schedule():
    log = make_log(Recipe(length=0.3))
    pose = sole_pose(log, 0, Side.RIGHT)
    assert pose.p_WF == pytest.approx([0.0, -HALF_WIDTH, 0.0])


def test_an_empty_log_has_no_phases():
    log = cut(make_log(), 0)
    assert (phase_spans(log), steps(log), pushes(log)) == ([], [], [])
