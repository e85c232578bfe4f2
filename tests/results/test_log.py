"""Phases, steps and pushes are found in a log whose recipe is known."""

import numpy as np
import pytest

from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.results.log import (
    phase_spans,
    pushes,
    signal_view,
    sole_pose,
    steps,
)
from nadia_balance.systems.signals import WalkingSignal
from tests.results.made_up_run import HALF_WIDTH, MASS, Recipe, T, make_log


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
    right_swing = spans[2]
    assert right_swing.swing_side is Side.RIGHT
    assert [right_swing.carries(side) for side in Side] == [True, False]
    assert all(spans[1].carries(side) for side in Side)


def test_a_step_knows_what_was_commanded_adjusted_and_achieved():
    """Oracle: the recipe: step 2 (left) is moved by (0.12, 0.2) m."""
    recipe = Recipe(num_steps=3, length=0.3)
    log = make_log(recipe)
    second = steps(log)[1]
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
    start = sole_pose(log, 0, Side.RIGHT)
    assert start.p_WF == pytest.approx([0.0, -HALF_WIDTH, 0.0])


def test_a_transfer_that_was_to_stand_has_a_step_of_its_swing():
    """Oracle: by hand: the target is NaN until a step was asked for."""
    log = dict(make_log(Recipe(num_steps=2, length=0.3)))
    expected = steps(log)[0].commanded
    spans, walking = phase_spans(log), log["walking_signal"].copy()
    log["walking_signal"] = walking
    column = WalkingSignal.get_fields().index("target_x")
    walking[spans[1].first, column : column + 3] = np.nan
    assert steps(log)[0].commanded == expected


def test_finds_each_push_with_its_own_size():
    """Oracle: the recipe, 0.1 s from 25 % of the swing that began at 1.8 s.

    A second push, put in by hand, follows at once.
    """
    log = make_log(Recipe(delta_v=0.4))
    (first,) = pushes(log)
    assert first.start == pytest.approx(1.8 + 0.25 * 0.7, abs=1.01 * T)
    assert first.end - first.start == pytest.approx(0.1)
    assert first.force == pytest.approx([0.0, MASS * 0.4 / 0.1, 0.0])
    push = signal_view(log, "push_signal")
    acts = np.flatnonzero(push.number)
    later = acts + len(acts)
    push.number[later], push.delta_v[later] = 2.0, 0.15
    push.force_x[later] = 136.0
    again, second = pushes(log)
    assert (again.start, again.delta_v) == (first.start, 0.4)
    assert second.start == pytest.approx(first.end)
    assert second.delta_v == 0.15
    assert second.force == pytest.approx([136.0, 0.0, 0.0])
